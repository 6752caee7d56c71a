"""Chunks on several machines by dask: the one room that imports dask and distributed, and only when it is used."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from models.fleet.executor import ClusterExecutor
    from models.work.task import FileStore

_NEEDED = ("distributed", "cryptography")


def open_executor(address: str, workers: int, store: FileStore, tell: Callable[[str], None]) -> ClusterExecutor:
    """Return an executor of chunks on a cluster whose workers were compared with this program.

    Args:
        address: ``tcp://HOST:PORT`` on this machine, ``tls://HOST:PORT``, or "local" for processes of this machine.
        workers: at least so many are waited for; 0 is one, or for "local" one per core.
        store: of the chunks, which all workers reach.
        tell: called with lines for people: workers that are waited for or refused, a scheduler that was lost.

    Raises:
        WrongInputError: a wrong address, a missing package or certificate, or workers that are refused.
        ClusterError: no scheduler answers, or too few workers come.
        ValueError: if workers is negative.
    """
    if workers < 0:
        raise ValueError(f"workers must not be negative, got {workers!r}")
    if missing := [name for name in _NEEDED if importlib.util.find_spec(name) is None]:
        raise WrongInputError(
            f'--cluster needs dask: pip install "spallwatch[cluster]" ({" and ".join(missing)} missing)'
        )
    from models.fleet.connect import Local, Remote
    from models.fleet.executor import ClusterExecutor

    cluster = Local(workers) if address == "local" else Remote(address, workers)
    return ClusterExecutor(cluster, store, tell)

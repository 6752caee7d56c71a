"""Loaded by dask in each worker of a local cluster (its ``preload``)."""

from __future__ import annotations

import signal


def dask_setup(_worker: object) -> None:
    """Ignore Ctrl-C: it reaches all processes of a terminal, and the command ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

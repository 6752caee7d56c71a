"""The child process that publishes; only it loads xarray and netCDF. One JSON answer for each line of input."""

from __future__ import annotations

import fcntl
import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

from monitor.records.database import StoreError
from monitor.records.store import Published, Store

_LOCK = "publisher.lock"


def main() -> None:
    """Answer each line of standard input until it ends; the arguments are the store and the folder of the files."""
    store, records_dir = Path(sys.argv[1]), Path(sys.argv[2])
    # The thread that commits has priority.
    os.nice(5)
    lock = os.open(store.with_name(_LOCK), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    # The publisher of a daemon that was killed may still be writing, under the same temporary names.
    fcntl.flock(lock, fcntl.LOCK_EX)
    # A broken pipe means that the daemon has ended.
    with suppress(BrokenPipeError):
        serve(sys.stdin, sys.stdout, store, records_dir)
    # The orderly end of an interpreter with these libraries costs a tenth of a second.
    os._exit(0)


def serve(requests: TextIO, answers: TextIO, store: Path, records_dir: Path) -> None:
    """Publish once for each line of ``requests``, and answer with a JSON object.

    Its keys are ``published`` (a list of :class:`Published`), ``problem`` (or null) and ``seconds``.
    """
    for _ in requests:
        answers.write(json.dumps(_publish(store, records_dir)) + "\n")
        answers.flush()


def _publish(path: Path, records_dir: Path) -> dict[str, Any]:
    from monitor.records.publish import PublishError, publish

    began = time.monotonic()
    written: list[Published] = []
    problem = None
    try:
        with Store.open(path, create=False, read_only=True) as store:
            publish(store, records_dir, note=written.append)
    except (PublishError, StoreError) as error:
        problem = str(error)
    return {"published": written, "problem": problem, "seconds": time.monotonic() - began}

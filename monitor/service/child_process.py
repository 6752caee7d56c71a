"""Child processes of the daemon: started with its own modules, heard without waiting, ended with it."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys

_KILLED_WITHIN = 0.5
# A service manager signals all processes at once; a child goes on until its parent lets go of it.
_START = """
import signal, sys
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_IGN)
import importlib, json
sys.path[:] = json.loads(sys.argv.pop())
module, _, function = sys.argv.pop(1).partition(":")
getattr(importlib.import_module(module), function)()
"""

Child = subprocess.Popen[bytes]


def start_child(entry: str, *arguments: str) -> Child:
    """Start a child whose standard input and output are pipes.

    Args:
        entry: the function that it runs, ``module:function``.
        arguments: what it finds in ``sys.argv[1:]``.

    Raises:
        OSError: it cannot be started.
    """
    command = [sys.executable, "-c", _START, entry, *arguments, json.dumps(sys.path)]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert child.stdout is not None
    os.set_blocking(child.stdout.fileno(), False)
    return child


def hear(child: Child, timeout: float, most: int) -> bytes | None:
    """Return what a child has said, ``b""`` where it has ended, None where it says nothing within so many seconds."""
    assert child.stdout is not None
    if not select.select([child.stdout], [], [], max(timeout, 0.0))[0]:
        return None
    return os.read(child.stdout.fileno(), most)


def let_go(child: Child) -> None:
    """Close the pipes of a child, which ends when it has finished what it is doing."""
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()


def end_child(child: Child) -> None:
    """Let go of a child and make sure, within a second, that it ends.

    One that hangs in a dead network share cannot even be killed; it is left behind.
    """
    let_go(child)
    try:
        child.wait(_KILLED_WITHIN)
    except subprocess.TimeoutExpired:
        child.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(_KILLED_WITHIN)

"""Child processes of the daemon: start, read without waiting, end."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys

_END_S = 0.5
# A service manager signals all processes at once; a child goes on until its parent closes its standard input.
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
    """Start a child with pipes that runs the function ``module:function`` with ``sys.argv[1:]``; may raise OSError."""
    command = [sys.executable, "-c", _START, entry, *arguments, json.dumps(sys.path)]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert child.stdout is not None
    os.set_blocking(child.stdout.fileno(), False)
    return child


def read_output(child: Child, timeout: float, max_bytes: int) -> bytes | None:
    """Return new output of a child, ``b""`` if it has ended, None if nothing comes within the timeout (s)."""
    assert child.stdout is not None
    if not select.select([child.stdout], [], [], max(timeout, 0.0))[0]:
        return None
    return os.read(child.stdout.fileno(), max_bytes)


def close_pipes(child: Child) -> None:
    """Close the pipes of a child, which ends after its present task."""
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()


def end_child(child: Child) -> None:
    """Close the pipes of a child and kill it if it does not end, within a second.

    A child that hangs in an unreachable network share cannot be killed; it is left behind.
    """
    close_pipes(child)
    try:
        child.wait(_END_S)
    except subprocess.TimeoutExpired:
        child.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(_END_S)

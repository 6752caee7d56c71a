"""Signals of processes: requests to end as interruptions, children that end with their parent.

What only POSIX has is used where it is there, as in ``models.platform.portable``.

Where this program is installed, for the processes that it starts.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

# Types are those of one system; what another lacks is looked up.
_signal: Any = signal
_AGAIN_S = 0.2
_DROPPED_S = 0.01


def on_signals(numbers: Iterable[signal.Signals], function: Callable[[], Any]) -> None:
    """Call a function in the running event loop when a signal comes."""
    import asyncio

    loop = asyncio.get_running_loop()

    def wake(*_: object) -> None:
        loop.call_soon_threadsafe(function)

    for number in numbers:
        try:
            loop.add_signal_handler(number, function)
        except NotImplementedError:
            signal.signal(number, wake)


@contextmanager
def ended_as_interrupted() -> Generator[None]:
    """Raise KeyboardInterrupt for requests to end too (SIGTERM, and SIGHUP of a terminal that is closed).

    In the main thread; a signal that is ignored or handled stays so.
    """
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    if threading.current_thread() is not threading.main_thread():
        numbers = []
    taken = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def interrupts_kept() -> Generator[None]:
    """Raise KeyboardInterrupt again where Python drops it with a message: in callbacks, as of imports and compilers.

    In the main thread; other exceptions that are dropped are reported as before.
    """
    before = sys.unraisablehook

    def again() -> None:
        time.sleep(_DROPPED_S)
        for number in (signal.SIGINT, signal.SIGTERM):
            # One that is ignored, or ends the process, was not what came.
            if callable(signal.getsignal(number)):
                _interrupt_main(number)
                return

    def hook(dropped: Any) -> None:
        if issubclass(dropped.exc_type, KeyboardInterrupt):
            # By another thread: here it would be dropped again.
            threading.Thread(target=again, name="interrupt", daemon=True).start()
        else:
            before(dropped)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


@contextmanager
def interrupt_held() -> Generator[None]:
    """Hold Ctrl-C back from the processes that this thread starts, until they call :func:`ended_by_parent`."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # Its start would let the signal through again.
    resource_tracker.ensure_running()
    mask: Any = _signal.pthread_sigmask(_signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        _signal.pthread_sigmask(_signal.SIG_SETMASK, mask)


def _interrupt_main(number: signal.Signals) -> None:
    if hasattr(signal, "pthread_kill"):
        # What it waits for is left at once.
        _signal.pthread_kill(threading.main_thread().ident, number)
    else:
        _thread.interrupt_main(number)


@contextmanager
def ended_by_parent(grace_s: float) -> Generator[None]:
    """Leave the block quietly, cleaning up, when the parent of this process ends it (SIGTERM) or is gone.

    Ctrl-C reaches all processes of a terminal and is ignored: the parent decides. What has not cleaned up ``grace_s``
    after the parent was lost is ended without. Of a process that ``multiprocessing`` has spawned, in its main thread.
    """
    import multiprocessing

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        _signal.pthread_sigmask(_signal.SIG_UNBLOCK, {signal.SIGINT})
    left, told = threading.Event(), threading.Event()

    def interrupt(*_: object) -> None:
        # Once: what cleans up is not interrupted.
        if not told.is_set():
            told.set()
            raise KeyboardInterrupt

    def watch() -> None:
        if (parent := multiprocessing.parent_process()) is None:
            return
        parent.join()
        until = time.monotonic() + grace_s
        while not left.is_set():
            if time.monotonic() > until:
                os._exit(1)
            # Again: the first one may come just before the main thread begins to wait for something.
            _interrupt_main(signal.SIGTERM)
            left.wait(_AGAIN_S)

    signal.signal(signal.SIGTERM, interrupt)
    threading.Thread(target=watch, name="parent", daemon=True).start()
    try:
        with suppress(KeyboardInterrupt):
            yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        left.set()


@contextmanager
def sigpipe_kept() -> Generator[None]:
    """Let no call of a foreign library change what a broken pipe does, by default an error where one writes to it.

    In every thread, where ``signal.signal`` does not work.
    """
    number = getattr(signal, "SIGPIPE", None)
    if number is None:
        yield
        return
    import ctypes

    handle = ctypes.CDLL(None).signal
    handle.argtypes, handle.restype = (ctypes.c_int, ctypes.c_void_p), ctypes.c_void_p
    # The C library tells a handler only when another one takes its place.
    before = handle(number, int(signal.SIG_IGN))
    handle(number, before)
    try:
        yield
    finally:
        handle(number, before)


ROOT = Path(__file__).resolve().parents[2]
"""The folder that holds the packages of this program."""


def child_path() -> list[str]:
    """Return ``sys.path`` for a process that imports this program: its own folder first.

    The folder of a script or the working directory, which is first in the parent, may hold packages of our names.
    """
    own = str(ROOT)
    return [own, *(place for place in sys.path if place != own)]

"""How kernels are compiled: cached on disk where that is possible, compiled anew in each process where it is not."""

from __future__ import annotations

import hashlib
import logging
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import config
from numba.core import event as events
from numba.core.event import Event, Listener

from models.platform.kernel_cache import KernelCache, fingerprint
from models.platform.kernel_code import NUMBERS, KernelCompiler, Pasted

_log = logging.getLogger(__name__)

# An integer of a kernel. To numba a literal argument is a type of its own, for which the function is compiled once
# more; constants are therefore passed as np.int64.
Index = int | np.int64

_F = TypeVar("_F", bound=Callable[..., Any])
_defined: Counter[str] = Counter()

# Sums may be reordered (so that loops over balls use vector instructions) and products fused; NaN and infinity keep
# their meaning, because a diverged state must be seen. No kernel is called from C.
_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "fastmath": {"reassoc", "contract", "nsz", "arcp"},
    "no_cfunc_wrapper": True,
}


def kernel(function: _F) -> _F:
    """Compile a function of plain floats and arrays in nopython mode, without the interpreter lock.

    Kernels that call it share its one machine code. Where no folder can be written it compiles without a cache.
    """
    # A kernel that is first called by a function to paste would be taken for one, and given another name.
    compiled: Any = numba.njit(pipeline_class=KernelCompiler, forceinline=False, **_OPTIONS)(function)
    if compiled is not function:
        NUMBERS[function] = _number(function)
        try:
            compiled._cache = KernelCache(function)
        except OSError as error:
            _say_once(f"kernels are compiled anew in each process: {error}")
    return cast("_F", compiled)


def _number(function: Callable[..., Any]) -> int:
    """Return one that functions of the same name share only where they are of the same text, in different processes."""
    text = f"{function.__module__}.{function.__qualname__} {fingerprint(Path(function.__code__.co_filename))}"
    _defined[text] += 1
    return int(hashlib.sha256(f"{text} {_defined[text]}".encode()).hexdigest()[:12], 16)


@cache
def _say_once(sentence: str) -> None:
    _log.warning("%s", sentence)


def inlined(function: _F) -> _F:
    """Compile a function that LLVM pastes into every kernel that calls it.

    A call with arrays costs more than a small kernel's body: ball_period is three times as fast with its parts inlined.
    Numba's own pasting (inline="always") gives the same code but types and lowers every copy anew, which costs most.
    """
    return function if cast("Any", config).DISABLE_JIT else cast("_F", Pasted(function, _OPTIONS))


@contextmanager
def compiling() -> Generator[dict[str, float]]:
    """Give a dictionary that is filled with what is compiled meanwhile: seconds (of the core) by name of function.

    They leave out the functions that one calls, and what the cache holds. Only this thread's calls may compile.
    """
    listener = _Stopwatch()
    with cast("Any", events).install_listener("numba:compile", listener):
        yield listener.seconds


class _Stopwatch(Listener):
    """Adds up the time between the events of numba's compiler, which nest."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        # Of each function that is being compiled: when it was begun, and the seconds of those that it calls.
        self._open: list[tuple[float, float]] = []

    def on_start(self, event: Event) -> None:
        self._open.append((time.thread_time(), 0.0))

    def on_end(self, event: Event) -> None:
        function: Any = cast("Any", event).data["dispatcher"].py_func
        name = f"{function.__module__.rpartition('.')[2]}.{function.__name__}"
        began, called = self._open.pop()
        took = time.thread_time() - began
        self.seconds[name] = self.seconds.get(name, 0.0) + took - called
        if self._open:
            outer_began, outer_called = self._open.pop()
            self._open.append((outer_began, outer_called + took))

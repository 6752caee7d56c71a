"""How kernels are compiled: cached on disk where that is possible, compiled anew in each process where it is not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_F = TypeVar("_F", bound=Callable[..., Any])

# Sums may be reordered (so that loops over balls use vector instructions) and products fused; NaN and infinity keep
# their meaning, because a diverged state must be seen.
_FASTMATH = {"reassoc", "contract", "nsz", "arcp"}


def kernel(function: _F) -> _F:
    """Compile a function of plain floats and arrays in nopython mode, without the interpreter lock.

    A read-only package without a writable home has no place for numba's cache; then it compiles without one.
    """
    try:
        compiled = numba.njit(cache=True, nogil=True, fastmath=_FASTMATH)(function)
    except RuntimeError:
        compiled = numba.njit(cache=False, nogil=True, fastmath=_FASTMATH)(function)
    return cast("_F", compiled)


def inlined(function: _F) -> _F:
    """Compile a function that is pasted into every kernel that calls it.

    A call with arrays costs more than a small kernel's body: ball_period is three times as fast with its parts inlined.
    """
    return cast("_F", numba.njit(nogil=True, fastmath=_FASTMATH, inline="always")(function))

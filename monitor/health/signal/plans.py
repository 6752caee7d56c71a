"""FFTW plans: fast lengths, reproducible planning.

pyFFTW is imported where it is called: it loads half of SciPy, which publisher, page and most commands never use.
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from types import ModuleType
from typing import Any, Literal, ParamSpec, TypeVar, cast

from numpy.typing import NDArray

_Asked = ParamSpec("_Asked")
_Made = TypeVar("_Made")
Precision = Literal["float32", "float64"]
Kind = Literal["real", "inverse", "synthesis"]
"""Real samples to half a spectrum, a spectrum to complex samples, half a spectrum to real samples."""


def load_fftw() -> Any:
    """Return pyFFTW, loaded if it was not: that takes longer than some ten analyses of a block.

    Where dask is installed, pyFFTW would load it, and pandas with it, for an interface that is not used here.
    """
    if "pyfftw" in sys.modules or "dask" in sys.modules:
        return import_module("pyfftw")
    sys.modules["dask"] = cast("ModuleType", None)
    try:
        return import_module("pyfftw")
    finally:
        del sys.modules["dask"]


def is_smooth(n: int) -> bool:
    """Return whether a positive length has no prime factor above 5."""
    for prime in (2, 3, 5):
        while n % prime == 0:
            n //= prime
    return n == 1


def previous_smooth(n: int) -> int:
    """Return the largest length up to ``n`` (at least 1) without a prime factor above 5."""
    while not is_smooth(n):
        n -= 1
    return n


def next_smooth(n: int) -> int:
    """Return the smallest length from ``n`` (at least 1) without a prime factor above 5."""
    while not is_smooth(n):
        n += 1
    return n


def envelope_length(n_bins: int, n_samples: int, oversampling: float) -> int:
    """Return a fast length for the analytic signal of ``n_bins`` bins, at most ``n_samples``.

    It is not divisible by 25: an envelope has no band limit, and where its length is a multiple of the number of
    impacts in the block, often a round number, all aliases fall on the lines of the impacts. Long ones are multiples of
    64, which FFTW transforms faster than their neighbours.
    """
    target = max(oversampling * n_bins, 16.0)
    step = 64 if target >= 4096 else 2
    factor = next_smooth(math.ceil(target / step))
    while factor % 25 == 0:
        factor = next_smooth(factor + 1)
    return min(step * factor, n_samples)


class FftPlan:
    """One FFTW plan; ``execute()`` transforms ``input`` into ``output``."""

    def __init__(
        self,
        n: int,
        kind: Kind,
        precision: Precision,
        *,
        source: NDArray[Any] | None = None,
        target: NDArray[Any] | None = None,
    ) -> None:
        """Plan a real forward, a complex inverse or a real inverse transform of ``n`` samples, not normalised.

        Args:
            n: samples.
            kind: of the transform.
            precision: of its arrays.
            source: aligned array whose beginning is the input, by default a new one.
            target: aligned array whose beginning is the output, by default a new one.
        """
        pyfftw = load_fftw()
        complex_type = "complex64" if precision == "float32" else "complex128"
        n_input, n_output = n // 2 + 1 if kind == "synthesis" else n, n // 2 + 1 if kind == "real" else n
        input_type = precision if kind == "real" else complex_type
        output_type = precision if kind == "synthesis" else complex_type
        self.input = pyfftw.zeros_aligned(n_input, input_type) if source is None else source[:n_input]
        self.output = pyfftw.zeros_aligned(n_output, output_type) if target is None else target[:n_output]
        direction = "FFTW_FORWARD" if kind == "real" else "FFTW_BACKWARD"
        plan = pyfftw.FFTW(self.input, self.output, direction=direction, flags=("FFTW_ESTIMATE",), threads=1)
        self.execute = plan.execute


_planner = threading.RLock()
"""FFTW's planner and its wisdom are shared by the process."""


@contextmanager
def planning() -> Generator[None]:
    """Hide what FFTW measured in this process from plans, so that their bits do not depend on it."""
    pyfftw = load_fftw()
    with _planner:
        wisdom = pyfftw.export_wisdom()
        pyfftw.forget_wisdom()
        try:
            yield
        finally:
            pyfftw.forget_wisdom()
            pyfftw.import_wisdom(wisdom)


def kept_by_thread(make: Callable[_Asked, _Made], most: int) -> Callable[_Asked, _Made]:
    """Return a function that makes each thing once for each thread, which keeps so many that it used last."""
    of_thread = threading.local()

    def kept(*args: _Asked.args, **options: _Asked.kwargs) -> _Made:
        found: Callable[_Asked, _Made] | None = getattr(of_thread, "kept", None)
        if found is None:
            found = of_thread.kept = cast("Callable[_Asked, _Made]", lru_cache(maxsize=most)(make))
        return found(*args, **options)

    return kept

"""Kernels keep their copies of the kernels that they call."""

from __future__ import annotations

import math
from typing import Any

import numba
import pytest

from models.kernels import jit, linkage

_SHARED = 3


def _caller(module: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a kernel that calls one which is too long, and called too often, to be pasted into it."""

    def called(x: float) -> float:
        for _ in range(3):
            x += math.sin(x) * math.cos(x) + math.atan2(x, math.exp(x)) + math.tan(x) ** 3 - math.erf(x) / math.log(x)
            x -= math.sinh(x) * math.cosh(x) + math.atan(x) * math.tanh(x) - math.gamma(x) + math.log1p(x) ** 5
        return x

    monkeypatch.setattr(called, "__module__", module)
    inner: Any = numba.njit(**jit._OPTIONS)(called)

    def calls(x: float) -> float:
        return inner(x) + inner(x + 1.0) + inner(x + 2.0) + inner(x + 3.0)

    monkeypatch.setattr(calls, "__module__", module)
    return numba.njit(**jit._OPTIONS)(calls)


@pytest.mark.parametrize("ours", [True, False])
def test_the_copies_of_a_kernel_are_its_own(monkeypatch: pytest.MonkeyPatch, *, ours: bool) -> None:
    """Elsewhere they are shared: if numba does without that one day, ours can go."""
    caller = _caller("models.kernels.jit" if ours else __name__, monkeypatch)
    caller.compile((numba.float64,))
    module = next(iter(caller.overloads.values())).library._final_module
    copies = [f for f in module.functions if "called" in f.name and not f.is_declaration]
    assert copies
    assert [int(f.linkage) == _SHARED for f in copies] == [not ours] * len(copies)


def test_it_takes_effect_once() -> None:
    library: Any = linkage.codegen.CPUCodeLibrary
    finalize = library._finalize_final_module
    linkage.keep_copies()
    assert library._finalize_final_module is finalize

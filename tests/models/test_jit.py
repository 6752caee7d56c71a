from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numba
import pytest

from models.kernels import jit


def test_without_a_place_for_the_cache_kernels_compile_without_one(monkeypatch: pytest.MonkeyPatch) -> None:
    real, asked = numba.njit, []

    def without_cache(**options: Any) -> Callable[..., Any]:
        asked.append(options["cache"])
        if options["cache"]:
            raise RuntimeError("cannot cache function: no locator available")
        return real(**options)

    monkeypatch.setattr(jit, "numba", SimpleNamespace(njit=without_cache))

    def double(x: float) -> float:
        return 2.0 * x

    assert jit.kernel(double)(4.0) == 8.0
    assert asked == [True, False]

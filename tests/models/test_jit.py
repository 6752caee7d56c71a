from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numba
import pytest

from models.kernels import jit, orbit
from models.kernels.orbit import settle


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


def test_the_fingerprint_follows_imports(tmp_path: Path) -> None:
    def prints(constant: str, other: str) -> str:
        jit._texts.cache_clear()
        (tmp_path / "outer.py").write_text("from models.kernels.middle import f\n")
        (tmp_path / "middle.py").write_text("from models.kernels.inner import C\nfrom models.kernels.outer import g\n")
        (tmp_path / "inner.py").write_text(f"C = {constant}\n")
        (tmp_path / "other.py").write_text(f"C = {other}\n")
        return jit.fingerprint(tmp_path / "outer.py")

    assert prints("1", "1") == prints("1", "2")
    assert prints("1", "1") != prints("2", "1")


def test_kernels_are_stamped_with_it() -> None:
    stamp = cast("Any", settle)._cache._cache_file._source_stamp
    assert stamp == jit.fingerprint(Path(orbit.__file__))


def test_compiling_is_timed_function_by_function_and_once() -> None:
    def inner(x: float) -> float:
        return x + 1.0

    first = jit.inlined(inner)

    def outer(x: float) -> float:
        return 2.0 * first(x)

    second = jit.inlined(outer)
    began = time.thread_time()
    with jit.compiling() as seconds:
        assert second(1.0) == 4.0
    took = time.thread_time() - began
    assert set(seconds) == {"test_jit.inner", "test_jit.outer"}
    assert 0.0 < sum(seconds.values()) <= took
    with jit.compiling() as seconds:
        assert second(2.0) == 6.0
    assert seconds == {}

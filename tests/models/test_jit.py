from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

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


@pytest.mark.parametrize("ours", [True, False])
def test_processes_that_save_at_once_are_not_given_the_code_of_another_signature(tmp_path: Path, *, ours: bool) -> None:
    """Both read the index before either has written it. If numba's own way is safe one day, ours can go."""
    first, second = (IndexDataCacheFile(str(tmp_path), "f-1.py311", "stamp") for _ in range(2))
    files: tuple[Any, Any] = first, second
    if ours:
        for file in files:
            file.save = partial(jit._save, file)
    write = files[0]._save_data

    def late(name: str, code: object) -> None:
        files[1].save("int64", "of int64")
        write(name, code)

    files[0]._save_data = late
    files[1]._load_index = dict
    files[0].save("float64", "of float64")
    read: Any = IndexDataCacheFile(str(tmp_path), "f-1.py311", "stamp")
    found = read.load("float64"), read.load("int64")
    # What is lost is compiled again.
    assert found == (("of float64", None) if ours else (None, "of float64"))


def test_code_of_an_earlier_text_is_removed(tmp_path: Path) -> None:
    for stamp in ("old", "new"):
        file: Any = IndexDataCacheFile(str(tmp_path), "f-1.py311", stamp)
        for key in ("float64", "int64"):
            jit._save(file, key, f"of {key}, {stamp}")
    assert [file.load(key) for key in ("float64", "int64")] == ["of float64, new", "of int64, new"]
    assert len(list(tmp_path.glob("*.nbc"))) == 2


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

from __future__ import annotations

import ast
import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

from models.platform import jit
from models.solve.six_dof.kernels import orbit
from models.solve.six_dof.kernels.orbit import settle


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
        (tmp_path / "model" / "kernels").mkdir(parents=True, exist_ok=True)
        (tmp_path / "model" / "kernel.py").write_text("from models.model.kernels.middle import f\n")
        (tmp_path / "model" / "kernels" / "middle.py").write_text(
            "from models.inner import C\nfrom models.model.kernel import g\n"
        )
        (tmp_path / "inner.py").write_text(f"C = {constant}\n")
        (tmp_path / "other.py").write_text(f"C = {other}\n")
        return jit.fingerprint(tmp_path / "model" / "kernel.py", tmp_path)

    assert prints("1", "1") == prints("1", "2")
    assert prints("1", "1") != prints("2", "1")


def test_kernels_are_stamped_with_it() -> None:
    stamp = cast("Any", settle)._cache._cache_file._source_stamp
    assert stamp == jit.fingerprint(Path(orbit.__file__))


def test_kernels_import_what_the_fingerprint_reads() -> None:
    """Constants and kernels by name from modules of kernels: of a module as a whole no text would be read."""
    root = Path(jit.__file__).parents[1]
    kernels = {path for path in root.rglob("*.py") if "kernel" in path.relative_to(root).as_posix()}
    assert len(kernels) > 20
    for path in kernels:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("models"):
                source = root.parent.joinpath(*str(node.module).split(".")).with_suffix(".py")
                assert source in kernels | {Path(jit.__file__)}, f"{path.name} imports {node.module}"
            elif isinstance(node, ast.Import):
                assert not any(name.name.startswith("models") for name in node.names), path.name


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


def test_an_index_of_types_that_are_gone_is_stale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba reads the types of a signature before it compares the stamp."""
    file: Any = IndexDataCacheFile(str(tmp_path), "f-1.py311", "old")
    monkeypatch.setattr(jit, "Gone", type("Gone", (), {"__module__": jit.__name__}), raising=False)
    jit._save(file, cast("Any", jit).Gone, "code")
    monkeypatch.delattr(jit, "Gone")
    later: Any = IndexDataCacheFile(str(tmp_path), "f-1.py311", "new")
    with pytest.raises(AttributeError, match="Gone"):
        later.load("int64")
    later._load_index = partial(jit._index, later, later._load_index)
    assert later.load("int64") is None
    jit._save(later, "int64", "of int64")
    assert later.load("int64") == "of int64"


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
    caller = _caller("models.platform.jit" if ours else __name__, monkeypatch)
    caller.compile((numba.float64,))
    module = next(iter(caller.overloads.values())).library._final_module
    copies = [f for f in module.functions if "called" in f.name and not f.is_declaration]
    assert copies
    assert [int(f.linkage) == jit._SHARED for f in copies] == [not ours] * len(copies)


def test_it_takes_effect_once() -> None:
    library: Any = jit.codegen.CPUCodeLibrary
    finalize = library._finalize_final_module
    jit.keep_copies()
    assert library._finalize_final_module is finalize

from __future__ import annotations

import ast
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import numba
import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile

from models.platform import jit, kernel_cache
from models.platform.kernel_code import called_kernels
from models.solve.six_dof.kernels import orbit
from models.solve.six_dof.kernels.orbit import settle
from models.solve.six_dof.kernels.period import fill_weights


def test_without_a_place_for_the_cache_kernels_compile_without_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(kernel_cache.config, "CACHE_DIR", str(tmp_path / "file"))

    def double(x: float) -> float:
        return 2.0 * x

    def half(x: float) -> float:
        return 0.5 * x

    assert jit.kernel(double)(4.0) == 8.0
    assert jit.kernel(half)(4.0) == 2.0
    assert [f"compiled anew in each process: {tmp_path / 'file'} cannot be written" in m for m in caplog.messages] == [
        True
    ]


def test_the_fingerprint_follows_imports(tmp_path: Path) -> None:
    def prints(constant: str, other: str) -> str:
        kernel_cache._texts.cache_clear()
        (tmp_path / "model" / "kernels").mkdir(parents=True, exist_ok=True)
        (tmp_path / "model" / "kernel.py").write_text("from models.model.kernels.middle import f\n")
        (tmp_path / "model" / "kernels" / "middle.py").write_text(
            "from models.inner import C\nfrom models.model.kernel import g\n"
        )
        (tmp_path / "inner.py").write_text(f"C = {constant}\n")
        (tmp_path / "other.py").write_text(f"C = {other}\n")
        return kernel_cache.fingerprint(tmp_path / "model" / "kernel.py", tmp_path)

    assert prints("1", "1") == prints("1", "2")
    assert prints("1", "1") != prints("2", "1")


def test_kernels_are_stamped_with_it() -> None:
    stamp = cast("Any", settle)._cache._cache_file._source_stamp
    assert stamp == kernel_cache.folder_of(Path(orbit.__file__)).name


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
            file.save = partial(kernel_cache.save, file)
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


def test_of_one_file_of_kernels_the_folders_used_last_are_kept(tmp_path: Path) -> None:
    for age in range(20):
        for name in ("period", "other"):
            old = tmp_path / f"kernels.{name}-{age:016}"
            old.mkdir()
            os.utime(old, (1e9 - age, 1e9 - age))
    kernel_cache.use(tmp_path / "kernels.period-new")
    kept = {path.name for path in tmp_path.glob("kernels.period-*")}
    assert kept == {"kernels.period-new", *(f"kernels.period-{age:016}" for age in range(15))}
    assert len(list(tmp_path.glob("kernels.other-*"))) == 20


def test_an_index_of_types_that_are_gone_is_stale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba reads the types of a signature before it compares the stamp."""
    file: Any = IndexDataCacheFile(str(tmp_path), "f-1.py311", "old")
    monkeypatch.setattr(jit, "Gone", type("Gone", (), {"__module__": jit.__name__}), raising=False)
    kernel_cache.save(file, cast("Any", jit).Gone, "code")
    monkeypatch.delattr(jit, "Gone")
    later: Any = IndexDataCacheFile(str(tmp_path), "f-1.py311", "new")
    with pytest.raises(AttributeError, match="Gone"):
        later.load("int64")
    later._load_index = partial(kernel_cache.load_index, later, later._load_index)
    assert later.load("int64") is None
    kernel_cache.save(later, "int64", "of int64")
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


def _caller(decorate: Callable[..., Any]) -> Any:
    """Return a kernel that calls one which is too long, and called too often, to be pasted into it."""

    def called(x: float) -> float:
        for _ in range(3):
            x = 0.1 * (math.sin(x) * math.cos(x) + math.atan2(x, math.exp(-x)) + math.tan(0.1 * x) ** 3 - math.erf(x))
            x = 0.1 * (math.sinh(x) * math.tanh(x) + math.atan(x) * math.cosh(x) - math.log1p(abs(x)) ** 5)
        return x

    inner = decorate(called)

    def calls(x: float) -> float:
        return inner(x) + inner(x + 1.0) + inner(x + 2.0) + inner(x + 3.0)

    return decorate(calls)


@pytest.mark.parametrize("ours", [True, False])
def test_the_machine_code_of_a_kernel_is_not_copied_into_its_callers(*, ours: bool) -> None:
    """If numba does without copies one day, ours can go."""
    caller = _caller(jit.kernel if ours else numba.njit(**jit._OPTIONS))
    assert caller(1.5) == pytest.approx(_caller(lambda function: function)(1.5), rel=1e-12)
    module = next(iter(caller.overloads.values())).library._final_module
    copies = [f for f in module.functions if "6called" in f.name]
    assert [f.is_declaration for f in copies if f.name.startswith("_ZN")] == [ours] * len(copies)


def test_what_is_pasted_has_no_machine_code_until_python_calls_it() -> None:
    def third(x: float) -> float:
        return x / 3.0

    pasted = jit.inlined(third)

    def calls(x: float) -> float:
        return pasted(x)

    assert jit.kernel(calls)(6.0) == 2.0
    code = next(iter(cast("Any", pasted).overloads.values())).library
    assert code.get_pointer_to_function(code.name) == 0
    assert pasted(9.0) == 3.0


_PARTS = ("jit", "kernel_cache", "kernel_code")
_RUN = """
from models.kernel_outer import outer
from models.kernel_inner import inner
print(outer(2.0), sum(outer.stats.cache_hits.values()), sum(inner.stats.cache_hits.values()))
"""


def _package(folder: Path, constant: str) -> Path:
    """Write a package of two kernels that call each other, with what compiles them."""
    (folder / "models" / "platform").mkdir(parents=True)
    for package in (folder / "models", folder / "models" / "platform"):
        (package / "__init__.py").write_text("")
    for name in _PARTS:
        shutil.copy(Path(jit.__file__).with_name(f"{name}.py"), folder / "models" / "platform")
    head = "from models.platform.jit import kernel\n"
    (folder / "models" / "kernel_constant.py").write_text(f"C = {constant}\n")
    inner = f"{head}from models.kernel_constant import C\n@kernel\ndef inner(x):\n    return C * x\n"
    (folder / "models" / "kernel_inner.py").write_text(inner)
    outer = f"{head}from models.kernel_inner import inner\n@kernel\ndef outer(x):\n    return 1.0 + inner(x)\n"
    (folder / "models" / "kernel_outer.py").write_text(outer)
    return folder


def _run(package: Path, compiled: Path) -> list[float]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(compiled), "PYTHONPATH": str(package)}
    command = [sys.executable, "-c", _RUN]
    found = subprocess.run(
        command, cwd=package, env=environment, check=True, capture_output=True, text=True, timeout=300
    )
    return [float(word) for word in found.stdout.split()]


@pytest.mark.process
def test_compiled_code_is_used_from_another_place_and_not_after_a_change(tmp_path: Path) -> None:
    compiled, first, second = tmp_path / "compiled", _package(tmp_path / "a", "3.0"), _package(tmp_path / "b", "3.0")
    assert _run(first, compiled) == [7.0, 0, 0]
    assert _run(second, compiled) == [7.0, 1, 1]
    # What one calls is compiled again where it was lost, under the same name.
    for lost in compiled.glob("models.kernel_inner-*/*"):
        lost.unlink()
    assert _run(second, compiled) == [7.0, 1, 0]
    assert _run(_package(tmp_path / "c", "4.0"), compiled) == [9.0, 0, 0]
    assert _run(first, compiled) == [7.0, 1, 1]


def test_code_that_calls_a_name_that_is_not_there_is_compiled_again() -> None:
    room = np.zeros(4)
    fill_weights(np.ones((1, 10)), np.array([0, 3]), room, np.zeros(3, dtype=np.bool_), True, room)
    result = next(iter(cast("Any", fill_weights).overloads.values()))
    cache: Any = cast("Any", fill_weights)._cache._impl
    kernel = next(iter(called_kernels(result.library)))
    (module, name, types), symbol = kernel.origin, kernel.symbol
    for called in (((module, name, types), f"{symbol}x"), ((module, "gone", types), symbol)):
        assert cache.rebuild(result.target_context, ((None, called), [], None)) is None

"""How kernels are compiled: cached on disk where that is possible, compiled anew in each process where it is not.

Numba's cache looks at the date and size of a kernel's own file: it misses changes of constants and parts that are
imported, and of files that are installed with a fixed date. What is cached here carries a stamp of all their texts.
"""

from __future__ import annotations

import glob
import hashlib
import logging
import re
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import codegen
from numba.core import event as events
from numba.core.event import Event, Listener

_log = logging.getLogger(__name__)

# An integer of a kernel. To numba a literal argument is a type of its own, for which the function is compiled once
# more; constants are therefore passed as np.int64.
Index = int | np.int64

_F = TypeVar("_F", bound=Callable[..., Any])

# Sums may be reordered (so that loops over balls use vector instructions) and products fused; NaN and infinity keep
# their meaning, because a diverged state must be seen. No kernel is called from C.
_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "fastmath": {"reassoc", "contract", "nsz", "arcp"},
    "no_cfunc_wrapper": True,
}
_IMPORT = re.compile(r"^ *from models\.([\w.]+) import", re.MULTILINE)
_MODELS = Path(__file__).resolve().parents[1]

# Of llvmlite.binding.Linkage.
_SHARED = 3
_OURS = ("_ZN6models", "_ZN7cpython6models")


def kernel(function: _F) -> _F:
    """Compile a function of plain floats and arrays in nopython mode, without the interpreter lock.

    A read-only package without a writable home has no place for numba's cache; then it compiles without one.
    """
    try:
        compiled = numba.njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:
        compiled = numba.njit(cache=False, **_OPTIONS)(function)
    else:
        _stamp(compiled, function)
    return cast("_F", compiled)


def inlined(function: _F) -> _F:
    """Compile a function that LLVM pastes into every kernel that calls it.

    A call with arrays costs more than a small kernel's body: ball_period is three times as fast with its parts inlined.
    Numba's own pasting (inline="always") gives the same code but types and lowers every copy anew, which costs most.
    """
    return cast("_F", numba.njit(forceinline=True, **_OPTIONS)(function))


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


def _stamp(compiled: Any, function: Callable[..., Any]) -> None:
    """Make the cache of a kernel stale when any file that it depends on has changed, and safe to write at once.

    Where a version of numba keeps the stamp elsewhere, its own stamp and way of saving remain.
    """
    file: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if hasattr(file, "_source_stamp"):
        file._source_stamp = fingerprint(Path(function.__code__.co_filename))
        file.save = partial(_save, file)
        file._load_index = partial(_index, file, file._load_index)


def _index(file: Any, load: Callable[[], dict[Any, str]]) -> dict[Any, str]:
    """Return the index of a kernel, empty where it names types that are no longer there: then it is of another text."""
    try:
        return load()
    except (AttributeError, ImportError) as error:
        _log.debug("the index %s is left: %s", file._index_path, error)
        return {}


def _save(file: Any, key: object, code: object) -> None:
    """Keep the code for one signature, under a name that no other signature and no other text of the kernel has.

    Numba counts names up from what its index holds. Two processes that save different signatures at the same time take
    the same name, and one of them is given the machine code of the other from then on: it runs, and computes something
    else. With names of their own the worst that can happen is that an entry of the index is lost and compiled again.
    """
    kept = file._load_index()
    index = Path(file._index_path)
    if not kept:
        for stale in index.parent.glob(f"{glob.escape(index.stem)}.*.nbc"):
            stale.unlink(missing_ok=True)
    digest = hashlib.sha256(file._source_stamp.encode() + file._dump(key)).hexdigest()
    name = f"{index.stem}.{digest[:16]}.nbc"
    file._save_data(name, code)
    file._save_index({**kept, key: name})


def fingerprint(source: Path, models: Path = _MODELS) -> str:
    """Return a digest of the texts of a file of kernels and of all files of the package ``models`` that it imports."""
    digest = hashlib.sha256()
    for text in _texts(source, models):
        digest.update(text)
    return digest.hexdigest()


@cache
def _texts(source: Path, models: Path) -> tuple[bytes, ...]:
    """Return the texts of a file and of those that it imports, each once, in a fixed order."""
    pending, seen = [source], {source: b""}
    while pending:
        path = pending.pop()
        try:
            seen[path] = path.read_bytes()
        except OSError:
            continue
        for name in _IMPORT.findall(seen[path].decode("utf-8", "replace")):
            imported = models.joinpath(*name.split(".")).with_suffix(".py")
            if imported not in seen:
                seen[imported] = b""
                pending.append(imported)
    return tuple(seen[path] for path in sorted(seen))


def keep_copies() -> None:
    """Give each kernel that is compiled from now on its own copies of those that it calls.

    The machine code of a kernel holds a copy of each kernel that it calls, under a name that all code of the process
    shares ("linkonce_odr"). Of several copies the first is used: that of the kernel on its own where this process
    compiled it, the caller's where both came from the cache. Each copy is optimised where it stands, so that their sums
    differ in the order of terms and the results in their last bits: a process that compiled would disagree with all
    later ones. With copies of its own a kernel computes as if it had come from the cache. Other code of the process is
    left as it is; where a version of numba compiles in another way, its own rule remains.
    """
    library: Any = getattr(codegen, "CPUCodeLibrary", None)
    finalize = getattr(library, "_finalize_final_module", None)
    if finalize is None or hasattr(finalize, "keeps_copies"):
        return

    def finalize_with_copies(self: Any) -> Any:
        make_private(self._final_module)
        return finalize(self)

    cast("Any", finalize_with_copies).keeps_copies = True
    library._finalize_final_module = finalize_with_copies


def make_private(module: Any) -> None:
    """Make the copies in a compiled module private, where a kernel of this project is in it."""
    functions = [function for function in module.functions if not function.is_declaration]
    if not any(function.name.startswith(_OURS) for function in functions):
        return
    for function in functions:
        if int(function.linkage) == _SHARED:
            function.linkage = "internal"


keep_copies()

"""The cache of kernels on disk: by the texts that a kernel is made of, wherever they are.

Numba's cache goes by the path of a kernel's own file and its text: it misses changes of constants and parts that are
imported, and another place or version of the package compiles all anew. Here the folder of a file of kernels has its
name from the texts of all files that it imports, and what compiles them.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportMissingTypeStubs=false, reportUnnecessaryComparison=false

from __future__ import annotations

import hashlib
import logging
import os
import re
import shutil
import sys
from collections.abc import Callable
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import llvmlite
import numba
from numba.core import caching, config
from platformdirs import user_cache_path

from models.platform.kernel_code import called_kernels

_log = logging.getLogger(__name__)

_IMPORT = re.compile(r"^ *from models\.([\w.]+) import", re.MULTILINE)
_MODELS = Path(__file__).resolve().parents[1]
# Folders kept of one file of kernels, those used last: of other versions and places of the package.
_KEPT = 16

_Caching: Any = caching


def fingerprint(source: Path, models: Path = _MODELS) -> str:
    """Return a digest of the texts of a file of kernels and of all files of the package ``models`` that it imports."""
    digest = hashlib.sha256()
    for name, text in _texts(source, models):
        digest.update(name.encode() + text)
    return digest.hexdigest()


@cache
def _texts(source: Path, models: Path) -> tuple[tuple[str, bytes], ...]:
    """Return the name within the package and the text of a file and of those that it imports, each once, in order."""
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
    return tuple(
        sorted(
            (path.relative_to(models).as_posix() if models in path.parents else path.name, seen[path]) for path in seen
        )
    )


def root() -> Path:
    """Return the folder of all machine code: the one that NUMBA_CACHE_DIR names, or one in the user's cache."""
    given: str = cast("Any", config).CACHE_DIR
    return Path(given) if given else user_cache_path("spallwatch") / "kernels"


def folder_of(source: Path) -> Path:
    """Return the folder of the machine code of a file of kernels."""
    made_by = f"{fingerprint(source)} {sys.version} {numba.__version__} {llvmlite.__version__}"
    return root() / f"{source.parent.name}.{source.stem}-{hashlib.sha256(made_by.encode()).hexdigest()[:16]}"


class _Locator(_Caching._CacheLocator):
    """Finds the folder of a kernel."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        self._py_file = file
        self._line = function.__code__.co_firstlineno
        self._folder = folder_of(Path(file))

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Locator:
        """Return it; raises OSError where the folder cannot be written."""
        locator = cls(py_func, py_file)
        use(locator._folder)
        return locator


@cache
def use(folder: Path) -> None:
    """Make a folder if it is not there, note that it is used, and remove those of the same file that are not.

    Raises:
        OSError: it cannot be written.
    """
    anew = not folder.is_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except OSError as error:
        raise OSError(f"{folder.parent} cannot be written: {error.strerror}") from error
    if anew:
        others = list(folder.parent.glob(f"{folder.name.rpartition('-')[0]}-*"))
        for stale in sorted(others, key=_used, reverse=True)[_KEPT:]:
            shutil.rmtree(stale, ignore_errors=True)


def _used(folder: Path) -> float:
    return folder.stat().st_mtime if folder.exists() else 0.0


class _Linked(_Caching.CompileResultCacheImpl):
    """Keeps the machine code of a kernel with the names of the kernels that it calls."""

    _locator_classes = (_Locator,)

    def check_cachable(self, data: Any) -> bool:
        """Return whether other processes find all that the kernel calls."""
        names = [kernel.origin[1] for kernel in called_kernels(data.library)]
        return all("." not in name for name in names) and super().check_cachable(data)

    def reduce(self, data: Any) -> tuple[Any, ...]:
        """Return what is written: the kernel and those that it calls, the names that it defines, and numba's data."""
        module = data.library._final_module
        kernels = [(each.origin, each.symbol) for each in (data.library, *called_kernels(data.library))]
        groups = (module.functions, module.global_variables)
        defined = [each.name for group in groups for each in group if not each.is_declaration]
        return kernels, defined, super().reduce(data)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the compiled kernel; None where a kernel that it calls has another name, so that it is of no use.

        Linked against a name that is not there, it would end the process.
        """
        (own, *called), defined, data = payload
        libraries = []
        for (module, name, types), symbol in called:
            kernel: Any = getattr(import_module(module), name, None)
            if kernel is None:
                return None
            kernel.compile(types)
            library = kernel.overloads[types].library
            if library.symbol != symbol:
                return None
            libraries.append(library)
        target_context.codegen()._engine._defined_symbols.update(defined)
        result = super().rebuild(target_context, data)
        # They live as long as it does.
        result.library._linking_libraries.extend(libraries)
        result.library.origin, result.library.symbol = own
        return result


class KernelCache(_Caching.FunctionCache):
    """The cache of one kernel.

    Raises:
        OSError: there is no folder that can be written.
    """

    _impl_class = _Linked

    def __init__(self, function: Callable[..., Any]) -> None:
        """Open it."""
        super().__init__(function)
        file: Any = self._cache_file
        file.save = partial(save, file)
        file._load_index = partial(load_index, file, file._load_index)


def load_index(file: Any, load: Callable[[], dict[Any, str]]) -> dict[Any, str]:
    """Return the index of a kernel, empty where it names types that are no longer there: then it is of another text."""
    try:
        return load()
    except (AttributeError, ImportError) as error:
        _log.debug("the index %s is left: %s", file._index_path, error)
        return {}


def save(file: Any, key: object, code: object) -> None:
    """Keep the code for one signature, under a name that no other signature of the kernel has.

    Numba counts names up from what its index holds. Two processes that save different signatures at the same time take
    the same name, and one of them is given the machine code of the other from then on: it runs, and computes something
    else. With names of their own the worst that can happen is that an entry of the index is lost and compiled again.
    """
    kept, index = file._load_index(), Path(file._index_path)
    digest = hashlib.sha256(file._source_stamp.encode() + file._dump(key)).hexdigest()
    name = f"{index.stem}.{digest[:16]}.nbc"
    file._save_data(name, code)
    file._save_index({**kept, key: name})

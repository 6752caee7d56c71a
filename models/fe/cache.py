"""Results of finite elements, kept between runs: one file an entry, named by all that determines its values.

An entry is an ``.npz`` of plain arrays with a JSON header, which repeats the key in full. It is written beside its
place and moved there, so that a reader, or another process that computes the same, sees a whole entry or none. What
cannot be read, or belongs to another key, is computed anew and reported.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from platformdirs import user_cache_dir

import models.fe

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_BYTES = 200_000_000
"""Size of all entries together, beyond which those that were not used for longest are deleted."""
_HEADER = "header"
_STALE_S = 86_400.0
"""Age from which an unfinished file is that of a process which was killed."""
_ENTRY = re.compile(r"[0-9a-f]{32}\.npz")
_UNFINISHED = re.compile(r"\.[a-z0-9_]{8}\.part")
"""Names of files that are ours: the folder may hold others."""
_UNREADABLE = (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True, eq=False)
class CacheEntry:
    """What is kept of a computation: arrays by name, and values that JSON can hold."""

    arrays: Mapping[str, NDArray[np.float64]] = field(default_factory=dict[str, "NDArray[np.float64]"])
    values: Mapping[str, Any] = field(default_factory=dict[str, Any])


def default_folder() -> Path:
    """Return the folder of the entries in the user's cache."""
    return Path(user_cache_dir("spallwatch")) / "fe"


@cache
def computation() -> str:
    """Return the version of the computation: a hash of the sources of ``models.fe``, so that none is forgotten."""
    digest = hashlib.sha256()
    folder = Path(models.fe.__path__[0])
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


class FeCache:
    """Entries in a folder of bounded size; with ``folder`` None nothing is kept and all is computed.

    ``report`` takes what a person should know: entries that were replaced, a folder that cannot be written.
    """

    def __init__(
        self,
        folder: Path | str | None,
        *,
        max_bytes: int = MAX_BYTES,
        report: Callable[[str], None] = lambda text: None,
    ) -> None:
        """Set the folder, which is made when the first entry is written."""
        self._folder = None if folder is None else Path(folder)
        self._max_bytes = max_bytes
        self._report = report
        self.found, self.made = 0, 0

    def path(self, key: Mapping[str, Any]) -> Path | None:
        """Return the file of a key, None where nothing is kept; ValueError if JSON cannot hold the key."""
        if self._folder is None:
            return None
        return self._folder / f"{hashlib.sha256(_text(key).encode()).hexdigest()[:32]}.npz"

    def get(self, key: Mapping[str, Any], make: Callable[[], CacheEntry]) -> CacheEntry:
        """Return the entry of a key, computed by ``make`` where there is none that can be used.

        Args:
            key: names and values of all that determines the result; the version of the computation is added.
            make: computes the entry; what it raises is raised, and nothing is kept.
        """
        path = self.path(key)
        entry = None if path is None else self._read(path, _text(key))
        if entry is not None:
            self.found += 1
            return entry
        entry = make()
        self.made += 1
        if path is not None:
            self._write(path, _text(key), entry)
        return entry

    def _read(self, path: Path, text: str) -> CacheEntry | None:
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
                header = json.loads(str(stored[_HEADER]))
                names: list[str] = header["arrays"]
                entry = CacheEntry(
                    {name: np.asarray(stored[f"_{name}"], np.float64) for name in names}, header["values"]
                )
                own = header["key"]
        except (FileNotFoundError, NotADirectoryError):
            return None
        except _UNREADABLE as error:
            self._report(f"{path}: cannot be read ({error or type(error).__name__}); computed anew")
            return None
        if own != text:
            self._report(f"{path}: belongs to another computation; computed anew")
            return None
        with suppress(OSError):
            os.utime(path)
        return entry

    def _write(self, path: Path, text: str, entry: CacheEntry) -> None:
        header = json.dumps({"key": text, "arrays": sorted(entry.arrays), "values": dict(entry.values)})
        # Names of arrays get a mark, so that none is the header.
        arrays = {f"_{name}": np.asarray(values, np.float64) for name, values in entry.arrays.items()}
        temporary: Path | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(prefix=".", suffix=".part", dir=path.parent)
            temporary = Path(name)
            with os.fdopen(handle, "wb") as stream:
                np.savez(stream, allow_pickle=False, **{_HEADER: np.array(header)}, **arrays)
            size = temporary.stat().st_size
            if size > self._max_bytes:
                return
            temporary.chmod(0o640)
            temporary.replace(path)
            self._evict(path, size)
        except OSError as error:
            self._report(f"{path.parent}: nothing is kept there ({error.strerror or error})")
        finally:
            if temporary is not None:
                with suppress(OSError):
                    temporary.unlink()

    def _evict(self, newest: Path, total: int) -> None:
        """Delete entries, those not used for longest first, until all fit; another process may delete them too.

        ``total`` is the size of the newest.
        """
        entries: list[tuple[float, int, Path]] = []
        for path in newest.parent.iterdir():
            with suppress(OSError):
                status = path.stat()
                if _ENTRY.fullmatch(path.name) and path != newest:
                    entries.append((status.st_mtime, status.st_size, path))
                elif _UNFINISHED.fullmatch(path.name) and status.st_mtime < time.time() - _STALE_S:
                    path.unlink()
        total += sum(size for _, size, _ in entries)
        for _, size, path in sorted(entries):
            if total <= self._max_bytes:
                break
            with suppress(OSError):
                path.unlink()
            total -= size


def _text(key: Mapping[str, Any]) -> str:
    """Return a key as text: equal for equal values, whatever their order."""
    return json.dumps({"computation": computation(), **key}, sort_keys=True, allow_nan=False)

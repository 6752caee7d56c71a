"""What must not be in the place of an archive: recordings, and results of another archive whose index is gone."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path

from models.work.task import FileStore
from monitor.fleet.index import INDEX_NAME, Index
from monitor.fleet.local import local_path, without_file_scheme
from monitor.fleet.manifest import TAKEN, WORK_NAME, ManifestError
from monitor.fleet.result import RESULT_NAME, RecordingResult

OWN = re.compile(r"(inputs|states)/[0-9a-f]{40}|records/[^/]+/[^/]+/([^/]+\.nc|result\.json)")
"""Files that an archive keeps in ``archive-work``."""
_LISTERS = 16
"""Machines that are listed at a time: object storage answers late."""


class Overlap:
    """Finds recordings among which an archive would be written."""

    def __init__(self, out: str, *, machines: bool) -> None:
        """Take the URL of the archive; ``machines``: whether it has a folder for each machine."""
        self._out, self._machines = out, machines
        self._place = _place_of(out)
        self._below: dict[str, tuple[str, str]] = {}

    def add(self, where: str, url: str) -> None:
        """Note a recording; ``where`` is file and line of its entry.

        Raises:
            ManifestError: the archive would be in it.
        """
        place = _place_of(url)
        if place is None or self._place is None:
            return
        if f"{self._place}/".startswith(f"{place}/"):
            raise ManifestError(f"{where}: recordings: {url} holds --out {self._out}; take another --out")
        if place.startswith(f"{self._place}/"):
            first = place[len(self._place) + 1 :].partition("/")[0]
            self._below.setdefault(first, (where, url))

    def check(self, machines: Iterable[str]) -> None:
        """Compare the recordings with what the archive will write.

        Raises:
            ManifestError: one is where files of the archive will be.
        """
        for name in (*TAKEN, *(machines if self._machines else ())):
            if name in self._below:
                where, url = self._below[name]
                raise ManifestError(
                    f"{where}: recordings: {url} is in {name} of --out {self._out}, where records will be written; "
                    "take another --out"
                )


def _place_of(url: str) -> str | None:
    """Return the place of a recording or archive, to be compared; None where it is in no folder and no bucket."""
    url = without_file_scheme(url)
    scheme, found, rest = url.partition("://")
    if found:
        return f"{scheme.lower().replace('s3a', 's3')}://{rest.rstrip('/')}"
    path = local_path(url)
    return None if path is None else _real(path)


def _real(path: Path) -> str:
    if path.is_symlink():
        return os.path.realpath(path).rstrip("/")
    # Millions of recordings are in few folders.
    return f"{_real_folder(str(path.absolute().parent))}/{path.name}".rstrip("/")


@lru_cache(maxsize=1024)
def _real_folder(path: str) -> str:
    return os.path.realpath(path).rstrip("/")


def refuse_lost_work(work: FileStore) -> None:
    """Refuse to begin where states or records of an archive are left.

    Raises:
        ManifestError: naming the first of them.
    """
    # Configurations alone are left by a process that was killed while it planned.
    ours = (name for name in work.names() if OWN.fullmatch(name) and not name.startswith("inputs/"))
    if (found := next(ours, None)) is not None:
        raise _lost(f"{WORK_NAME}/{found}")


def refuse_lost_results(index: Index, out: FileStore) -> None:
    """Refuse to begin where a machine of the index has results of an archive already.

    Raises:
        ManifestError: naming the first of them.
    """
    machines = list(index.machines())

    def first_result(machine: str) -> str | None:
        ours = re.compile(rf"{re.escape(machine)}/[^/]+/{re.escape(RESULT_NAME)}")
        listed = (name for name in out.names(f"{machine}/") if ours.fullmatch(name))
        return next((name for name in listed if _is_result(out.read(name))), None)

    with ThreadPoolExecutor(_LISTERS) as pool:
        for found in pool.map(first_result, machines):
            if found is not None:
                raise _lost(found)


def _is_result(data: bytes | None) -> bool:
    try:
        RecordingResult.from_json(data or b"")
    except (ValueError, KeyError, TypeError, AttributeError):
        return False
    return True


def _lost(name: str) -> ManifestError:
    return ManifestError(
        f"--out: holds {name} of an archive, and its {INDEX_NAME} is gone; take another --out, or delete what is left"
    )

"""Recordings that came after an archive was planned: the manifest as it is now is planned aside, compared, and added.

All recordings of the archive must still be named, by the same machines with the same configurations and kinds of
history. Recordings of ``history = "each"`` may be added anywhere; a continued history goes on at its end alone, or with
a new beginning (``anew``), as its state is kept there and nowhere else. What is added stands behind what is there.

A history that goes on is replayed from the state at its end. It is replayed from its first recording where there is
none: it had blocks without dates, too few to learn its bands from, or its state is of another version.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from models.work.task import FileStore
from monitor.fleet.index import Index
from monitor.fleet.local import count_files
from monitor.fleet.manifest import ManifestError
from monitor.fleet.occupied import Overlap
from monitor.fleet.plan import HISTORY_NAME, Planner, name_of
from monitor.fleet.result import Later


def extend(index: Index, manifest: Path, store: FileStore, overlap: Overlap | None = None) -> Later:
    """Add the recordings that a manifest names now to the index of an archive; they and longer histories wait then.

    Args:
        index: that holds a plan; it is left as it is where an error is raised.
        manifest: of the archive, as it is now.
        store: takes the configurations with their maps and libraries.
        overlap: finds recordings in the place of the archive.

    Returns:
        How many recordings were added, and the first of them.

    Raises:
        ManifestError: the manifest cannot be used, or what was planned cannot be extended to it.
        ConfigError: a configuration cannot be used.
        RemoteError: an object storage cannot be listed.
    """
    with tempfile.TemporaryDirectory(prefix="spallwatch-index-") as folder:
        path = Path(folder) / "planned.db"
        with Index(path) as planned:
            Planner(planned, store, overlap).plan(manifest)
            meta = planned.meta()
        with index.compared(path):
            _Check(index, manifest).all()
            index.begin()
            try:
                count, first = 0, ""
                for url in index.add_compared(_name_of):
                    count, first = count + 1, first or url
                index.set_meta(**meta)
                index.commit()
            except BaseException:
                index.rollback()
                raise
    return Later(count, first)


def grown_folders(index: Index) -> Later:
    """Count the recordings that are folders with more files than were read: files of a folder are not added later."""
    found = [url for url, files in index.folders_read() if (count_files(url) or 0) > files]
    return Later(len(found), found[0] if found else "")


class _Check:
    """Refuses what an archive cannot be extended to; ManifestError names machine and recording."""

    def __init__(self, index: Index, manifest: Path) -> None:
        self._index, self._manifest = index, manifest

    def all(self) -> None:
        self._machines()
        self._each()
        self._continued()

    def _refuse(self, machine: str, text: str) -> ManifestError:
        return ManifestError(f"{self._manifest}: machine {machine}: {text}; take another --out for it")

    def _machines(self) -> None:
        for machine, before, now, same in self._index.machine_changes():
            if now is None:
                raise self._refuse(machine, "is in the archive, and is not named any more")
            if before != now:
                raise self._refuse(machine, f'history: expected "{before}", as the archive was begun, got "{now}"')
            if not same:
                raise self._refuse(machine, "its configuration or its maps have changed since the archive was begun")

    def _each(self) -> None:
        if (found := self._index.dropped()) is not None:
            raise self._refuse(found[0], f"{found[1]} is in the archive, and is not named any more")

    def _continued(self) -> None:
        if (found := self._index.history_change()) is not None:
            raise self._refuse(
                found.machine,
                f"recording {found.place + 1} of {found.history}: expected {found.before}, as the archive was begun, "
                f"got {found.now or 'nothing'}; a history goes on at its end alone",
            )


def _name_of(url: str, each: bool) -> str:
    return name_of(url) if each else HISTORY_NAME

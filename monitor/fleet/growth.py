"""Recordings that came after an archive was planned: the manifest as it is now is planned aside, compared, and added.

All recordings of the archive must still be named, by the same machines with the same configurations and kinds of
history. Recordings of ``history = "each"`` may be added anywhere; a continued history goes on at its end alone, or with
a new beginning (``anew``), as its state is kept there and nowhere else. What is added stands behind what is there.

A history that goes on is replayed from the state at its end. It is replayed from its first recording where there is
none: it had blocks without dates, too few to learn its bands from, or its state is of another version.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from models.work.task import Store
from monitor.fleet.index import DONE, Index, Later
from monitor.fleet.local import count_files
from monitor.fleet.manifest import ManifestError
from monitor.fleet.occupied import Overlap
from monitor.fleet.plan import HISTORY_NAME, Planner, name_of

_TABLES = ("known", "named", "known_links", "named_links")
_EACH = """
CREATE TEMP TABLE {table} AS SELECT recordings.id AS id, machines.name AS machine, url
FROM {schema}.recordings JOIN {schema}.machines ON machines.id = machine WHERE history = 'each'
"""
_CONTINUED = """
CREATE TEMP TABLE {table} AS WITH histories AS (
    SELECT recordings.id AS id, machines.name AS machine, recordings.name AS name, url,
        row_number() OVER (PARTITION BY machines.name ORDER BY recordings.id) AS nth
    FROM {schema}.recordings JOIN {schema}.machines ON machines.id = machine WHERE history = 'continued')
SELECT id, machine, name, nth, 0 AS place, url FROM histories UNION ALL
SELECT id, machine, name, nth, place, links.url FROM histories JOIN {schema}.links ON recording = id
"""
_FURTHER = """
SELECT new.id, machine, new.url, 1 FROM named AS new LEFT JOIN known AS old USING (machine, url)
WHERE old.id IS NULL UNION ALL
SELECT new.id, machine, new.url, 0 FROM named_links AS new LEFT JOIN known_links AS old USING (machine, nth, place)
WHERE new.place = 0 AND old.id IS NULL ORDER BY 1
"""
_LONGER = """
SELECT old.id, new.place, new.url FROM named_links AS new JOIN known_links AS old USING (machine, nth)
LEFT JOIN known_links AS same ON same.machine = new.machine AND same.nth = new.nth AND same.place = new.place
WHERE old.place = 0 AND same.id IS NULL ORDER BY old.id, new.place
"""


def extend(index: Index, manifest: Path, store: Store, overlap: Overlap | None = None) -> Later:
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
        with _compared(index, path):
            _Check(index, manifest).all()
            index.begin()
            try:
                count, first = 0, ""
                for url in _added(index):
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


@contextmanager
def _compared(index: Index, planned: Path) -> Iterator[None]:
    """Attach another index as ``planned``, and list the recordings of both in temporary tables."""
    index.run("ATTACH ? AS planned", str(planned))
    try:
        for schema, each, links in (("main", "known", "known_links"), ("planned", "named", "named_links")):
            index.run(_EACH.format(schema=schema, table=each))
            index.run(f"CREATE INDEX temp.{each}_url ON {each} (machine, url)")
            index.run(_CONTINUED.format(schema=schema, table=links))
            index.run(f"CREATE INDEX temp.{links}_place ON {links} (machine, nth, place)")
        yield
    finally:
        for table in _TABLES:
            index.run(f"DROP TABLE IF EXISTS temp.{table}")
        index.run("DETACH planned")


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
        query = (
            "SELECT old.name, old.history, new.history, old.setup = new.setup FROM main.machines AS old"
            " LEFT JOIN planned.machines AS new USING (name) ORDER BY old.id"
        )
        for machine, before, now, same in self._index.run(query).fetchall():
            if now is None:
                raise self._refuse(machine, "is in the archive, and is not named any more")
            if before != now:
                raise self._refuse(machine, f'history: expected "{before}", as the archive was begun, got "{now}"')
            if not same:
                raise self._refuse(machine, "its configuration or its maps have changed since the archive was begun")

    def _each(self) -> None:
        query = "SELECT machine, url FROM known EXCEPT SELECT machine, url FROM named ORDER BY 1, 2 LIMIT 1"
        for machine, url in self._index.run(query).fetchall():
            raise self._refuse(machine, f"{url} is in the archive, and is not named any more")

    def _continued(self) -> None:
        expected = (
            "SELECT machine, old.name, place, old.url, new.url FROM known_links AS old"
            " LEFT JOIN named_links AS new USING (machine, nth, place) WHERE new.url IS NOT old.url"
            " ORDER BY old.id, place LIMIT 1"
        )
        more = (
            "SELECT machine, new.name, place, 'nothing', new.url FROM named_links AS new"
            " LEFT JOIN known_links AS old USING (machine, nth, place) WHERE old.url IS NULL"
            " AND nth < (SELECT max(nth) FROM known_links WHERE machine = new.machine) ORDER BY new.id, place LIMIT 1"
        )
        for query in (expected, more):
            for machine, history, place, before, now in self._index.run(query).fetchall():
                raise self._refuse(
                    machine,
                    f"recording {place + 1} of {history}: expected {before}, as the archive was begun, got "
                    f"{now or 'nothing'}; a history goes on at its end alone",
                )


def _added(index: Index) -> Iterator[str]:
    """Add machines, recordings and histories, and let longer histories wait; yield each recording."""
    index.run(
        "INSERT INTO main.machines (name, setup, history) SELECT name, setup, history FROM planned.machines"
        " WHERE name NOT IN (SELECT name FROM main.machines) ORDER BY id"
    )
    for recording, place, url in index.run(_LONGER):
        index.add_link(recording, place, url)
        # Replayed from its beginning it is another attempt: chunks of the first one name states that are gone.
        index.run(
            "UPDATE main.recordings SET status = 0, attempt = attempt + (id NOT IN (SELECT recording FROM checkpoints))"
            " WHERE id = ? AND status = ?",
            *(recording, DONE),
        )
        yield url
    machines: dict[str, int] = dict(index.run("SELECT name, id FROM main.machines").fetchall())
    for number, machine, url, each in index.run(_FURTHER):
        added = index.add_recording(machines[machine], name_of(url) if each else HISTORY_NAME, url)
        yield url
        for place, link in index.run("SELECT place, url FROM planned.links WHERE recording = ? ORDER BY place", number):
            index.add_link(added, place, link)
            yield link

"""What holds in every crash state: the store is opened as by a daemon's start, and compared with what was promised."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path

from benchmarks.crash.history import State
from benchmarks.crash.life import Places, blocks_of, states_of
from benchmarks.crash.recorder import Entry
from models.words.errors import SpallwatchError
from monitor.config.load import load_config
from monitor.pipeline import resumed_state
from monitor.records.backup import backups_of, verify
from monitor.records.database import opened
from monitor.records.events import EventLog
from monitor.records.publish import publish
from monitor.records.published_folder import moved_days
from monitor.records.recover import published
from monitor.records.recover.salvage import SalvageReport, open_or_salvage
from monitor.records.store import Store
from monitor.service.setup import source_settings
from monitor.service.system import read_status

MACHINE = "m"


@dataclass(frozen=True)
class Promised:
    """What a life was promised up to a moment.

    Attributes:
        blocks: names of the acknowledged blocks.
        events: notices, and whether each is acknowledged.
        backup: name of the latest backup that was reported.
        moving: name of the file of the day that is being moved, or was.
        lost: whether the store itself was removed.
    """

    blocks: frozenset[str] = frozenset()
    events: Mapping[str, bool] = field(default_factory=dict[str, bool])
    backup: str | None = None
    moving: str | None = None
    lost: bool = False

    def after(self, entry: Entry) -> Promised:
        """Return what is promised after an entry of the record."""
        said = entry.mark
        if not said:
            return self
        events = dict(self.events)
        if "notice" in said:
            events[said["notice"]] = False
        if "acknowledged" in said:
            events[said["acknowledged"]] = True
        return replace(
            self,
            blocks=self.blocks | said.get("blocks", {}).keys(),
            # A notice that is in no snapshot is lost with its store; records are not.
            events={} if said.get("lost") else events,
            backup=said.get("backup", self.backup),
            moving=said.get("moving", self.moving),
            lost=self.lost or "lost" in said,
        )


class Truth:
    """What the whole life held: all records, states, and whole published files."""

    def __init__(self, entries: Sequence[Entry]) -> None:
        """Read the marks of a life."""
        self.blocks: dict[str, str] = {}
        self.states: set[tuple[str, str]] = set()
        self.published: dict[str, set[bytes]] = {}
        for entry in entries:
            self.blocks |= entry.mark.get("blocks", {})
            self.states |= set(entry.mark.get("states", {}).items())

    def note_published(self, name: str, content: bytes) -> None:
        """Note the content with which a published file got its name."""
        self.published.setdefault(name, set()).add(content_digest(content))


def content_digest(content: bytes) -> bytes:
    """Return a digest of a file."""
    return blake2b(content, digest_size=16).digest()


class Judge:
    """Builds states at the place of the life, and opens them."""

    def __init__(self, places: Places, truth: Truth) -> None:
        """Keep the places, whose root is emptied and filled again and again."""
        self.places, self.truth = places, truth
        self._recorded = str(Places(places.base).root.resolve()).encode()
        config = load_config(places.config)
        self._settings = [source_settings(config, section) for section in config.source]
        self._verified: dict[bytes, str | None] = {}
        # A process for each of thousands of states would cost hours; what it runs is run here, once for equal files.
        self._gathered: dict[bytes, tuple[bytes, dict[Path, tuple[int, int]]]] = {}
        published._in_child = self._take_files
        self.republished = self.salvaged = 0

    def _take_files(self, scratch: Path, files: Sequence[Path], _: published.Beat) -> dict[Path, tuple[int, int]]:
        parts = [str(file).encode() + content_digest(file.read_bytes()) for file in files]
        key = content_digest(b"".join(parts))
        if key not in self._gathered:
            found = published.take_files(scratch, files)
            with closing(opened(scratch)) as connection:
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            self._gathered[key] = scratch.read_bytes(), found
        content, found = self._gathered[key]
        for suffix in ("-wal", "-shm"):
            scratch.with_name(scratch.name + suffix).unlink(missing_ok=True)
        scratch.write_bytes(content)
        return found

    def broken(self, state: State, promised: Promised) -> list[str]:
        """Return the promises that a state breaks, one sentence each."""
        self._build(state)
        try:
            return [*self._read(state, promised), *self._open(state, promised)]
        except (SpallwatchError, OSError) as error:
            return [f"it cannot be opened: {type(error).__name__}: {error}"]

    def _build(self, state: State) -> None:
        root = self.places.root
        shutil.rmtree(root, ignore_errors=True)
        root.mkdir()
        for name in sorted(state.folders):
            (root / name).mkdir()
        for name, content in state.files.items():
            if name.endswith("-moved.json"):
                # The register names a folder by its whole path.
                content = content.replace(self._recorded, str(root.resolve()).encode())
            (root / name).write_bytes(content)

    def _read(self, state: State, promised: Promised) -> Iterator[str]:
        """Check what is only read: the status, backups, and days that were moved."""
        read_status(self.places.store.parent)
        backups = [] if not self.places.backups.exists() else backups_of(self.places.backups, MACHINE)
        for folder in backups:
            if (problem := self._problem_of(folder, state)) is not None:
                yield f"backup {folder.name} has its name and is not whole: {problem}"
        if promised.backup is not None and not any(folder.name >= promised.backup for folder in backups):
            yield f"backup {promised.backup} is gone"
        if (name := promised.moving) is not None:
            moved_days(self.places.records, MACHINE)
            copies = [state.files.get(path) for path in (f"records/{name}", f"old/moved/{name}")]
            if not any(copy is not None and self._is_whole(name, copy) for copy in copies):
                yield f"{name} is whole neither in its folder nor where it was moved to"

    def _problem_of(self, folder: Path, state: State) -> str | None:
        place = f"{folder.relative_to(self.places.root)}/"
        parts = [(path, content) for path, content in sorted(state.files.items()) if path.startswith(place)]
        key = content_digest(b"".join(path.encode() + content_digest(content) for path, content in parts))
        if key not in self._verified:
            try:
                verify(folder)
            except (SpallwatchError, OSError) as error:
                self._verified[key] = str(error)
            else:
                self._verified[key] = None
        return self._verified[key]

    def _is_whole(self, name: str, content: bytes) -> bool:
        return content_digest(content) in self.truth.published.get(name, ())

    def _open(self, state: State, promised: Promised) -> Iterator[str]:
        records = self.places.records
        store, report = open_or_salvage(self.places.store, machine=MACHINE, records_dir=records)
        with store:
            yield from self._compare(store, promised, report)
            yield from self._published(store, state, promised)

    def _compare(self, store: Store, promised: Promised, report: SalvageReport | None) -> Iterator[str]:
        if report is None:
            yield from self._states(store)
        else:
            self.salvaged += 1
            if not promised.lost:
                yield f"the store was made again: {report.text}"
        yield from self._blocks(store, promised, is_whole=report is None)
        with EventLog(store.path) as log:
            for name, is_acknowledged in promised.events.items():
                found = log.event(name)
                if found is None or (is_acknowledged and not found.acknowledgements):
                    yield f"notice {name} {'is lost' if found is None else 'is not acknowledged'}"

    def _states(self, store: Store) -> Iterator[str]:
        found = states_of(store)
        if any(item not in self.truth.states for item in found.items()):
            yield "the states are not those after a block"
        ends = {settings.name: store.last(settings.name) for settings in self._settings}
        if any(int(text.split()[1]) != ends[text.split()[0]] for text in found.values()):
            yield "the states are not those after the last block"

    def _blocks(self, store: Store, promised: Promised, *, is_whole: bool) -> Iterator[str]:
        for settings in self._settings:
            resumed_state(store, settings)
        blocks = blocks_of(store)
        if promised.blocks - blocks.keys():
            yield f"lost: {', '.join(sorted(promised.blocks - blocks.keys()))}"
        if any(self.truth.blocks.get(name) != digest for name, digest in blocks.items()):
            yield "a block is there that was not offered, or is not as it was committed"
        rows = store.rows("SELECT count(*), count(DISTINCT source || ' ' || sequence) FROM blocks")[0]
        if rows[0] != rows[1] or rows[0] != len(blocks):
            yield "a block is there twice, or has no record"
        files = store.rows("SELECT count(*) FROM sqlite_master WHERE name = 'files'")[0][0]
        if files and is_whole:
            taken = store.rows("SELECT count(*) FROM files WHERE source = 'f' AND verdict = 'accepted'")[0][0]
            if taken != sum(name.startswith("f ") for name in blocks):
                yield f"{taken} files are noted as taken, which is not the number of their blocks"

    def _published(self, store: Store, state: State, promised: Promised) -> Iterator[str]:
        """Check that published files are whole, or are made again."""
        folder = self.places.records
        torn = [
            path.name for path in folder.glob(f"{MACHINE}-*.nc") if not self._is_whole(path.name, path.read_bytes())
        ]
        if not torn:
            return
        self.republished += 1
        publish(store, folder)
        for name in torn:
            content = (folder / name).read_bytes()
            if content == state.files.get(f"records/{name}"):
                yield f"{name} is not whole and was not made again"
        with suppress(FileNotFoundError):
            for path in folder.glob(f"{MACHINE}-*.lost-*"):
                if path.name not in {Path(name).name for name in state.files}:
                    yield f"{path.name} was kept, although nothing was in it"

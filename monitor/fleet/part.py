"""The task of an archive: replay one recording, or a part of the recordings that continue each other.

What is remote is fetched into a scratch folder; the records go to the store of the archive as one file a UTC day. An
error of the recording or of its configuration is a result, not an exception: the others go on.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import netCDF4

from models.platform.scratch import scratch_folder
from models.words.errors import WrongInputError
from models.work.codec import digest_of
from models.work.folder_store import open_store
from models.work.redact import redact
from models.work.task import FileStore, Work
from monitor.fleet.history import HistorySource, Position, end_of, packed_state, unpack_state
from monitor.fleet.manifest import count_files
from monitor.fleet.result import RESULT_NAME, RecordingResult, RecordsFile, Shape
from monitor.fleet.setup import ArchiveError, LoadedSetup, load_setup
from monitor.records.filing import SECONDS_PER_DAY
from monitor.records.publish import days, file_name
from monitor.records.queries import condensed_of_day, last_published, newest_day
from monitor.records.store import Store
from monitor.service.replay import Replay, ReplayExtent, kept_dating, replay_source
from monitor.service.setup import open_configured
from streams.files.groups import FilesBeside
from streams.files.remote import is_remote
from streams.files.remote_folder import opened_remote
from streams.recording.state import ReadingState, ResumableSource
from streams.types.source import Source

_SCRATCH = "spallwatch-archive-"
PART_BLOCKS = 5000
"""Blocks of a part: some minutes of work, after which a state is kept."""
MAX_PART_RECORDINGS = 1000
MEMORY = 600_000_000
"""Bytes that a replay needs beside the program where no file is above 250 MB."""
_PER_FILE = frozenset(
    {"history", "date_created", "title", "id", "dated", "records_elsewhere"}
    | {f"time_coverage_{which}" for which in ("start", "end", "duration")}
)
"""Global attributes of one file, not of how its records were made."""


@dataclass(frozen=True)
class SharedPlaces:
    """What all parts share.

    Attributes:
        archive: identity of the archive: results of another one leave no files here.
        records: URL of the store of the records.
        work: URL of the store of configurations and of the states of histories.
        part_blocks: blocks after which a part ends.
    """

    archive: str
    records: str
    work: str
    part_blocks: int = PART_BLOCKS


_BEGIN = Position()


@dataclass(frozen=True)
class RecordingPart:
    """A recording, or a part of a history.

    Attributes:
        recording: number of its row in the index.
        machine, name: of it.
        setup: digest of the configuration of the machine.
        urls: of the recordings from ``begin`` on.
        shown: URL of the first recording of all, without credentials.
        more: whether further recordings continue them.
        continued: whether recordings that come later may continue them.
        begin: where the part begins.
        state: name of the store of records at ``begin``, None at the first part.
        attempt: how often it failed in runs before.
    """

    recording: int
    machine: str
    name: str
    setup: str
    urls: tuple[str, ...]
    shown: str
    more: bool = False
    continued: bool = False
    begin: Position = _BEGIN
    state: str | None = None
    attempt: int = 0

    @property
    def is_history(self) -> bool:
        """Whether recordings continue each other."""
        return self.more or len(self.urls) > 1 or self.begin.recording > 0


@dataclass(frozen=True)
class PartResult:
    """What a part leaves.

    Attributes:
        following: where the next part begins, None where this was the last.
        end: after the last part, where recordings that come later would begin; None where they cannot go on.
        state: name of the store of records there.
        folders: recordings that were opened and are folders of this machine, with the number of files in them.
    """

    result: RecordingResult
    following: Position | None = None
    state: str | None = None
    end: Position | None = None
    folders: tuple[tuple[str, int], ...] = ()


def replay_part(shared: SharedPlaces, part: RecordingPart) -> PartResult:
    """Replay a part; the result of a recording in one part is also written beside its records.

    Raises:
        ArchiveError, OSError: a store lacks what it should hold, or cannot be reached.
    """
    began = time.perf_counter()
    records = open_store(shared.records)
    with scratch_folder(_SCRATCH) as folder:
        replayed = _Replayed(shared, part, records, folder)
        try:
            done = replayed.result()
        except WrongInputError as error:
            done = PartResult(_failed(part, str(error)))
    result = replace(done.result, seconds=time.perf_counter() - began)
    if done.following is None and part.begin.part == 0:
        write_result(records, result, again=part.attempt > 0)
    return replace(done, result=result, folders=tuple(replayed.folders.items()))


def replay_parts(shared: SharedPlaces, parts: tuple[RecordingPart, ...]) -> tuple[PartResult | None, ...]:
    """Replay parts of several recordings one after another; None for one that raises, which is tried again alone.

    Raises:
        ArchiveError, OSError: as :func:`replay_part`, where there is one part.
    """
    if len(parts) == 1:
        return (replay_part(shared, parts[0]),)
    results: list[PartResult | None] = []
    for part in parts:
        try:
            results.append(replay_part(shared, part))
        except Exception:
            # Its log is that of the attempts alone.
            results.append(None)
    return tuple(results)


REPLAYS = Work("recordings", replay_parts, memory=MEMORY)


def write_result(records: FileStore, result: RecordingResult, *, again: bool = False) -> None:
    """Write the result of a recording beside its records; ``again``: delete those of an attempt that failed before."""
    records.write(f"{result.folder}/{RESULT_NAME}", result.to_json())
    if again:
        ours = re.compile(rf"{re.escape(f'{result.folder}/{result.machine}')}-(?:\d{{8}}|undated)\.nc")
        kept = {file.name for file in result.files}
        for name in [name for name in records.names(f"{result.folder}/") if ours.fullmatch(name)]:
            if name not in kept:
                records.delete(name)


def read_result(records: FileStore, folder: str) -> RecordingResult:
    """Return the result of the recording in a folder of the store.

    Raises:
        ArchiveError: it is missing or damaged.
    """
    data = records.read(f"{folder}/{RESULT_NAME}")
    try:
        return RecordingResult.from_json(data or b"")
    except (ValueError, KeyError, TypeError) as error:
        what = "is missing" if data is None else f"is damaged: {error}"
        raise ArchiveError(f"{records.url}: {folder}/{RESULT_NAME} {what}") from None


def _failed(part: RecordingPart, reason: str) -> RecordingResult:
    return RecordingResult(part.machine, part.name, part.shown, "failed", redact(" ".join(reason.split())))


class _Replayed:
    """One part under way in a scratch folder."""

    def __init__(self, shared: SharedPlaces, part: RecordingPart, records: FileStore, folder: Path) -> None:
        self._shared, self._part, self._records, self._folder = shared, part, records, folder
        self._out = folder / "out"
        self._work = open_store(shared.work)
        self._fetched_bytes = 0
        self._reading: ReadingState | None = None
        self.folders: dict[str, int] = {}

    def result(self) -> PartResult:
        part = self._part
        machine = load_setup(self._shared.work, part.setup)
        if part.state is not None:
            data = self._work.read(part.state)
            if data is None:
                raise ArchiveError(f"{self._work.url}: {part.state} is missing; --resume replays it from its beginning")
            self._reading = unpack_state(data, self._out / "state.db")
        if not part.is_history:
            with self._opened(machine, part.urls[0], self._reading, keep=True) as source:
                replayed = self._replay(machine, source)
                self._reading = source.state() if isinstance(source, ResumableSource) else None
            reached = replace(part.begin, part=part.begin.part + 1)
            return self._settled(replayed, reached, replayed.taken < self._shared.part_blocks, None)
        opener = partial(self._opened, machine)
        history = HistorySource(machine.settings.name, part.urls, part.begin, opener, self._reading)
        if part.state is not None:
            history.after(self._out / "state.db")
        replayed = self._replay(machine, history)
        self._reading = history.state()
        last = replayed.taken < self._shared.part_blocks and not part.more
        return self._settled(replayed, history.reached, last, history.problem)

    @contextmanager
    def _opened(
        self, machine: LoadedSetup, url: str, reading: ReadingState | None, *, keep: bool = False
    ) -> Iterator[Source]:
        """Open a recording to go on from a state of reading, fetched where it is remote.

        ``keep``: what dates its files is that of the store.
        """
        section = machine.config.source[0]
        dating = kept_dating(self._out, section.name) if keep and self._part.state is not None else None
        if not is_remote(url):
            # Before the files are listed: one that comes in between is counted as not read.
            if (files := count_files(url)) is not None:
                self.folders[url] = files
            yield open_configured(machine.config, section, url, dating, reading)
            return
        scratch = self._folder / "fetched"
        scratch.mkdir(exist_ok=True)
        with opened_remote(url, scratch, FilesBeside(section.pulses, section.files)) as found:
            try:
                yield open_configured(machine.config, section, found.url, dating, reading, found.files)
            finally:
                self._fetched_bytes += found.size

    def _replay(self, machine: LoadedSetup, source: Source) -> Replay:
        part = self._part
        return replay_source(
            machine.named(part.machine),
            machine.settings,
            source,
            self._out,
            ReplayExtent(limit=self._shared.part_blocks, whole=part.state is None, in_parts=True),
            resume=part.state is not None,
            before_publishing=self._fetch_days,
        )

    def _fetch_days(self, store: Store) -> None:
        """Fetch the files of days of earlier parts that blocks of this part belong to, so that they are extended."""
        for day, last_block in days(store):
            name = file_name(store.machine, day)
            written = last_published(store, name)
            if written is None or written >= last_block or not condensed_of_day(store, day):
                continue
            data = self._records.read(f"{self._part.machine}/{self._part.name}/{name}")
            if data is None:
                raise ArchiveError(f"{self._records.url}: {self._part.machine}/{self._part.name}/{name} is missing")
            path = self._out / "records" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)

    def _settled(self, replayed: Replay, reached: Position, last: bool, problem: str | None) -> PartResult:
        """Write what is complete, and unless it is the last part, the state from which the next one goes on."""
        part = self._part
        last = last or problem is not None
        written = [Path(file) for file in replayed.summary["records"]]
        open_day = None if last else self._newest_day()
        result = RecordingResult(part.machine, part.name, part.shown)
        for path in written:
            found = described(path, part.machine, part.name)
            (file,) = found.files
            if last or file.day not in (None, open_day):
                self._records.write(file.name, path.read_bytes())
                result = result.followed_by(found)
        summary = {key: value for key, value in replayed.summary.items() if key != "records"}
        reason = _reason(summary, problem) if last else ""
        result = replace(
            result,
            status="failed" if reason else "done",
            reason=redact(reason),
            summary=summary,
            bytes_read=self._fetched_bytes,
        )
        if not last:
            return PartResult(result, reached, self._kept_state())
        end = None if reason or not part.continued else self._end(reached)
        return PartResult(result) if end is None else PartResult(result, state=self._kept_state(), end=end)

    def _end(self, reached: Position) -> Position | None:
        """Return where recordings that come later would begin."""
        part, self._reading = self._part, None
        blocks = end_of(self._out / "state.db", load_setup(self._shared.work, part.setup).settings.name)
        behind = part.begin.recording + len(part.urls)
        return None if blocks is None else Position(reached.part, behind, blocks)

    def _newest_day(self) -> int | None:
        with Store.open(self._out / "state.db", read_only=True) as store:
            return newest_day(store)

    def _kept_state(self) -> str:
        data = packed_state(self._out / "state.db", self._reading)
        # Another recording of the same content deletes its own state alone.
        name = f"states/{digest_of(b'%d %s' % (self._part.recording, data))}"
        self._work.write(name, data)
        return name


def _reason(summary: Mapping[str, Any], problem: str | None) -> str:
    """Return why a recording failed, "" where it did not: every block is rejected, or a recording cannot be read."""
    if problem is not None:
        return " ".join(problem.split())
    if summary["accepted"] or set(summary["rejected"]) <= {"duplicate"}:
        return ""
    status, reason = next(iter(summary["reasons"].items()), ("", ""))
    return f"every block is rejected; first {status}, {reason}"


def described(path: Path, machine: str, recording: str) -> RecordingResult:
    """Return the result of a file of records alone; its digest is of all that they hold, by those of the ledger."""
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        dated = file.getncattr("dated") == "yes"
        times: list[float] = file.variables["time"][...].tolist() if dated else []
        first, last = (times[0], times[-1]) if times else (None, None)
        columns = [file["ledger"].variables[name][...] for name in ("ledger_digest", "content_digest")]
        variables = {
            name: variable.dimensions[1:]
            for name, variable in file.variables.items()
            if name != "time" and variable.dimensions[:1] == ("time",)
        }
        used = {dim for dims in variables.values() for dim in dims}
        shape = Shape(
            channels=tuple(map(str, file.variables["channel"][...])),
            variables=variables,
            sizes={name: len(dim) for name, dim in file.dimensions.items() if name in used},
            attributes={name: _plain(file.getncattr(name)) for name in file.ncattrs() if name not in _PER_FILE},
        )
        rows = len(file.dimensions["time"])
    day = None if first is None else int(first // SECONDS_PER_DAY)
    digest = digest_of(b"".join(column.tobytes() for column in columns))
    file_of = RecordsFile(f"{machine}/{recording}/{path.name}", day, rows, path.stat().st_size, digest)
    return RecordingResult(machine, recording, "", files=(file_of,), rows=rows, first=first, last=last, shape=shape)


def _plain(value: Any) -> Any:
    """Return an attribute of a file as a value for JSON."""
    return value.tolist() if hasattr(value, "tolist") else value

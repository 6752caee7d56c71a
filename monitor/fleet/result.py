"""What the replay of one recording leaves: where its records are, their shape, and its summary.

The recordings of a machine that continue each other are one history, and count as one recording here.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, field, replace
from typing import Any, Literal, NamedTuple

from models.work.codec import decode, encode
from monitor.fleet.history import Position

Status = Literal["done", "failed"]
RESULT_NAME = "result.json"
WAITING, DONE, FAILED, SET_ASIDE = range(4)
STATUS_WORDS = ("waiting", "done", "failed", "set_aside")


@dataclass(frozen=True)
class RecordsFile:
    """One netCDF file of records.

    Attributes:
        name: in the store of the records, such as "press/2024-03/press-20240301.nc".
        day: UTC day as a number of days since 1970, or None for records without a date.
        rows: of the file, one a block.
        size: bytes.
        digest: of the records, without the date of writing that the file holds.
    """

    name: str
    day: int | None
    rows: int
    size: int
    digest: str = ""


@dataclass(frozen=True)
class Shape:
    """Variables and dimensions of records, so that arrays can be planned without opening a file.

    Attributes:
        channels: in order; the dimension ``channel``.
        variables: of those along ``time``, the other dimensions by name.
        sizes: greatest size of each of these dimensions.
        attributes: global attributes that tell what made the records: hashes, versions, calibration.
    """

    channels: tuple[str, ...] = ()
    variables: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    sizes: Mapping[str, int] = field(default_factory=dict[str, int])
    attributes: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def joined(self, other: Shape) -> Shape:
        """Return the shape of both, the longer dimensions of a variable where they differ."""
        variables = dict(self.variables)
        for name, dims in other.variables.items():
            variables[name] = max(variables.get(name, ()), dims, key=len)
        return Shape(
            channels=tuple(dict.fromkeys((*self.channels, *other.channels))),
            variables=variables,
            sizes={dim: max(self.sizes.get(dim, 0), other.sizes.get(dim, 0)) for dim in {**self.sizes, **other.sizes}},
            attributes={**self.attributes, **other.attributes},
        )


@dataclass(frozen=True)
class RecordingResult:
    """A recording that was replayed, or that cannot be.

    Attributes:
        machine: name of the machine, as a part of a path.
        recording: name of the recording, as a part of a path, unique in its machine.
        url: where the recording is, without credentials; of a history, its first recording.
        status: "failed" where the recording or the configuration is at fault; ``reason`` then says why in one line.
        files: of the records, by day, those without a date first; their rows together are ``rows``.
        first, last: UTC of the first and last dated block, s since 1970, or None.
        summary: keys of ``replay --json``, {} where it failed.
        seconds: wall time of fetching and replaying.
        bytes_read: size of what was fetched from object storage.
    """

    machine: str
    recording: str
    url: str
    status: Status = "done"
    reason: str = ""
    files: tuple[RecordsFile, ...] = ()
    rows: int = 0
    first: float | None = None
    last: float | None = None
    shape: Shape = field(default_factory=Shape)
    summary: Mapping[str, Any] = field(default_factory=dict[str, Any])
    seconds: float = 0.0
    bytes_read: int = 0

    @property
    def folder(self) -> str:
        """Where its files are in the store of the records."""
        return f"{self.machine}/{self.recording}"

    def followed_by(self, later: RecordingResult) -> RecordingResult:
        """Return the result of this part of a history and the next one, whose summary is that of both."""
        files = {file.day: file for file in (*self.files, *later.files)}
        firsts = [time for time in (self.first, later.first) if time is not None]
        lasts = [time for time in (self.last, later.last) if time is not None]
        listed = tuple(files[day] for day in sorted(files, key=lambda day: (day is not None, day)))
        return replace(
            later,
            url=self.url,
            files=listed,
            rows=sum(file.rows for file in listed),
            first=min(firsts, default=None),
            last=max(lasts, default=None),
            shape=self.shape.joined(later.shape),
            summary=_summary_of(self.summary, later.summary),
            seconds=self.seconds + later.seconds,
            bytes_read=self.bytes_read + later.bytes_read,
        )

    def to_json(self) -> bytes:
        """Return the result as JSON text, the file ``result.json`` beside the records."""
        return json.dumps({"version": 1, **asdict(self)}, allow_nan=False).encode()

    @classmethod
    def from_json(cls, data: bytes) -> RecordingResult:
        """Return the result that :meth:`to_json` gave.

        Raises:
            ValueError: it is of another version.
        """
        values: dict[str, Any] = json.loads(data)
        version = values.pop("version", None)
        if version != 1:
            raise ValueError(f"{RESULT_NAME}: version 1 expected, got {version!r}")
        shape = values["shape"]
        variables = {name: tuple(dims) for name, dims in shape["variables"].items()}
        values["shape"] = Shape(tuple(shape["channels"]), variables, shape["sizes"], shape["attributes"])
        values["files"] = tuple(RecordsFile(**file) for file in values["files"])
        return cls(**values)


def _summary_of(earlier: Mapping[str, Any], later: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the summary of two parts: that of the later one, with the first reason of each status."""
    if not later or not earlier:
        return later or earlier
    return {**later, "reasons": {**later.get("reasons", {}), **earlier.get("reasons", {})}}


class Waiting(NamedTuple):
    """A recording that is not replayed yet.

    Attributes:
        id: its number.
        setup: digest of the configuration of its machine.
        history: "each" or "continued".
        attempt: how often it failed in runs before.
    """

    id: int
    machine: str
    setup: str
    history: str
    name: str
    url: str
    attempt: int


class Checkpoint(NamedTuple):
    """Where a history stands: where its next part begins, from which state, and the result of the parts before.

    It is kept in plain types, since a history may go on years later.
    """

    position: Position
    state: str | None
    result: RecordingResult

    def packed(self) -> bytes:
        """Return it as bytes."""
        return encode((list(astuple(self.position)), self.state, self.result.to_json()))

    @classmethod
    def unpacked(cls, data: bytes) -> Checkpoint | None:
        """Return it from its bytes, None where they are of another version: the history is then replayed anew."""
        try:
            position, state, result = decode(data)
            return cls(Position(*position), state, RecordingResult.from_json(result))
        except (ValueError, TypeError, KeyError):
            return None


class RecordingOutcome(NamedTuple):
    """What the index keeps of a recording that is replayed, failed or set aside.

    ``end`` is the checkpoint at the end of a history that was replayed, from which it can go on later.
    """

    id: int
    status: int
    rows: int = 0
    first: float | None = None
    last: float | None = None
    seconds: float = 0.0
    chunk: str | None = None
    reason: str | None = None
    log: str | None = None
    end: Checkpoint | None = None


class Counts(NamedTuple):
    """Recordings by status; rows of records and seconds of work of all that were replayed, failed ones included."""

    waiting: int = 0
    done: int = 0
    failed: int = 0
    set_aside: int = 0
    rows: int = 0
    seconds: float = 0.0

    @property
    def recordings(self) -> int:
        """All of them."""
        return self.waiting + self.done + self.failed + self.set_aside


class Later(NamedTuple):
    """Recordings that came after an archive was planned: how many they are, and the first, "" where there is none."""

    recordings: int = 0
    first: str = ""

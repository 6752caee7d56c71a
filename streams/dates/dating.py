"""What dates the blocks of a source: the choice that is kept beside its ledger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from streams.types.listing import printable
from streams.types.source import ACCEPTED, Ledger
from streams.types.spec import SourceError, SourceSpec
from streams.types.stamps import Order, utc_text

By = Literal["header", "name", "count", "mtime", "nothing"]


@dataclass(frozen=True)
class Dating:
    """The kept choice of a source; None for what is not chosen.

    Attributes:
        by: what dates the blocks; None: chosen at the next file.
        pattern: ``time_name``, where one was configured.
        order: of day and month; ``decided_by`` is the file that left no other, or "configuration".
        start: ``start_utc`` of a count, s since 1970 UTC.
        interval: ``interval_s`` of a count.
        step: time from one place of a count to the next, s.
        group: which number of a file's name is its place, from the right; None: the number of the block.
        first: the number at ``start``.
        numbers: how many numbers a name has; ``folder`` holds all files that are counted by their names.
        example: the file at which the choice was made.
        growing: a file whose end was not seen, ``grown`` its length so far, s: the step, once another file comes.
    """

    by: By | None = None
    pattern: str | None = None
    order: Order | None = None
    decided_by: str | None = None
    start: float | None = None
    interval: float | None = None
    step: float | None = None
    group: int | None = None
    first: int = 0
    numbers: int = 0
    folder: str = ""
    example: str = ""
    growing: str = ""
    grown: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the choice as plain values for JSON."""
        return {"version": 1, **asdict(self)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Dating:
        """Restore a choice written by :meth:`to_dict`; ValueError for another version."""
        if values.get("version") != 1:
            raise ValueError(f"dating of version {values.get('version')!r}, expected 1")
        return cls(**{key: value for key, value in values.items() if key != "version"})

    def describe(self) -> str:
        """Return the choice in words."""
        order = "" if self.order is None else printable(f", {self.order.replace('_', ' ')} ({self.decided_by})")
        if self.by == "header":
            return f"by the header of each file{order}"
        if self.by == "name":
            return f"by the name of each file{'' if self.pattern is None else f', {self.pattern}'}{order}"
        if self.by == "mtime":
            return "by the time of the last change of each file, less its length"
        if self.by != "count":
            return "by nothing" if self.by else "not chosen yet"
        place = "the number of the block" if self.group is None else f"the number in the name, from {self.first} on"
        step = "the length of a file" if self.step is None else f"{self.step:g} s"
        begin = "no start_utc: seconds from the first block" if self.start is None else f"from {utc_text(self.start)}"
        return f"by count ({begin}; {place}; {step} each)"


def check_kept(spec: SourceSpec, kept: Dating) -> None:
    """Raise SourceError where the configuration contradicts the kept choice; it names the command that changes it."""
    if kept.by is None:
        return
    pairs: list[tuple[str, object, object]] = [("time_from", wanted_by(spec) or kept.by, kept.by)]
    if kept.by == "name":
        pairs.append(("time_name", spec.time_name, kept.pattern))
    if kept.order is not None and spec.date_order is not None:
        pairs.append(("date_order", spec.date_order, kept.order))
    if kept.by == "count":
        pairs.append(("start_utc", _utc(spec.start), _utc(kept.start)))
        pairs.append(("interval_s", spec.interval, kept.interval))
    for key, configured, found in pairs:
        if configured != found:
            since = printable(f" since {kept.example}" if kept.example else "")
            raise SourceError(
                f"[[source]] {spec.name}: {key} is {configured if configured is not None else 'not set'}, but its "
                f"blocks are dated {kept.describe()}{since}; go back to it, or change the dates of later blocks by: "
                f"spallwatch redate {spec.name}"
            )


def kept_dating(spec: SourceSpec, ledger: Ledger) -> Dating | None:
    """Return what dates the blocks of a source by its ledger, None where nothing is chosen.

    Blocks of an earlier version that dated none stay so: dates begin at a command, not at an update. SourceError where
    the configuration contradicts it.
    """
    values = ledger.dating(spec.name)
    kept = None if values is None else Dating.from_dict(values)
    if kept is None and ledger.began(spec.name) is None and ledger.file_counts(spec.name).get(ACCEPTED):
        kept = Dating("nothing", example="an earlier version")
    if kept is not None:
        check_kept(spec, kept)
    return kept


def _utc(seconds: float | None) -> str | None:
    return None if seconds is None else utc_text(seconds)


def wanted_by(spec: SourceSpec) -> By | None:
    """Return what the configuration asks for, None where the files decide."""
    return spec.time_from or ("name" if spec.time_name is not None else None)

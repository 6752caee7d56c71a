"""Dates the files of a source by a header, a name, a count, or the time of the last change.

The choice is made once, at the first file that can be read: live and replayed files go through the same
:class:`Dater`.
"""

from __future__ import annotations

import contextlib
import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from streams.dates import places
from streams.dates.best import latest_of
from streams.dates.dating import Dating, check_kept, folder_of, numbers_of, place_in_names, wanted_by
from streams.dates.drift import DAY
from streams.dates.order import DateOrder, UndatedError
from streams.dates.places import FilePlace, NamedTime
from streams.dates.stating import COUNTED, Witnesses, by_header, by_name, lags_from, stamp_doubt
from streams.types.listing import printable
from streams.types.samples import Samples
from streams.types.spec import SourceSpec
from streams.types.stamps import Order, Stamp, day_in_folders, read_stamp, stamp_in_name, utc_text
from streams.types.times import TimeStatement

_LOG = logging.getLogger(__name__)

_MAX_OFFSET_S = 14 * 3600.0
"""Largest difference of a zone to UTC."""
_LENGTH_TOLERANCE = 0.1
"""Share by which a file may be longer than the time to the next one."""


class Dater:
    """Dates the files of one source."""

    def __init__(
        self,
        spec: SourceSpec,
        kept: Dating | None = None,
        *,
        cut: bool = False,
        several: bool = True,
        keep: Callable[[Dating], None] = lambda choice: None,
        names: Callable[[], Iterable[str]] = tuple,
        changes: Callable[[], Mapping[str, float]] | None = None,
        above: str = "",
    ) -> None:
        """Begin with the kept choice of a source, if there is one.

        Args:
            cut: files are cut into blocks of ``block_s``.
            several: there may be more than one file.
            keep: stores a choice before it is used.
            names: gives the paths of the files that are known.
            changes: gives the times of their last changes, s since 1970 UTC, where no other files will come.
            above: the folders above them that hold nothing but a date, see :func:`streams.types.stamps.date_folders`.

        Raises:
            SourceError: the configuration contradicts the choice.
        """
        self.choice = kept or Dating()
        check_kept(spec, self.choice)
        self.remarks: dict[str, str] = {}
        """Sentences for people: what is not used, what has no date."""
        self._spec, self._cut, self._several = spec, cut, several
        self._keep, self._names, self._changes = keep, names, changes
        self._above = f"{above}/" if above else ""
        self._places: Mapping[str, FilePlace] | None = None
        self._by_starts: Mapping[str, FilePlace] = {}
        self.order = DateOrder(spec, lambda: self.choice, self._set, names, self._name_stamp)

    def name_order(self, path: str) -> float | None:
        """Return what orders a file where names are what dates, None where its name states no time."""
        if self.choice.by != "name":
            return None
        place = self._place(path)
        if place is not None:
            return place.rank
        named = self._named(path)
        if named is None or self.choice.counter is None:
            return None if named is None else named.time
        return places.counted(named, self.choice.counter)

    def _states_time(self, path: str) -> bool:
        """Return whether names state times; numbers below folders of a date do where all can be read so."""
        stamp = self._name_stamp(path)
        if stamp is None or "/" not in stamp.text:
            return stamp is not None
        return all(self._name_stamp(name) is not None for name in self._names())

    def _named(self, path: str) -> NamedTime | None:
        stamp = self._name_stamp(path)
        return (
            None
            if stamp is None
            else places.named_time(path, self._above + path, stamp, self.choice.order, self._spec.timezone)
        )

    def _place(self, path: str) -> FilePlace | None:
        """Return the place of a file among all, where no others will come and their order is settled."""
        if self._changes is None:
            return None
        if self._places is None:
            # The names are listed by their order, which is not needed for that.
            self._places = {}
            named = [found for name in self._names() if (found := self._named(name)) is not None]
            is_open = any(one.repeated_s for one in named) or places.may_be_wrong(named)
            changes = self._changes() if is_open else {}
            self._places = places.places_of(named, self.choice.counter, changes, latest_of(time.time()))
            if wrong := places.wrong_words(named, self._places):
                self._remark("wrong", wrong)
        return self._places.get(path)

    def date(self, samples: Samples, path: str, mtime: float | None, *, whole: bool = True) -> Samples:
        """Return the samples of a file, at a settled rate, with start and elapsed time, None where not known.

        Args:
            samples: of the whole file, or of the part that is there where it is not ``whole``.
            path: of the file.
            mtime: time of its last change, s since 1970 UTC.
            whole: the file will not grow.

        Raises:
            UndatedError: other files must be seen first, or they contradict this one.
        """
        if self.choice.by is None:
            self._choose(samples, path)
        choice = self.choice
        length = samples.values.shape[1] / samples.known_rate
        ended = mtime - length if mtime is not None and whole else None
        if choice.by == "count" and samples.start is not None and choice.start is None:
            # Nothing dates the source, but this file states its date.
            return self._by_header(samples, samples.start, path, ended)
        if choice.by == "count":
            return self._counted(samples, path, length, whole)
        if choice.by == "mtime":
            start = None if mtime is None else mtime - length
            return samples.changed(start=start, elapsed=None, joins=False, stated=TimeStatement("mtime"))
        if choice.by == "name":
            samples = self._by_name(samples, path, ended)
        elif choice.by == "header":
            stamp = None if samples.start is not None else self._header_stamp(samples, path)
            start = samples.start if stamp is None else self.order.resolve(stamp, path)
            if stamp is None and start is not None:
                self.order.wait_for_open(path)
            samples = replace(samples, start=None) if start is None else self._by_header(samples, start, path, ended)
        if samples.start is None and choice.by in ("header", "name"):
            samples = self._undated(samples, path, ended)
        return samples

    def _undated(self, samples: Samples, path: str, ended: float | None) -> Samples:
        """Estimate the start of a file that states none between those around it, where these are known."""
        place = self._by_starts.get(path)
        if place is not None and place.placed_s is not None:
            start, stated = place.placed_s, TimeStatement("between", margin_s=place.margin_s, is_stated=False)
        else:
            # The last change follows a copy: the judge knows whether it goes with the clock.
            start, stated = None, TimeStatement("order", is_stated=False, witnesses=lags_from(0.0, {"mtime": ended}))
        self._remark("undated", f"{path} has no date in its {self.choice.by}: the time of its blocks is estimated")
        return samples.changed(start=start, elapsed=None, joins=False, stated=stated)

    def _by_name(self, samples: Samples, path: str, ended: float | None) -> Samples:
        """Date a file by its name; ``ended`` is its last change less its length."""
        stamp = self._name_stamp(path)
        start = None if stamp is None else self.order.resolve(stamp, path)
        stated = None
        if stamp is not None and start is not None:
            stated = by_name(stamp, start, self._spec.timezone, {"header": samples.start, "mtime": ended})
            place = self._place(path)
            if place is not None:
                stated = places.placed(stated, place)
        elif samples.start is not None:
            return self._by_header(samples, samples.start, path, ended)
        elif (day := self._day(path)) is not None:
            start, stated = day, TimeStatement("folder", DAY)
        return samples.changed(start=start, elapsed=None, joins=False, stated=stated)

    def _by_header(self, samples: Samples, start: float, path: str, ended: float | None) -> Samples:
        """Date a file by its header; ``ended`` is its last change less its length."""
        named = self._name_stamp(path) if samples.number == 1 else None
        others: Witnesses = {"name": None if named is None else named.fixed, "mtime": ended}
        day = self._day(path) if named is None else None
        if day is not None and not day - _MAX_OFFSET_S <= start <= day + DAY + _MAX_OFFSET_S:
            others["folder"] = day
        stated = by_header(samples, start, self._spec.timezone, others)
        if (place := self._by_starts.get(path)) is not None:
            stated = places.placed(stated, place)
        doubt = stamp_doubt(start, samples.values.shape[1] / samples.known_rate, stated)
        if doubt is not None:
            self._remark("stamps", f"{path}: {doubt}; time_from says which dates its blocks")
        return samples.changed(start=start, stated=stated)

    def take_starts(self, files: Iterable[tuple[str, Samples, float | None]]) -> None:
        """Take what the headers of all files state, in their order, where no others will come.

        What does not fit its neighbours is placed between them from then on.

        Args:
            files: path, samples and time of the last change of each, s since 1970 UTC.
        """
        found: list[NamedTime] = []
        self._by_starts = {}
        for path, samples, changed in files:
            with contextlib.suppress(UndatedError):
                dated = self.date(samples, path, changed)
                if dated.stated is None or dated.stated.source == "count" or not dated.stated.is_stated:
                    found.append(NamedTime(path, 0.0, 0.0, path))
                elif dated.start is not None:
                    found.append(NamedTime(path, dated.start, dated.stated.repeated_s, path))
        self._by_starts = places.places_in_order(found, latest_of(time.time()))
        wrong = [one for one in found if one.time and one.path in self._by_starts]
        if words := places.wrong_words(wrong, self._by_starts):
            self._remark("wrong", words)

    def note_own(self, name: str, start: float | None) -> None:
        """Remark which keys are not used because the files of a data set state their time."""
        spec = self._spec
        keys = {"time_from": spec.time_from, "time_name": spec.time_name, "interval_s": spec.interval}
        keys["start_utc"] = None if start is None else spec.start
        unused = [key for key, value in keys.items() if value is not None]
        if unused:
            self._remark("own", f"{', '.join(unused)} not used: files of {name} state their time")

    def place_time(self, sequence: int, length: float) -> tuple[float | None, float] | None:
        """Return start and elapsed time of a block of ``length`` s that is counted by its number, else None."""
        choice = self.choice
        if choice.by != "count" or choice.group is not None or choice.step is None or not self._several:
            return None
        if length > choice.step * (1.0 + _LENGTH_TOLERANCE):
            self._remark_long(f"block {sequence}", length, choice.step)
            return None
        elapsed = (sequence - 1) * choice.step
        return (None if choice.start is None else choice.start + elapsed), elapsed

    def depends_on_order(self, samples: Samples) -> bool:
        """Return whether the order of day and month in headers must be told over all files."""
        return self.choice.by == "header" and samples.start is None and samples.stamp is not None

    def check_names(self) -> None:
        """Resolve the dates in all names; UndatedError where they leave the order of day and month open."""
        if self.choice.by == "name":
            for path in self._names():
                stamp = self._name_stamp(path)
                if stamp is not None:
                    self.order.resolve(stamp, path)

    def _header_stamp(self, samples: Samples, path: str) -> Stamp | None:
        """Return the open stamp of a header, by the order that its name or the folders above confirm."""
        stamp = None if samples.stamp is None else read_stamp(samples.stamp, self._spec.timezone)
        if stamp is None:
            return None
        named = self._name_stamp(path)
        other = None if named is None else named.fixed
        other = self._day(path) if other is None else other
        if other is None:
            return stamp
        near: list[Order] = [
            order for order in stamp.orders if abs((stamp.at(order) or 0.0) - other) <= DAY + _MAX_OFFSET_S
        ]
        return stamp.only(near)

    def _name_stamp(self, path: str) -> Stamp | None:
        return stamp_in_name(self._above + path, self._spec.timezone, self._spec.time_name)

    def _day(self, path: str) -> float | None:
        stamp = day_in_folders(self._above + path, self._spec.timezone)
        return None if stamp is None else stamp.fixed

    def _set(self, choice: Dating) -> None:
        self._keep(choice)
        if (choice.by, choice.order, choice.counter) != (self.choice.by, self.choice.order, self.choice.counter):
            self._places = None
        self.choice = choice

    def _remark(self, kind: str, text: str) -> None:
        if kind not in self.remarks:
            self.remarks[kind] = printable(text)
            _LOG.warning("source %s: %s", self._spec.name, self.remarks[kind])

    def _remark_long(self, what: str, length: float, step: float) -> None:
        self._remark("long", f"{what} has {length:g} s, but {step:g} s lie between two starts: it has no date; "
                             "give interval_s")  # fmt: skip

    def _choose(self, samples: Samples, path: str) -> None:
        """Make the choice at a file that could be read."""
        spec, by = self._spec, wanted_by(self._spec)
        if by is None:
            by = "count"
            if samples.start is not None or samples.stamp is not None:
                by = "header"
            elif self._states_time(path) or (not self._several and self._day(path) is not None):
                by = "name"
        order = spec.date_order if by in ("header", "name") else None
        choice = Dating(by, order=order, decided_by=None if order is None else "configuration", example=path)
        if by == "name":
            self.choice = choice = replace(choice, pattern=spec.time_name)
            named = [found for name in {path, *self._names()} if (found := self._named(name)) is not None]
            choice = replace(choice, counter=places.counter_in(named))
        elif by == "count":
            choice = self._count_choice(choice, samples, path)
        self._set(choice)
        _LOG.info("source %s: blocks are dated %s", spec.name, choice.describe())
        if by != "count" and spec.start is not None:
            self._remark("start_utc", f"start_utc is not used: blocks are dated {choice.describe()}")
        if by == "count" and spec.start is None and self._several:
            self._remark(
                "nothing",
                f"nothing dates its blocks (no date in header or name of {path}, no start_utc): seconds are counted "
                f"from the first block, {choice.describe()}; give start_utc, and interval_s if files are further apart",
            )

    def _count_choice(self, choice: Dating, samples: Samples, path: str) -> Dating:
        spec = self._spec
        step = spec.interval
        block = None if spec.block_s == "file" or not self._cut else spec.block_s
        if step is not None and block is not None and math.isclose(step, block):
            # Blocks that follow each other are the default of files that are cut.
            step = None
        choice = replace(choice, start=spec.start, interval=spec.interval, step=step)
        if not self._several:
            return choice
        found = place_in_names(path, [*self._names()])
        if found is not None:
            group, numbers, first = found
            return replace(choice, group=group, numbers=numbers, first=first, folder=folder_of(path))
        if step is None:
            rate, count = samples.known_rate, samples.values.shape[1]
            step = (count if block is None else max(1, round(block * rate))) / rate
        return replace(choice, step=step)

    def _counted(self, samples: Samples, path: str, length: float, whole: bool) -> Samples:
        """Date a file by the number in its name; one that is counted by its blocks is left as it is."""
        choice = self.choice
        if not self._several:
            return samples.changed(start=choice.start, elapsed=0.0, stated=COUNTED)
        if samples.start is not None and self._spec.time_from is None:
            self._remark("header", f"{path} states {utc_text(samples.start)}, but blocks are dated {choice.describe()}")
        if choice.group is None:
            return _without_time(samples)
        found = numbers_of(path)
        if len(found) != choice.numbers or folder_of(path) != choice.folder:
            self._remark("undated", f"{path} has no number like {choice.example}: its blocks have no date")
            return _without_time(samples)
        number, example = found[-choice.group].value, numbers_of(choice.example)
        if path != choice.example and number == example[-choice.group].value and found != example:
            raise UndatedError(
                f"{path}: has number {number} like {choice.example}, so another number of the names counts; "
                f"choose again by: spallwatch redate {self._spec.name}"
            )
        place, before = number - choice.first, choice.step
        step = self._settled_step(path, length, whole)
        if place and before is not None and step != before:
            self._remark("grew", f"{path} had {before:g} s when its end seemed to be seen, and now has {length:g} s: "
                                 "its first blocks are dated too early; give interval_s")  # fmt: skip
        if step is None and place:
            raise UndatedError(f"{path}: waits for its end: its length is the time between files")
        if step is not None and length > step * (1.0 + _LENGTH_TOLERANCE):
            self._remark_long(path, length, step)
            return _without_time(samples)
        elapsed = place * (step or 0.0)
        start = None if choice.start is None else choice.start + elapsed
        return samples.changed(start=start, elapsed=elapsed, joins=False, stated=COUNTED)

    def _settled_step(self, path: str, length: float, whole: bool) -> float | None:
        """Return the time between files, chosen at the first whole one; None before.

        A growing file that is whole because it did not change for long may grow again; the next one ends it.
        """
        choice = self.choice
        if choice.growing not in ("", path):
            self._set(replace(choice, step=choice.step or choice.grown, growing="", grown=None))
        elif whole and not choice.growing and choice.step is None:
            self._set(replace(choice, step=length))
        elif (choice.growing and length != choice.grown) or (choice.step is None and (whole or not choice.growing)):
            # Kept, so that after a restart the next file need not wait for another one.
            self._set(replace(choice, step=length if whole else None, growing=path, grown=length))
        return self.choice.step


def _without_time(samples: Samples) -> Samples:
    """Return samples that have no time of their own and are not joined by it."""
    return samples.changed(start=None, elapsed=None, joins=False, stated=None)

"""What a row of numbers is, told by its name, its unit and its shape: vibration, or something recorded beside it.

Name and unit alone may mislead in both directions; a row that runs on without turning back is never vibration, whatever
it is called.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from streams.files.judge import Start, judge_rate, judge_start
from streams.files.keys import SPEED_UNITS, UNIT_IN_NAME
from streams.files.statements import StatedNumber, multiple_of
from streams.files.time_column import UNITS_OF_TIME, TimeColumn, column_statements, time_column
from streams.types.block import VELOCITY
from streams.types.samples import DIGITAL, ReaderError, Samples
from streams.types.spec import UNITS, ChannelSpec
from streams.types.stamps import Stamp, utc_text

Kind = Literal["vibration", "speed", "load", "tacho", "time", "index", "other"]

_MAX_LOOKED = 1 << 16
"""Samples whose shape is looked at."""
_MIN_EVEN, _MIN_RUNNING, _MIN_SLOW = 8, 64, 64
"""Samples from which on a constant step, a run of any steps, and a slow change are evidence."""
_MIN_LEVELS = 16
_SAME_STEP = 1e-3
_MAX_HELD, _MAX_SMOOTH, _FAR, _MAX_STATES = 0.05, 1e-3, 3.0, 8
"""A process value changes between few samples, or little from one to the next, and is this many SD from 0, or has few
levels."""
_WORDS = re.compile(r"[a-zäöüµμ]+|\d+")
_SECONDS = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "sekunden": 1.0, "secondi": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millis": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "usec": 1e-6, "micros": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nsec": 1e-9, "nanos": 1e-9, "nanosecond": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0, "d": 86400.0, "day": 86400.0, "days": 86400.0,
}  # fmt: skip
_TIME_WORDS = {
    *("time", "times", "timestamp", "timestamps", "stamp", "zeit", "zeiten", "zeitstempel", "uhrzeit", "tempo"),
    *("temps", "tiempo", "epoch", "unix", "unixtime", "posix", "clock", "datetime", "elapsed", "ticks", "xvalue"),
    *("millis", "micros", "nanos"),
}
_INDEX_WORDS = {
    *("index", "idx", "indices", "number", "nr", "no", "num", "lfd", "counter", "count", "zähler", "zaehler", "seq"),
    *("sequence", "sample", "samples", "samplenumber", "sampleno", "point", "points", "row", "line", "messpunkt"),
    *("indice", "numero", "campione", "scan", "record"),
}
_FILLERS = {
    "utc",
    "local",
    "since",
    "start",
    "rel",
    "relative",
    "abs",
    "absolute",
    "of",
    "in",
    "the",
    "x",
    "value",
    "1970",
}
_LETTERS = {"t": "time", "ts": "time", "i": "index", "n": "index"}
_JOINED = re.compile(r"^(time|times|timestamp|zeit|epoch|t)(?:in)?_?(s|sec|seconds|ms|us|µs|ns)$")
_SPEEDS = re.compile(r"rpm|\bspeed|drehzahl|tacho|umdrehung|1/min|min-1|min\^-1|\bgiri|tr/min", re.IGNORECASE)
_LOADS = re.compile(r"\bload|\bforce|kraft|\blast\b", re.IGNORECASE)
_OTHERS = re.compile(
    r"temp|°|\bdegc\b|current|strom|druck|press|\bbar\b|humid|feuchte|torque|moment|counter|\bindex\b|\bsample\b|\bnr\b"
    r"|\bno\.?\b|\bpower|leistung|\bflow\b|durchfluss|potenza|pressione|coppia|battery|\bstatus\b",
    re.IGNORECASE,
)

_PROCESS = re.compile(
    r"temp(?:erat|[\W_\d]|$)|humid|feuchte|(?:luft|öl)druck|pressure|pressione|torque|drehmoment|leistung|battery",
    re.IGNORECASE,
)
"""Names that hold whatever unit a file states for all its rows."""


@dataclass(frozen=True)
class ColumnKind:
    """What a row is, and in words by what evidence; "" where nothing speaks against vibration."""

    kind: Kind
    evidence: str = ""


def kind_of(title: str, unit: str, values: NDArray[np.floating]) -> ColumnKind:
    """Return what a row is.

    Args:
        title: its name in the file; a path of groups counts by its last part.
        unit: as the file spells it, "" where it states none.
        values: shape (sample,).
    """
    name, behind = _split(re.split(r"[/.]", title)[-1])
    run, called = running(values), _called(name, unit or behind)
    own = multiple_of(unit)[0] in UNITS
    if run is None and called is not None and 1 < values.size < _MIN_EVEN and np.all(np.diff(values) > 0.0):
        run = "rises"
    if run is not None and called == "time":
        return ColumnKind("time", f"is called {name!r} and {run}")
    if run is not None:
        return ColumnKind("index", f"{run}, as times or running numbers do")
    if called is not None and not own and name.lower() not in _LETTERS:
        return ColumnKind("other", f"is called {name!r}, which is no vibration")
    words = f"{title} {unit or behind}"
    if _SPEEDS.search(words):
        return ColumnKind("speed", "a speed by its name or unit")
    if _LOADS.search(words) or unit in ("N", "kN"):
        return ColumnKind("load", "a load by its name or unit")
    if unit and not own:
        return ColumnKind("other", f"is in {unit}, no unit of acceleration or velocity")
    if _PROCESS.search(title.rpartition("/")[2]) or (not own and _OTHERS.search(words)):
        return ColumnKind("other", f"is called {name!r}, which is no vibration")
    return ColumnKind("vibration")


def _split(title: str) -> tuple[str, str]:
    """Return a title without the unit behind it, and that unit, "" for none."""
    match = UNIT_IN_NAME.match(title)
    return (title.strip(), "") if match is None else (match[1].strip(), match[2].strip())


def _called(name: str, unit: str) -> Literal["time", "index"] | None:
    """Return whether a name is that of times or running numbers, as a whole."""
    plain = name.lower().strip()
    if plain in _LETTERS:
        return "time" if _LETTERS[plain] == "time" else "index"
    if _JOINED.match(plain):
        return "time"
    words = set(_WORDS.findall(plain.replace("_", " ")))
    rest = words - _FILLERS - _SECONDS.keys()
    if rest and rest <= _TIME_WORDS:
        return "time"
    if rest and rest <= _INDEX_WORDS | _TIME_WORDS:
        return "index"
    return "time" if words and not rest and unit.lower() in _SECONDS and words & {"x"} else None


@lru_cache(maxsize=256)
def _is_called_time(title: str) -> bool:
    return _called(*_split(re.split(r"[/.]", title)[-1])) == "time"


def counted_in(title: str, unit: str) -> TimeColumn:
    """Return what a row of times counts, by its unit, which a file may state for all rows, or its name."""
    name, behind = _split(re.split(r"[/.]", title)[-1])
    by_unit, by_name = (UNITS_OF_TIME.get(text.lower()) for text in (re.split(r"\s+since\b", unit)[0], behind))
    named = time_column(name)
    return TimeColumn(title, by_unit or by_name or (None if named is None else named.size))


def hertz_in(title: str, unit: str) -> float | None:
    """Return the Hz in one of a speed, 1/60 for rpm, by its unit or its name; None where neither states it."""
    for words in (unit.lower(), title.lower()):
        # "Drehzahl" is not in Hz.
        for spelling, size in SPEED_UNITS.items():
            if re.search(rf"(?<![a-z]){re.escape(spelling)}(?![a-z])", words):
                return size
    return 1.0 / 60.0 if "giri/min" in title.lower() else None


def running(values: NDArray[np.floating]) -> str | None:
    """Return in words that a row runs on in one direction, also one that begins anew at a limit; None where it turns.

    Equal steps are evidence from 8 samples on, others from 64 and 16 different values; so much vibration turns back.
    """
    # Of nearly all rows the first samples decide.
    begin = values[:_MIN_RUNNING]
    up, down = np.count_nonzero(begin[1:] > begin[:-1]), np.count_nonzero(begin[1:] < begin[:-1])
    if begin.size < _MIN_EVEN or min(up, down) > (begin.size - 1) // 4:
        return None
    row = np.asarray(values[:_MAX_LOOKED], dtype=np.float64)
    if not np.isfinite(row).all():
        return None
    steps = np.diff(row)
    way = 1.0 if np.count_nonzero(steps > 0.0) >= np.count_nonzero(steps < 0.0) else -1.0
    ahead, back = way * steps, way * steps < 0.0
    word = "rises" if way > 0.0 else "falls"
    if not back.any():
        mean = float(ahead.mean())
        even = mean > 0.0 and float(np.max(np.abs(ahead - mean))) <= _SAME_STEP * mean
        if even:
            return f"{word} by {mean:.6g} at each sample"
        levels = np.count_nonzero(ahead) + 1
        many = row.size >= _MIN_RUNNING and levels >= _MIN_LEVELS
        return f"{word} from {row[0]:.9g} to {row[-1]:.9g} without turning back" if many else None
    return _wrapping(row, ahead, back, word)


def _wrapping(row: NDArray[np.float64], ahead: NDArray[np.float64], back: NDArray[np.bool_], word: str) -> str | None:
    """Return that a row runs on but begins anew at a limit, None where it does not."""
    span = float(np.ptp(row))
    onward = ahead[~back]
    few = np.count_nonzero(back) * _MIN_EVEN <= ahead.size and row.size >= _MIN_RUNNING
    if not few or np.any(ahead[back] > -0.5 * span) or np.any(onward > 0.25 * span):
        return None
    # Of a pulse or a step most samples stay where they are.
    if np.count_nonzero(onward) * 2 < onward.size:
        return None
    return f"{word} and begins anew {np.count_nonzero(back)} times"


def _process_words(values: NDArray[np.floating], *, switches: bool) -> str | None:
    """Return in words that a row without a name changes as process values do, None where it does not.

    ``switches``: also rows of few levels, which may be of a tacho.
    """
    row = np.asarray(values[:_MAX_LOOKED], dtype=np.float64)
    if row.size < _MIN_SLOW or not np.isfinite(row).all():
        return None
    deviation, steps = float(row.std()), np.diff(row)
    if deviation == 0.0:
        return None
    held = np.count_nonzero(steps) <= _MAX_HELD * steps.size
    if held and (levels := np.unique(row).size) <= _MAX_STATES:
        return f"has {levels} levels and changes seldom" if switches else None
    smooth = held or float(np.mean(steps**2)) <= 2.0 * _MAX_SMOOTH * deviation**2
    if smooth and abs(float(row.mean())) >= _FAR * deviation:
        return f"changes slowly around {row.mean():.4g}, as a process value does"
    return None


def kinds_of(
    titles: Sequence[str], units: Sequence[str], rows: Sequence[NDArray[np.floating]], *, switches: bool = True
) -> list[ColumnKind]:
    """Return what each of the rows of a file is; arguments as :func:`kind_of`.

    A row that nothing names and that changes as a process value is vibration only where there is no other; without
    ``switches``, one of few levels is. Where no row is vibration by name and unit, those without a unit are that do not
    run on. A velocity beside accelerations is most often their integral, and no sensor.
    """
    found = [kind_of(title, unit, row) for title, unit, row in zip(titles, units, rows, strict=True)]
    own = {unit for kind, unit in zip(found, units, strict=True) if kind.kind == "vibration"}
    if VELOCITY in own and own & {"g", "m/s2", "V"}:
        integral = ColumnKind("other", f"is in {VELOCITY} beside accelerations: a velocity")
        found = [integral if unit == VELOCITY else kind for kind, unit in zip(found, units, strict=True)]
    shapes = [
        _process_words(row, switches=switches) if kind.kind == "vibration" and not unit else None
        for kind, unit, row in zip(found, units, rows, strict=True)
    ]
    if any(kind.kind == "vibration" and words is None for kind, words in zip(found, shapes, strict=True)):
        found = [
            kind if words is None else ColumnKind("other", words) for kind, words in zip(found, shapes, strict=True)
        ]
    if not any(kind.kind == "vibration" for kind in found):
        found = [
            ColumnKind("vibration") if kind.kind == "other" and not (unit or _PROCESS.search(title)) else kind
            for kind, title, unit in zip(found, titles, units, strict=True)
        ]
    return found


def vibration_rows(samples: Samples, where: str, *, is_ours: bool = False) -> list[int]:
    """Return the rows of a file that are taken where no channel is configured: those of vibration.

    ``is_ours``: the data set says that all are, but for those that are on or off.

    Raises:
        ReaderError: ``wrong_shape`` where there is none; it says what each row is.
    """
    # A row of truth values is of a tacho or a switch.
    numbers = [row for row, stored in enumerate(samples.stored) if stored != DIGITAL]
    if not numbers:
        raise ReaderError("wrong_shape", f"{where}: holds only rows that are on or off, and no vibration")
    if is_ours:
        return numbers
    titles, units = [samples.names[row] for row in numbers], [samples.units[row] or "" for row in numbers]
    found = kinds_of(titles, units, [samples.values[row] for row in numbers], switches=False)
    kinds = [kind.kind for kind in found]
    if "vibration" in kinds:
        return [row for row, kind in zip(numbers, kinds, strict=True) if kind == "vibration"]
    # The check of their units says what they are in.
    kept = [row for row, kind in zip(numbers, kinds, strict=True) if kind not in ("time", "index")]
    if not kept:
        seen = "; ".join(f"{title} {kind.evidence}" for title, kind in zip(titles, found, strict=True))
        raise ReaderError("wrong_shape", f"{where}: holds no vibration: {seen[:600]}")
    return kept


def refuse_running(samples: Samples, channels: Sequence[ChannelSpec], where: str) -> None:
    """Refuse a configured channel of vibration that runs on: times, a running number or a counter.

    ``samples`` has the rows of the ``channels``; those that are passed on in any unit may be anything.

    Raises:
        ReaderError: ``wrong_shape``, with what the row does.
    """
    for channel, title, row in zip(channels, samples.names, samples.values, strict=True):
        run = None if channel.any_unit else running(row)
        if run is not None:
            raise ReaderError(
                "wrong_shape",
                f"{where}: channel {channel.name}: {title} {run}, as times or running numbers do; expected vibration",
            )


def with_times(samples: Samples, where: str) -> Samples:
    """Add the rate and the start that rows of times state, which stay among the rows.

    A row is one of times by its name and because it rises; see :func:`streams.files.time_column.column_statements`.

    Raises:
        ReaderError: ``wrong_rate`` where the times are not even, or the file states another rate; ``nan``;
            ``unreadable`` where it states another start.
    """
    rates: list[StatedNumber] = []
    starts: list[Start] = []
    for title, unit, row in zip(samples.names, samples.units, samples.values, strict=True):
        if not _is_called_time(title) or kind_of(title, unit or "", row).kind != "time":
            continue
        column = counted_in(title, unit or "")
        stated, begins = column_statements(column, row, where)
        rates += stated
        starts += begins
    if not rates and not starts:
        return samples
    if samples.rate is not None:
        rates.append(StatedNumber("the file", f"{samples.rate:g} Hz", (samples.rate,)))
    if samples.start is not None:
        starts.append(Start("the file", Stamp(utc_text(samples.start), samples.start, samples.start, local=True)))
    rate, start = judge_rate(rates, where), judge_start(starts, where)
    return replace(
        samples,
        **rate.fields,
        start=start.value,
        stamp=start.opened or (samples.stamp if start.value is None else None),
    )

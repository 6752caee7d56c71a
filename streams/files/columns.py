"""What a row of numbers is, told by its name, its unit and its shape: vibration, or something recorded beside it.

Name and unit alone may mislead in both directions; a row that runs on without turning back is never vibration, whatever
it is called.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from streams.files.abscissa import (
    abscissa_called,
    abscissa_of,
    column_statements,
    is_even,
    refuse_lost_rows,
    refuse_spectrum,
    running,
    split_unit,
)
from streams.files.judge import Start, judge_rate, judge_start
from streams.files.keys import SPEED_UNITS
from streams.files.statements import StatedNumber, multiple_of
from streams.types.block import VELOCITY
from streams.types.samples import DIGITAL, ReaderError, Samples
from streams.types.spec import UNITS, ChannelSpec
from streams.types.stamps import Stamp, utc_text

Kind = Literal["vibration", "speed", "load", "tacho", "time", "index", "other"]

_MAX_LOOKED = 1 << 16
"""Samples whose shape is looked at."""
_MIN_EVEN, _MIN_SLOW = 8, 64
"""Samples from which on a constant step, and a slow change, are evidence."""
_MAX_HELD, _MAX_SMOOTH, _FAR, _MAX_STATES = 0.05, 1e-3, 3.0, 8
"""A process value changes between few samples, or little from one to the next, and is this many SD from 0, or has few
levels."""
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


_COMPUTED = re.compile(
    r"(?<![a-z])(?:rms|peak|crest|kurtosis|envelope|filtered|absolute|magnitude|resultant|vector[ _]?sum|fft|spectrum"
    r"|hüllkurve|gefiltert|betrag|effektivwert|spitzenwert|mittelwert|enveloppe|inviluppo)(?![a-z])",
    re.IGNORECASE,
)
"""Names of what a logger computes of vibration and writes beside it."""


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
    name, behind = split_unit(re.split(r"[/.]", title)[-1])
    axis, run = abscissa_called(name if not behind else f"{name} [{behind}]", unit), running(values)
    own = multiple_of(unit)[0] in UNITS
    if run is None and axis.is_named and 1 < values.size < _MIN_EVEN and np.all(np.diff(values) > 0.0):
        run = "rises"
    if run is not None and axis.kind == "time" and (axis.is_named or is_even(values)):
        return ColumnKind("time", f"is called {name!r} and {run}" if axis.is_named else f"{run}, in a unit of time")
    if run is not None:
        return ColumnKind("index", f"{run}, as times or running numbers do")
    if axis.is_named and not own and len(name) > 2:
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


def hertz_in(title: str, unit: str) -> float | None:
    """Return the Hz in one of a speed, 1/60 for rpm, by its unit or its name; None where neither states it."""
    for words in (unit.lower(), title.lower()):
        # "Drehzahl" is not in Hz.
        for spelling, size in SPEED_UNITS.items():
            if re.search(rf"(?<![a-z]){re.escape(spelling)}(?![a-z])", words):
                return size
    return 1.0 / 60.0 if "giri/min" in title.lower() else None


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


def _other_words(title: str, unit: str, row: NDArray[np.floating], *, switches: bool) -> str | None:
    """Return in words why a row that name and unit allow to be vibration may be none, None where nothing says so."""
    computed = _COMPUTED.search(title.replace("_", " "))
    if computed is not None:
        return f"is computed by its name ({computed[0]})"
    return None if unit else _process_words(row, switches=switches)


def kinds_of(
    titles: Sequence[str], units: Sequence[str], rows: Sequence[NDArray[np.floating]], *, switches: bool = True
) -> list[ColumnKind]:
    """Return what each of the rows of a file is; arguments as :func:`kind_of`.

    A row that nothing names and that changes as a process value, and one that is computed by its name, is vibration
    only where there is no other; without ``switches``, one of few levels is. Where no row is vibration by name and
    unit, those without a unit are that do not run on. A velocity beside accelerations is most often their integral,
    and no sensor.
    """
    found = [kind_of(title, unit, row) for title, unit, row in zip(titles, units, rows, strict=True)]
    own = {unit for kind, unit in zip(found, units, strict=True) if kind.kind == "vibration"}
    if VELOCITY in own and own & {"g", "m/s2", "V"}:
        integral = ColumnKind("other", f"is in {VELOCITY} beside accelerations: a velocity")
        found = [integral if unit == VELOCITY else kind for kind, unit in zip(found, units, strict=True)]
    shapes = [
        _other_words(title, unit, row, switches=switches) if kind.kind == "vibration" else None
        for kind, title, unit, row in zip(found, titles, units, rows, strict=True)
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

    A row is one of times by its name and because it rises; see :func:`streams.files.abscissa.column_statements`.

    Raises:
        ReaderError: ``wrong_rate`` where the times are not even, a running number leaves some out, or the file states
            another rate; ``nan``; ``unreadable`` where it states another start.
    """
    rates: list[StatedNumber] = []
    starts: list[Start] = []
    for title, unit, row in zip(samples.names, samples.units, samples.values, strict=True):
        axis = abscissa_called(re.split(r"[/.]", title)[-1], unit or "")
        found = abscissa_of(axis.title, unit or "", row)
        refuse_spectrum(found, where)
        if found is None:
            refuse_lost_rows(axis, row, where)
        if axis.kind != "time" or kind_of(title, unit or "", row).kind != "time":
            continue
        stated, begins = column_statements(replace(axis, title=title), row, where)
        rates += stated
        starts += begins
    if not rates and not starts:
        return samples
    if samples.rate is not None:
        rates.append(StatedNumber("the file", f"{samples.rate:g} Hz", (samples.rate,)))
    elif samples.rate_readings:
        opened = (samples.rate_written, samples.rate_readings, samples.rate_resolution)
        rates.append(StatedNumber("the file", *opened, is_exact=False))
    if samples.start is not None:
        starts.append(Start("the file", Stamp(utc_text(samples.start), samples.start, samples.start, local=True)))
    rate, start = judge_rate(rates, where), judge_start(starts, where)
    return replace(
        samples,
        **rate.fields,
        start=start.value,
        stamp=start.opened or (samples.stamp if start.value is None else None),
    )

"""Columns that no sensor gives: times, running numbers, frequencies; what times say of rate and start."""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from streams.files.judge import Start
from streams.files.keys import TIME_UNITS, UNIT_IN_NAME
from streams.files.statements import StatedNumber, is_of_vibration, nice_rate, plain_unit
from streams.types import large
from streams.types.large import contiguous, elementwise, forget_pages, is_any
from streams.types.samples import ReaderError
from streams.types.stamps import Stamp, epoch_seconds, utc_text

AbscissaKind = Literal["time", "index", "frequency"]

_MAX_LOOKED = 1 << 16
"""Samples whose shape is looked at."""
_MIN_EVEN, _MIN_RUNNING, _MIN_LEVELS = 8, 64, 16
"""Samples from which on a constant step, and a run of any steps over so many values, are evidence."""
_TIMES = frozenset(("time", "times", "timestamp", "timestamps", "stamp", "zeit", "zeiten", "zeitstempel", "zeitpunkt",
                     "uhrzeit", "tempo", "temps", "tiempo", "tijd", "epoch", "unix", "posix", "clock", "datetime",
                     "elapsed", "xvalue", "時間", "時刻", "経過時間"))  # fmt: skip
_NUMBERS = frozenset(("index", "idx", "indices", "number", "nr", "no", "num", "lfd", "counter", "count", "zahler",
                      "seq", "zaehler", "sequence", "indice", "numero", "nummer", "ticks", "id", "番号"))  # fmt: skip
_COUNTED = frozenset(("sample", "samples", "point", "points", "punkt", "row", "line", "zeile", "messpunkt", "campione",
                      "scan", "record"))  # fmt: skip
"""What a number may be that of, and a time the time of."""
_FILLERS = frozenset(("utc", "local", "since", "start", "rel", "relative", "abs", "absolute", "of", "in", "the", "x",
                      "value", "offset", "1970"))  # fmt: skip
_FREQUENCIES = frozenset(("frequency", "frequencies", "freq", "frequenz", "frequence", "frequenza", "frecuencia", "f",
                          "cpm", "order", "周波数"))  # fmt: skip
_FREQUENCY_UNITS = ("hz", "khz", "cpm", "order", "orders")
_ORIGINS = ("", "-", "unix", "utc", "epoch", "ole", "ole2", "oledate", "excel", "serial", "datenum", "matlab")
_LETTERS = {"t": "time", "ts": "stamp", "i": "index", "n": "index"}
_KNOWN = _TIMES | _NUMBERS | _COUNTED | _FILLERS | TIME_UNITS.keys() - {"s", "h", "d"} | {"sec", "seconds"}
_PARTS = re.compile("|".join(sorted(_KNOWN, key=len, reverse=True)))
_MOST_UNCERTAIN, _MIN_FITTED = 5e-5, 256
"""Relative uncertainty from which times state no rate; times from which their slope is fitted."""
_LEAST_RATE = 50.0
"""Hz, least rate of vibration of bearings: times without a unit that give less are in another one."""
_MAX_RATE = 2e6
"""Hz above which times without a unit are in another one."""
_WORD = re.compile(r"[^\W\d_]+|\d+")
_CAPITAL = re.compile(r"(?<=[a-z])(?=[A-Z][a-z])")


@dataclass(frozen=True)
class Abscissa:
    """What a name and a unit say of a column.

    Attributes:
        title: in the file.
        kind: None where they name none.
        is_named: the name has no other meaning; else only the shape decides.
        size: s of one unit of times, None where nothing states it.
    """

    title: str
    kind: AbscissaKind | None = None
    is_named: bool = False
    size: float | None = None


def split_unit(title: str) -> tuple[str, str]:
    """Return a title without the unit in brackets behind it, and that unit, "" for none."""
    match = UNIT_IN_NAME.match(title)
    return (title.strip(), "") if match is None else (match[1].strip(), match[2].strip())


@lru_cache(maxsize=1024)
def abscissa_called(title: str, unit: str) -> Abscissa:
    """Return what a column is by its title and its unit, "" where none is stated; it may stand in the title, too."""
    name, behind = split_unit(title)
    stated = [plain_unit(re.split(r"\s+since\b", text)[0]) for text in (unit, behind)]
    sizes = [TIME_UNITS[text] for text in stated if text in TIME_UNITS]
    other = [text for text in stated if text not in (*TIME_UNITS, *_ORIGINS)]
    words = _words(name)
    own = [word for word in words if plain_unit(word) in TIME_UNITS]
    size = (*sizes, *(TIME_UNITS[plain_unit(word)] for word in own), None)[0]
    if any(text in _FREQUENCY_UNITS for text in other) or (words and not own and set(words) <= _FREQUENCIES):
        return Abscissa(title, "frequency")
    # A unit of vibration may be stated of all columns of a file.
    if any(not is_of_vibration(text) for text in other) or (behind and is_of_vibration(behind)):
        return Abscissa(title, size=size)
    rest = {_LETTERS.get(word, word) if len(words) - len(own) == 1 else word for word in words if word not in own}
    rest -= _FILLERS
    if rest & _NUMBERS and rest <= _NUMBERS | _COUNTED | _TIMES:
        return Abscissa(title, "index", is_named=True)
    if rest & _TIMES and rest <= _TIMES | _COUNTED:
        return Abscissa(title, "time", is_named=True, size=size)
    if rest and rest <= _COUNTED and not sizes:
        return Abscissa(title, "index", is_named=True)
    is_timed = bool(rest & _TIMES) or bool(sizes) or (not rest and bool(own))
    return Abscissa(title, "time" if is_timed else None, size=size)


def _words(name: str) -> list[str]:
    """Return the words of a name in lower case without accents; those written as one, such as ``sampletime``, apart."""
    plain = unicodedata.normalize("NFKD", _CAPITAL.sub(" ", name)).replace("μ", "u")
    plain = unicodedata.normalize("NFC", re.sub("[\u0300-\u036f]", "", plain)).lower()
    whole = re.sub(r"[\W_]", "", plain)
    found: list[str] = []
    if whole in _TIMES:
        return [whole]
    for word in _WORD.findall(plain.replace("_", " ")):
        match = re.fullmatch(r"t([mun]s)", word)
        parts = ["t", match[1]] if match is not None else _PARTS.findall(word)
        found += parts if "".join(parts) == word else [word]
    return found


def abscissa_of(title: str, unit: str, values: NDArray[np.floating]) -> Abscissa | None:
    """Return what a column is by name, unit and shape, None where it may be a signal.

    Times are called so, or are in a unit of time, or have a name with that word, and rise by one step; a running number
    is called so or not at all and counts by ones. Frequencies rise by one step from the first or second one on.
    """
    axis = abscissa_called(title, unit)
    if axis.kind == "time":
        return axis if (is_even(values) if not axis.is_named else not turns(values)) else None
    if axis.kind == "frequency":
        return axis if is_even(values) and float(values[0]) <= 2.0 * float(values[1] - values[0]) else None
    is_unnamed = not title.strip() or title.startswith("column_")
    return Abscissa(title, "index") if (axis.kind == "index" or is_unnamed) and counts(values) else None


def refuse_spectrum(axis: Abscissa | None, where: str) -> None:
    """Raise ReaderError ``wrong_shape`` for a column of the frequencies of a spectrum."""
    if axis is not None and axis.kind == "frequency":
        raise ReaderError(
            "wrong_shape", f"{where}: {axis.title!r} rises as frequencies do: a spectrum; expected samples over time"
        )


def refuse_lost_rows(axis: Abscissa, values: NDArray[np.floating], where: str) -> None:
    """Raise ReaderError ``wrong_rate`` for a running number that counts by ones but leaves numbers out."""
    if axis.kind != "index" or not axis.is_named or len(values) < _MIN_EVEN:
        return
    with np.errstate(invalid="ignore"):
        steps = np.diff(contiguous(values, np.float64))
    jumps = np.flatnonzero(steps != 1.0)
    ahead = steps[jumps]
    if 2 * jumps.size >= steps.size or np.any(ahead < 2.0) or np.any(ahead != np.rint(ahead)):
        return
    first, lost = float(values[jumps[0]]), float(np.sum(ahead - 1.0))
    raise ReaderError(
        "wrong_rate",
        f"{where}: {axis.title!r} goes from {first:.0f} to {first + ahead[0]:.0f}: {lost:.0f} samples are lost",
    )


def turns(values: NDArray[np.floating]) -> bool:
    """Return whether a row falls and rises as signals do: at least a fifth of its steps each."""
    looked = np.asarray(values[:_MAX_LOOKED], dtype=np.float64)
    before, behind = looked[:-1], looked[1:]
    return bool(min(np.count_nonzero(behind > before), np.count_nonzero(behind < before)) * 5 > before.size)


def counts(values: NDArray[np.floating]) -> bool:
    """Return whether a row counts by ones."""
    count = len(values)
    if count < _MIN_EVEN or float(values[-1]) - float(values[0]) != count - 1:
        return False
    return not is_any(lambda part: part[1:] != part[:-1] + 1.0, contiguous(values, np.float64))


def is_even(values: NDArray[np.floating]) -> bool:
    """Return whether numbers rise by one step, as times do and vibration never does, within their rounding."""
    count = len(values)
    if count < _MIN_EVEN or not math.isfinite(float(values[-1]) - float(values[0])):
        return False
    step = (float(values[-1]) - float(values[0])) / (count - 1)
    if step <= 0.0 or float(values[1]) < float(values[0]):
        return False
    ideal = float(values[0]) + step * np.arange(count)
    return bool(np.max(np.abs(values - ideal)) <= 0.51 * step)


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
    if back.any():
        return _wrapping(row, ahead, back, word)
    if is_even(way * row):
        return f"{word} by {float(ahead.mean()):.6g} at each sample"
    levels = np.count_nonzero(ahead) + 1
    many = row.size >= _MIN_RUNNING and levels >= _MIN_LEVELS
    return f"{word} from {row[0]:.9g} to {row[-1]:.9g} without turning back" if many else None


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


def column_statements(
    column: Abscissa, times: NDArray[np.floating], where: str
) -> tuple[list[StatedNumber], list[Start]]:
    """Return what a column of times states of rate and start.

    Times since 1970 are told by their size; other times without a unit are in s, or in ms or us where s would give a
    rate below 50 Hz, or in min, h or days, where that would be above 2 MHz: that is open then.

    Raises:
        ReaderError: ``nan``, ``wrong_rate`` where the times do not increase evenly.
    """
    place = f"the times in {column.title!r}" if column.title else "the times"
    first = float(times[0]) if len(times) else 0.0
    by_size = epoch_seconds(first)
    size = column.size or (by_size / first if by_size is not None else 1.0)
    absolute = by_size if column.size is None else _since_1970(first * column.size, column.title)
    local = False
    if column.size in (None, 86400.0) and (origin := _origin_of_days(times)) is not None:
        size, absolute, local = 86400.0, 86400.0 * (first - origin), True
    measured = _measured(_scaled(times, size), where)
    starts: list[Start] = []
    if absolute is not None:
        stamp = Stamp(utc_text(absolute), absolute, absolute, local=local, resolution=1e-3)
        starts.append(Start(place, stamp, of_rows=True))
    if measured is None:
        return [], starts
    rate, uncertainty = measured
    if uncertainty < _MOST_UNCERTAIN:
        rate, uncertainty = nice_rate(rate, uncertainty + 1e-12), 0.0
    written = f"{first:.10g}, {float(times[1]):.10g}, ..."
    is_sure = by_size is not None or local or rate <= _MAX_RATE
    if (rate >= _LEAST_RATE and is_sure) or (column.size is not None and by_size is None):
        return [StatedNumber(place, written, (rate,), uncertainty * rate, is_exact=uncertainty == 0.0)], starts
    if rate > _MAX_RATE:
        return [StatedNumber(place, written, tuple(rate / other for other in (1.0, 60.0, 3600.0, 86400.0)))], starts
    others = {1.0, 1e-3, 1e-6} if by_size is None else {1.0, 1e-3, 1e-6, by_size / first}
    return [StatedNumber(place, written, (rate, *(rate * size / other for other in sorted(others - {size}))))], []


def _since_1970(seconds: float, title: str) -> float | None:
    """Return a time since 1970, s, by its size or where its column is called so; None for any other."""
    named = re.search("epoch|unix|posix", title, re.IGNORECASE) is not None
    return seconds if named or epoch_seconds(seconds) == seconds else None


def _origin_of_days(times: NDArray[np.floating]) -> float | None:
    """Return the day 1970-01-01 of times in days of Excel or MATLAB, None for others.

    Their numbers are those of the years 1995 to 2064, and as seconds they would give a rate beyond 1 MHz.
    """
    if len(times) < 2 or not 0.0 < (float(times[-1]) - float(times[0])) / (len(times) - 1) < 1e-6:
        return None
    days = (day for day in (25569.0, 719529.0) if 9131.0 < float(times[0]) - day < 34334.0)
    return next(days, None)


def _scaled(times: NDArray[np.floating], size: float) -> NDArray[np.floating]:
    return times if size == 1.0 else elementwise(lambda part: part * size, times)


def rate_of_times(times: NDArray[np.floating], where: str) -> float | None:
    """Return the rate in Hz that a column of times in s states.

    None where there are less than two times, or their rounding leaves it uncertain by more than 5e-5 of it.

    Raises:
        ReaderError: as :func:`_measured`.
    """
    found = _measured(times, where)
    return None if found is None or found[1] >= _MOST_UNCERTAIN else nice_rate(found[0], found[1] + 1e-12)


def _measured(times: NDArray[np.floating], where: str) -> tuple[float, float] | None:
    """Return the rate of times in s, in Hz, and its relative uncertainty by their rounding; None for less than two.

    Raises:
        ReaderError: ``nan`` for a time that is no number, ``wrong_rate`` where the times do not increase evenly.
    """
    if len(times) < 2:
        return None
    values = contiguous(times, np.float64)
    if is_any(lambda part: ~np.isfinite(part), values):
        raise ReaderError("nan", f"{where}: a time is not a number")
    span = values[-1] - values[0]
    step = span / (len(values) - 1)
    if not (step > 0.0 and math.isfinite(step)):
        raise ReaderError("wrong_rate", f"{where}: the times do not increase")
    deviation, largest, unit, longest, shortest = _spread_of_times(values, step)
    if longest > max(1.5 * step, 1.01 * unit) or shortest < 0.0:
        raise ReaderError("wrong_rate", f"{where}: the times are not evenly spaced; the longest step is {longest:g} s")
    rounding = max(deviation, float(np.spacing(largest)))
    uncertainty = 2.0 * rounding / span
    if uncertainty >= _MOST_UNCERTAIN and len(values) >= _MIN_FITTED:
        # The ends alone are too coarse; the slope of all of them is finer by the root of their number.
        step, uncertainty = _slope(values), 8.0 * rounding / (span * math.sqrt(len(values)))
    return 1.0 / step, uncertainty


def _slope(times: NDArray[np.float64]) -> float:
    """Return the step in s of times by least squares."""
    place = np.arange(len(times)) - 0.5 * (len(times) - 1)
    return float(place @ (times - times[0]) / (place @ place))


def _spread_of_times(times: NDArray[np.float64], step: float) -> tuple[float, float, float, float, float]:
    """Return of times that should have one step: the largest deviation from that and the largest amount, then of the
    steps the least above 0, the largest and the least; all in s, computed piece by piece.
    """
    deviation = largest = 0.0
    unit, longest, shortest = math.inf, -math.inf, math.inf
    count = max(2, large.PIECE_BYTES // times.dtype.itemsize)
    for begin in range(0, len(times) - 1, count - 1):
        part = times[begin : begin + count]
        ideal = times[0] + step * np.arange(begin, begin + len(part))
        deviation = max(deviation, float(np.max(np.abs(part - ideal))))
        largest = max(largest, float(np.max(np.abs(part))))
        steps = np.diff(part)
        # Times written more coarsely than the sampling interval repeat themselves, then jump by one unit.
        unit = min(unit, float(np.min(steps[steps > 0.0], initial=math.inf)))
        longest, shortest = max(longest, float(np.max(steps))), min(shortest, float(np.min(steps)))
        forget_pages(times)
    return deviation, largest, unit, longest, shortest

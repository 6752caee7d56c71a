"""Pulses of a tacho as files store them: an array of times, or of counts at even steps; told by its unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from streams.files.judge import judge_rate
from streams.files.keys import PULSE_KEYS
from streams.files.statements import Facts, number_of, rate_statements, seconds_utc
from streams.turns.pulses import Pulses
from streams.types.samples import ReaderError, Samples

_SECONDS = {
    "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "µs": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "nanosecond": 1e-9,
    "nanoseconds": 1e-9, "day": 86400.0, "days": 86400.0,
}  # fmt: skip
_COUNTS = ("count", "counts", "edges", "pulses", "impulse", "1")
_UNIT_KEYS = ("unit", "units", "unitstring", "einheit")
MAX_PER_REVOLUTION = 1_000_000


def matches_pulses(pattern: str | None, *names: str) -> bool:
    """Return whether one of the names of an array matches the pattern of the pulses, None: it is not asked for."""
    return pattern is not None and any(fnmatchcase(name, pattern) for name in names)


Array = TypeVar("Array")


def sought(patterns: Sequence[str], pulses: str | None, separator: str = "/") -> tuple[str, ...]:
    """Return the patterns of arrays that are read: () where all are, else also those of pulses, or of their group."""
    if not patterns or pulses is None:
        return tuple(patterns)
    return (*patterns, pulses, f"{pulses}{separator}*")


def own_facts(own: Facts, inherited: Facts) -> Facts:
    """Return what an array of pulses states; of what is stated around it only the pulses a revolution count."""
    return {**{key: inherited[key] for key in PULSE_KEYS if key in inherited}, **own}


def only_one(found: Sequence[Array], pattern: str, name: str) -> Array | None:
    """Return the array that matches the pattern of the pulses, None where none does: the tacho was not connected.

    Raises:
        ReaderError: ``wrong_shape`` where several match.
    """
    if len(found) > 1:
        raise ReaderError("wrong_shape", f"{name}: pulses = {pattern!r} matches {len(found)} arrays; expected one")
    return found[0] if found else None


def with_pulses(
    samples: Samples, values: NDArray[Any], own: Facts, zone: str, where: str, began: float | None = None
) -> Samples:
    """Add the pulses that an array states.

    Args:
        values: times of the pulses, numbers or dates, never falling; or counts at even steps.
        own: what the array itself states under plain keys: ``unit`` and pulses a revolution, of counts the rate.
            Times without a unit are s from the first sample; ``UNIT since DATE`` counts from a date.
        zone: IANA name of the zone of a date that names none.
        where: names file and array in messages.
        began: when the first count was read, s since 1970 UTC; by default with the first sample.

    Raises:
        ReaderError: ``wrong_unit``, ``nan``, ``wrong_rate`` where the numbers fall.
    """
    epoch: float | None = None
    unit = next((str(own[key]).strip() for key in _UNIT_KEYS if own.get(key) is not None), "").strip("[]()").lower()
    if values.size == max(values.shape, default=1):
        values = values.reshape(-1)
    if values.ndim != 1:
        raise ReaderError("wrong_shape", f"{where}: times of pulses are one row, got shape {values.shape}")
    if values.dtype.kind == "M":
        times, epoch = _of_dates(values, where)
    elif values.dtype.kind not in "fiu":
        raise ReaderError("unreadable", f"{where}: expected times of pulses, got type {values.dtype}")
    else:
        # Loggers write a step of 0 beside times.
        rate = _rate_of_counts(own, where) if not unit or unit in _COUNTS else None
        if unit in _COUNTS or (not unit and rate is not None):
            times, epoch = _of_counts(values, rate, unit, where), began
        else:
            factor, epoch = _scale_of(unit, zone, where)
            times = values.astype(np.float64) * factor
    if epoch is not None and samples.start is not None:
        # By the clock of the file, however the file is dated.
        times, epoch = times + (epoch - samples.start), None
    return replace(samples, pulses=checked_pulses(times, per_revolution(own, where), where), pulse_epoch=epoch)


def _rate_of_counts(own: Facts, where: str) -> float | None:
    """Return the rate in Hz at which pulses were counted, None where none is stated.

    Raises:
        ReaderError: ``wrong_rate`` where it contradicts itself or may be read in several ways.
    """
    found = judge_rate(rate_statements(own, where), where)
    if found.readings:
        raise ReaderError("wrong_rate", f"{where}: {found.written} of the pulses may mean {found.meant}")
    return found.value


def per_revolution(facts: Facts, where: str) -> int | None:
    """Return the pulses a revolution among named values, or None.

    Raises:
        ReaderError: ``unreadable`` where it is no whole number from 1.
    """
    for key in PULSE_KEYS:
        if key in facts:
            number = number_of(facts[key])
            if number is None or number != int(number) or not 1 <= number <= MAX_PER_REVOLUTION:
                found = str(facts[key])[:40]
                raise ReaderError(
                    "unreadable", f"{where}: pulses a revolution are a whole number from 1, got {found!r}"
                )
            return int(number)
    return None


def checked_pulses(times: NDArray[np.float64], revolution: int | None, where: str) -> Pulses:
    """Return pulses at some times, s; ReaderError ``nan`` or ``wrong_rate`` where they are no numbers or fall."""
    if not np.isfinite(times).all():
        place = int(np.flatnonzero(~np.isfinite(times))[0])
        raise ReaderError("nan", f"{where}: the time of pulse {place + 1} is not a number")
    falls = np.flatnonzero(np.diff(times) < 0.0)
    if falls.size:
        place = int(falls[0])
        found = f"{times[place + 1]:.9g} s behind {times[place]:.9g} s"
        raise ReaderError("wrong_rate", f"{where}: the times of pulses fall: pulse {place + 2} is at {found}")
    return Pulses(times, revolution)


def fitting_pulses(samples: Samples, where: str) -> Samples:
    """Return dated samples of known rate with their pulses counted from the first one.

    Pulses that are outside by less than a sample are left out: times are rounded.

    Raises:
        ReaderError: ``wrong_rate`` where pulses are outside the samples, or have dates and the samples none.
    """
    pulses = samples.pulses
    if pulses is None:
        return samples
    if samples.pulse_epoch is not None:
        if samples.start is None:
            reason = "the pulses have dates, the samples none; give the pulses in s from the first sample"
            raise ReaderError("wrong_rate", f"{where}: {reason}")
        pulses = pulses.shifted(samples.pulse_epoch - samples.start)
    rate, length = samples.known_rate, samples.values.shape[1]
    place = np.floor(pulses.times * rate)
    outside = np.flatnonzero((place < -1) | (place > length))
    if outside.size:
        reason = f"{outside.size} of {place.size} pulses are outside the samples"
        found = f"the first of them at {pulses.times[outside[0]]:.9g} s, the samples last {length / rate:.9g} s"
        raise ReaderError(
            "wrong_rate", f"{where}: {reason}, {found}; times are s from the first sample, or state a unit"
        )
    return replace(samples, pulses=pulses.in_samples(rate, 0, length), pulse_epoch=None)


def _scale_of(unit: str, zone: str, where: str) -> tuple[float, float | None]:
    """Return the seconds in a unit of times, and the date from which they count, or None."""
    found = re.fullmatch(r"(\S+)\s+since\s+(.+)", unit)
    factor = _SECONDS.get(found[1] if found else unit or "s")
    epoch = None
    if found is not None:
        epoch = seconds_utc(found[2].upper().replace(" UTC", "+00:00"), zone)
    if factor is None or (found is not None and epoch is None):
        wanted = 's, ms, us, ns, "s since DATE", or counts with their rate'
        raise ReaderError("wrong_unit", f"{where}: times of pulses are in {wanted}; got {unit[:40]!r}")
    return factor, epoch


def _of_dates(values: NDArray[Any], where: str) -> tuple[NDArray[np.float64], float | None]:
    """Return the seconds from the first date on, rounded down to a second, and that second since 1970 UTC."""
    if not values.size:
        return np.empty(0), None
    if np.isnat(values).any():
        raise ReaderError(
            "nan", f"{where}: the time of pulse {int(np.flatnonzero(np.isnat(values))[0]) + 1} is no date"
        )
    first = values[0].astype("datetime64[s]")
    since = (values - first).astype("timedelta64[ns]").astype(np.int64)
    return since * 1e-9, float(first.astype(np.int64))


def _of_counts(values: NDArray[Any], rate: float | None, unit: str, where: str) -> NDArray[np.float64]:
    """Return the times of the pulses that a counter counted, each in the middle of its share of a step."""
    if rate is None:
        raise ReaderError("wrong_rate", f"{where}: counts ({unit or 'no unit'}) need the rate at which they were read")
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise ReaderError("nan", f"{where}: a count is not a number")
    if values.dtype.kind == "f" and np.any(values != np.round(values)):
        raise ReaderError("wrong_unit", f"{where}: counts are whole numbers; times need their unit (s)")
    # Unsigned counters start again from 0; a difference of their own type goes on.
    steps = np.diff(values) if values.dtype.kind == "u" else np.diff(values.astype(np.int64))
    steps = steps.view(f"i{steps.dtype.itemsize}") if steps.dtype.kind == "u" else steps
    if np.any(steps < 0):
        raise ReaderError("wrong_rate", f"{where}: the counts fall at sample {int(np.flatnonzero(steps < 0)[0]) + 2}")
    total = int(steps.sum(dtype=np.int64))
    if total > 64 * max(values.size, 1024):
        raise ReaderError("refused", f"{where}: {total} pulses in {values.size} counts")
    begins = np.repeat(np.arange(steps.size), steps)
    within = np.arange(total) - np.repeat(np.cumsum(steps) - steps, steps)
    return (begins + (within + 0.5) / np.repeat(steps, steps)) / rate

"""Quality of a block and its channels: rejected, flagged, or ok; it gates all later stages.

A rejected block gives no values; the flags of another one decide which stages use it (:attr:`Verdict.for_baseline`,
:attr:`Verdict.for_tracker`). A bad block never raises an alarm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.codec import StoredState
from monitor.health.signal.filled import filled_runs
from monitor.health.signal.indicators import span_of
from streams.dates.clock import judge_time
from streams.dates.observed import UNKNOWN_TIME, ClockState, JudgedTime, TimeObservation

REJECTIONS = (
    "empty",
    "short",
    "nan",
    "out_of_range",
    "wrong_rate",
    "wrong_shape",
    "wrong_unit",
    "unreadable",
    "incomplete",
    "refused",
    "reader_crashed",
    "duplicate",
    "changed",
    "poisoned",
)
# Append only: the integers of the published files are positions in this tuple.
FLAGS = ("flat", "stopped", "clipped", "gap", "clock", "late", "out_of_order", "outside_speed", "filled")
_NOT_LEARNED = frozenset({"flat", "stopped", "late", "out_of_order", "outside_speed", "filled"})

_MIN_LENGTH_SHARE = 0.9
"""A block with less than this share of the nominal samples is short."""
_RATE_TOLERANCE = 1e-3
"""Largest relative difference of equal rates; far inside the speed search."""
_STOPPED_SHARE = 0.05
"""A channel below this share of its learned RMS is of a stopped machine."""
STOPPED_RMS = 0.03
"""The same before a level is learned, m/s2 (3 mg, above the noise of the electronics)."""
_CLIP_SHARE = 1e-3
_PROVING_SHARE = 32
_RAIL = 0.995


@dataclass(frozen=True)
class Verdict:
    """Whether a channel of a block is used, and by which stages.

    Attributes:
        status: "ok", or the first reason to reject, or the first flag.
        flags: all flags, in the order of ``FLAGS``.
        reason: one sentence, "" for ok.
    """

    status: str = "ok"
    flags: tuple[str, ...] = ()
    reason: str = ""

    @property
    def accepted(self) -> bool:
        """Whether the samples are used at all."""
        return self.status not in REJECTIONS

    @property
    def for_baseline(self) -> bool:
        """Whether the baseline and the detector use it.

        The machine runs within its configured speeds, the sensor works, samples are not filled, blocks are in order.
        """
        return self.accepted and not _NOT_LEARNED & set(self.flags)

    @property
    def for_tracker(self) -> bool:
        """Whether its RMS is inverted into damage: as for the baseline, and not clipped."""
        return self.for_baseline and "clipped" not in self.flags


def rejected(status: str, reason: str) -> Verdict:
    """Return a verdict of rejection.

    Raises:
        ValueError: ``status`` is not one of ``REJECTIONS``.
    """
    if status not in REJECTIONS:
        raise ValueError(f"unknown rejection status {status!r}")
    return Verdict(status=status, reason=reason)


def check_samples(
    samples: NDArray[np.floating],
    *,
    expected: int | None = None,
    signal_range: float | None = None,
    reference_rms: float | None = None,
    absolute: bool = True,
    span: tuple[float, float] | None = None,
) -> Verdict:
    """Check the samples of one channel.

    Args:
        samples: shape (sample,), m/s2, or an unknown unit (``absolute`` False).
        expected: nominal number of samples, or None.
        signal_range: full scale of the sensor in the unit of the samples, or None.
        reference_rms: RMS of the baseline, or None.
        absolute: the unit is known, so absolute limits apply.
        span: what ``span_of`` gives for them, where that is known.
    """
    n = samples.size
    if n == 0:
        return rejected("empty", "no samples")
    if expected is not None and n < _MIN_LENGTH_SHARE * expected:
        return rejected("short", f"{n} samples, expected {expected}")
    low, high = span_of(samples) if span is None else span
    if not (math.isfinite(low) and math.isfinite(high)):
        bad = int(n - np.count_nonzero(np.isfinite(samples)))
        return rejected("nan", f"{bad} of {n} samples are missing or not finite")
    limit = 1.05 * signal_range if signal_range is not None else (1e7 if absolute else 1e30)
    if max(-low, high) > limit:
        return rejected("out_of_range", f"peak {max(-low, high):.4g} exceeds what the sensor can give ({limit:.4g})")
    if low == high or _stuck(samples):
        return Verdict("flat", ("flat",), "the sensor gives a constant")
    least_rms = _STOPPED_SHARE * reference_rms if reference_rms is not None else (STOPPED_RMS if absolute else 0.0)
    if not _exceeds(samples, least_rms):
        rms = float(np.std(samples, dtype=np.float64))
        if rms < least_rms:
            return Verdict("stopped", ("stopped",), f"RMS {rms:.3g}: the machine stands still")
    begins, ends = filled_runs(samples, low, high)
    if not begins.size:
        clipped = _clipped(samples, low, high, signal_range)
        return Verdict("clipped", ("clipped",), f"clipped at {max(-low, high):.4g}") if clipped else Verdict()
    lost = np.zeros(n + 1, np.int8)
    lost[begins] += 1
    lost[ends] -= 1
    rest = samples[np.cumsum(lost[:n], dtype=np.int8) == 0]
    flags = ("clipped",) if _clipped(rest, *span_of(rest), signal_range) else ()
    return with_flags(
        Verdict("filled", ("filled",), f"{n - rest.size} of {n} samples are filled with a constant"), flags
    )


def _stuck(samples: NDArray[np.floating]) -> bool:
    """Return whether a tenth of the block is one run of a single value."""
    step = max(1, samples.size // 20)
    # A run of a tenth of the block holds two neighbouring probes at a twentieth; only then are the samples counted.
    probes = samples[::step]
    same = np.flatnonzero(probes[1:] == probes[:-1])
    return any(bool(np.all(samples[i * step : (i + 1) * step] == samples[i * step])) for i in same)


def _exceeds(samples: NDArray[np.floating], rms: float) -> bool:
    """Return whether a part of the samples alone proves that the RMS about the mean exceeds a value."""
    part = samples[: -(-samples.size // _PROVING_SHARE)]
    # The squares about the mean of all samples sum to no less than those of a part about the mean of the part.
    return float(np.var(part, dtype=np.float64)) * part.size > rms**2 * samples.size


def _clipped(samples: NDArray[np.floating], low: float, high: float, signal_range: float | None) -> bool:
    """Return whether peaks are clipped: at the known rail, or by runs of the extreme value."""
    if signal_range is not None:
        return int(np.count_nonzero(np.abs(samples) >= _RAIL * signal_range)) >= 2
    least = max(3, int(_CLIP_SHARE * samples.size))
    for extreme in (low, high):
        # Within 1e-6 of the span: the last bit of a scaled integer may differ.
        within = 1e-6 * (high - low)
        at_rail = samples >= extreme - within if extreme == high else samples <= extreme + within
        if np.count_nonzero(at_rail) >= least and bool(np.any(at_rail[2:] & at_rail[1:-1] & at_rail[:-2])):
            # A coarsely quantised small signal often meets its extremes without a rail.
            return np.unique(samples[:: max(1, samples.size // 4096)]).size > 64
    return False


@dataclass(frozen=True)
class SpeedLimits:
    """Speeds within which blocks are compared with each other; None: no limit.

    Attributes:
        least: Hz.
        most: Hz.
        acceleration: largest absolute change of the speed within a block, Hz/s.
    """

    least: float | None = None
    most: float | None = None
    acceleration: float | None = None


def check_speed(speed: tuple[float, float] | None, acceleration: float | None, limits: SpeedLimits) -> tuple[str, ...]:
    """Return the flag ``outside_speed`` of a block beyond the limits, or nothing.

    Args:
        speed: least and highest of the block, Hz; None where it is not known: it cannot be within limits of it.
        acceleration: Hz/s; None where only the mean speed is known: it is not checked.
    """
    low, high = limits.least, limits.most
    if speed is None:
        outside = low is not None or high is not None
    else:
        outside = (low is not None and speed[0] < low) or (high is not None and speed[1] > high)
    steep = limits.acceleration is not None and acceleration is not None and abs(acceleration) > limits.acceleration
    return ("outside_speed",) if outside or steep else ()


@dataclass(frozen=True)
class OrderState(StoredState):
    """Position in the stream of one source; version 2, version 1 knew time and interval of the clock alone.

    Attributes:
        sequence: of the newest block, 0 before the first.
        clock: what is known of the clock of the source.
    """

    VERSIONS = (1, 2)

    version: int = VERSIONS[-1]
    sequence: int = 0
    clock: ClockState = field(default_factory=ClockState)

    @classmethod
    def upgraded(cls, stored: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a state of version 1 as the present one has it."""
        if stored["version"] > 1:
            return stored
        time, interval = stored["time"], stored["interval"]
        clock = ClockState(time=time, interval=interval, began=time, believed=0 if time is None else stored["sequence"])
        return {"version": 2, "sequence": stored["sequence"], "clock": asdict(clock)}


def check_order(
    state: OrderState,
    sequence: int,
    seen: TimeObservation | None,
    *,
    now: float | None = None,
    latest: float | None = None,
) -> tuple[OrderState, tuple[str, ...], JudgedTime]:
    """Check the position of a block in its stream and judge its time.

    Args:
        sequence: of the block, from 1.
        seen: what it states of its time, None where nothing does.
        now, latest: as of :func:`streams.dates.clock.judge_time`.

    Returns:
        The state, the flags ``late``, ``out_of_order``, ``gap`` and ``clock``, and the time of the block.
    """
    if sequence <= state.sequence:
        found = UNKNOWN_TIME if seen is None else JudgedTime(seen.time, seen.resolution, seen.source)
        return state, ("late",), found
    missing = bool(state.sequence) and sequence > state.sequence + 1
    if seen is None:
        return replace(state, sequence=sequence), ("gap",) if missing else (), UNKNOWN_TIME
    clock, found = judge_time(state.clock, replace(seen, in_order=not missing), now, latest)
    flags = {"gap"} if missing or found.gap else set[str]()
    if found.doubt:
        flags.add("clock")
    if seen.statement is not None and not seen.statement.has_place:
        flags.add("out_of_order")
    return OrderState(sequence=sequence, clock=clock), tuple(flag for flag in FLAGS if flag in flags), found


def check_rate(rate: float, expected: float | None) -> Verdict:
    """Check the sampling rate of a block against the configured one, if any."""
    if not (math.isfinite(rate) and rate > 0):
        return rejected("wrong_rate", f"sampling rate {rate!r} Hz")
    if expected is not None and abs(rate / expected - 1.0) > _RATE_TOLERANCE:
        return rejected("wrong_rate", f"sampling rate {rate:g} Hz, expected {expected:g} Hz")
    return Verdict()


def bands_above_nyquist(
    channel: str, bands: Sequence[tuple[float, float]], rms_band: tuple[float, float] | None, rate: float
) -> str | None:
    """Return a sentence on the first band above the Nyquist frequency of a rate (Hz), or None."""
    keys = [("band_hz", band) for band in bands] + ([] if rms_band is None else [("rms_band_hz", rms_band)])
    for key, band in keys:
        if band[1] > 0.5 * rate:
            return (
                f"channel {channel!r}: {key} = [{band[0]:g}, {band[1]:g}] Hz reaches above the Nyquist frequency "
                f"{0.5 * rate:g} Hz of a sampling rate of {rate:g} Hz; allowed is 0 to {0.5 * rate:g} Hz"
            )
    return None


def with_flags(verdict: Verdict, flags: tuple[str, ...]) -> Verdict:
    """Add the flags of the block to the verdict on a channel."""
    if not flags or not verdict.accepted:
        return verdict
    merged = tuple(flag for flag in FLAGS if flag in flags or flag in verdict.flags)
    status = verdict.status if verdict.status != "ok" else merged[0]
    return Verdict(status, merged, verdict.reason or ", ".join(flags))


def verdict_of_block(verdicts: Mapping[str, Verdict], order_flags: tuple[str, ...]) -> Verdict:
    """Return the verdict on a block: rejected only where all its channels are."""
    reason = "; ".join(f"{name}: {verdict.reason}" for name, verdict in verdicts.items() if verdict.reason)
    accepted = [verdict for verdict in verdicts.values() if verdict.accepted]
    if not accepted:
        return Verdict(next(iter(verdicts.values())).status, (), reason)
    raised = {*order_flags, *(flag for verdict in accepted for flag in verdict.flags)}
    flags = tuple(flag for flag in FLAGS if flag in raised)
    return Verdict(flags[0] if flags else "ok", flags, reason)

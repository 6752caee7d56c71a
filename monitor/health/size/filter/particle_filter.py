"""The physical tracker: a posterior over extent, depth and growth rate (a particle filter).

The particles (``particles.py``) are candidate defects with their growth, weighted by how well they explain the RMS and
the first lines of BPFO, given the errors of the map (``prior.py``). RMS depends weakly on the extent of a defect, the
lines depend on it more: with RMS alone the interval is wide and depends on the prior of the growth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from monitor.health.codec import FloatOrNan, StoredState
from monitor.health.size import Damage, DamageInput, EdvStatus
from monitor.health.size.filter.particles import (
    GAIN,
    LN_H,
    LN_V,
    STILL,
    Particles,
    assimilate,
    decorrelate,
    draw,
    grow,
    quantiles,
    resample,
    two_peaks,
)
from monitor.health.size.filter.prior import ErrorModel, GrowthPrior, MapLookup, build_lookup

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.maps.data import MapSlice

    Floats = NDArray[np.float64]

WIDENING_RMS = 1.0
"""Factor on the half widths of ln V_eq with RMS alone."""
WIDENING_HARMONICS = 1.27
"""The same with lines of BPFO."""
IMPLAUSIBLE_SD = 4.0
"""One in 200 simulated lives has a step of this score."""
_OUTSIDE_SD = 3.0
_STEP_SD, _MIN_BLOCKS = 0.15, 5
_GAP_INTERVALS = 12.0
"""Intervals from which the time between two blocks is a gap of the logging."""


@dataclass(frozen=True)
class FilterSettings:
    """Settings of the physical tracker.

    Attributes:
        part_radius: r_o of Eq. 90, or that of the damaged inner race or ball, m.
        lines: number of BPFO lines used beside the RMS, 0 to 6.
        interval: level of the interval of V_eq.
        ambiguous_ratio: upper over lower bound from which the result is ambiguous.
        seed: of all draws; those of a block depend only on it and the number of blocks before.
        widening_rms: factor on the half widths of ln V_eq with RMS alone.
        widening_harmonics: the same with lines.
        implausible_sd: step of ln RMS from what is expected, in standard deviations, beyond which a block is refused.
    """

    part_radius: float
    particles: int = 800
    lines: int = 3
    interval: float = 0.8
    ambiguous_ratio: float = 6.0
    seed: int = 0
    growth: GrowthPrior = field(default_factory=GrowthPrior)
    errors: ErrorModel = field(default_factory=ErrorModel)
    widening_rms: float = WIDENING_RMS
    widening_harmonics: float = WIDENING_HARMONICS
    implausible_sd: float = IMPLAUSIBLE_SD

    def __post_init__(self) -> None:
        """Raise ValueError naming the field that is out of range."""
        if not (math.isfinite(self.part_radius) and self.part_radius > 0.0):
            raise ValueError(f"part_radius must be positive, got {self.part_radius!r} m")
        if self.particles < 50:
            raise ValueError(f"particles must be 50 or more, got {self.particles!r}")
        if not 0 <= self.lines <= 6:
            raise ValueError(f"lines must be 0 to 6, got {self.lines!r}")
        if not 0.0 < self.interval < 1.0:
            raise ValueError(f"interval must lie between 0 and 1, got {self.interval!r}")
        if not self.implausible_sd > 0.0:
            raise ValueError(f"implausible_sd must be positive, got {self.implausible_sd!r}")


@dataclass(frozen=True, eq=False)
class FilterState(StoredState):
    """State of the tracker.

    Attributes:
        count: blocks used.
        t: time of the latest, s.
        interval: time between the latest two without a gap, s; NaN before.
        load: at the latest, N.
        speed: at the latest, Hz.
        sensors: number of sensors that gave each feature at the latest block that had it.
        particles: None before the first block.
    """

    VERSIONS = (1, 2)
    LATER = frozenset({"interval"})

    version: int = VERSIONS[-1]
    count: int = 0
    t: float | None = None
    interval: FloatOrNan = math.nan
    load: FloatOrNan = math.nan
    speed: FloatOrNan = math.nan
    sensors: tuple[int, ...] = ()
    particles: Particles | None = None


def step(
    state: FilterState,
    inputs: DamageInput | Sequence[DamageInput],
    *,
    map_slice: MapSlice | None,
    settings: FilterSettings,
) -> tuple[FilterState, Damage]:
    """Track one block.

    Several sensors in the same direction on the bearing are averaged in the logarithm: that reduces their scatter, not
    the error of the map. A block that no defect of the map explains, or that does not follow from those before, leaves
    the state unchanged; what may follow widens with the time.

    Args:
        state: ``FilterState()`` at t_fs.
        inputs: of one sensor, or of each sensor in the same block; without a positive, finite RMS it is ``bad_block``.
            BPFO lines that are not positive count as missing.
        map_slice: the map at the block's load and speed, or None.

    Raises:
        ValueError: the time is not finite, goes back or differs between sensors.
    """
    heard = _hear(state, inputs, map_slice, settings)
    if isinstance(heard, EdvStatus):
        return state, Damage(heard)
    t, lookup, ln_x, sensors = heard
    outside = _outside(lookup, ln_x[0], settings.errors)
    if outside is not None:
        return state, Damage(outside)
    rng = np.random.default_rng((settings.seed, state.count))
    particles = _grown(state, t, lookup, sensors, settings, rng)
    seen = lookup.at(*particles.sizes(settings.part_radius))
    if abs(_step_score(state, particles, seen, float(ln_x[0]))) > settings.implausible_sd:
        return state, Damage(EdvStatus.IMPLAUSIBLE)
    particles = _updated(particles, lookup, seen, ln_x, sensors, settings, rng)
    remembered = tuple(
        int(n) if n else old for n, old in zip(sensors, state.sensors or (0,) * len(sensors), strict=True)
    )
    gap = math.nan if state.t is None else t - state.t
    interval = gap if gap > 0.0 and not _is_gap(state, t) else state.interval
    following = FilterState(
        count=state.count + 1,
        t=t,
        interval=interval,
        load=lookup.load,
        speed=lookup.speed,
        sensors=remembered,
        particles=particles,
    )
    return following, _damage(particles, lookup, settings, with_lines=bool(np.any(sensors[1:] > 0)))


def step_score(
    state: FilterState, inputs: DamageInput | Sequence[DamageInput], *, map_slice: MapSlice, settings: FilterSettings
) -> float:
    """Return the score of the step of ln RMS that ``step`` compares with ``implausible_sd``; 0 where it does not."""
    heard = _hear(state, inputs, map_slice, settings)
    if isinstance(heard, EdvStatus):
        return 0.0
    t, lookup, ln_x, sensors = heard
    rng = np.random.default_rng((settings.seed, state.count))
    particles = _grown(state, t, lookup, sensors, settings, rng)
    return _step_score(state, particles, lookup.at(*particles.sizes(settings.part_radius)), float(ln_x[0]))


def _hear(
    state: FilterState,
    inputs: DamageInput | Sequence[DamageInput],
    map_slice: MapSlice | None,
    settings: FilterSettings,
) -> EdvStatus | tuple[float, MapLookup, Floats, NDArray[np.int64]]:
    """Return the time, the map, ln of the features and the numbers of sensors of a block, or why there are none."""
    inputs = [inputs] if isinstance(inputs, DamageInput) else inputs
    usable = [sensor for sensor in inputs if math.isfinite(sensor.rms) and sensor.rms > 0.0]
    if not usable:
        return EdvStatus.BAD_BLOCK
    t = _time(state, usable)
    lookup = None if map_slice is None else build_lookup(map_slice, settings.errors, settings.lines)
    if lookup is None:
        return EdvStatus.NO_MAP
    return t, lookup, *_features(usable, settings.lines)


def _time(state: FilterState, inputs: Sequence[DamageInput]) -> float:
    times = {sensor.time for sensor in inputs}
    t = inputs[0].time
    if len(times) > 1 or not math.isfinite(t) or (state.t is not None and t < state.t):
        raise ValueError(f"t must be one finite time, not before the latest block ({state.t} s), got {sorted(times)}")
    return float(t)


def _features(inputs: Sequence[DamageInput], lines: int) -> tuple[Floats, NDArray[np.int64]]:
    """Return the mean logarithm of each feature over sensors, NaN where missing, and the numbers of sensors."""
    values = np.full((len(inputs), 1 + lines), np.nan)
    for row, sensor in zip(values, inputs, strict=True):
        row[0] = sensor.rms
        if sensor.harmonics is not None:
            found = np.asarray(sensor.harmonics, dtype=float)[:lines]
            row[1 : 1 + found.size] = np.where(np.isfinite(found) & (found > 0.0), found, np.nan)
    sensors = np.sum(np.isfinite(values), axis=0)
    sums = np.nansum(np.log(values), axis=0)
    return np.where(sensors > 0, sums / np.maximum(sensors, 1), np.nan), sensors


def _outside(lookup: MapLookup, ln_rms: float, errors: ErrorModel) -> EdvStatus | None:
    """Return the status of an RMS more than three standard deviations beyond the map, or None."""
    value, w, s = (a[:, 0] for a in lookup.log_features(lookup.table))
    sd = np.sqrt(w**2 * (errors.gain_sd**2 + float(lookup.gains[0]) ** 2 + s**2) + errors.scatter**2)
    if ln_rms < np.min(value - _OUTSIDE_SD * sd):
        return EdvStatus.BELOW_MAP
    return EdvStatus.ABOVE_MAP if ln_rms > np.max(value + _OUTSIDE_SD * sd) else None


def _grown(
    state: FilterState,
    t: float,
    lookup: MapLookup,
    sensors: NDArray[np.int64],
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Particles:
    """Return the particles at the time of a block, before it is heard."""
    errors, radius = settings.errors, settings.part_radius
    if state.particles is None or state.t is None:
        return draw(rng, settings.particles, lookup.gains, settings.growth, errors)
    before = state.particles.sizes(radius)
    gap = t - state.t
    # Whether the machine ran while nobody logged is not known, nor for how long.
    ran = gap * rng.uniform(size=state.particles.weight.size) if _is_gap(state, t) else gap
    particles = grow(state.particles, rng, ran, settings.growth)
    after = particles.sizes(radius)
    moved = [np.abs(new - old)[:, None] for new, old in zip(after, before, strict=True)]
    lengths = np.array([errors.rms_length] + [errors.harmonic_length] * settings.lines).T
    distance = moved[0] / lengths[0] + moved[1] / lengths[1]
    distance += abs(math.log(lookup.load / state.load)) / errors.load_length
    distance += abs(math.log(lookup.speed / state.speed)) / errors.speed_length
    particles = decorrelate(particles, distance)
    return _other_sensors(particles, sensors, state.sensors, errors)


def _is_gap(state: FilterState, t: float) -> bool:
    """Return whether logging had stopped before a block at ``t`` s."""
    return state.t is not None and t - state.t > _GAP_INTERVALS * state.interval


def _step_score(state: FilterState, particles: Particles, seen: tuple[Floats, Floats, Floats], ln_rms: float) -> float:
    """Return how far ln RMS lies from what the particles expect, over the spread of that and ``_STEP_SD``.

    It is 0 in the first blocks, in which the gain is not known. The errors within a block that the weights assume (0.4)
    would hide a gain that is three times as large.
    """
    if state.count < _MIN_BLOCKS:
        return 0.0
    expected, w, s = (a[:, 0] for a in seen)
    b, z = particles.mean[:, 0, 0], particles.mean[:, 0, 1]
    said = expected + w * (particles.core[:, GAIN] + b + s * z)
    mean = float(particles.weight @ said)
    variance = float(particles.weight @ (said - mean) ** 2)
    return (ln_rms - mean) / math.sqrt(variance + _STEP_SD**2)


def _updated(
    particles: Particles,
    lookup: MapLookup,
    seen: tuple[Floats, Floats, Floats],
    ln_x: Floats,
    sensors: NDArray[np.int64],
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Particles:
    """Return the posterior after a block."""
    errors = settings.errors
    model_sd = np.array([errors.rms_model_sd] + [errors.harmonic_model_sd] * settings.lines)
    variance = errors.scatter**2 / np.maximum(sensors, 1) + model_sd**2
    particles = assimilate(particles, lookup, settings.part_radius, ln_x, variance, errors, seen)
    if particles.weight.size != settings.particles or particles.effective < 0.5 * settings.particles:
        particles = resample(particles, rng, settings.particles)
    return particles.rounded()


def _other_sensors(
    particles: Particles, sensors: NDArray[np.int64], before: tuple[int, ...], errors: ErrorModel
) -> Particles:
    """Increase the variance of a feature's gain where the number of its sensors changes."""
    old = np.array(before)
    changed = (sensors > 0) & (old > 0) & (sensors != old)
    if not np.any(changed):
        return particles
    cov = particles.cov.copy()
    cov[:, :, 0] += np.where(changed, errors.gain_sd**2, 0.0)
    return replace(particles, cov=cov)


def _damage(particles: Particles, lookup: MapLookup, settings: FilterSettings, *, with_lines: bool) -> Damage:
    dphi_d, h_d = particles.sizes(settings.part_radius)
    weight = particles.weight / np.sum(particles.weight)
    beyond = float(np.sum(weight[(dphi_d > lookup.dphi_d[-1]) | (h_d > lookup.h_d[-1])]))
    if beyond > 0.5:
        return Damage(EdvStatus.ABOVE_MAP)
    ln_v = particles.core[:, LN_V]
    tail = 0.5 * (1.0 - settings.interval)
    low, middle, high = quantiles(ln_v, weight, (tail, 0.5, 1.0 - tail))
    widening = settings.widening_harmonics if with_lines else settings.widening_rms
    lower, upper = middle - widening * (middle - low), middle + widening * (high - middle)
    ambiguous = upper - lower > math.log(settings.ambiguous_ratio) or two_peaks(ln_v, weight)
    return Damage(
        status=EdvStatus.AMBIGUOUS if ambiguous else EdvStatus.OK,
        v_eq=math.exp(middle),
        v_eq_lower=math.exp(lower),
        v_eq_upper=math.exp(upper),
        dphi_d=quantiles(dphi_d, weight, (0.5,))[0],
        h_d=math.exp(quantiles(particles.core[:, LN_H], weight, (0.5,))[0]),
        p_no_growth=float(weight @ (particles.core[:, STILL] > 0.0)),
    )

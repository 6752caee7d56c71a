"""The physical tracker: what may be damaged, as a posterior over extent, depth and growth rate.

Where the thesis' method takes the one defect of least volume that is as loud as what is heard, this one keeps many
that may be (a particle filter, ``filter_particles``), each with its growth, and weighs them by how well they explain
the RMS and the first lines of BPFO, given how far a map may be from the bearing (``filter_model``). RMS hardly sees the
extent of a defect and the lines do: with RMS alone the interval is wide, and leans on the prior of the growth.

It tracks; it is no forecast.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from monitor.health.damage.filter.particles import (
    HASTE,
    LN_H,
    LN_R,
    LN_V,
    POWER,
    Particles,
    draw,
    forget,
    grow,
    listen,
    quantiles,
    resample,
    two_peaks,
)
from monitor.health.damage.filter.prior import ErrorModel, GrowthPrior, HeardMap, heard_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.maps.data import MapSlice

    Floats = NDArray[np.float64]

STATE_VERSION = 1
WIDENING_RMS = 1.0
"""Factor on the half widths of ln V_eq where RMS alone is heard (``benchmarks/filter.py``, "widening")."""
WIDENING_HARMONICS = 1.27
"""The same where lines of BPFO are heard too."""
_BINS = 24
_OUTSIDE_SD = 3.0


class FilterStatus(StrEnum):
    """What became of one block.

    ``ok`` and ``ambiguous`` carry values; ``ambiguous`` says that the volumes that may be are of two kinds, or wide
    apart. ``below_map`` and ``above_map`` say that no defect of the map is so quiet or so loud, or that the damage has
    grown off the map. The others are verdicts of what comes before, except ``no_map``, also for a map without values.
    """

    OK = "ok"
    AMBIGUOUS = "ambiguous"
    BELOW_MAP = "below_map"
    ABOVE_MAP = "above_map"
    NO_MAP = "no_map"
    NOT_FINAL_STAGE = "not_final_stage"
    BAD_BLOCK = "bad_block"
    NO_ABSOLUTE_LEVEL = "no_absolute_level"
    OUTSIDE_CONDITIONS = "outside_conditions"


GATES = frozenset(FilterStatus) - {
    FilterStatus.OK,
    FilterStatus.AMBIGUOUS,
    FilterStatus.BELOW_MAP,
    FilterStatus.ABOVE_MAP,
}
"""Verdicts of earlier stages with which a block does not reach the tracker."""


@dataclass(frozen=True)
class FilterSettings:
    """How the tracker works.

    Attributes:
        outer_race_radius: r_o of Eq. 90, m.
        particles: how many.
        lines: how many lines of BPFO are read beside the RMS, 0 to 6.
        interval: level of the interval of V_eq.
        ambiguous_ratio: upper over lower bound from which on the answer is called ambiguous.
        seed: of everything that is drawn; with it a block's draws depend on the number of blocks before it alone.
        growth: the prior of the growth.
        errors: how far what is heard may be from the map.
        widening_rms: factor on the half widths of ln V_eq where RMS alone is heard.
        widening_harmonics: the same where lines are heard too.
    """

    outer_race_radius: float
    particles: int = 800
    lines: int = 3
    interval: float = 0.8
    ambiguous_ratio: float = 6.0
    seed: int = 0
    growth: GrowthPrior = field(default_factory=GrowthPrior)
    errors: ErrorModel = field(default_factory=ErrorModel)
    widening_rms: float = WIDENING_RMS
    widening_harmonics: float = WIDENING_HARMONICS

    def __post_init__(self) -> None:
        """Refuse what cannot be tracked with.

        Raises:
            ValueError: naming the field and what it is.
        """
        if not (math.isfinite(self.outer_race_radius) and self.outer_race_radius > 0.0):
            raise ValueError(f"outer_race_radius must be positive, got {self.outer_race_radius!r} m")
        if self.particles < 50:
            raise ValueError(f"particles must be 50 or more, got {self.particles!r}")
        if not 0 <= self.lines <= 6:
            raise ValueError(f"lines must be 0 to 6, got {self.lines!r}")
        if not 0.0 < self.interval < 1.0:
            raise ValueError(f"interval must lie between 0 and 1, got {self.interval!r}")


@dataclass(frozen=True)
class FilterInput:
    """What one sensor heard in one block.

    Attributes:
        t: time that the damage has had, s: the machine's running time from anywhere.
        rms: RMS in the band of the map, m/s2.
        harmonics: amplitudes of BPFO lines 1, 2, ..., m/s2, or None; what is not positive counts as not heard.
    """

    t: float
    rms: float
    harmonics: Sequence[float] | None = None


@dataclass(frozen=True, eq=False)
class FilterState:
    """All that the tracker remembers.

    Attributes:
        count: blocks taken in.
        t: time of the latest, s.
        load: load of the map at the latest, N.
        speed: speed of the map at the latest, Hz.
        sensors: how many sensors gave each feature at the latest block that had it.
        particles: the posterior, or None before the first block.
        version: layout of this state.
    """

    count: int = 0
    t: float | None = None
    load: float = math.nan
    speed: float = math.nan
    sensors: tuple[int, ...] = ()
    particles: Particles | None = None
    version: int = STATE_VERSION

    def to_dict(self) -> dict[str, Any]:
        """Return the state as JSON can hold it; it comes back bit for bit."""
        return {
            "version": self.version,
            "count": self.count,
            "t": self.t,
            "load": None if self.particles is None else self.load,
            "speed": None if self.particles is None else self.speed,
            "sensors": list(self.sensors),
            "particles": None if self.particles is None else self.particles.to_dict(),
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> FilterState:
        """Return the state that ``to_dict`` wrote.

        Raises:
            ValueError: the state was written in a layout that this version does not know.
        """
        if stored.get("version") != STATE_VERSION:
            raise ValueError(f"filter state: version {STATE_VERSION} expected, got {stored.get('version')!r}")
        if stored["particles"] is None:
            return cls()
        return cls(
            count=stored["count"],
            t=stored["t"],
            load=stored["load"],
            speed=stored["speed"],
            sensors=tuple(stored["sensors"]),
            particles=Particles.from_dict(stored["particles"]),
        )


@dataclass(frozen=True, eq=False)
class Posterior:
    """Where the defect may be, for drawing.

    Attributes:
        dphi_d: edges of the bins of the extent, rad, shape (25,).
        h_d: edges of the bins of the depth, m, shape (25,).
        probability: shape (24, 24), depth first; what lies beyond the map is missing from its sum.
    """

    dphi_d: Floats
    h_d: Floats
    probability: Floats


@dataclass(frozen=True, eq=False)
class FilterResult:
    """What one block says of the damage; NaN and None wherever ``status`` says that there is no value.

    Attributes:
        status: how the values came about, or why there are none.
        v_eq: median of the volume per width, m2.
        v_eq_lower: lower bound of the interval, m2.
        v_eq_upper: its upper bound, m2.
        dphi_d: median of the extent, rad.
        h_d: median of the depth, m.
        rate: median of the rate at which V_eq grows now, m2/s.
        effective: effective number of particles after this block.
        posterior: for drawing.
    """

    status: FilterStatus
    v_eq: float = math.nan
    v_eq_lower: float = math.nan
    v_eq_upper: float = math.nan
    dphi_d: float = math.nan
    h_d: float = math.nan
    rate: float = math.nan
    effective: float = math.nan
    posterior: Posterior | None = None


def step(
    state: FilterState,
    inputs: FilterInput | Sequence[FilterInput],
    *,
    map_slice: MapSlice | None,
    settings: FilterSettings,
    gate: FilterStatus | None = None,
) -> tuple[FilterState, FilterResult]:
    """Track one block.

    Several sensors that hear the same bearing in the same direction are averaged in the logarithm: their own scatter
    is less so, the error of the map is common to them. A block that is gated, or that no defect of the map explains,
    leaves the state alone.

    Args:
        state: what the tracker remembers; ``FilterState()`` at t_fs.
        inputs: what the sensor heard, or what each sensor heard in the same block.
        map_slice: the map at the block's load and speed, or None where there is none.
        settings: how to track.
        gate: the verdict of an earlier stage that keeps this block out (one of ``GATES``), or None.

    Returns:
        The next state and the block's result. A block without a positive, finite RMS is ``bad_block``.

    Raises:
        ValueError: ``gate`` is not one of ``GATES``, or the time is not finite, goes back or differs between sensors.
    """
    inputs = [inputs] if isinstance(inputs, FilterInput) else list(inputs)
    if gate is not None and gate not in GATES:
        raise ValueError(f"gate must be one of {sorted(GATES)} or None, got {gate!r}")
    if gate is not None:
        return state, FilterResult(gate)
    usable = [sensor for sensor in inputs if math.isfinite(sensor.rms) and sensor.rms > 0.0]
    if not usable:
        return state, FilterResult(FilterStatus.BAD_BLOCK)
    t = _time(state, usable)
    heard = None if map_slice is None else heard_map(map_slice, settings.errors, settings.lines)
    if heard is None:
        return state, FilterResult(FilterStatus.NO_MAP)
    ln_x, sensors = _features(usable, settings.lines)
    outside = _outside(heard, ln_x[0], settings.errors)
    if outside is not None:
        return state, FilterResult(outside)
    particles = _advance(state, t, heard, ln_x, sensors, settings)
    remembered = tuple(
        int(n) if n else old for n, old in zip(sensors, state.sensors or (0,) * len(sensors), strict=True)
    )
    following = FilterState(state.count + 1, t, heard.load, heard.speed, remembered, particles)
    return following, _result(particles, heard, settings, lines_heard=bool(np.any(sensors[1:] > 0)))


def _time(state: FilterState, inputs: Sequence[FilterInput]) -> float:
    times = {sensor.t for sensor in inputs}
    t = inputs[0].t
    if len(times) > 1 or not math.isfinite(t) or (state.t is not None and t < state.t):
        raise ValueError(f"t must be one finite time, not before the latest block ({state.t} s), got {sorted(times)}")
    return float(t)


def _features(inputs: Sequence[FilterInput], lines: int) -> tuple[Floats, NDArray[np.int64]]:
    """Return the mean over sensors of the logarithm of each feature, NaN where none has it, and their numbers."""
    values = np.full((len(inputs), 1 + lines), np.nan)
    for row, sensor in zip(values, inputs, strict=True):
        row[0] = sensor.rms
        if sensor.harmonics is not None:
            found = np.asarray(sensor.harmonics, dtype=float)[:lines]
            row[1 : 1 + found.size] = np.where(np.isfinite(found) & (found > 0.0), found, np.nan)
    sensors = np.sum(np.isfinite(values), axis=0)
    sums = np.nansum(np.log(values), axis=0)
    return np.where(sensors > 0, sums / np.maximum(sensors, 1), np.nan), sensors


def _outside(heard: HeardMap, ln_rms: float, errors: ErrorModel) -> FilterStatus | None:
    """Say whether the RMS is lower or higher than at any node of the map, three standard deviations allowed for."""
    value, w, s = (a[:, 0] for a in heard.heard(heard.table))
    sd = np.sqrt(w**2 * (errors.gain_sd**2 + errors.rms_gain_sd**2 + s**2) + errors.scatter**2)
    if ln_rms < np.min(value - _OUTSIDE_SD * sd):
        return FilterStatus.BELOW_MAP
    return FilterStatus.ABOVE_MAP if ln_rms > np.max(value + _OUTSIDE_SD * sd) else None


def _advance(
    state: FilterState,
    t: float,
    heard: HeardMap,
    ln_x: Floats,
    sensors: NDArray[np.int64],
    settings: FilterSettings,
) -> Particles:
    """Return the posterior after a block."""
    rng = np.random.default_rng((settings.seed, state.count))
    errors, radius = settings.errors, settings.outer_race_radius
    if state.particles is None or state.t is None:
        particles = draw(rng, settings.particles, heard.features, settings.growth, errors)
    else:
        before = state.particles.sizes(radius)
        particles = grow(state.particles, rng, t - state.t, settings.growth)
        after = particles.sizes(radius)
        moved = [np.abs(new - old)[:, None] for new, old in zip(after, before, strict=True)]
        lengths = np.array([errors.rms_length] + [errors.harmonic_length] * settings.lines).T
        distance = moved[0] / lengths[0] + moved[1] / lengths[1]
        distance += abs(math.log(heard.load / state.load)) / errors.load_length
        distance += abs(math.log(heard.speed / state.speed)) / errors.speed_length
        particles = forget(particles, distance)
        particles = _other_sensors(particles, sensors, state.sensors, errors)
    doubt = np.array([errors.rms_doubt] + [errors.harmonic_doubt] * settings.lines)
    variance = errors.scatter**2 / np.maximum(sensors, 1) + doubt**2
    particles = listen(particles, heard, radius, ln_x, variance, errors)
    if particles.weight.size != settings.particles or particles.effective < 0.5 * settings.particles:
        particles = resample(particles, rng, settings.particles)
    return particles.rounded()


def _other_sensors(
    particles: Particles, sensors: NDArray[np.int64], before: tuple[int, ...], errors: ErrorModel
) -> Particles:
    """Return the particles with the gain of a feature less certain where other sensors give it than before."""
    old = np.array(before)
    changed = (sensors > 0) & (old > 0) & (sensors != old)
    if not np.any(changed):
        return particles
    cov = particles.cov.copy()
    cov[:, :, 0] += np.where(changed, errors.gain_sd**2, 0.0)
    return replace(particles, cov=cov)


def _result(particles: Particles, heard: HeardMap, settings: FilterSettings, *, lines_heard: bool) -> FilterResult:
    dphi_d, h_d = particles.sizes(settings.outer_race_radius)
    weight = particles.weight / np.sum(particles.weight)
    beyond = float(np.sum(weight[(dphi_d > heard.dphi_d[-1]) | (h_d > heard.h_d[-1])]))
    if beyond > 0.5:
        return FilterResult(FilterStatus.ABOVE_MAP, effective=particles.effective)
    ln_v = particles.core[:, LN_V]
    tail = 0.5 * (1.0 - settings.interval)
    low, middle, high = quantiles(ln_v, weight, (tail, 0.5, 1.0 - tail))
    widening = settings.widening_harmonics if lines_heard else settings.widening_rms
    lower, upper = middle - widening * (middle - low), middle + widening * (high - middle)
    ambiguous = upper - lower > math.log(settings.ambiguous_ratio) or two_peaks(ln_v, weight)
    power = particles.core[:, POWER] * (ln_v - math.log(settings.growth.threshold))
    rate = quantiles(particles.core[:, LN_R] + particles.core[:, HASTE] + power, weight, (0.5,))[0]
    edges = tuple(np.linspace(axis[0], axis[-1], _BINS + 1) for axis in (heard.h_d, heard.dphi_d))
    return FilterResult(
        status=FilterStatus.AMBIGUOUS if ambiguous else FilterStatus.OK,
        v_eq=math.exp(middle),
        v_eq_lower=math.exp(lower),
        v_eq_upper=math.exp(upper),
        dphi_d=quantiles(dphi_d, weight, (0.5,))[0],
        h_d=math.exp(quantiles(particles.core[:, LN_H], weight, (0.5,))[0]),
        rate=math.exp(rate),
        effective=particles.effective,
        posterior=Posterior(edges[1], edges[0], np.histogram2d(h_d, dphi_d, bins=edges, weights=weight)[0]),
    )

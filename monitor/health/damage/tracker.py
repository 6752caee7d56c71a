"""From the features of a block to V_eq and TT, by the methods that are configured.

The tracker begins at t_fs, which becomes known only later: readings since the detector's score rose wait here, and go
first when the final stage is known. Each reading is judged at its own load and speed. Time is damage time: the hours in
which the machine stood still are no part of it, and the caller does not count them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from monitor.health.damage.filter.particle_filter import FilterInput, FilterSettings, FilterState
from monitor.health.damage.filter.particle_filter import step as filter_step
from monitor.health.damage.filter.prior import GrowthPrior
from monitor.health.damage.library.forecaster import (
    QUANTILES,
    LibraryInput,
    LibrarySettings,
    LibraryState,
    ThresholdResult,
)
from monitor.health.damage.library.forecaster import step as ask_library
from monitor.health.damage.library.model import Library
from monitor.health.damage.thesis import edv, forecast

if TYPE_CHECKING:
    from models.maps import data as map_data

MapAt = Callable[[float | None, float | None], "tuple[edv.MapSlice | None, edv.EdvStatus | None]"]
"""Gives the map at a load (N) and speed (Hz), or the status that says why there is none."""

SpreadAt = Callable[[float | None, float | None], "tuple[map_data.MapSlice | None, edv.EdvStatus | None]"]
"""Likewise with the BPFO lines and the spreads of the map; the same object for the same condition."""

TrackMethod = Literal["thesis", "filter", "library"]
ForecastMethod = Literal["thesis", "library"]

_MOST_PENDING = 2000
"""Readings that a tracker may lag behind: an onset so slow that it takes more to become known loses its first part."""
_NONE = (math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Reading:
    """What the trackers take of one block.

    Attributes:
        time: damage time, s.
        rms: in the band of the map, m/s2.
        harmonics: amplitudes of the first six BPFO lines, m/s2, or None where the block resolves none.
        load: N, or None where unknown.
        speed: Hz.
    """

    time: float
    rms: float
    harmonics: tuple[float, ...] | None
    load: float | None
    speed: float | None


@dataclass(frozen=True)
class DamageSettings:
    """How damage is tracked and forecast on a channel.

    Attributes:
        track_method: what gives V_eq.
        forecast_method: what gives TT.
        map_at: the RMS map by load and speed, or None where there is none.
        spread_at: the same map with its lines and spreads, for the filter.
        edv: settings of the thesis' tracker.
        filter: settings of the physical tracker, or None where there is no map for it.
        forecast: settings of the thesis' forecast.
        thresholds: of V_eq, m2, ascending.
        library: the library of simulated lives, or None where there is none.
        asking: how the library is asked.
    """

    track_method: TrackMethod = "thesis"
    forecast_method: ForecastMethod = "thesis"
    map_at: MapAt | None = None
    spread_at: SpreadAt | None = None
    edv: edv.EdvSettings = field(default_factory=edv.EdvSettings)
    filter: FilterSettings | None = None
    forecast: forecast.ForecastSettings = field(default_factory=forecast.ForecastSettings)
    thresholds: tuple[float, ...] = (0.05e-6,)
    library: Library | None = None
    asking: LibrarySettings = field(default_factory=LibrarySettings)

    @property
    def asks_library(self) -> bool:
        """Whether V_eq or TT come from the library."""
        return "library" in (self.track_method, self.forecast_method)

    @property
    def prior(self) -> str | None:
        """In words what intervals lean on, or None where there are none."""
        leans = []
        if self.track_method == "filter" and self.filter is not None:
            leans.append(f"for V_eq, {_growth_words(self.filter.growth)}")
        if self.asks_library and self.library is not None:
            leans.append(f"for TT, {self.library.prior}" if leans else self.library.prior)
        return ", and ".join(leans) or None


@dataclass(frozen=True)
class DamageState:
    """All that the trackers and forecasts of a channel remember.

    Attributes:
        pending: readings since the detector's score first rose, while t_fs is not known.
        edv: the thesis' tracker.
        filter: the physical tracker.
        forecast: the thesis' forecast.
        library: the history as the library looks at it.
    """

    pending: tuple[Reading, ...] = ()
    edv: edv.EdvState = field(default_factory=edv.EdvState)
    filter: FilterState = field(default_factory=FilterState)
    forecast: forecast.ForecastState = field(default_factory=forecast.ForecastState)
    library: LibraryState = field(default_factory=LibraryState)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON; floats come back as they were."""
        return {
            "pending": [[r.time, r.rms, r.harmonics, r.load, r.speed] for r in self.pending],
            "edv": self.edv.to_dict(),
            "filter": self.filter.to_dict(),
            "forecast": self.forecast.to_dict(),
            "library": self.library.to_dict(),
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> DamageState:
        """Return the state that :meth:`to_dict` gave."""
        return cls(
            pending=tuple(
                Reading(time, rms, None if harmonics is None else tuple(harmonics), load, speed)
                for time, rms, harmonics, load, speed in stored["pending"]
            ),
            edv=edv.EdvState.from_dict(stored["edv"]),
            filter=FilterState.from_dict(stored["filter"]),
            forecast=forecast.ForecastState.from_dict(stored["forecast"]),
            library=LibraryState.from_dict(stored["library"]),
        )


@dataclass(frozen=True)
class Damage:
    """V_eq after one block; NaN wherever ``status`` says that there is no value, and what a method does not give.

    Attributes:
        status: as in ``monitor.health.schema.EDV_STATUSES``.
        v_eq: equivalent damaged volume per width, m2; the median where there is an interval.
        v_eq_lower: lower end of its interval, m2.
        v_eq_upper: upper end, m2.
        dphi_d: extent of the equivalent defect, rad.
        h_d: its depth, m.
        rms_smoothed: trailing mean of the RMS (thesis), m/s2.
    """

    status: str
    v_eq: float = math.nan
    v_eq_lower: float = math.nan
    v_eq_upper: float = math.nan
    dphi_d: float = math.nan
    h_d: float = math.nan
    rms_smoothed: float = math.nan


@dataclass(frozen=True)
class Remaining:
    """One forecast for one threshold; NaN wherever ``status`` says that there is no value.

    Attributes:
        threshold: V_th, m2.
        status: as in ``monitor.health.schema.TT_STATUSES``.
        tt: time to threshold, s of damage time; the median where there is an interval.
        tt_lower: lower end of its interval, s.
        tt_upper: upper end, s.
        t_threshold: when the threshold is reached, s of the readings' clock.
        p_threshold: probability that it is reached within the maintenance window; NaN without a window.
        coefficients: of the thesis' quadratic, SI.
        r_squared: of that fit.
        quantiles: (probability, TT in s) pairs, for the archive.
    """

    threshold: float
    status: str
    tt: float = math.nan
    tt_lower: float = math.nan
    tt_upper: float = math.nan
    t_threshold: float = math.nan
    p_threshold: float = math.nan
    coefficients: tuple[float, float, float] = _NONE
    r_squared: float = math.nan
    quantiles: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of_thesis(cls, result: forecast.ForecastResult) -> Remaining:
        """Return what the thesis' forecast said."""
        return cls(
            threshold=result.threshold,
            status=str(result.status),
            tt=result.tt,
            t_threshold=result.t_threshold,
            coefficients=result.coefficients,
            r_squared=result.r_squared,
        )

    @classmethod
    def of_library(cls, result: ThresholdResult) -> Remaining:
        """Return what the library said."""
        return cls(
            threshold=result.threshold,
            status=str(result.status),
            tt=result.tt,
            tt_lower=result.tt_lower,
            tt_upper=result.tt_upper,
            t_threshold=result.t_threshold,
            p_threshold=result.p_threshold,
            quantiles=tuple(zip(QUANTILES, result.quantiles, strict=False)),
        )


@dataclass(frozen=True)
class Stage:
    """What earlier stages say of the block.

    Attributes:
        final: whether the bearing is known to be in the final stage.
        raised: whether the detector's score is raised while the final stage is not known yet.
        usable: whether the quality of the block lets it be inverted.
        absolute: whether the channel's unit is known, so that levels mean something.
    """

    final: bool = True
    raised: bool = False
    usable: bool = True
    absolute: bool = True


def _growth_words(growth: GrowthPrior) -> str:
    hours = " to ".join(f"{value / 3600.0:.3g}" for value in growth.durations)
    depth = " to ".join(f"{value * 1e6:g}" for value in growth.h_threshold)
    reached = f"{hours} h to {growth.threshold * 1e6:g} mm2, where it is {depth} um deep"
    return f"a growth that takes {reached}, and may stall or jump"


def step(
    state: DamageState, reading: Reading, stage: Stage, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Track and forecast one block.

    Args:
        state: what is remembered.
        reading: of the block.
        stage: what earlier stages say of it.
        settings: how.

    Returns:
        The next state, V_eq and one forecast a threshold.
    """
    gate = _gate(stage)
    # Once t_fs is known, the readings since t_fs go first.
    history = (*(state.pending if gate is None else ()), reading)
    damage, forecasts = Damage(str(edv.EdvStatus.NOT_FINAL_STAGE)), ()
    for item in history:
        state, damage, forecasts = _one(state, item, gate, stage, settings)
    if gate is None:
        return replace(state, pending=()), damage, forecasts
    if not stage.final:
        return replace(state, pending=_pending(state, reading, stage)), damage, forecasts
    return state, damage, forecasts


def _gate(stage: Stage) -> edv.EdvStatus | None:
    """Return what keeps the block out of every method, or None."""
    if not stage.absolute:
        return edv.EdvStatus.NO_ABSOLUTE_LEVEL
    if not stage.final:
        return edv.EdvStatus.NOT_FINAL_STAGE
    return None if stage.usable else edv.EdvStatus.BAD_BLOCK


def _pending(state: DamageState, reading: Reading, stage: Stage) -> tuple[Reading, ...]:
    """Keep the readings since the score rose: the tracker begins at t_fs (thesis: t(1) = t_fs), known only later."""
    if not stage.raised:
        return ()
    return (*state.pending, reading)[-_MOST_PENDING:] if stage.usable else state.pending


def _one(
    state: DamageState, reading: Reading, gate: edv.EdvStatus | None, stage: Stage, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Take one reading through the configured methods."""
    damage, forecasts = Damage(str(edv.EdvStatus.NO_MAP)), ()
    if settings.asks_library:
        state, damage, forecasts = _ask_library(state, reading, gate, stage, settings)
    if settings.track_method == "thesis":
        state, damage = _thesis_volume(state, reading, gate, settings)
    elif settings.track_method == "filter":
        state, damage = _filter_volume(state, reading, gate, settings)
    if settings.forecast_method == "thesis":
        state, forecasts = _thesis_forecast(state, reading, damage.v_eq, stage, settings)
    return state, damage, forecasts


def _ask_library(
    state: DamageState, reading: Reading, gate: edv.EdvStatus | None, stage: Stage, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Let the library say V_eq and TT; a block that is kept out of a final stage leaves its history as it is."""
    if gate is not None and (stage.final or not stage.absolute) and settings.library is not None:
        status = "cannot_tell" if stage.final else "not_final_stage"
        return state, Damage(str(gate)), tuple(Remaining(threshold, status) for threshold in settings.thresholds)
    before, known = state.library, settings.library
    if known is not None and (before.library, before.features) != (known.hash, settings.asking.features):
        # Configured anew since: histories of another library or other features mean something else, so one begins.
        before = LibraryState()
    block = LibraryInput(
        t=reading.time,
        rms=reading.rms,
        harmonics=reading.harmonics,
        load=math.nan if reading.load is None else reading.load,
        speed=math.nan if reading.speed is None else reading.speed,
    )
    after, found = ask_library(
        before, block, known, settings.asking, thresholds=settings.thresholds, final_stage=stage.final
    )
    damage = Damage(str(found.edv_status), found.v_eq, found.v_eq_lower, found.v_eq_upper)
    return replace(state, library=after), damage, tuple(Remaining.of_library(result) for result in found.forecasts)


def _thesis_volume(
    state: DamageState, reading: Reading, gate: edv.EdvStatus | None, settings: DamageSettings
) -> tuple[DamageState, Damage]:
    map_slice = None
    if settings.map_at is None and gate is not edv.EdvStatus.NO_ABSOLUTE_LEVEL:
        gate = edv.EdvStatus.NO_MAP
    elif settings.map_at is not None and gate is None:
        map_slice, gate = settings.map_at(reading.load, reading.speed)
    tracker, found = edv.step(state.edv, reading.rms, map_slice=map_slice, settings=settings.edv, gate=gate)
    damage = Damage(
        str(found.status), v_eq=found.v_eq, dphi_d=found.dphi_d, h_d=found.h_d, rms_smoothed=found.rms_smoothed
    )
    return replace(state, edv=tracker), damage


def _filter_volume(
    state: DamageState, reading: Reading, gate: edv.EdvStatus | None, settings: DamageSettings
) -> tuple[DamageState, Damage]:
    map_slice = None
    if (settings.spread_at is None or settings.filter is None) and gate is not edv.EdvStatus.NO_ABSOLUTE_LEVEL:
        return state, Damage(str(edv.EdvStatus.NO_MAP))
    if settings.spread_at is not None and gate is None:
        map_slice, gate = settings.spread_at(reading.load, reading.speed)
    if gate is not None or settings.filter is None:
        return state, Damage(str(gate))
    heard = FilterInput(t=reading.time, rms=reading.rms, harmonics=reading.harmonics)
    # A posterior over other features than are configured now says nothing of them, so a new one begins.
    before = state.filter if len(state.filter.sensors) == 1 + settings.filter.lines else FilterState()
    after, found = filter_step(before, heard, map_slice=map_slice, settings=settings.filter)
    return replace(state, filter=after), Damage(
        str(found.status),
        v_eq=found.v_eq,
        v_eq_lower=found.v_eq_lower,
        v_eq_upper=found.v_eq_upper,
        dphi_d=found.dphi_d,
        h_d=found.h_d,
    )


def _thesis_forecast(
    state: DamageState, reading: Reading, v_eq: float, stage: Stage, settings: DamageSettings
) -> tuple[DamageState, tuple[Remaining, ...]]:
    forecaster, results = forecast.step(
        state.forecast,
        reading.time,
        v_eq,
        thresholds=settings.thresholds,
        settings=settings.forecast,
        final_stage=stage.final,
    )
    return replace(state, forecast=forecaster), tuple(Remaining.of_thesis(result) for result in results)

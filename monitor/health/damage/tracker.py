"""V_eq and TT of a block by the configured methods.

Tracking begins at t_fs, which is known only later: blocks since the detector's score rose wait here and are tracked
first when the final stage is known. Each block is judged at its own load and speed. Times are damage time: standstill
does not count.
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
from monitor.health.damage.library.forecaster import step as library_step
from monitor.health.damage.library.model import Library
from monitor.health.damage.thesis import edv, forecast
from monitor.health.damage.thesis.level_set import LevelMap

if TYPE_CHECKING:
    from models.maps import data as map_data

MapAt = Callable[[float | None, float | None], "tuple[LevelMap | None, edv.EdvStatus | None]"]
"""The map at a load (N) and speed (Hz), or the status that says why there is none."""

SpreadAt = Callable[[float | None, float | None], "tuple[map_data.MapSlice | None, edv.EdvStatus | None]"]
"""Likewise with the BPFO lines and spreads; the same object for the same condition."""

TrackMethod = Literal["thesis", "filter", "library"]
ForecastMethod = Literal["thesis", "library"]

MAX_PENDING_BLOCKS = 2000
"""Blocks kept before t_fs is known; of a slower onset the first part is lost."""
_NONE = (math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class DamageInput:
    """What the trackers use of one block.

    Attributes:
        time: damage time, s.
        rms: in the band of the map, m/s2.
        harmonics: amplitudes of the first six BPFO lines, m/s2, or None where unresolved.
        load: N, or None.
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
        map_at: the RMS map by load and speed, or None.
        spread_at: the same map with its lines and spreads, for the filter.
        filter: None where there is no map for it.
        thresholds: of V_eq, m2, ascending.
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
    library_settings: LibrarySettings = field(default_factory=LibrarySettings)

    @property
    def uses_library(self) -> bool:
        """Whether V_eq or TT come from the library."""
        return "library" in (self.track_method, self.forecast_method)

    @property
    def prior(self) -> str | None:
        """The prior of the intervals, as text; None where there are no intervals."""
        parts: list[str] = []
        if self.track_method == "filter" and self.filter is not None:
            parts.append(f"for V_eq, {_describe_growth(self.filter.growth)}")
        if self.uses_library and self.library is not None:
            parts.append(f"for TT, {self.library.prior}" if parts else self.library.prior)
        return ", and ".join(parts) or None


@dataclass(frozen=True)
class DamageState:
    """State of the trackers and forecasts of a channel.

    Attributes:
        pending: blocks since the detector's score first rose, while t_fs is unknown.
    """

    pending: tuple[DamageInput, ...] = ()
    edv: edv.EdvState = field(default_factory=edv.EdvState)
    filter: FilterState = field(default_factory=FilterState)
    forecast: forecast.ForecastState = field(default_factory=forecast.ForecastState)
    library: LibraryState = field(default_factory=LibraryState)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON."""
        return {
            "pending": [[r.time, r.rms, r.harmonics, r.load, r.speed] for r in self.pending],
            "edv": self.edv.to_dict(),
            "filter": self.filter.to_dict(),
            "forecast": self.forecast.to_dict(),
            "library": self.library.to_dict(),
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> DamageState:
        """Restore a state written by :meth:`to_dict`."""
        return cls(
            pending=tuple(
                DamageInput(time, rms, None if harmonics is None else tuple(harmonics), load, speed)
                for time, rms, harmonics, load, speed in stored["pending"]
            ),
            edv=edv.EdvState.from_dict(stored["edv"]),
            filter=FilterState.from_dict(stored["filter"]),
            forecast=forecast.ForecastState.from_dict(stored["forecast"]),
            library=LibraryState.from_dict(stored["library"]),
        )


@dataclass(frozen=True)
class Damage:
    """V_eq after one block; NaN wherever ``status`` says that there is no value.

    Attributes:
        status: as in ``monitor.health.schema.EDV_STATUSES``.
        v_eq: m2; the median where there is an interval.
        v_eq_lower: lower end of its interval, m2.
        dphi_d: extent of the equivalent defect, rad.
        h_d: its depth, m.
        rms_smoothed: trailing mean of the RMS (thesis only), m/s2.
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
        tt: s of damage time; the median where there is an interval.
        tt_lower: lower end of its interval, s.
        t_threshold: when the threshold is reached, s on the blocks' clock.
        p_threshold: probability of that within the maintenance window; NaN without a window.
        coefficients: of the thesis' quadratic, SI.
        quantiles: (probability, TT in s) pairs.
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
        """Return the forecast of the thesis' method."""
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
        """Return the forecast of the library."""
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
class DamageGate:
    """Verdicts of earlier stages on the block.

    Attributes:
        final: the bearing is known to be in the final stage.
        raised: the detector's score is raised, the final stage not yet known.
        usable: the quality of the block allows inversion.
        absolute: the unit of the channel is known.
    """

    final: bool = True
    raised: bool = False
    usable: bool = True
    absolute: bool = True


def _describe_growth(growth: GrowthPrior) -> str:
    hours = " to ".join(f"{value / 3600.0:.3g}" for value in growth.durations)
    depth = " to ".join(f"{value * 1e6:g}" for value in growth.h_threshold)
    reached = f"{hours} h to {growth.threshold * 1e6:g} mm2, where it is {depth} um deep"
    return f"a growth that takes {reached}, and may stall or jump"


def step(
    state: DamageState, block: DamageInput, gates: DamageGate, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Return the next state, V_eq and one forecast per threshold for one block."""
    gate = _gate(gates)
    # Once t_fs is known, the blocks since t_fs are tracked first.
    history = (*(state.pending if gate is None else ()), block)
    damage, forecasts = Damage(str(edv.EdvStatus.NOT_FINAL_STAGE)), ()
    for item in history:
        state, damage, forecasts = _track_one(state, item, gate, gates, settings)
    if gate is None:
        return replace(state, pending=()), damage, forecasts
    if not gates.final:
        return replace(state, pending=_pending(state, block, gates)), damage, forecasts
    return state, damage, forecasts


def _gate(gates: DamageGate) -> edv.EdvStatus | None:
    """Return the status that keeps the block from every method, or None."""
    if not gates.absolute:
        return edv.EdvStatus.NO_ABSOLUTE_LEVEL
    if not gates.final:
        return edv.EdvStatus.NOT_FINAL_STAGE
    return None if gates.usable else edv.EdvStatus.BAD_BLOCK


def _pending(state: DamageState, block: DamageInput, gates: DamageGate) -> tuple[DamageInput, ...]:
    """Keep the blocks since the score rose: tracking begins at t_fs (thesis: t(1) = t_fs), known only later."""
    if not gates.raised:
        return ()
    return (*state.pending, block)[-MAX_PENDING_BLOCKS:] if gates.usable else state.pending


def _track_one(
    state: DamageState, block: DamageInput, gate: edv.EdvStatus | None, gates: DamageGate, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Apply the configured methods to one block."""
    damage, forecasts = Damage(str(edv.EdvStatus.NO_MAP)), ()
    if settings.uses_library:
        state, damage, forecasts = _track_by_library(state, block, gate, gates, settings)
    if settings.track_method == "thesis":
        state, damage = _thesis_volume(state, block, gate, settings)
    elif settings.track_method == "filter":
        state, damage = _filter_volume(state, block, gate, settings)
    if settings.forecast_method == "thesis":
        state, forecasts = _thesis_forecast(state, block, damage.v_eq, gates, settings)
    return state, damage, forecasts


def _track_by_library(
    state: DamageState, block: DamageInput, gate: edv.EdvStatus | None, gates: DamageGate, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Track and forecast by the library; a block gated in the final stage leaves its history unchanged."""
    if gate is not None and (gates.final or not gates.absolute) and settings.library is not None:
        status = "cannot_tell" if gates.final else "not_final_stage"
        return state, Damage(str(gate)), tuple(Remaining(threshold, status) for threshold in settings.thresholds)
    before, library = state.library, settings.library
    if library is not None and (before.library, before.features) != (library.hash, settings.library_settings.features):
        # The configuration has changed: a history of another library or other features cannot be continued.
        before = LibraryState()
    library_input = LibraryInput(
        t=block.time,
        rms=block.rms,
        harmonics=block.harmonics,
        load=math.nan if block.load is None else block.load,
        speed=math.nan if block.speed is None else block.speed,
    )
    after, found = library_step(
        before,
        library_input,
        library,
        settings.library_settings,
        thresholds=settings.thresholds,
        final_stage=gates.final,
    )
    damage = Damage(str(found.edv_status), found.v_eq, found.v_eq_lower, found.v_eq_upper)
    return replace(state, library=after), damage, tuple(Remaining.of_library(result) for result in found.forecasts)


def _thesis_volume(
    state: DamageState, block: DamageInput, gate: edv.EdvStatus | None, settings: DamageSettings
) -> tuple[DamageState, Damage]:
    map_slice = None
    if settings.map_at is None and gate is not edv.EdvStatus.NO_ABSOLUTE_LEVEL:
        gate = edv.EdvStatus.NO_MAP
    elif settings.map_at is not None and gate is None:
        map_slice, gate = settings.map_at(block.load, block.speed)
    tracker, found = edv.step(state.edv, block.rms, map_slice=map_slice, settings=settings.edv, gate=gate)
    damage = Damage(
        str(found.status), v_eq=found.v_eq, dphi_d=found.dphi_d, h_d=found.h_d, rms_smoothed=found.rms_smoothed
    )
    return replace(state, edv=tracker), damage


def _filter_volume(
    state: DamageState, block: DamageInput, gate: edv.EdvStatus | None, settings: DamageSettings
) -> tuple[DamageState, Damage]:
    map_slice = None
    if (settings.spread_at is None or settings.filter is None) and gate is not edv.EdvStatus.NO_ABSOLUTE_LEVEL:
        return state, Damage(str(edv.EdvStatus.NO_MAP))
    if settings.spread_at is not None and gate is None:
        map_slice, gate = settings.spread_at(block.load, block.speed)
    if gate is not None or settings.filter is None:
        return state, Damage(str(gate))
    observed = FilterInput(t=block.time, rms=block.rms, harmonics=block.harmonics)
    # The configuration has changed: a posterior over other features cannot be continued.
    before = state.filter if len(state.filter.sensors) == 1 + settings.filter.lines else FilterState()
    after, found = filter_step(before, observed, map_slice=map_slice, settings=settings.filter)
    return replace(state, filter=after), Damage(
        str(found.status),
        v_eq=found.v_eq,
        v_eq_lower=found.v_eq_lower,
        v_eq_upper=found.v_eq_upper,
        dphi_d=found.dphi_d,
        h_d=found.h_d,
    )


def _thesis_forecast(
    state: DamageState, block: DamageInput, v_eq: float, gates: DamageGate, settings: DamageSettings
) -> tuple[DamageState, tuple[Remaining, ...]]:
    forecaster, results = forecast.step(
        state.forecast,
        block.time,
        v_eq,
        thresholds=settings.thresholds,
        settings=settings.forecast,
        final_stage=gates.final,
    )
    return replace(state, forecast=forecaster), tuple(Remaining.of_thesis(result) for result in results)

"""V_eq and TT of a block by the configured methods.

Tracking begins at t_fs, which is known only later: blocks since the detector's score rose wait here and are tracked
first when the final stage is known. Each block is judged at its own load and speed. Times are damage time: standstill
does not count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from monitor.health.damage import Damage, DamageInput, EdvStatus, Remaining, TtStatus
from monitor.health.damage.filter.particle_filter import FilterSettings, FilterState
from monitor.health.damage.filter.particle_filter import step as filter_step
from monitor.health.damage.filter.prior import GrowthPrior
from monitor.health.damage.library.forecaster import LibrarySettings, LibraryState
from monitor.health.damage.library.forecaster import step as library_step
from monitor.health.damage.library.model import Library
from monitor.health.damage.thesis import edv, forecast
from monitor.health.damage.thesis.level_set import LevelMap

if TYPE_CHECKING:
    from models.maps import data as map_data

MapAt = Callable[[float | None, float | None], "tuple[LevelMap | None, EdvStatus | None]"]
"""The map at a load (N) and speed (Hz), or the status that says why there is none."""

SpreadAt = Callable[[float | None, float | None], "tuple[map_data.MapSlice | None, EdvStatus | None]"]
"""Likewise with the BPFO lines and spreads; the same object for the same condition."""

TrackMethod = Literal["thesis", "filter", "library"]
ForecastMethod = Literal["thesis", "library"]

MAX_PENDING_BLOCKS = 2000
"""Blocks kept before t_fs is known; of a slower onset the first part is lost."""


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
    for earlier in state.pending if gate is None else ():
        state, _, _ = _track_one(state, earlier, gate, gates, settings)
    state, damage, forecasts = _track_one(state, block, gate, gates, settings)
    if gate is None:
        state = replace(state, pending=())
    elif not gates.final:
        state = replace(state, pending=_pending(state, block, gates))
    return state, damage, forecasts


def _gate(gates: DamageGate) -> EdvStatus | None:
    """Return the status that keeps the block from every method, or None."""
    if not gates.absolute:
        return EdvStatus.NO_ABSOLUTE_LEVEL
    if not gates.final:
        return EdvStatus.NOT_FINAL_STAGE
    return None if gates.usable else EdvStatus.BAD_BLOCK


def _pending(state: DamageState, block: DamageInput, gates: DamageGate) -> tuple[DamageInput, ...]:
    """Keep the blocks since the score rose: tracking begins at t_fs (thesis: t(1) = t_fs), known only later."""
    if not gates.raised:
        return ()
    return (*state.pending, block)[-MAX_PENDING_BLOCKS:] if gates.usable else state.pending


def _track_one(
    state: DamageState, block: DamageInput, gate: EdvStatus | None, gates: DamageGate, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Apply the configured methods to one block."""
    damage, forecasts = Damage(EdvStatus.NO_MAP), ()
    if settings.uses_library:
        state, damage, forecasts = _track_by_library(state, block, gate, gates, settings)
    if settings.track_method == "thesis":
        state, damage = _thesis_volume(state, block, gate, settings)
    elif settings.track_method == "filter":
        state, damage = _filter_volume(state, block, gate, settings)
    if settings.forecast_method == "thesis":
        after, forecasts = forecast.step(
            state.forecast,
            block.time,
            damage.v_eq,
            thresholds=settings.thresholds,
            settings=settings.forecast,
            final_stage=gates.final,
        )
        state = replace(state, forecast=after)
    return state, damage, forecasts


def _track_by_library(
    state: DamageState, block: DamageInput, gate: EdvStatus | None, gates: DamageGate, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Track and forecast by the library; a block gated in the final stage leaves its history unchanged."""
    if gate is not None and (gates.final or not gates.absolute) and settings.library is not None:
        status = TtStatus.CANNOT_TELL if gates.final else TtStatus.NOT_FINAL_STAGE
        return state, Damage(gate), tuple(Remaining(threshold, status) for threshold in settings.thresholds)
    before, library = state.library, settings.library
    if library is not None and (before.library, before.features) != (library.hash, settings.library_settings.features):
        # The configuration has changed: a history of another library or other features cannot be continued.
        before = LibraryState()
    after, damage, forecasts = library_step(
        before,
        block,
        library,
        settings.library_settings,
        thresholds=settings.thresholds,
        final_stage=gates.final,
    )
    return replace(state, library=after), damage, forecasts


def _thesis_volume(
    state: DamageState, block: DamageInput, gate: EdvStatus | None, settings: DamageSettings
) -> tuple[DamageState, Damage]:
    if settings.map_at is None and gate is not EdvStatus.NO_ABSOLUTE_LEVEL:
        return state, Damage(EdvStatus.NO_MAP)
    map_slice = None
    if settings.map_at is not None and gate is None:
        map_slice, gate = settings.map_at(block.load, block.speed)
    if gate is not None:
        return state, Damage(gate)
    after, damage = edv.step(state.edv, block.rms, map_slice=map_slice, settings=settings.edv)
    return replace(state, edv=after), damage


def _filter_volume(
    state: DamageState, block: DamageInput, gate: EdvStatus | None, settings: DamageSettings
) -> tuple[DamageState, Damage]:
    if (settings.spread_at is None or settings.filter is None) and gate is not EdvStatus.NO_ABSOLUTE_LEVEL:
        return state, Damage(EdvStatus.NO_MAP)
    map_slice = None
    if settings.spread_at is not None and gate is None:
        map_slice, gate = settings.spread_at(block.load, block.speed)
    if gate is not None or settings.filter is None:
        return state, Damage(gate or EdvStatus.NO_MAP)
    # The configuration has changed: a posterior over other features cannot be continued.
    before = state.filter if len(state.filter.sensors) == 1 + settings.filter.lines else FilterState()
    after, damage = filter_step(before, block, map_slice=map_slice, settings=settings.filter)
    return replace(state, filter=after), damage

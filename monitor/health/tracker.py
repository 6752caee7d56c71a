"""V_eq and TT of a block by the configured methods.

Tracking begins at t_fs, which is known only later: blocks since the detector's score rose wait here and are tracked
first when the final stage is known. Each block is judged at its own load and speeds. Times are damage time: standstill
does not count.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from models.machine.scene import Part
from monitor.health.codec import StoredState
from monitor.health.rest import quadratic as forecast
from monitor.health.rest.learned.forecaster import LearnedState
from monitor.health.rest.learned.forecaster import step as learned_step
from monitor.health.rest.learned.history import StageHistory
from monitor.health.rest.learned.model import LearnedModel
from monitor.health.rest.learned.pool import pool
from monitor.health.size import Damage, DamageInput, EdvStatus, Remaining, RemainingSettings, TtStatus, edv
from monitor.health.size.calibration import beside, mark_forecast, mark_volume, relate
from monitor.health.size.filter.particle_filter import FilterSettings, FilterState
from monitor.health.size.filter.particle_filter import step as filter_step
from monitor.health.size.level_set import LevelMap, map_of_block
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState
from monitor.health.size.library.forecaster import step as library_step
from monitor.health.size.library.model import Library

if TYPE_CHECKING:
    from models.maps import data as map_data

MapAt = Callable[[float | None, float | None], "tuple[LevelMap | None, EdvStatus | None]"]
"""The map at a load (N) and speed (Hz), or the status that says why there is none."""

SpreadAt = Callable[[float | None, float | None], "tuple[map_data.MapSlice | None, EdvStatus | None]"]
"""Likewise with the BPFO lines and spreads; the same object for the same condition."""

TrackMethod = Literal["thesis", "filter", "library"]
ForecastMethod = Literal["thesis", "library", "learned", "combined"]

_LIBRARY_PARTS: tuple[Part, ...] = ("outer",)
"""Parts whose damage the lives of a library have."""

MAX_PENDING_BLOCKS = 2000
"""Blocks kept before t_fs is known; of a slower onset the first part is lost."""


@dataclass(frozen=True)
class PartMap:
    """The RMS map of one damaged part.

    Attributes:
        map_at: by load and speed.
        spread_at: the same with its lines and spreads, for the filter.
        filter: settings of the filter on it, or None where there is no filter.
        model: that it was simulated with.
    """

    map_at: MapAt
    spread_at: SpreadAt | None = None
    filter: FilterSettings | None = None
    model: str = "six_dof"


@dataclass(frozen=True)
class DamageSettings:
    """How damage is tracked and forecast on a channel.

    Attributes:
        maps: by the damaged part.
        thresholds: of V_eq, m2, ascending.
        calibrated: whether the rig of maps and library is that of the machine.
        uncalibrated_threshold: whether TT is issued where it is not.
        learned: of recorded runs, for the methods "learned" and "combined"; without runs, of the elapsed time alone.
    """

    track_method: TrackMethod = "thesis"
    forecast_method: ForecastMethod = "thesis"
    maps: Mapping[Part, PartMap] = field(default_factory=dict[Part, PartMap])
    edv: edv.EdvSettings = field(default_factory=edv.EdvSettings)
    thresholds: tuple[float, ...] = (0.05e-6,)
    library: Library | None = None
    library_settings: LibrarySettings = field(default_factory=LibrarySettings)
    calibrated: bool = True
    uncalibrated_threshold: bool = False
    learned: LearnedModel = field(default_factory=LearnedModel)
    learned_settings: RemainingSettings = field(default_factory=RemainingSettings)

    @property
    def uses_library(self) -> bool:
        """Whether V_eq or TT come from the library."""
        return "library" in (self.track_method, self.forecast_method) or self.combines

    @property
    def uses_learned(self) -> bool:
        """Whether TT comes from recorded runs, alone or combined."""
        return self.forecast_method in ("learned", "combined")

    @property
    def combines(self) -> bool:
        """Whether TT is combined with that of a library, which needs a calibrated rig."""
        return self.forecast_method == "combined" and self.library is not None and self.calibrated

    @property
    def tracks_volume(self) -> bool:
        """Whether there is anything to track V_eq by, or no other purpose than V_eq."""
        return bool(self.maps) or self.library is not None or not self.uses_learned

    @property
    def prior(self) -> str | None:
        """The prior of the intervals, as text; None where there are no intervals."""
        parts: list[str] = []
        filters = [one.filter for one in self.maps.values() if one.filter is not None]
        if self.track_method == "filter" and filters:
            parts.append(f"for V_eq, {filters[0].growth.prior}")
        if self.uses_library and self.library is not None:
            parts.append(f"for TT, {self.library.prior}" if parts else self.library.prior)
        if self.uses_learned:
            parts.append(f"for TT, {self.learned.prior}")
        return ", and ".join(parts) or None


@dataclass(frozen=True)
class DamageState(StoredState):
    """State of the trackers and forecasts of a channel.

    Attributes:
        pending: blocks since the detector's score first rose, while t_fs is unknown.
        part: whose map the blocks so far were tracked on, or None.
        first_v_eq: first V_eq that was tracked for this part, m2, or None.
    """

    LATER = frozenset({"first_v_eq", "part", "learned"})

    part: Part | None = None
    pending: tuple[DamageInput, ...] = ()
    edv: edv.EdvState = field(default_factory=edv.EdvState)
    filter: FilterState = field(default_factory=FilterState)
    forecast: forecast.ForecastState = field(default_factory=forecast.ForecastState)
    library: LibraryState = field(default_factory=LibraryState)
    learned: LearnedState = field(default_factory=LearnedState)
    first_v_eq: float | None = None

    @classmethod
    def upgraded(cls, stored: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return an older state with the first V_eq of the thesis' forecast; other methods take their next value."""
        fit: Mapping[str, Any] | None = stored["forecast"]["fit"]
        first = None if fit is None or fit["v_first"] <= 0.0 else fit["v_first"]
        return {"first_v_eq": first, **stored}


@dataclass(frozen=True)
class DamageGate:
    """Verdicts of earlier stages on the block.

    Attributes:
        final: the bearing is known to be in the final stage.
        raised: the detector's score is raised, the final stage not yet known.
        closed: with this block the final stage closed again.
        usable: the quality of the block allows inversion.
        absolute: the unit of the channel is known.
        broadband: its RMS is that of acceleration over all frequencies, as that of maps and libraries is.
        fault: the part that the envelope names, several joined by "|", or None.
        baseline: RMS of the healthy machine, in the unit of the blocks, or None.
        since_t_fs: time on the clock since t_fs, s, or None.
    """

    final: bool = True
    raised: bool = False
    closed: bool = False
    usable: bool = True
    absolute: bool = True
    broadband: bool = True
    fault: str | None = None
    baseline: float | None = None
    since_t_fs: float | None = None

    @property
    def no_level(self) -> EdvStatus | None:
        """Why the RMS of the channel is not one of maps and libraries, in any block, or None."""
        if not self.absolute:
            return EdvStatus.NO_ABSOLUTE_LEVEL
        return None if self.broadband else EdvStatus.VELOCITY_SENSOR


def part_of(fault: str | None, parts: Collection[Part]) -> Part | None:
    """Return the part whose map is taken, None where there is none for what is named.

    Of parts that are named together it is the only one that has a map. Without a name it is the outer race, as in the
    thesis, or the only part that has a map.
    """
    candidates: list[Part]
    if fault is None:
        candidates = [part for part in parts if part == "outer" or len(parts) == 1]
    else:
        candidates = [part for part in parts if part in fault.split("|")]
    return candidates[0] if len(candidates) == 1 else None


def step(
    state: DamageState, block: DamageInput, gates: DamageGate, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Return the next state, V_eq and one forecast per threshold for one block.

    Where the final stage closes, the state begins anew: a later one is another growth.
    """
    if gates.closed and (gates.no_level is None or settings.uses_learned):
        void = (Remaining(threshold, TtStatus.EPISODE_CLOSED) for threshold in settings.thresholds)
        return DamageState(), Damage(gates.no_level or EdvStatus.EPISODE_CLOSED), tuple(void)
    gate = _gate(gates)
    # What is learned is relative to the healthy machine, so that it needs no unit.
    taken = gate is None or (settings.uses_learned and gates.final and gates.usable)
    if settings.uses_learned and taken:
        state = _begin_learned(state, block, gates)
    # Once t_fs is known, the blocks since t_fs are tracked first.
    for earlier in state.pending if taken else ():
        state, _, _ = _track_one(state, earlier, gate, gates, settings)
    state, damage, forecasts = _track_one(state, block, gate, gates, settings)
    if taken:
        state = replace(state, pending=())
    elif not gates.final:
        state = replace(state, pending=_pending(state, block, gates))
    if not settings.calibrated:
        damage = mark_volume(damage)
        if not settings.uses_learned:
            forecasts = tuple(mark_forecast(one, issued=settings.uncalibrated_threshold) for one in forecasts)
    return state, damage, forecasts


def _gate(gates: DamageGate) -> EdvStatus | None:
    """Return the status that keeps the block from every method, or None."""
    if gates.no_level is not None:
        return gates.no_level
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
    if settings.track_method != "library":
        state, damage = _track_on_map(state, block, gate, gates, settings, settings.track_method)
    elif any(used.filter is not None for used in settings.maps.values()):
        state, tracked = _track_on_map(state, block, gate, gates, settings, "filter")
        damage = beside(damage, tracked)
    first, damage = relate(state.first_v_eq, damage)
    state = replace(state, first_v_eq=first)
    if settings.forecast_method == "thesis":
        after, forecasts = forecast.step(
            state.forecast,
            block.time,
            damage.v_eq,
            thresholds=settings.thresholds,
            final_stage=gates.final,
        )
        state = replace(state, forecast=after)
    if settings.uses_learned:
        state, forecasts = _forecast_learned(state, block, gates, settings, forecasts)
    return state, damage, forecasts


def _begin_learned(state: DamageState, block: DamageInput, gates: DamageGate) -> DamageState:
    """Begin the history since t_fs, also where the first blocks of the final stage were not kept."""
    if state.learned.history is not None:
        return state
    kept = state.pending if len(state.pending) < MAX_PENDING_BLOCKS else ()
    since = 0.0 if kept or gates.since_t_fs is None else gates.since_t_fs
    origin = kept[0].time if kept else min((block.time - since, *(one.time for one in state.pending[:1])))
    return replace(state, learned=LearnedState(StageHistory.begin(origin)))


def _forecast_learned(
    state: DamageState,
    block: DamageInput,
    gates: DamageGate,
    settings: DamageSettings,
    physical: tuple[Remaining, ...],
) -> tuple[DamageState, tuple[Remaining, ...]]:
    """Forecast by recorded runs, combined with the forecast of a library where there is one."""
    threshold = settings.thresholds[0]
    if gates.final and not gates.usable:
        return state, (Remaining(threshold, TtStatus.CANNOT_TELL),)
    after, found = learned_step(
        state.learned,
        block if block.reference_rms is None else replace(block, rms=block.reference_rms),
        settings.learned,
        settings.learned_settings,
        baseline=gates.baseline,
        threshold=threshold,
        final_stage=gates.final,
    )
    if settings.combines and physical:
        found = pool(found, physical[0], settings.learned.library_weight, settings.learned_settings)
    return replace(state, learned=after), (found,)


def _track_by_library(
    state: DamageState, block: DamageInput, gate: EdvStatus | None, gates: DamageGate, settings: DamageSettings
) -> tuple[DamageState, Damage, tuple[Remaining, ...]]:
    """Track and forecast by the library; a block gated in the final stage leaves its history unchanged."""
    if gate is not None and (gates.final or gates.no_level is not None) and settings.library is not None:
        status = TtStatus.CANNOT_TELL if gates.final else TtStatus.NOT_FINAL_STAGE
        return state, Damage(gate), tuple(Remaining(threshold, status) for threshold in settings.thresholds)
    if gate is None and gates.fault is not None and part_of(gates.fault, _LIBRARY_PARTS) is None:
        void = tuple(Remaining(threshold, TtStatus.CANNOT_TELL) for threshold in settings.thresholds)
        return state, Damage(EdvStatus.NOT_THIS_PART), void
    before, library = state.library, settings.library
    if library is not None and (before.library, before.features) != (library.hash, settings.library_settings.features):
        # The configuration has changed: a history of another library or other features cannot be continued.
        before = LibraryState()
        if settings.track_method == "library":
            state = replace(state, first_v_eq=None)
    after, damage, forecasts = library_step(
        before,
        block,
        library,
        settings.library_settings,
        thresholds=settings.thresholds,
        final_stage=gates.final,
    )
    return replace(state, library=after), damage, forecasts


def _track_on_map(
    state: DamageState,
    block: DamageInput,
    gate: EdvStatus | None,
    gates: DamageGate,
    settings: DamageSettings,
    method: TrackMethod,
) -> tuple[DamageState, Damage]:
    """Track by the map of the named part; where that is another part than before, the trackers begin anew."""
    if not settings.maps and gates.no_level is None:
        return state, Damage(EdvStatus.NO_MAP)
    if gate is not None:
        return state, Damage(gate)
    part = part_of(gates.fault, settings.maps)
    if part is None:
        return state, Damage(EdvStatus.NO_MAP if gates.fault is None else EdvStatus.NOT_THIS_PART)
    if part != state.part:
        # Volumes of two parts are no one growth.
        begun = DamageState(part=part) if state.part is not None else state
        state = replace(
            state, part=part, edv=begun.edv, filter=begun.filter, forecast=begun.forecast, first_v_eq=begun.first_v_eq
        )
    if method == "filter":
        return _filter_volume(state, block, settings.maps[part])
    map_slice, refused = map_of_block(settings.maps[part].map_at, block)
    if refused is not None:
        return state, Damage(refused)
    after, damage = edv.step(state.edv, block.rms, map_slice=map_slice, settings=settings.edv)
    return replace(state, edv=after), damage


def _filter_volume(state: DamageState, block: DamageInput, used: PartMap) -> tuple[DamageState, Damage]:
    if used.spread_at is None or used.filter is None:
        return state, Damage(EdvStatus.NO_MAP)
    map_slice, refused = map_of_block(used.spread_at, block)
    if refused is not None:
        return state, Damage(refused)
    # The configuration has changed: a posterior over other features cannot be continued.
    before = state.filter if len(state.filter.sensors) == 1 + used.filter.lines else FilterState()
    after, damage = filter_step(before, block, map_slice=map_slice, settings=used.filter)
    return replace(state, filter=after), damage

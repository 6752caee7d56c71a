"""Which wheel is damaged: its indicators against those that were learned of the healthy machine.

Four values of each wheel enter as logarithms: FM4, M6A, the residual over the noise, and the first sidebands over the
mesh. Each is standardised by what was learned, as one more draw from a normal distribution of which n values are known.
Of the last two, the rise that all wheels share is taken off: load, speed and noise lift them alike, a damaged wheel
stands out. FM0, NA4 and the sideband level are recorded and do not name: load moves them.

The highest excess counts as the highest of as many as there are values and wheels
(:mod:`monitor.health.onset.detector`), so that a block of a healthy machine exceeds the threshold at the stated rate.
A wheel is named after ``persist_blocks`` in a row in which it stands highest, and until ``close_blocks`` in a row stay
below half of the threshold or another wheel takes its place.

Whether a tooth is damaged or the wheel runs eccentric is a hint: one damaged tooth changes the shape of the turn (FM4,
M6A) or the residual, an eccentric wheel the first sidebands above all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from monitor.health.codec import StoredState
from monitor.health.gears.indicators import GearIndicators
from monitor.health.gears.settings import GearSettings
from monitor.health.onset.detector import one_of, threshold_for

VALUES = ("fm4", "m6a", "residual", "sideband")
"""What is learned of each wheel, as logarithms."""
_SHARED_FROM = 2
"""Place in ``VALUES`` from which a rise that all wheels share is taken off."""
DRIFT = (0.12, 0.25, 0.3, 0.3)
"""Standard deviation of the drift of each value of a healthy machine, ln."""
MIN_LEARNED = 20
"""Blocks with an average that are learned, at least."""
MARGIN = 1.25
"""Factor by which speed and load may leave what was learned, either way."""
TOOTH, ECCENTRIC, UNCERTAIN = "tooth", "eccentric", "uncertain"
KINDS = (TOOTH, ECCENTRIC, UNCERTAIN)
"""What may be wrong with a wheel that is named."""
NAMED = "gear:"
"""Beginning of the value of ``fault`` that names a wheel."""
STATUSES = ("ok", "learning", "too_short", "no_angle", "above_band", "outside_conditions", "bad_block")
"""Whether a wheel was judged in a block, or why not. Append only."""


@dataclass(frozen=True)
class Learned:
    """Running mean and sum of squared deviations of each of ``VALUES`` of one wheel, and the mean of its variance."""

    count: int = 0
    mean: tuple[float, ...] = (0.0,) * len(VALUES)
    squares: tuple[float, ...] = (0.0,) * len(VALUES)
    variance: float = 0.0

    def after(self, values: Sequence[float], variance: float) -> Learned:
        """Return what is known after one more block."""
        count = self.count + 1
        mean = tuple(old + (new - old) / count for old, new in zip(self.mean, values, strict=True))
        squares = tuple(
            before + (new - old) * (new - now)
            for before, old, now, new in zip(self.squares, self.mean, mean, values, strict=True)
        )
        return Learned(count, mean, squares, self.variance + (variance - self.variance) / count)

    def excess(self, place: int, rise: float) -> float:
        """Return a rise of one value over its mean as a standard normal excess, drift included."""
        freedom = self.count - 1
        scale = self.squares[place] / freedom * (1.0 + 1.0 / self.count)
        t = rise / math.sqrt(scale + DRIFT[place] ** 2)
        # Wallace, Ann. Math. Stat. 30, 1959: the normal deviate of the same tail as Student's t.
        normal = math.sqrt(freedom * math.log1p(t * t / freedom)) * (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
        return math.copysign(normal, t)


@dataclass(frozen=True)
class GearsState(StoredState):
    """What is known of the wheels of one channel between two blocks.

    Attributes:
        learned: by wheel.
        speed, load: least and highest that were learned, Hz and N; None before the first.
        named: the wheel that is named, or None.
        kind: of its damage, one of ``KINDS``.
        since: number of the block from which it is named.
        rival: wheel that stood above the threshold in the latest blocks, and how many.
        quiet: blocks in a row below half of the threshold.
        turns: turns per turn of the bearing's shaft of each wheel: with others, what was learned has no meaning.
    """

    VERSIONS = (1,)

    learned: Mapping[str, Learned] = field(default_factory=dict[str, Learned])
    speed: tuple[float, float] | None = None
    load: tuple[float, float] | None = None
    named: str | None = None
    kind: str | None = None
    since: int | None = None
    rival: tuple[str, int] = ("", 0)
    quiet: int = 0
    turns: Mapping[str, float] = field(default_factory=dict[str, float])
    version: int = VERSIONS[-1]


@dataclass(frozen=True)
class WheelReading:
    """What one block says of one wheel: its status, and where that is "ok" its indicators and the turns averaged."""

    status: str
    indicators: GearIndicators | None = None
    turns: int | None = None


@dataclass(frozen=True)
class GearsInput:
    """What the stage takes from a block.

    Attributes:
        wheels: by name, those that turn alike joined by "|".
        speed, load: Hz and N, or None.
        learning: whether the channel still learns its baseline.
    """

    sequence: int
    wheels: Mapping[str, WheelReading]
    speed: float | None = None
    load: float | None = None
    learning: bool = False


@dataclass(frozen=True)
class GearNamingSettings:
    """Rate of false alarms, over all wheels, and blocks in a row that name one and that end a name."""

    false_alarms_per_1000_blocks: float = 1.0
    persist_blocks: int = 5
    close_blocks: int = 50


@dataclass(frozen=True)
class GearsOutput:
    """What is said of the wheels of one channel after a block.

    Attributes:
        wheels: readings by name, with the status of what was judged.
        na4: by wheel, None where there is none.
        scores: excess of each wheel that was judged over the threshold; above 1 it counts.
        named: the wheel, or None.
        kind: of its damage, a hint.
        changed: whether the name changed with this block.
        replaced: the name before, where it changed.
    """

    wheels: Mapping[str, WheelReading]
    na4: Mapping[str, float | None] = field(default_factory=dict[str, float | None])
    scores: Mapping[str, float] = field(default_factory=dict[str, float])
    named: str | None = None
    kind: str | None = None
    changed: bool = False
    replaced: str | None = None

    @property
    def fault(self) -> str | None:
        """The value of ``fault``, or None."""
        return None if self.named is None else NAMED + self.named


def step(
    state: GearsState, block: GearsInput, gears: GearSettings, settings: GearNamingSettings
) -> tuple[GearsState, GearsOutput]:
    """Take one block of one channel into its state; wheels without an average leave theirs as it is."""
    turns = {"|".join(group): gears.by_name[group[0]].turns for group in gears.groups()}
    if dict(state.turns) != turns:
        state = GearsState(turns=turns)
    usable = {name: found for name, one in block.wheels.items() if (found := _values(one)) is not None}
    outside = {name for name in usable if _is_settled(state, name, block) and _leaves(state, block)}
    ready = {name for name in usable if _is_settled(state, name, block)} - outside
    na4 = {name: _na4(state, name, block.wheels[name]) for name in usable}
    excess = _excesses(state, {name: usable[name] for name in ready})
    learning = set(usable) - ready - outside
    if learning:
        state = _learn(state, block, {name: usable[name] for name in sorted(learning)})
    wheels = {
        name: replace(
            one, status="outside_conditions" if name in outside else "learning" if name in learning else one.status
        )
        for name, one in block.wheels.items()
    }
    threshold = threshold_for(settings.false_alarms_per_1000_blocks, 1)
    tests = len(VALUES) * max(1, len(turns))
    scores = {name: one_of(max(found), tests) / threshold for name, found in excess.items()}
    before = state.named
    if scores:
        state = _judge(state, block.sequence, scores, excess, settings)
    changed = state.named != before
    return state, GearsOutput(wheels, na4, scores, state.named, state.kind, changed, before if changed else None)


def _values(reading: WheelReading) -> tuple[float, ...] | None:
    """Return the logarithms that are learned, or None where one has no value."""
    found = None if reading.indicators is None else [getattr(reading.indicators, name) for name in VALUES]
    if found is None or any(value is None for value in found):
        return None
    return tuple(math.log(value) for value in found)


def _is_settled(state: GearsState, name: str, block: GearsInput) -> bool:
    known = state.learned.get(name)
    return known is not None and known.count >= MIN_LEARNED and not block.learning


def _na4(state: GearsState, name: str, reading: WheelReading) -> float | None:
    """Return NA4 with the present block in the mean while it is learned."""
    known = state.learned.get(name, Learned())
    indicators = reading.indicators
    if indicators is None or indicators.variance is None:
        return None
    if known.count >= MIN_LEARNED:
        return indicators.na4(known.variance)
    return indicators.na4((known.variance * known.count + indicators.variance) / (known.count + 1))


def _leaves(state: GearsState, block: GearsInput) -> bool:
    """Tell whether speed or load is beyond what was learned."""
    for known, value in ((state.speed, block.speed), (state.load, block.load)):
        if known is None or value is None:
            continue
        low, high = sorted((abs(known[0]), abs(known[1])))
        if not low / MARGIN <= abs(value) <= high * MARGIN:
            return True
    return False


def _learn(state: GearsState, block: GearsInput, values: Mapping[str, tuple[float, ...]]) -> GearsState:
    learned = dict(state.learned)
    for name, one in values.items():
        indicators = block.wheels[name].indicators
        assert indicators is not None
        assert indicators.variance is not None
        learned[name] = learned.get(name, Learned()).after(one, indicators.variance)
    return replace(state, learned=learned, speed=_wider(state.speed, block.speed), load=_wider(state.load, block.load))


def _wider(known: tuple[float, float] | None, value: float | None) -> tuple[float, float] | None:
    if value is None:
        return known
    return (value, value) if known is None else (min(known[0], value), max(known[1], value))


def _excesses(state: GearsState, values: Mapping[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
    """Return the standardised excesses of each wheel, in the order of ``VALUES``."""
    rises = {
        name: tuple(value - mean for value, mean in zip(found, state.learned[name].mean, strict=True))
        for name, found in values.items()
    }
    shared = [0.0] * len(VALUES)
    if len(rises) > 1:
        for place in range(_SHARED_FROM, len(VALUES)):
            shared[place] = max(0.0, min(rise[place] for rise in rises.values()))
    return {
        name: tuple(state.learned[name].excess(place, rise - shared[place]) for place, rise in enumerate(found))
        for name, found in rises.items()
    }


def _judge(
    state: GearsState,
    sequence: int,
    scores: Mapping[str, float],
    excess: Mapping[str, tuple[float, ...]],
    settings: GearNamingSettings,
) -> GearsState:
    """Return the state with the wheel that is named after a block that judged some."""
    best = max(scores, key=lambda name: scores[name])
    container = _container(state, best, scores)
    best = best if container is None else container
    quiet = state.quiet + 1 if scores[best] < 0.5 else 0
    rival = (best, state.rival[1] + 1 if state.rival[0] == best else 1) if scores[best] > 1.0 else ("", 0)
    state = replace(state, quiet=quiet, rival=rival)
    if rival[1] >= settings.persist_blocks:
        since = state.since if state.named == best else sequence
        return replace(state, named=best, kind=_kind(excess[best]), since=since)
    if state.named is not None and quiet >= settings.close_blocks:
        return replace(state, named=None, kind=None, since=None)
    return state


def _container(state: GearsState, best: str, scores: Mapping[str, float]) -> str | None:
    """Return a slower wheel that stands above the threshold and in whose turn are whole turns of this one, or None.

    All that repeats with that wheel shows in the average of this one too, but not the other way round.
    """
    for name, score in scores.items():
        ratio = state.turns[best] / state.turns[name]
        if score > 1.0 and round(ratio) > 1 and abs(ratio / round(ratio) - 1.0) < 1e-6:
            return name
    return None


def _kind(excess: tuple[float, ...]) -> str:
    fm4, m6a, residual, sideband = excess
    shape = max(fm4, m6a)
    if shape > max(residual, sideband) or (residual > sideband and shape > 0.0):
        return TOOTH
    return ECCENTRIC if sideband > residual else UNCERTAIN

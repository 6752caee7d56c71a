"""The geometric error of an encoder: how far each mark stands from its place, learned once and then removed.

Eccentricity and uneven marks repeat with each turn of the wheel: averaged over turns, the elapsed times less their slow
course show how wide each interval is. Turns of a block are weighted by a Hann window, so that what is not a multiple of
the shaft within two turns of the block falls out. What turns with the shaft (unbalance, a bent shaft, a shaft order of
the load) cannot be told from the marks: an error that was learned holds it as it was then, and only its changes remain.

Where the wheel has no index, each block begins at another mark: its pattern is turned to where it fits best. A block
whose pattern is not the learned one at any place is not corrected (another wheel, pulses lost within the block), and a
pattern that does not repeat from turn to turn is never used. The state is that of one wheel; after ``LEARNING_TURNS``
it no longer changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from monitor.health.codec import Float32Row, StoredState
from monitor.health.signal.rotation.intervals import (
    MIN_TURNS,
    Intervals,
    PulseTrain,
    TooFewPulsesError,
    UnevenPulsesError,
    intervals,
)

LEARNING_TURNS = 1000
"""Turns of the wheel over which its error is learned: five blocks of 5 s at 40 Hz."""

MIN_BLOCKS = 3
"""Blocks over which it is learned at least."""

MIN_REPEATED = 3.0
"""An error that is removed is at least so many times its own standard error, both root mean squares over the wheel."""

MIN_FIT = 0.5
"""Share of the power of a block's pattern that the learned one must explain."""

MAX_WANDER = 0.03
"""Power of the difference between the patterns of both halves of a block, over that of the whole."""

MAX_UNEVEN = 0.45
"""An interval that differs by more than this share from the same one of other turns, and by more than six standard
deviations of all: a pulse too few or too many that was not counted."""

_OUTLIER = 6.0

EncoderStatus = Literal[
    "ok", "learning", "not_repeatable", "other_wheel", "not_aligned", "slipped", "irregular", "too_few"
]
ENCODER_STATUSES: tuple[EncoderStatus, ...] = (
    *("ok", "learning", "not_repeatable", "other_wheel", "not_aligned", "slipped", "irregular", "too_few"),
)
"""Of a block: the error of its marks is removed; it is still learned; nothing repeats from turn to turn; the wheel has
another number of marks; the pattern is not the learned one; it wanders or jumps within the block; a pulse too few or
too many; too few turns or marks."""

_HANN_WEIGHT = 1.5
"""Variance of a mean with Hann weights over that with equal ones."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """By how much each mark stands ahead of its place.

    Attributes:
        error: shape (per_revolution,), revolutions, by ``numbers % per_revolution``; its mean is 0.
        variance: of the error of each value, revolutions squared, mean over the marks.
        turns: of the wheel that were averaged.
    """

    error: Float32Row
    variance: float
    turns: int

    @property
    def rms(self) -> float:
        """Root mean square over the marks, revolutions, what noise adds taken off."""
        return math.sqrt(max(float(np.mean(np.square(self.error))) - self.variance, 0.0))

    @property
    def rms_error(self) -> float:
        """Standard error of a mark, revolutions, root mean square over the marks."""
        return math.sqrt(self.variance)

    @property
    def repeatable(self) -> bool:
        """Whether it is more than what does not repeat leaves behind."""
        return self.rms >= MIN_REPEATED * self.rms_error


@dataclass(frozen=True, eq=False)
class BlockPattern(Pattern):
    """That of the turns of one block.

    Attributes:
        uneven: largest departure of an interval from its mean over the turns, in intervals; 0 where that is within six
            standard deviations.
    """

    uneven: float = 0.0


@dataclass(frozen=True, eq=False)
class EncoderState(StoredState):
    """What is known of a wheel; version 1.

    Attributes:
        pattern: mean over the blocks so far, or None before the first.
        blocks: that are in it.
        indexed: whether the marks are counted from an index.
        frozen: whether it has seen ``LEARNING_TURNS``.
    """

    VERSIONS = (1,)
    LATER = frozenset({"blocks", "indexed", "frozen"})

    version: int = VERSIONS[-1]
    pattern: Pattern | None = None
    blocks: int = 0
    indexed: bool = False
    frozen: bool = False


@dataclass(frozen=True, eq=False)
class EncoderReading:
    """What is said of the encoder in one block.

    Attributes:
        status: one of ``ENCODER_STATUSES``.
        error: shape (per_revolution,), revolutions by which each mark stands ahead of its place, by ``numbers %
            per_revolution`` of this train; None unless the status is "ok".
        rms, rms_error: of the learned error and of its standard error, revolutions; None where there is none yet.
        turns: over which it was learned.
    """

    status: EncoderStatus
    error: NDArray[np.float64] | None = None
    rms: float | None = None
    rms_error: float | None = None
    turns: int = 0


def encoder_step(state: EncoderState, train: PulseTrain, *, learn: bool = True) -> tuple[EncoderState, EncoderReading]:
    """Take the pulses of a block into the learned error of their wheel.

    Args:
        state: before the block.
        train: its repaired pulses.
        learn: whether the block may be learned from: False for one whose speed or quality is not in order.
    """
    is_other = state.pattern is not None and state.pattern.error.size != train.per_revolution
    try:
        found = intervals(train)
    except TooFewPulsesError:
        return state, _reading(state, "too_few")
    except UnevenPulsesError:
        return state, _reading(state, "irregular")
    block = pattern_of(found)
    if block.uneven > MAX_UNEVEN:
        return state, _reading(state, "irregular")
    if is_other:
        # How many marks a wheel has is stated: it is another one from now on.
        return _learned(EncoderState(), block, train.indexed) if learn else state, EncoderReading("other_wheel")
    if state.pattern is None:
        state = _learned(state, block, train.indexed) if learn else state
        return state, _reading(state, "learning")
    shift = 0 if train.indexed and state.indexed else _best_shift(state.pattern.error, block.error)
    turned = replace(block, error=np.roll(block.error, shift))
    fits = _fits(state.pattern, turned)
    if _slips(found, block):
        return state, _reading(state, "slipped")
    if not state.frozen:
        differs = block.repeatable and state.pattern.repeatable and not fits
        if learn:
            # Of two patterns that differ one is wrong: it begins anew. Two of noise never fit, and are averaged.
            state = _learned(EncoderState() if differs else state, block if differs else turned, train.indexed)
        return state, _reading(state, "not_aligned" if differs else "learning")
    if not state.pattern.repeatable:
        return state, _reading(state, "not_repeatable")
    if not fits:
        return state, _reading(state, "not_aligned")
    return state, replace(_reading(state, "ok"), error=np.roll(state.pattern.error, -shift))


def pattern_of(found: Intervals) -> BlockPattern:
    """Return the error of the marks in the turns of one block.

    Its variance is that of the turns about their mean: also what does not turn with the wheel, and so an upper bound.
    """
    by_turn = found.longer.reshape(found.turns, found.per_revolution)
    mean = _mean_turn(by_turn)
    # The angle of each mark in each turn, its mean over the turn taken off.
    by_turn -= mean
    uneven = max(float(by_turn.max()), -float(by_turn.min()))
    if uneven <= _OUTLIER * float(np.std(by_turn)):
        uneven = 0.0
    apart = np.cumsum(by_turn, axis=1, out=by_turn)
    apart -= apart.mean(axis=1, keepdims=True)
    np.square(apart, out=apart)
    scatter = float(apart.mean()) / found.per_revolution**2
    error = _angles(np.roll(mean, found.first % found.per_revolution))
    return BlockPattern(error, scatter * _HANN_WEIGHT / max(found.turns - 1, 1), found.turns, uneven)


def _mean_turn(by_turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean over turns with Hann weights, (turn, interval) to (interval,)."""
    turns = len(by_turn)
    weights = 1.0 - np.cos((np.arange(turns) + 0.5) * (2.0 * math.pi / turns))
    return np.einsum("t,ti->i", weights / weights.sum(), by_turn)


def _angles(widths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles of marks, revolutions, from the relative excess width of the interval after each."""
    widths = (widths - widths.mean()) / widths.size
    angles = np.concatenate(([0.0], np.cumsum(widths)[:-1]))
    return angles - angles.mean()


def _learned(state: EncoderState, block: Pattern, indexed: bool) -> EncoderState:
    """Return the state with a block whose pattern is already turned to that of the state."""
    before = state.pattern
    if before is None:
        mean, variance, turns = block.error, block.variance, block.turns
    else:
        turns = before.turns + block.turns
        share = block.turns / turns
        mean = before.error + share * (block.error - before.error)
        variance = (1.0 - share) ** 2 * before.variance + share**2 * block.variance
    # As stored: a restarted monitor goes on with the same digits.
    mean = mean.astype(np.float32).astype(np.float64)
    blocks = state.blocks + 1
    frozen = turns >= LEARNING_TURNS and blocks >= MIN_BLOCKS
    return EncoderState(
        pattern=Pattern(mean, variance, turns),
        blocks=blocks,
        indexed=indexed and (before is None or state.indexed),
        frozen=frozen,
    )


def _best_shift(learned: NDArray[np.float64], block: NDArray[np.float64]) -> int:
    """Return by how many marks a block's pattern has to be rolled to fit the learned one best."""
    product = np.fft.rfft(learned) * np.conj(np.fft.rfft(block))
    return int(np.argmax(np.fft.irfft(product, learned.size)))


def _fits(learned: Pattern, block: Pattern) -> bool:
    """Tell whether the learned pattern explains enough of a block's; a block of much noise is not explained."""
    left = float(np.mean(np.square(block.error - learned.error)))
    return left <= (1.0 - MIN_FIT) * float(np.mean(np.square(block.error)))


def _slips(found: Intervals, whole: Pattern) -> bool:
    """Tell whether the pattern jumps between the halves of a block, as it does where pulses are lost uncounted."""
    if found.turns < 2 * MIN_TURNS or not whole.repeatable:
        return False
    by_turn = found.longer.reshape(found.turns, found.per_revolution)
    half = found.turns // 2
    apart = _angles(_mean_turn(by_turn[:half])) - _angles(_mean_turn(by_turn[half:]))
    power = float(np.mean(np.square(apart)))
    # Half of the turns have twice the variance.
    noise = 4.0 * whole.variance
    return power > MIN_REPEATED**2 * noise and power > MAX_WANDER * float(np.mean(np.square(whole.error)))


def _reading(state: EncoderState, status: EncoderStatus) -> EncoderReading:
    if state.pattern is None:
        return EncoderReading(status)
    return EncoderReading(status, None, state.pattern.rms, state.pattern.rms_error, state.pattern.turns)

"""One block through the detector: baseline, score, final stage that opens and closes, end of life.

The end of life: peaks that reach a limit, in the final stage, at a level that stays up.

A knock, a restart or a loose part gives one or several high peaks; a bearing that is worn out gives them block after
block, and its level lies high between them. So the peaks must be consecutive and, over twice as many blocks and one,
the median of the peaks must reach half the limit and that of RMS the level of an alarm.

The score that a healthy block exceeds at a stated rate, and what it costs to listen to several parts.

Of the lines of several parts the highest excess z counts. Any of m may be the one that chance lifts, however they
depend on each other (the lines of two parts can share bins, all share a floor): P(max z > x) <= m Q(x), with Q the
upper tail of the normal distribution. So z gives up 2 ln m of its square,

    g = sqrt(max(z^2 - 2 ln m, 0)),    m Q(z) <= Q(g),

since Q(x) = phi(x) M(x), phi(g) = m phi(z), and Mills' ratio M falls: g exceeds any value at most as often as one
standard normal excess does, and the threshold is that of the level and one family of lines.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

from monitor.health.onset.baseline import learn, learn_lines, learn_lower, learn_wider
from monitor.health.onset.state import (
    HEALTHY,
    LINES,
    MAX_EPISODES,
    Baseline,
    DetectInput,
    DetectOutput,
    DetectSettings,
    DetectState,
    Episode,
    Mark,
    Relearned,
)


def one_of(excess: float, count: int) -> float:
    """Return what the highest of ``count`` standardised excesses is worth as the only one, at least 0."""
    if count <= 1 or excess <= 0.0:
        return max(excess, 0.0)
    return math.sqrt(max(excess * excess - 2.0 * math.log(count), 0.0))


def exceedance_rate(threshold: float, groups: int = 2) -> float:
    """Return how often the score of a healthy block exceeds ``threshold`` (positive).

    The score is the length of ``groups`` independent standard normal excesses, negative ones set to zero: the number of
    positive ones is binomial, and the length of k of them has the chi distribution of k degrees of freedom.
    """
    return sum(math.comb(groups, k) * _chi_tail(threshold, k) for k in range(1, groups + 1)) / 2.0**groups


def _chi_tail(x: float, freedom: int) -> float:
    """Return the upper tail of the chi distribution, in closed form."""
    half = 0.5 * x * x
    if freedom % 2:
        total, term = math.erfc(x / math.sqrt(2.0)), math.sqrt(2.0 / math.pi) * x * math.exp(-half)
        for k in range(3, freedom + 1, 2):
            total, term = total + term, term * x * x / k
        return total
    total = term = math.exp(-half)
    for k in range(1, freedom // 2):
        term *= half / k
        total += term
    return total


@cache
def threshold_for(false_alarms_per_1000_blocks: float, groups: int = 2) -> float:
    """Return the score that a healthy block exceeds at the stated rate.

    Raises:
        ValueError: the rate is not between 1e-9 and 500 per 1000 blocks.
    """
    rate = false_alarms_per_1000_blocks / 1000.0
    if not 1e-12 <= rate <= 0.5:
        raise ValueError(f"false_alarms_per_1000_blocks must be between 1e-9 and 500, got {rate * 1000:g}")
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if exceedance_rate(middle, groups) > rate else (low, middle)
    return 0.5 * (low + high)


_PEAK_SHARE = 0.5


def count_peaks(
    state: DetectState,
    block: DetectInput,
    mark: Mark,
    settings: DetectSettings,
    threshold: float,
    level: float | None = None,
) -> DetectState:
    """Latch the end of life at the first of the consecutive blocks that reach the peak.

    Args:
        state: after the onset of this block.
        threshold: of the score.
        level: RMS over what is learned at the condition of the block, or None.
    """
    if state.t_eol is not None or block.peak is None:
        return state
    reference = state.reference_rms
    rms = block.rms if level is None or reference is None else level * reference
    recent = (*state.recent, (block.peak, rms))[-(2 * settings.end_of_life_blocks + 1) :]
    if block.peak < settings.end_of_life_peak:
        return replace(state, recent=recent, high_peaks=0, first_high_peak=None)
    first, count = state.first_high_peak or mark, state.high_peaks + 1
    state = replace(state, recent=recent, high_peaks=count, first_high_peak=first)
    if state.t_fs is None or count < settings.end_of_life_blocks or not _is_sustained(state, settings, threshold):
        return state
    return replace(state, t_eol=first, quiet=0, quiet_since=None)


def _is_sustained(state: DetectState, settings: DetectSettings, threshold: float) -> bool:
    if state.baseline is None:
        return False
    peak, rms = (statistics.median(values) for values in zip(*state.recent, strict=True))
    level = state.baseline.ln_rms + threshold * math.hypot(state.baseline.ln_rms_sd, settings.rms_drift)
    return peak >= _PEAK_SHARE * settings.end_of_life_peak and rms > math.exp(level)


_ONSET_SHARE = 0.5
"""t_fs is where the score rose for good above this share of the threshold; below it, an episode is quiet."""
_LEAST_SD = 1e-6


@dataclass(frozen=True)
class _Judged:
    """Excesses of a block over the baseline in standard deviations.

    Attributes:
        rms: of RMS, of either sign.
        ln_level: RMS over what is learned at the condition of the block.
        lines: of those lines that are listened to.
        listened: how many lines are, shown in this block or not.
    """

    rms: float
    ln_level: float = 0.0
    lines: Mapping[str, float] = field(default_factory=dict[str, float])
    listened: int = 0

    @property
    def highest_line(self) -> float:
        """What the highest of the lines counts."""
        return one_of(self._highest, self.listened)

    @property
    def _highest(self) -> float:
        return max(0.0, *self.lines.values()) if self.lines else 0.0

    @property
    def score(self) -> float:
        """Length of the vector of the positive excesses of RMS and of the highest lines."""
        return math.hypot(max(self.rms, 0.0), self.highest_line)

    @property
    def height(self) -> float:
        """The same with nothing given up: it dates an onset that the score has proved."""
        return math.hypot(max(self.rms, 0.0), self._highest)

    def raised(self, level: float) -> tuple[str, ...]:
        """Return the lines that stand above the baseline by more than a level."""
        return tuple(name for name, excess in self.lines.items() if excess > level)

    @property
    def leading(self) -> str | None:
        """The feature that adds most to the score."""
        if self.score == 0.0:
            return None
        return "rms" if self.rms >= self.highest_line else max(self.lines, key=lambda name: self.lines[name])


def step(state: DetectState, block: DetectInput, settings: DetectSettings) -> tuple[DetectState, DetectOutput]:
    """Apply one block to the state.

    Blocks must come in the order of acquisition; one that is not usable, or at a condition at which the level was not
    learned, changes only the recent peaks and how many of the latter there were.
    """
    before, mark = state, Mark(block.sequence, block.time)
    judged: _Judged | None = None
    closed: Episode | None = None
    relearned: Relearned | None = None
    threshold = _threshold(state.baseline, settings)
    depends = state.baseline is not None and "rms" in state.baseline.by
    if block.usable and block.rms > 0.0:
        state = replace(state, seen=state.seen + 1)
        if state.baseline is None:
            state = learn(state, block, settings)
        elif (judged := _judge(state.baseline, block, settings)) is None:
            state = learn_wider(state, block, settings)
        else:
            state, closed = _advance(state, judged, threshold, mark, settings)
            state, relearned = _keep_baseline(state, block, judged, threshold, settings)
    level = None if judged is None or not depends else math.exp(judged.ln_level)
    state = count_peaks(state, block, mark, settings, threshold, level)
    return state, DetectOutput(
        stage=state.stage,
        score=None if judged is None else judged.score,
        threshold=threshold,
        leading=None if judged is None else judged.leading,
        raised=() if judged is None else judged.raised(_ONSET_SHARE * threshold),
        alarm=before.t_fs is None and state.t_fs is not None,
        end=before.t_eol is None and state.t_eol is not None,
        closed=closed,
        relearned=relearned,
        level=level,
        expected_rms=state.reference_rms if not depends else None if level is None else block.rms / level,
        outside=state.outside > before.outside,
    )


def raised_lines(state: DetectState, block: DetectInput, settings: DetectSettings) -> tuple[str, ...]:
    """Return the lines that stand above the baseline by half the threshold; none of a block that is not used."""
    if state.baseline is None or not block.usable or block.rms <= 0.0:
        return ()
    judged = _judge(state.baseline, block, settings)
    return () if judged is None else judged.raised(_ONSET_SHARE * _threshold(state.baseline, settings))


def _listened(baseline: Baseline, settings: DetectSettings) -> tuple[str, ...]:
    return tuple(name for name in LINES if name in settings.features and name in baseline.lines)


def _threshold(baseline: Baseline | None, settings: DetectSettings) -> float:
    """Return the threshold for RMS, and for lines beside it where any are listened to."""
    with_lines = bool(set(LINES) & set(settings.features) if baseline is None else _listened(baseline, settings))
    return threshold_for(settings.false_alarms_per_1000_blocks, 1 + with_lines)


def _judge(baseline: Baseline, block: DetectInput, settings: DetectSettings) -> _Judged | None:
    """Return the excesses of a block; None at a condition at which its RMS was not learned."""

    def excess(ln_value: float, middle: float, spread: float, drift: float, error: float) -> float:
        sd = math.hypot(spread, drift)
        return (ln_value - middle) / max(sd if error == 0.0 else math.hypot(sd, error), _LEAST_SD)

    _, ln_rms, ln_lines, condition = block.point
    rms = baseline.less_condition("rms", ln_rms, condition)
    if rms is None:
        return None
    shown: dict[str, float | None] = dict(zip(LINES, ln_lines, strict=True))
    listened = _listened(baseline, settings)
    lines = {
        name: baseline.less_condition(name, value, condition)
        for name in listened
        if (value := shown[name]) is not None and name not in block.shallow
    }
    return _Judged(
        rms=excess(rms[0], baseline.ln_rms, baseline.ln_rms_sd, settings.rms_drift, rms[1]),
        ln_level=rms[0] - baseline.ln_rms,
        lines={
            name: excess(line[0], *baseline.lines[name], settings.h_or_drift, line[1])
            for name, line in lines.items()
            if line is not None
        },
        listened=len(listened),
    )


def _advance(
    state: DetectState, judged: _Judged, threshold: float, mark: Mark, settings: DetectSettings
) -> tuple[DetectState, Episode | None]:
    """Count exceedances, or the quiet blocks of the final stage.

    The final stage begins where the elevated interval began that holds the alarm. It closes where it was quiet for long
    enough, unless the life has ended.
    """
    score, level = judged.score, _ONSET_SHARE * threshold
    if state.t_fs is not None and state.t_fs_known is not None:
        return _hold(state, mark, settings, began=state.t_fs, known=state.t_fs_known, raised=score > level)
    elevated = (state.elevated or mark) if judged.height > level else None
    exceeding = state.exceeding + 1 if score > threshold else 0
    state = replace(state, elevated=elevated, exceeding=exceeding)
    if exceeding >= settings.persist_blocks:
        state = replace(state, t_fs=elevated, t_fs_known=mark, learned=(), lower_since=None, returned=0)
    return state, None


def _hold(
    state: DetectState, mark: Mark, settings: DetectSettings, *, began: Mark, known: Mark, raised: bool
) -> tuple[DetectState, Episode | None]:
    """Take a block of an open episode."""
    if raised or state.t_eol is not None:
        return replace(state, quiet=0, quiet_since=None), None
    quiet, since = state.quiet + 1, state.quiet_since or mark
    if quiet < settings.close_blocks:
        return replace(state, quiet=quiet, quiet_since=since), None
    closed = Episode(began, known, since, mark)
    episodes = (*state.episodes, closed)[-MAX_EPISODES:]
    # What follows is a machine as healthy as before: the detector is armed again.
    nothing = {"elevated": None, "t_fs": None, "t_fs_known": None, "quiet_since": None}
    return replace(state, exceeding=0, quiet=0, episodes=episodes, **nothing), closed


def _keep_baseline(
    state: DetectState, block: DetectInput, judged: _Judged, threshold: float, settings: DetectSettings
) -> tuple[DetectState, Relearned | None]:
    """Follow a healthy machine whose level stays below the baseline, or learn the lines that the baseline lacks."""
    if state.stage != HEALTHY:
        return state, None
    state, relearned = learn_lower(state, block, settings, below=judged.rms < -threshold)
    if state.lower_since is None and relearned is None and judged.score <= _ONSET_SHARE * threshold:
        state = learn_lines(state, block, settings)
    return state, relearned

"""Time to the end of a final stage, as recorded runs ended (``--method learned``), block by block.

It needs RMS alone, in any unit, and the RMS of the healthy machine; without recorded runs it needs the time alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from monitor.health.codec import StoredState
from monitor.health.rest.learned.fit import MIN_POINTS
from monitor.health.rest.learned.history import StageHistory
from monitor.health.rest.learned.model import Distribution, LearnedModel
from monitor.health.size import DamageInput, Remaining, RemainingSettings, TtStatus
from monitor.health.size.library.forecaster import QUANTILES


@dataclass(frozen=True)
class LearnedState(StoredState):
    """State of the forecasts, of bounded size; ``history`` is None before the first block of the final stage.

    It depends on no model, so that another model continues it.
    """

    VERSIONS = (1,)

    history: StageHistory | None = None
    version: int = VERSIONS[-1]


def step(
    state: LearnedState,
    block: DamageInput,
    model: LearnedModel | None = None,
    settings: RemainingSettings | None = None,
    *,
    baseline: float | None = None,
    threshold: float = math.nan,
    final_stage: bool = True,
) -> tuple[LearnedState, Remaining]:
    """Add one block to the history; return the forecast.

    Args:
        state: ``LearnedState()`` at t_fs.
        block: time and RMS.
        model: None for "as long again as it has lasted".
        baseline: RMS of the healthy machine in the unit of the block's, or None.
        threshold: of V_eq, m2; not used, only named in the result.
        final_stage: where False, the state is returned unchanged.

    Raises:
        ValueError: a time that is not finite or goes back.
    """
    settings, model = settings or RemainingSettings(), model or LearnedModel()
    if not final_stage:
        return state, Remaining(threshold, TtStatus.NOT_FINAL_STAGE)
    if not math.isfinite(block.time) or (state.history is not None and block.time < state.history.latest):
        after = "" if state.history is None else f" after {state.history.latest:g}"
        raise ValueError(f"time must be finite and may not go back, got {block.time:g}{after}")
    if not (math.isfinite(block.rms) and block.rms > 0.0):
        return state, Remaining(threshold, TtStatus.CANNOT_TELL)
    history = (state.history or StageHistory.begin(block.time)).add(block.time, math.log(block.rms))
    state = LearnedState(history)
    if history.count < MIN_POINTS or history.elapsed <= 0.0:
        return state, Remaining(threshold, TtStatus.TOO_FEW_POINTS)
    ln_baseline = math.log(baseline) if baseline else math.nan
    inputs = history.inputs(ln_baseline)
    found = model.distribution(inputs, history.elapsed)
    result = replace(_forecast(found, block.time, settings), threshold=threshold)
    return state, replace(result, p_crossed=model.end_levels.probability_beyond(float(inputs[1])))


def _forecast(found: Distribution, t: float, settings: RemainingSettings) -> Remaining:
    """Return the forecast of a distribution, issued at a damage time, s."""
    half = 0.5 * settings.interval
    median = found.quantile(0.5)
    status = TtStatus.OK if median <= settings.horizon else TtStatus.BEYOND_HORIZON
    return Remaining(
        threshold=math.nan,
        status=TtStatus.OUTSIDE_LIBRARY if found.outside else status,
        tt=median,
        tt_lower=found.quantile(0.5 - half),
        tt_upper=found.quantile(0.5 + half),
        t_threshold=t + median,
        p_threshold=math.nan if settings.window is None else found.probability(settings.window),
        quantiles=tuple((level, found.quantile(level)) for level in QUANTILES),
    )

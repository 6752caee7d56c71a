"""Simulate the vibration of a scene with the model that it names, or the cheapest that is good enough for it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from models.solve.choice import select
from models.solve.response import judged
from models.words.request import Request

if TYPE_CHECKING:
    from models.machine.scene import Scene
    from models.solve.response import Response
    from models.words.request import Quantity, Sensor

# The slope of RMS by volume is taken over twice the accuracy of the volume, within these limits, from responses whose
# error is this share of that change.
_LEAST_CHANGE, _MOST_CHANGE = 0.02, 0.1
_SLOPE_ACCURACY = 0.05
# Below this slope the RMS does not tell the volume.
_LEAST_SLOPE = 0.02
# A finer accuracy is not asked for.
_LEAST_ACCURACY = 1e-7


def simulate(
    scene: Scene,
    *,
    accuracy: float = Request.accuracy,
    tolerance: float | None = None,
    steps_per_period: int | None = None,
    max_periods: int = Request.max_periods,
    band: tuple[float, float] | None = None,
    lines_to: float | None = None,
    direction: float = 0.0,
    duration: float = Request.duration,
    rate: float = Request.rate,
    quantity: Quantity = "rms",
    sensor: Sensor | None = None,
) -> Response:
    """Return the settled vibration of a scene.

    A motion that nothing but the ball passages drives is solved for one ball period; any other is simulated over time
    and averaged. ``Response.why`` says what was taken.

    Args:
        accuracy: relative error of ``quantity`` that is asked for. Steps are halved until its estimate,
            ``Response.error``, is below it; the status ``inaccurate`` says that it is not met.
        tolerance: relative change of the RMS from period to period at which the motion counts as settled, by default
            a hundredth of the accuracy.
        steps_per_period: least steps in a ball period, instead of those that the accuracy asks for.
        max_periods: ball periods to simulate where the motion does not settle, at least 20; up to four times as many
            where its level still drifts, and up to 4000 beside an orbit in which the rings part.
        band: frequencies (lo, hi), Hz, in which RMS and peak are taken; None is the full bandwidth.
        lines_to: frequency up to which the lines of the spectrum are computed, Hz, raised to the end of the band; by
            default 30 kHz and at most 10,000 lines, or as far as the steps or the signal resolve.
        direction: angle of the sensor from the load, rad.
        duration: time to simulate where the motion is not driven by the ball passages alone, s.
        rate: sampling rate of ``Response.record`` then, Hz.
        quantity: what the accuracy is for: "waveform" (RMS of its error over its RMS), "rms", "lines" (the first six of
            the passages over the defect) or "v_eq": the equivalent volume that a monitor would find from the RMS, whose
            error is that of the RMS over the local slope of ln RMS by ln V (``volume_slope``), which needs two more
            responses. That one RMS may belong to several volumes is not in it.
        sensor: the first of the response, to which its errors apply; None is the first of the model.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    request = Request(
        accuracy=accuracy,
        tolerance=tolerance,
        steps_per_period=steps_per_period,
        max_periods=max_periods,
        band=band,
        lines_to=lines_to,
        direction=direction,
        duration=duration,
        rate=rate,
        quantity=quantity,
        sensor=sensor,
    )
    if quantity != "v_eq":
        return _answer(scene, request)
    slope = abs(volume_slope(scene, request))
    finer = max(accuracy * max(slope, _LEAST_SLOPE), _LEAST_ACCURACY)
    found = _answer(scene, replace(request, quantity="rms", accuracy=finer))
    known = slope > _LEAST_SLOPE
    error, model = (value / slope if known else math.inf for value in (found.rms_error, found.model_error))
    return judged(replace(found, v_eq_error=error, model_error=model if known else 0.0), request)


def volume_slope(scene: Scene, request: Request) -> float:
    """Return the slope of ln RMS by ln V where the defect of a scene grows in extent and depth alike.

    Raises:
        ValueError: if the scene has not exactly one defect that a ball can feel.
    """
    defect = scene.defect
    if defect is None or not defect.moves_balls or scene.more_defects:
        raise ValueError("quantity 'v_eq' needs a scene with one defect of some extent and depth")
    change = min(max(2.0 * request.accuracy, _LEAST_CHANGE), _MOST_CHANGE)
    finer = replace(request, quantity="rms", accuracy=min(request.accuracy, _SLOPE_ACCURACY * change))
    # Each of extent and depth takes half of the change of the volume in logarithm, to either side.
    share = math.exp(0.25 * math.log1p(change))
    sizes = [(min(k * defect.dphi_d, 2.0 * math.pi), k * defect.h_d) for k in (1.0 / share, share)]
    levels = [_answer(replace(scene, defect=replace(defect, dphi_d=d, h_d=h)), finer).rms for d, h in sizes]
    if not min(levels) > 0.0:
        return 0.0
    (d_1, h_1), (d_2, h_2) = sizes
    return math.log(levels[1] / levels[0]) / math.log(d_2 * h_2 / (d_1 * h_1))


def _answer(scene: Scene, request: Request) -> Response:
    """Return the response of what is chosen, or of the reference where a stand-in says that it missed the accuracy."""
    chosen = select(scene, request)
    found = chosen.answer()
    if chosen.instead is None:
        return found
    found = judged(found, request)
    usable = found.status == "converged" or (found.status == "not_periodic" and not scene.repeats)
    return found if usable and found.error <= request.accuracy else chosen.instead.answer()

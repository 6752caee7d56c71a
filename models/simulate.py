"""Simulate the vibration of a scene with the model that it names, or the cheapest that has all of its effects."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from models.registry import Request, adapted, choose

if TYPE_CHECKING:
    from models.response import Response
    from models.scene import Scene


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
) -> Response:
    """Return the settled vibration of a scene.

    A motion that nothing but the ball passages drives is solved for one ball period; any other is simulated over time
    and averaged. ``Response.why`` says what was taken.

    Args:
        accuracy: relative error of the RMS that is asked for. Steps are halved until their estimated error is below
            it; ``Response.rms_error`` is the estimate, and the status ``inaccurate`` says that it is not met.
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
    )
    solver, why = choose(scene, request)
    response = solver.solve(adapted(scene, solver), request)
    return response if why is None else replace(response, why=why)

"""Simulate the settled vibration of a scene with the model that it names."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.dynamics.orbit import STATE_SCALE, find_orbit, period_jacobian
from models.dynamics.six_dof import BallPeriod, prepare
from models.kernels.orbit import fourier_coefficients
from models.kernels.six_dof import P_U_1
from models.response import HARMONICS, Response, check_band, peak_in_band

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.scene import Scene

DEFAULT_TOLERANCE = 1e-5
DEFAULT_MAX_PERIODS = 300
# Lines are computed up to here, Hz; the model is meant for recorders of up to 20 kHz.
LINES_TO = 30e3
# Lines above this share of the step rate are not resolved by the quadrature (half would be the Nyquist limit).
_RESOLVED = 0.4
# The Jacobian only steers the search for the orbit, so few steps suffice.
_JACOBIAN_STEPS = 96
_WORST_CONDITION = 1e10


def simulate(
    scene: Scene,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    accuracy: float | None = None,
    steps_per_period: int | None = None,
    max_periods: int = DEFAULT_MAX_PERIODS,
    band: tuple[float, float] | None = None,
    lines_to: float = LINES_TO,
) -> Response:
    """Return the settled vibration of a scene.

    Args:
        tolerance: relative change of the RMS from period to period at which the motion counts as settled.
        accuracy: target of the relative error of the RMS due to the steps (rms over scenes), at least 2e-4, the
            default; coarser ones are faster. benchmarks/six_dof.py measures the actual error.
        steps_per_period: minimum number of steps in a ball period, instead of ``accuracy``.
        band: frequencies (lo, hi), Hz, in which RMS and peak are taken; None is the full bandwidth.
        lines_to: frequency up to which the lines of the spectrum are computed, Hz; raised to the end of the band,
            and lowered to 0.4 of the step rate, beyond which the steps do not resolve them.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    if scene.model != "six_dof":
        raise ValueError(f"unknown model {scene.model!r}; known are: six_dof")
    period = prepare(scene, steps_per_period, accuracy)
    resolved = _resolved(period.steps, period.duration)
    if band is not None:
        lines_to = max(lines_to, check_band(band)[1])
        check_resolved(band, period.steps, period.duration)
    orbit = find_orbit(
        period,
        tolerance=tolerance,
        max_periods=max_periods,
        steering=steering(replace(scene, defect=None)),
    )
    bpfo = 1.0 / period.duration
    count = max(HARMONICS, math.ceil(min(lines_to, resolved) / bpfo))
    coefficients = fourier_coefficients(orbit.waves, period.time, period.weight, period.first, period.duration, count)
    rms, peak = _levels(period, orbit.waves) if band is None else _levels_in_band(coefficients, bpfo, band)
    return Response(
        rms=float(rms[0]),
        peak=float(peak[0]),
        rms_resonator=float(rms[1]),
        peak_resonator=float(peak[1]),
        bpfo=bpfo,
        harmonics=2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1]),
        periods=orbit.periods,
        period_change=orbit.period_change,
        spread=orbit.spread,
        model=scene.model,
        status=orbit.status,
        rms_band=band,
        coefficients=coefficients,
    )


def _resolved(steps: int, duration: float) -> float:
    """Return the frequency up to which the quadrature over a ball period resolves lines, Hz."""
    return _RESOLVED * steps / duration


def steps_to_resolve(frequency: float, duration: float) -> int:
    """Return how many steps in ``duration`` s resolve lines up to a frequency, Hz."""
    return math.ceil(frequency * duration / _RESOLVED)


def check_resolved(band: tuple[float, float], steps: int, duration: float) -> None:
    """Raise a ValueError that names what ``steps`` in ``duration`` s resolve, if the band ends beyond it."""
    resolved = _resolved(steps, duration)
    if band[1] > resolved:
        raise ValueError(f"the band ends at {band[1]!r} Hz, {steps} steps resolve up to {resolved:.0f} Hz")


def _levels(period: BallPeriod, waves: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return RMS and peak of both sensors over full bandwidth, each of shape (2,)."""
    power = np.einsum("pvs,v->s", waves * waves, period.weight) / len(waves)
    return np.sqrt(np.maximum(power, 0.0)), np.max(np.abs(waves), axis=(0, 1))


def _levels_in_band(
    coefficients: NDArray[np.complex128], bpfo: float, band: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return RMS and peak of both sensors from the lines within a band, each of shape (2,)."""
    low, high = max(1, math.ceil(band[0] / bpfo)), math.floor(band[1] / bpfo)
    rms = np.sqrt(2.0 * np.sum(np.abs(coefficients[:, low : high + 1]) ** 2, axis=1))
    return rms, np.array([peak_in_band(row, low, high) for row in coefficients])


@lru_cache(maxsize=512)
def steering(scene: Scene) -> NDArray[np.float64] | None:
    """Return the matrix that steers the orbit search of scenes that differ from this healthy one in the defect only.

    It is the inverse of identity minus the scaled Jacobian of the healthy period map, shape (12, 12); None if that is
    ill-conditioned or not finite.
    """
    period = prepare(scene, _JACOBIAN_STEPS)
    approach = float(period.parameter[P_U_1]) - scene.clearance
    if approach <= 0.0:
        return None
    jacobian = period_jacobian(period, min(1e-2, 1e-2 * approach / STATE_SCALE[0]))
    if not np.all(np.isfinite(jacobian)):
        return None
    try:
        inverse = np.linalg.inv(jacobian)
    except np.linalg.LinAlgError:
        return None
    if not np.linalg.norm(jacobian) * np.linalg.norm(inverse) < _WORST_CONDITION:
        return None
    return np.ascontiguousarray(-inverse, dtype=np.float64)

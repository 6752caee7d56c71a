"""The six-degree-of-freedom model with slip as its mean force, which has a ball period: one scene by the lane kernels.

Sigma of Eq. 82 redrawn ever faster leaves the mean of the contact force over sigma (``models.machine.scene.Slip``).
Blocks of PERIODS ball periods are simulated until they no longer change, and steps are halved until the estimated error
is within the accuracy that is asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.rig import Rig
from models.solve.engine.motion import ERROR_OF_WAVE
from models.solve.registry import Solver
from models.solve.response import HARMONICS, Response, Status, judged, levels_of_lines, lines_error
from models.solve.six_dof.kernels.lanes import LANES
from models.solve.six_dof.lane_group import PERIODS, Group, Workspace
from models.solve.six_dof.lanes import LaneOptions, shared_grid
from models.solve.six_dof.setup import LANE_EFFECTS, LANE_STEP, MIN_LANE_STEPS, MODEL, check_scene, mean_force_cost
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene

EFFECTS = LANE_EFFECTS - {"slip"}
# Steps in a ball period at most; a smaller vibration counts as zero, m/s2.
MOST_STEPS = 16384
_SILENCE = 1e-9
# Lines up to this share of the step rate are computed.
_RESOLVED = 0.4
# Relative change of the RMS from block to block that counts as none, as a share of the accuracy.
_SETTLING_SHARE = 0.1
# A smaller one is rounding.
_LEAST_TOLERANCE = 1e-9
_LEAST_ERROR = 1e-5


@dataclass(frozen=True, eq=False)
class _Motion:
    """The last block of a motion with steps of one length.

    Attributes:
        coefficients: Fourier coefficients at multiples of the ball passage, m/s2, (2, lines + 1).
        wave: accelerations of both sensors, m/s2, (steps, 2).
        level, change: RMS of the casing, m/s2, and its relative change from block to block.
        levels: RMS of the casing in the later half of the blocks.
    """

    coefficients: NDArray[np.complex128]
    wave: NDArray[np.float64]
    level: float
    change: float
    levels: NDArray[np.float64]
    blocks: int


def solve(scene: Scene, request: Request) -> Response:
    """Return the settled vibration of a scene with slip as its mean force.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    check_scene(scene, EFFECTS)
    if request.direction != 0.0:
        raise ValueError(f"direction must be 0 with slip as its mean force, got {request.direction!r} rad")
    steps, fixed = _first_steps(scene, request)
    workspace = Workspace()
    motion = _settle(scene, request, steps, workspace)
    periods = motion.blocks
    while True:
        finer = _settle(scene, request, 2 * steps, workspace)
        delta, wave = _changes(motion, finer)
        periods, motion, steps = periods + finer.blocks, finer, 2 * steps
        error = max(delta, ERROR_OF_WAVE * wave)
        asked = {"waveform": wave, "lines": _error_of_lines(motion, wave)}.get(request.quantity, error + motion.change)
        if fixed or asked <= request.accuracy or 2 * steps > MOST_STEPS:
            break
    return judged(_response(scene, request, motion, PERIODS * periods, error, wave), request)


def _first_steps(scene: Scene, request: Request) -> tuple[int, bool]:
    """Return the steps in a ball period to begin with, half of the fewest that may answer, and whether they are given.

    Raises:
        ValueError: if the steps do not resolve the band or the lines.
    """
    bpfo = kinematics(scene.bearing, scene.speed).bpfo
    steps = max(MIN_LANE_STEPS, math.ceil(1.0 / (bpfo * LANE_STEP)))
    most = MOST_STEPS
    if request.steps_per_period is not None:
        steps = most = request.steps_per_period
    highest = request.highest(_RESOLVED * most * bpfo, f"{most} steps resolve up to")
    steps = max(steps, math.ceil(highest / (_RESOLVED * bpfo)))
    if steps > most:
        raise ValueError(f"speed {scene.speed!r} Hz is too low: it needs {steps} steps, at most {most} are taken")
    return math.ceil(0.5 * steps), request.steps_per_period is not None


def _tolerance(request: Request) -> float:
    """Return the relative change of the RMS from block to block that counts as none."""
    return request.tolerance or max(_SETTLING_SHARE * request.accuracy, _LEAST_TOLERANCE)


def _settle(scene: Scene, request: Request, steps: int, workspace: Workspace) -> _Motion:
    """Simulate until the RMS of a block no longer changes."""
    grid = shared_grid([scene], LaneOptions(steps_per_period=steps))
    group = Group(grid, [scene] * LANES, scene.slip, workspace)
    tolerance = _tolerance(request)
    levels: list[float] = []
    change, wave = math.inf, np.empty((grid.steps, 2))
    for _ in range(max(3, math.ceil(request.max_periods / PERIODS))):
        group.run_block()
        wave = group.wave[:, :, 0].copy()
        levels.append(math.sqrt(float(np.mean(wave[:, 0] ** 2))))
        if len(levels) > 1:
            now, before = levels[-1], levels[-2]
            change = 0.0 if max(now, before) <= _SILENCE else abs(now - before) / max(now, _SILENCE)
        if not math.isfinite(levels[-1]) or (len(levels) >= 3 and change < tolerance):
            break
    count = max(HARMONICS, int(_RESOLVED * grid.steps / PERIODS))
    spectrum = np.fft.rfft(wave, axis=0)[: PERIODS * count + 1 : PERIODS] / grid.steps
    return _Motion(spectrum.T.copy(), wave, levels[-1], change, np.array(levels[len(levels) // 2 :]), len(levels))


def _changes(coarse: _Motion, fine: _Motion) -> tuple[float, float]:
    """Return the changes of RMS and waveform of the casing by a halving of the steps, relative."""
    if not (math.isfinite(coarse.level) and math.isfinite(fine.level)):
        return math.inf, math.inf
    if fine.level <= _SILENCE:
        return 0.0, 0.0
    count = min(coarse.coefficients.shape[1], fine.coefficients.shape[1])
    difference = coarse.coefficients[0, 1:count] - fine.coefficients[0, 1:count]
    wave = math.sqrt(2.0 * float(np.sum(np.abs(difference) ** 2)))
    return abs(fine.level - coarse.level) / fine.level, wave / fine.level


def _error_of_lines(motion: _Motion, wave: float) -> float:
    """Return a bound of the error of the lines over the largest: that of the waveform, relative, in a single line."""
    harmonics = 2.0 * np.abs(motion.coefficients[0, 1 : HARMONICS + 1])
    return lines_error(harmonics, np.array([math.sqrt(2.0) * wave * motion.level]))


def _response(
    scene: Scene, request: Request, motion: _Motion, periods: int, error: float, wave_error: float
) -> Response:
    bpfo, wave = kinematics(scene.bearing, scene.speed).bpfo, motion.wave
    settled, finite = motion.change < _tolerance(request), math.isfinite(motion.level)
    rms = np.sqrt(np.mean(wave * wave, axis=0))
    # The block is a whole number of periods, with points at PERIODS places within each step.
    peak = np.max(np.abs(wave), axis=0)
    coefficients = motion.coefficients
    if request.band is not None:
        rms, peak = levels_of_lines(coefficients, bpfo, request.band)
    spread = 0.0 if settled else float(np.std(motion.levels))
    harmonics = 2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1])
    # "judged" tells whether it is accurate.
    status: Status = "inaccurate"
    if not settled:
        status = "not_periodic" if finite else "not_converged"
    return Response(
        levels=tuple(zip(rms.tolist(), peak.tolist(), strict=True)),
        rms_error=error + motion.change,
        rms_se=0.0,
        peak_error=wave_error,
        waveform_error=wave_error,
        bpfo=bpfo,
        harmonics=harmonics,
        harmonics_error=np.full(HARMONICS, math.nan),
        lines_error=_error_of_lines(motion, wave_error),
        periods=periods,
        period_change=motion.change,
        spread=spread,
        multiplier=math.nan,
        model=MODEL,
        solver=SOLVER.name,
        status=status,
        rms_band=request.band,
        coefficients=coefficients,
    )


SOLVER = Solver(
    model=MODEL,
    name="mean_force",
    effects=EFFECTS,
    error=_LEAST_ERROR,
    cost=mean_force_cost,
    solve=solve,
    reason="the mean force of slip repeats with the ball passage, so that blocks of periods are simulated",
    rig=Rig,
)

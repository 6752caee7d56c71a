"""The six-degree-of-freedom model simulated over time, for scenes whose motion has no ball period.

Defects that turn (inner race, ball), a force that turns (unbalance) and balls that slip have no common period; several
defects need not have one. They are simulated from rest at the static equilibrium, the beginning is dropped, and what
remains is averaged with its standard error. Waviness and gravity are modelled here too.
``models/kernels/time_domain.py`` describes the integration.

Readings: the path coordinate is an angle on the damaged part, kinematics those of pure rolling (``Kinematics``). Slip
shifts when a ball meets the defect, not where it presses: the angle is small. Gravity changes the static equilibrium
and nothing else, because the rest of the model is linear in it.

Error of the steps: a span from the beginning is simulated again with half the steps; the estimate is that of
``models.kernels.settled`` for one halving. Where an accuracy is asked for, steps are halved until it is met, or until
halving no longer helps, as where the motion is chaotic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.bearing import kinematics
from models.dynamics.six_dof import ERROR_OF_WAVE, MODEL, TIME_EFFECTS, check_scene, steps_for
from models.dynamics.time_plan import prepare_plan
from models.kernels import time_domain as kernels
from models.kernels.step import P_DIRECTION_1, P_DIRECTION_2, STATUS_OK
from models.numerics import filter_valid, kaiser_order
from models.registry import Request, Solver
from models.response import CASING, HARMONICS, PASSBAND, Response, SignalRecord, Status, band_passed
from models.rigs.six_dof import Rig

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.bearing import Kinematics
    from models.scene import Scene

# Longest step, s: benchmarks/effects.py prints the error that it leaves.
DEFAULT_STEP = 10e-6
# Steps of a run at most: 320 MB.
MOST_STEPS = 20_000_000
# Dropped at the beginning: ball periods, and the minimum in seconds.
_SETTLE_PERIODS = 40
_SETTLE_SECONDS = 0.2
_LEAST_BLOCKS = 4.0
_STOPBAND_DB = 80.0
# Span of the run, and blocks of it at least, in which the error of the steps is looked at.
_LOOKED_AT = 0.1
_BLOCKS_LOOKED_AT = 2.0
# Error of a sampled signal over its change by halving the steps: first order, where the force jumps between steps.
_HALVED = 2.0
# A halving that leaves more than this share of the waveform's error does not help.
_HELPS = 0.7
# A smaller change of the RMS from the first to the second half is ignored at any standard error.
_SAME_LEVEL = 3e-3
# A smaller spread of the RMS from ball period to ball period is due to the steps.
_SAME_PERIOD = 2e-2
# A smaller vibration counts as zero, m/s2.
SILENCE = 1e-9
_SECONDS_A_STEP = 4e-7
_LEAST_ERROR = 1e-6


def solve(scene: Scene, request: Request) -> Response:
    """Return the vibration of a scene over the time that a request names, with steps that meet its accuracy.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    step = None
    if request.steps_per_period is not None:
        step = 1.0 / (kinematics(scene.bearing, scene.speed).bpfo * request.steps_per_period)
    return _simulate(scene, request, None, (math.cos(request.direction), math.sin(request.direction)), step)


def simulate_time(
    scene: Scene,
    duration: float,
    rate: float,
    *,
    settle: float | None = None,
    direction: tuple[float, float] = (1.0, 0.0),
    step: float = DEFAULT_STEP,
) -> Response:
    """Return ``duration`` seconds of the vibration of a scene with all effects that it names, sampled at ``rate`` Hz.

    As ``solve``, with steps that are given.

    Args:
        settle: time that is simulated before and dropped, s; by default 40 ball periods, and 0.2 s at least.
        direction: of the sensor, along the load and across it; made a unit vector.
        step: longest step of the integration, s; taken so that a sample has a whole number of steps, at least 2.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    if not (math.isfinite(step) and step > 0.0):
        raise ValueError(f"step must be positive and finite, got {step!r}")
    length = math.hypot(*direction)
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"direction must be a vector of finite length other than zero, got {direction!r}")
    unit = (direction[0] / length, direction[1] / length)
    return _simulate(scene, Request(duration=duration, rate=rate), settle, unit, step)


def _simulate(
    scene: Scene, request: Request, settle: float | None, direction: tuple[float, float], step: float | None
) -> Response:
    """Return the response with a given step, or one that meets the accuracy."""
    check_scene(scene, TIME_EFFECTS)
    request.highest(PASSBAND * 0.5 * request.rate, "the signal is flat up to")
    lines = kinematics(scene.bearing, scene.speed)
    run = _Run(scene, request, _settling(settle, lines), direction)
    wished = _longest_step(scene, lines) if step is None else step
    oversampling = max(2, math.ceil(1.0 / (request.rate * wished) - 1e-9))
    run.check_length(oversampling)
    oversampling, error = run.look(oversampling, None if step is not None else request.accuracy)
    wave, finite = run.whole(oversampling)
    return _response(scene, request, _measured(wave, run, oversampling), error, finite=finite)


@dataclass(frozen=True)
class _StepError:
    """Errors of RMS, waveform and peak due to the steps, relative."""

    rms: float
    wave: float
    peak: float


class _Run:
    """One scene over one time, with steps of any length that a sample has a whole number of."""

    def __init__(self, scene: Scene, request: Request, settle: float, direction: tuple[float, float]) -> None:
        """Plan which ball meets what, once for all steps."""
        self.lines = kinematics(scene.bearing, scene.speed)
        self.rate, self.samples = request.rate, max(1, round(request.duration * request.rate))
        self.settled = math.ceil(settle * request.rate)
        self.block = 1.0 / _block_rate(scene, self.lines)
        self._scene, self._request, self._direction = scene, request, direction
        self._plan: kernels.Plan | None = None

    @property
    def plan(self) -> kernels.Plan:
        """What the kernel needs."""
        if self._plan is None:
            # The filter reaches beyond both ends by its half length, which hardly depends on the steps.
            margin = _margin(2) + 2
            plan = prepare_plan(self._scene, (max(margin, self.settled) + self.samples + margin) / self.rate)
            plan.parameter[P_DIRECTION_1], plan.parameter[P_DIRECTION_2] = self._direction
            self._plan = plan
        return self._plan

    def check_length(self, oversampling: int) -> None:
        """Raise a ValueError where the run would have too many steps."""
        steps = (self.settled + self.samples) * oversampling
        if steps > MOST_STEPS:
            raise ValueError(
                f"duration {self.samples / self.rate:g} s and {self.settled / self.rate:g} s to settle take {steps} "
                f"steps of {1.0 / (self.rate * oversampling):.3g} s, at most {MOST_STEPS} are taken"
            )

    def whole(self, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        """Return the accelerations of all steps, (steps, 2), and whether they are finite."""
        margin = _margin(oversampling) * oversampling
        begin = max(margin, self.settled * oversampling)
        return self._from_rest(begin + self.samples * oversampling + margin, oversampling)

    def _from_rest(self, steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        wave = np.empty((steps, 2))
        status = kernels.run(np.zeros((2, 6)), wave, 1.0 / (self.rate * oversampling), self.plan)
        return wave, status == STATUS_OK

    def look(self, oversampling: int, accuracy: float | None) -> tuple[int, _StepError]:
        """Return steps a sample that meet an accuracy, or those given where it is None, and the error they leave."""
        whole = self.settled + self.samples
        span = min(whole, math.ceil(max(_LOOKED_AT * whole, _BLOCKS_LOOKED_AT * self.block * self.rate)))
        wave, _ = self._from_rest(span * oversampling, oversampling)
        finer, _ = self._from_rest(2 * span * oversampling, 2 * oversampling)
        error = _step_error(wave, finer, oversampling, self._request)
        while accuracy is not None and error.rms > accuracy and 2 * whole * oversampling <= MOST_STEPS:
            wave, (finer, _) = finer, self._from_rest(4 * span * oversampling, 4 * oversampling)
            better = _step_error(wave, finer, 2 * oversampling, self._request)
            if not better.wave < _HELPS * error.wave:
                break
            oversampling, error = 2 * oversampling, better
        return oversampling, error


def _rms(signal: NDArray[np.float64]) -> float:
    return math.sqrt(float(np.mean(signal * signal)))


def _step_error(
    wave: NDArray[np.float64], finer: NDArray[np.float64], oversampling: int, request: Request
) -> _StepError:
    """Return the errors of the casing's waveform from one with half the steps.

    That of the waveform is of the sampled signal: where the force jumps between steps, it is larger than at the steps.
    So is that of the RMS in a band.
    """
    coarse, fine = wave[:, 0], finer[::2, 0]
    level = _rms(fine)
    if not math.isfinite(level):
        return _StepError(math.inf, math.inf, math.inf)
    if level <= SILENCE:
        return _StepError(0.0, 0.0, 0.0)
    change = _rms(coarse - fine) / level
    error = max(abs(_rms(coarse) - level) / level, ERROR_OF_WAVE * change)
    peak, peak_fine = _peaks(wave)[0], _peaks(finer)[0]
    margin, samples = _margin(oversampling), len(wave) // oversampling
    sampled = change
    if samples > 4 * margin:
        kept = samples - 2 * margin - 1
        ours, better = (
            _sampled(run[:, 0], n, margin, kept) for run, n in ((wave, oversampling), (finer, 2 * oversampling))
        )
        sampled = max(change, _HALVED * _rms(ours - better) / level)
        if request.band is not None:
            ours, better = (band_passed(signal, request.rate, request.band) for signal in (ours, better))
            inside = max(_rms(better), SILENCE)
            error = _HALVED * max(abs(_rms(ours) - inside), ERROR_OF_WAVE * _rms(ours - better)) / inside
    return _StepError(error, sampled, abs(peak - peak_fine) / peak_fine + change)


def _cost(scene: Scene, request: Request) -> float:
    """Return the expected processor time, s."""
    lines = kinematics(scene.bearing, scene.speed)
    looked_at = 1.0 + 3.0 * _LOOKED_AT
    return _SECONDS_A_STEP * looked_at * (request.duration + default_settling(lines)) / _longest_step(scene, lines)


def _longest_step(scene: Scene, lines: Kinematics) -> float:
    """Return the step to begin with, s."""
    return min(DEFAULT_STEP, 1.0 / (lines.bpfo * steps_for(scene)))


def _block_rate(scene: Scene, lines: Kinematics) -> float:
    """Return how many blocks a second has: the slowest of the frequencies with which the level swings, Hz."""
    if scene.repeats:
        return lines.bpfo
    return lines.ftf if "ball_defect" in scene.effects else lines.speed


def default_settling(lines: Kinematics) -> float:
    """Return the time to drop at the beginning, s: the longer of 40 ball periods and 0.2 s."""
    return max(_SETTLE_SECONDS, _SETTLE_PERIODS / lines.bpfo)


def _settling(settle: float | None, lines: Kinematics) -> float:
    """Return the time to drop, s: the given one, or the default."""
    if settle is None:
        return default_settling(lines)
    if not (math.isfinite(settle) and settle >= 0.0):
        raise ValueError(f"settle must be finite and not negative, got {settle!r}")
    return settle


@dataclass(frozen=True)
class _Levels:
    rms: float
    error: float
    spread: float
    drift: float
    peak_spread: float


@dataclass(frozen=True, eq=False)
class _Measured:
    """What a run gave: levels and peaks of both sensors, and the signal."""

    levels: tuple[_Levels, _Levels]
    peaks: tuple[float, float]
    record: SignalRecord


def _measured(wave: NDArray[np.float64], run: _Run, oversampling: int) -> _Measured:
    samples, first = run.samples, max(_margin(oversampling), run.settled)
    settled = wave[first * oversampling : (first + samples) * oversampling]
    signals = np.array([_sampled(wave[:, k], oversampling, first, samples) for k in (0, 1)])
    blocks = max(samples / run.rate / run.block, _LEAST_BLOCKS)
    levels = (_levels(settled[:, 0], blocks), _levels(settled[:, 1], blocks))
    return _Measured(levels, _peaks(settled), SignalRecord(run.rate, signals))


def _sampled(signal: NDArray[np.float64], oversampling: int, first: int, samples: int) -> NDArray[np.float64]:
    """Return a signal as a recorder samples it, from sample ``first`` on."""
    taps = anti_alias_filter(oversampling)
    half, begin = len(taps) // 2, first * oversampling
    return filter_valid(signal[begin - half : begin + (samples - 1) * oversampling + half + 1], taps)[::oversampling]


def _peaks(wave: NDArray[np.float64]) -> tuple[float, float]:
    """Return the largest absolute values of both sensors at the steps: the force jumps, so nothing is put between."""
    highest = np.max(np.abs(wave), axis=0)
    return float(highest[0]), float(highest[1])


def _levels(signal: NDArray[np.float64], blocks: float) -> _Levels:
    """Return the levels over ``blocks`` blocks; the last, broken one is left out, because it would bias the mean."""
    count = math.floor(blocks + 1e-9)
    energy = np.concatenate(([0.0], np.cumsum(signal**2)))
    edges = np.arange(count + 1) * (len(signal) / blocks)
    means = np.maximum(np.diff(np.interp(edges, np.arange(len(energy)), energy)) / (len(signal) / blocks), 0.0)
    rms, half = math.sqrt(np.mean(means)), count // 2
    drift = abs(math.sqrt(np.mean(means[-half:])) - math.sqrt(np.mean(means[:half])))
    error = float(np.std(means, ddof=1)) / math.sqrt(count) / (2.0 * rms) if rms > 0.0 else 0.0
    first = np.unique(np.minimum(edges[:-1].astype(np.int64), len(signal) - 1))
    peaks = np.maximum.reduceat(np.abs(signal), first)
    return _Levels(rms, error, float(np.std(np.sqrt(means), ddof=1)), drift, float(np.std(peaks)))


def _response(scene: Scene, request: Request, found: _Measured, step: _StepError, *, finite: bool) -> Response:
    """Return the response; error and spread are known over full bandwidth and apply relatively to a band."""
    levels, bpfo = found.levels[0], kinematics(scene.bearing, scene.speed).bpfo
    rms, peaks = [level.rms for level in found.levels], list(found.peaks)
    if request.band is not None:
        pairs = [found.record.levels_in_band(*request.band, sensor) for sensor in CASING]
        rms, peaks = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    share = rms[0] / levels.rms if levels.rms > SILENCE else 1.0
    error = (levels.error / levels.rms if levels.rms > SILENCE else 0.0) + step.rms
    coefficients = found.record.coefficients(bpfo, _line_count(request, bpfo))
    repeats = scene.repeats and levels.spread <= _SAME_PERIOD * levels.rms
    peak_spread = 0.0 if repeats else levels.peak_spread / max(found.peaks[0], SILENCE)
    return Response(
        levels=tuple(zip(rms, peaks, strict=True)),
        rms_error=error,
        rms_se=levels.error * share,
        peak_error=peak_spread + step.peak,
        waveform_error=step.wave,
        bpfo=bpfo,
        harmonics=2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1]),
        harmonics_error=np.full(HARMONICS, math.nan),
        periods=math.floor(request.duration * bpfo),
        period_change=math.nan,
        spread=levels.spread * share,
        multiplier=math.nan,
        model=MODEL,
        solver=SOLVER.name,
        status=_status(levels, error, request.accuracy, finite=finite, repeats=repeats),
        rms_band=request.band,
        coefficients=coefficients,
        record=found.record,
    )


def _line_count(request: Request, bpfo: float) -> int:
    """Return how many lines are computed: those that the signal holds, as far as they are asked for."""
    passed = PASSBAND * 0.5 * request.rate
    return max(HARMONICS, math.ceil((passed if request.lines_to is None else request.lines_to) / bpfo))


def _status(levels: _Levels, error: float, accuracy: float, *, finite: bool, repeats: bool) -> Status:
    if not finite or not math.isfinite(levels.rms):
        return "not_converged"
    if levels.rms <= SILENCE:
        return "converged"
    # The difference of two halves has twice the standard error of the whole.
    if levels.drift > max(8.0 * levels.error, _SAME_LEVEL * levels.rms):
        return "not_converged"
    if not repeats:
        return "not_periodic"
    return "converged" if error <= accuracy else "inaccurate"


def _margin(oversampling: int) -> int:
    """Return the half length of the filter, in whole samples."""
    return math.ceil(len(anti_alias_filter(oversampling)) // 2 / oversampling)


def anti_alias_filter(oversampling: int) -> NDArray[np.float64]:
    """Return the taps (an odd number) of the filter before every ``oversampling``-th sample is kept."""
    width = (1.0 - PASSBAND) / oversampling
    count, beta = kaiser_order(_STOPBAND_DB, width)
    half = count // 2 + 1
    cutoff = 0.5 * (1.0 + PASSBAND) / oversampling
    taps = cutoff * np.sinc(cutoff * np.arange(-half, half + 1)) * np.kaiser(2 * half + 1, beta)
    return taps / taps.sum()


SOLVER = Solver(
    model=MODEL,
    name="time_domain",
    effects=TIME_EFFECTS,
    error=_LEAST_ERROR,
    cost=_cost,
    solve=solve,
    reason="one ball period would not show all of it, so that it is simulated over time",
    rig=Rig,
)

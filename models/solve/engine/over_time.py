"""What the models that are simulated over time share: error of the steps, length of the run, peaks, record, status.

A model gives a ``Motion``. The error of its steps (``models.solve.engine.step_error``) is looked at in a span at the
beginning, or after the time that modes need to ring with the error (``Motion.build_up``). Where an accuracy is asked
for, steps are halved until it is met together with the error of the mean, or until halving no longer helps, as
where the motion is chaotic.

What the steps of a simulation over time cost: a span is simulated again with half of them and compared.

The estimate is that of ``models.solve.six_dof.kernels.settled`` for one halving, over the settled RMS where that is
fainter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine.speed_profile import constant
from models.solve.engine.averages import MeanLevels, amplitudes_at, levels_of
from models.solve.engine.motion import ERROR_OF_WAVE, SILENCE, Motion, lines_over_angle, margin_of, sampled_at
from models.solve.response import HARMONICS, PASSBAND, Response, SignalRecord, Status, band_passed, judged, lines_error
from models.words.request import MEANS, USUAL_SECONDS, Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.machine.speed_profile import SpeedProfile


# Error of a sampled signal over its change by halving the steps: first order, where the force jumps between steps.
_HALVED = 2.0
# A waveform that half the steps change by more is lost.
_LOST = 0.3


@dataclass(frozen=True)
class StepError:
    """Errors of RMS, waveform, peak and, where they are asked for, lines due to the steps, over those of ``level``.

    ``harmonics``: those of the lines of the ball passage, in the unit of the motion, (HARMONICS,).
    """

    rms: float
    wave: float
    peak: float
    lines: float = math.nan
    level: float = 0.0
    harmonics: NDArray[np.float64] = field(default_factory=lambda: np.zeros(HARMONICS))

    def over(self, settled: float) -> StepError:
        """Return the errors of a settled motion, of that RMS, where the beginning that was looked at is louder.

        Where the waveform is lost, its error is like noise, whose power adds to that of the motion.
        """
        if not settled > SILENCE or not math.isfinite(self.level):
            return self
        louder = max(self.level / settled, 1.0)
        change = louder * self.wave / _HALVED
        rms = max(louder * self.rms, 0.5 * change**2 if change > _LOST else 0.0)
        return replace(self, rms=rms, wave=louder * self.wave, peak=louder * self.peak)

    def of(self, request: Request) -> float:
        """Return that of the quantity that is asked for."""
        return {"waveform": self.wave, "lines": self.lines}.get(request.quantity, self.rms)


def _rms(signal: NDArray[np.float64]) -> float:
    return math.sqrt(float(np.mean(signal * signal)))


def step_error(
    wave: NDArray[np.float64],
    finer: NDArray[np.float64],
    oversampling: int,
    begin: int,
    motion: Motion,
    request: Request,
) -> StepError:
    """Return the errors of the first sensor's waveform from one with half the steps, both from a sample on.

    That of the waveform is of the sampled signal: where the force jumps between steps, it is larger than at the steps.
    So is that of the RMS in a band.
    """
    wave, finer = wave[begin * oversampling :], finer[2 * begin * oversampling :]
    coarse, fine = wave[:, 0], finer[::2, 0]
    level = _rms(fine)
    if not math.isfinite(level):
        return StepError(math.inf, math.inf, math.inf, math.inf, harmonics=np.full(HARMONICS, math.inf))
    if level <= SILENCE:
        return StepError(0.0, 0.0, 0.0, 0.0)
    change = _rms(coarse - fine) / level
    error = max(abs(_rms(coarse) - level) / level, ERROR_OF_WAVE * change)
    peak, peak_fine = peaks(wave)[0], peaks(finer)[0]
    margin, samples = margin_of(oversampling), len(wave) // oversampling
    sampled = change
    if samples > 4 * margin:
        kept = samples - 2 * margin - 1
        ours, better = (
            sampled_at(run[:, 0], n, margin, kept) for run, n in ((wave, oversampling), (finer, 2 * oversampling))
        )
        sampled = max(change, _HALVED * _rms(ours - better) / level)
        if request.band is not None:
            ours, better = (band_passed(signal, request.rate, request.band) for signal in (ours, better))
            inside = max(_rms(better), SILENCE)
            error = _HALVED * max(abs(_rms(ours) - inside), ERROR_OF_WAVE * _rms(ours - better)) / inside
    found = StepError(error, sampled, abs(peak - peak_fine) / peak_fine + change, level=level)
    rate = request.rate * oversampling
    found = replace(found, harmonics=_errors_of_lines(coarse, finer[:, 0], motion.bpfo / rate)[0])
    if request.quantity == "lines":
        errors, lines = _errors_of_lines(coarse, finer[:, 0], _passages(motion) / rate)
        found = replace(found, lines=lines_error(lines, errors))
    return found


def _passages(motion: Motion) -> float:
    return motion.bpfo if motion.passages is None else motion.passages


def _errors_of_lines(
    coarse: NDArray[np.float64], finer: NDArray[np.float64], turn: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the errors of lines, of first order, and the lines; ``turn``: their frequency over the coarser rate."""
    found = [amplitudes_at(signal, share * turn, HARMONICS)[0] for share, signal in ((1.0, coarse), (0.5, finer))]
    return _HALVED * np.abs(found[1] - found[0]), found[1]


def peaks(wave: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the largest absolute value of each sensor at the steps: the force jumps, so nothing is put between."""
    return tuple(float(highest) for highest in np.max(np.abs(wave), axis=0))


# Steps of a run at most: 320 MB for two sensors.
MOST_STEPS = 20_000_000
# Span of the run, and blocks of it at least, in which the error of the steps is looked at.
LOOKED_AT = 0.1
_BLOCKS_LOOKED_AT = 2.0
_LEAST_BLOCKS = 4.0
# A halving that leaves more than this share of the waveform's error does not help.
_HELPS = 0.7
# A smaller change of the RMS from the first to the second half is ignored at any standard error.
_SAME_LEVEL = 3e-3

MOST_SECONDS = 4.0
"""Longest time over which a level is averaged where no duration is named, s, or that of the first blocks if longer."""
# Blocks of the first run whose length follows the error, and by how much a longer one is longer: between the square,
# which independent blocks would need, and what blocks that swing regularly do.
_FIRST_BLOCKS = 8
_GROWTH, _LEAST_GROWTH, _MOST_GROWTH = 1.5, 1.5, 4.0

# Processor time of what does not depend on the steps, s: filters, lines, levels.
SECONDS_A_CALL = 5e-3


def answer(motion: Motion, request: Request, step: float, *, fixed: bool = False) -> Response:
    """Return the vibration of a motion over the time that a request names.

    Where it names none and a level is asked for, runs become longer until the error of the mean is within what the
    error of the steps leaves of the accuracy, or MOST_SECONDS are reached.

    Args:
        step: longest step, s, unless the request has its own; taken so that a sample has a whole number of steps, at
            least 2.
        fixed: whether steps are as given, as those of a request are, and not halved until they meet the accuracy.

    Raises:
        ValueError: if the request is outside what the signal holds, or the run would have too many steps.
    """
    motion = motion.led_by(request.sensor)
    request.highest(PASSBAND * 0.5 * request.rate, "the signal is flat up to")
    if request.steps_per_period is not None:
        step, fixed = 1.0 / (motion.bpfo * request.steps_per_period), True
    oversampling = max(2, math.ceil(1.0 / (request.rate * step) - 1e-9))
    run, accuracy = _Run.first(motion, request, oversampling), request.accuracy
    run.check_length(oversampling)
    # Of a mean whose length is open, the steps get half.
    share = 0.5 if run.most > run.samples and not motion.repeats else 1.0
    oversampling, error = run.look(oversampling, None if fixed else share * accuracy)
    while True:
        wave, finite = run.whole(oversampling)
        found = _measured(wave, run, oversampling)
        level = found.levels[0]
        settled, averaged = error.over(level.rms), _averaged(level, motion)
        if not finite:
            break
        longer = run.longer(averaged / _left(accuracy, settled.of(request)), oversampling)
        if longer is not None:
            run = longer
            continue
        left = _left(accuracy, averaged) if request.quantity in MEANS else accuracy
        if fixed or not settled.of(request) > left or not run.fits(2 * oversampling):
            break
        _, better = run.look(2 * oversampling, None)
        if not better.wave < _HELPS * error.wave:
            break
        oversampling, error = 2 * oversampling, better
    return judged(_response(run, request, found, settled, finite=finite), request)


def _left(accuracy: float, error: float) -> float:
    """Return what one of two errors leaves of the accuracy to the other, at least half of it."""
    return accuracy - min(error, 0.5 * accuracy)


def _averaged(level: MeanLevels, motion: Motion) -> float:
    """Return the relative error of the RMS by the length; where the speed changes, the level is that of the time."""
    if motion.per_turn is not None or level.rms <= SILENCE:
        return 0.0
    return level.averaging(repeats=motion.repeats)


def duration_of(request: Request, settle: float) -> float:
    """Return the longest time from rest that ``answer`` simulates, s; the least, where the length follows the error."""
    # The filter reaches beyond both ends by its half length, which hardly depends on the steps.
    ends = margin_of(2) + 2
    return (max(ends, math.ceil(settle * request.rate)) + _samples(request) + ends) / request.rate


def expected_seconds(scene: Scene, request: Request) -> float:
    """Return how long a response is expected to be, s."""
    seconds = request.seconds
    if seconds is None:
        first = _FIRST_BLOCKS / scene.speed
        seconds = min(max(first, USUAL_SECONDS * Request.accuracy / request.accuracy), max(first, MOST_SECONDS))
    return seconds


def timed(scene: Scene, request: Request) -> tuple[Request, SpeedProfile | None]:
    """Return how the shaft turns where its speed changes, else None, and a request that then names its duration.

    Raises:
        ValueError: if the shaft would stop within that time.
    """
    seconds = USUAL_SECONDS if request.duration is None else request.duration
    profile = scene.rotation(seconds)
    return request if profile is None else replace(request, duration=seconds), profile


def _samples(request: Request) -> int:
    return max(1, round((request.seconds or 0.0) * request.rate))


class _Run:
    """A motion over some time."""

    def __init__(self, motion: Motion, request: Request, samples: int, most: int) -> None:
        """Count the samples that are kept, at most, and dropped."""
        self.rate, self.samples, self.most = request.rate, samples, most
        self.settled = math.ceil(motion.settle * request.rate)
        self.motion, self._request = motion, request

    @classmethod
    def first(cls, motion: Motion, request: Request, oversampling: int) -> _Run:
        """Return the run over the time that a request names, or where it names none over a few blocks."""
        if request.seconds is not None:
            return cls(motion, request, _samples(request), _samples(request))
        usual, few = (math.ceil(seconds * request.rate) for seconds in (USUAL_SECONDS, _FIRST_BLOCKS * motion.block))
        most = max(few, math.ceil(MOST_SECONDS * request.rate))
        # As many blocks as may be, if they are very long.
        room = max(MOST_STEPS // oversampling - math.ceil(motion.settle * request.rate), usual)
        return cls(motion, request, min(few, room), most)

    def longer(self, excess: float, oversampling: int) -> _Run | None:
        """Return a longer run where the error of the mean is too large by a factor, None where it is not or may not."""
        most = min(self.most, MOST_STEPS // oversampling - self.settled)
        if not excess > 1.0 or self.samples >= most:
            return None
        growth = min(max(excess**_GROWTH, _LEAST_GROWTH), _MOST_GROWTH)
        return _Run(self.motion, self._request, min(math.ceil(growth * self.samples), most), self.most)

    def check_length(self, oversampling: int) -> None:
        """Raise a ValueError where the run would have too many steps."""
        if not self.fits(oversampling):
            steps = (self.settled + self.samples) * oversampling
            raise ValueError(
                f"duration {self.samples / self.rate:g} s and {self.settled / self.rate:g} s to settle take {steps} "
                f"steps of {1.0 / (self.rate * oversampling):.3g} s, at most {MOST_STEPS} are taken"
            )

    def fits(self, oversampling: int) -> bool:
        """Return whether a run has no more steps than may be taken."""
        return (self.settled + self.samples) * oversampling <= MOST_STEPS

    def whole(self, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        """Return the accelerations of all steps, (steps, sensors), and whether they are finite."""
        margin = margin_of(oversampling) * oversampling
        begin = max(margin, self.settled * oversampling)
        return self.motion.from_rest(begin + self.samples * oversampling + margin, oversampling)

    def look(self, oversampling: int, accuracy: float | None) -> tuple[int, StepError]:
        """Return steps a sample that meet an accuracy, or those given where it is None, and the error they leave."""
        from_rest = self.motion.from_rest
        whole, skipped = self.settled + self.samples, math.ceil(self.motion.build_up * self.rate)
        looked_at = math.ceil(max(LOOKED_AT * whole, _BLOCKS_LOOKED_AT * self.motion.block * self.rate))
        span = min(whole, skipped + looked_at)
        begin = span - min(span, looked_at)
        wave, _ = from_rest(span * oversampling, oversampling)
        finer, _ = from_rest(2 * span * oversampling, 2 * oversampling)
        error = step_error(wave, finer, oversampling, begin, self.motion, self._request)
        while accuracy is not None and error.of(self._request) > accuracy and self.fits(2 * oversampling):
            wave, (finer, _) = finer, from_rest(4 * span * oversampling, 4 * oversampling)
            better = step_error(wave, finer, 2 * oversampling, begin, self.motion, self._request)
            if not better.wave < _HELPS * error.wave:
                break
            oversampling, error = 2 * oversampling, better
        return oversampling, error


@dataclass(frozen=True, eq=False)
class _Measured:
    """What a run gave: levels and peaks of all sensors, and the signal."""

    levels: tuple[MeanLevels, ...]
    peaks: tuple[float, ...]
    record: SignalRecord


def _measured(wave: NDArray[np.float64], run: _Run, oversampling: int) -> _Measured:
    samples, first = run.samples, max(margin_of(oversampling), run.settled)
    settled = wave[first * oversampling : (first + samples) * oversampling]
    signals = np.array([sampled_at(column, oversampling, first, samples) for column in wave.T])
    blocks = max(samples / run.rate / run.motion.block, _LEAST_BLOCKS)
    levels = tuple(levels_of(column, blocks) for column in settled.T)
    return _Measured(levels, peaks(settled), SignalRecord(run.rate, signals, run.motion.sensors))


def _response(run: _Run, request: Request, found: _Measured, step: StepError, *, finite: bool) -> Response:
    """Return the response; error and spread are known over full bandwidth and apply relatively to a band."""
    motion, levels, seconds = run.motion, found.levels[0], run.samples / run.rate
    bpfo = motion.bpfo
    rms, peaks = [level.rms for level in found.levels], list(found.peaks)
    if request.band is not None:
        pairs = [found.record.levels_in_band(*request.band, sensor) for sensor in motion.sensors]
        rms, peaks = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    share = rms[0] / levels.rms if levels.rms > SILENCE else 1.0
    averaged = _averaged(levels, motion)
    profile = motion.profile
    if profile is None or motion.per_turn is None:
        coefficients = found.record.coefficients(bpfo, _line_count(request, bpfo))
        profile = None if motion.speed is None else constant(motion.speed, seconds)
    else:
        coefficients = lines_over_angle(found.record, profile, motion.per_turn)
    repeats = levels.rms <= SILENCE or levels.same(repeats=motion.repeats)
    # Waveform and lines of what fails to repeat are known no better than that.
    unknown = levels.spread / max(levels.rms, SILENCE) if motion.repeats and not repeats else 0.0
    peak_spread = 0.0 if repeats else levels.peak_spread / max(found.peaks[0], SILENCE)
    lines, asked = (_lines_by_length(found, rate, motion) for rate in (bpfo, _passages(motion)))
    return Response(
        levels=tuple(zip(rms, peaks, strict=True)),
        rms_error=averaged + step.rms,
        averaging_error=averaged,
        rms_se=0.0 if repeats or motion.per_turn is not None else levels.error * share,
        peak_error=peak_spread + step.peak,
        waveform_error=max(step.wave, unknown),
        bpfo=bpfo,
        harmonics=2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1]),
        harmonics_error=lines[1] + (step.harmonics if motion.per_turn is None else math.nan),
        periods=math.floor(seconds * bpfo),
        period_change=math.nan,
        spread=0.0 if repeats else levels.spread * share,
        multiplier=math.nan,
        model=motion.model,
        solver=motion.solver,
        status=_status(levels, finite=finite, steady=motion.per_turn is None),
        rms_band=request.band,
        coefficients=coefficients,
        record=found.record,
        sensors=motion.sensors,
        lines_error=max(step.lines + lines_error(*asked), unknown),
        profile=profile,
    )


def _lines_by_length(found: _Measured, rate: float, motion: Motion) -> NDArray[np.float64]:
    """Return the lines of the first sensor at multiples of a rate, Hz, and the errors that the length leaves, (2, 6).

    None where the speed changes: its lines over the angle are those of that time.
    """
    if motion.per_turn is not None:
        return np.stack((np.ones(HARMONICS), np.zeros(HARMONICS)))
    return amplitudes_at(found.record.signal[0], rate / found.record.rate, HARMONICS)


def _line_count(request: Request, bpfo: float) -> int:
    """Return how many lines are computed: those that the signal holds, as far as they are asked for."""
    passed = PASSBAND * 0.5 * request.rate
    return max(HARMONICS, math.ceil((passed if request.lines_to is None else request.lines_to) / bpfo))


def _status(levels: MeanLevels, *, finite: bool, steady: bool) -> Status:
    """Return whether there is a level; of all else, ``judged`` decides. ``steady``: whether the speed is one."""
    if not finite or not math.isfinite(levels.rms):
        return "not_converged"
    # The difference of two halves has twice the standard error of the whole.
    drifts = levels.rms > SILENCE and levels.drift > max(8.0 * levels.error, _SAME_LEVEL * levels.rms)
    return "not_converged" if steady and drifts else "inaccurate"

"""What the steps of a simulation over time cost: a span is simulated again with half of them and compared.

The estimate is that of ``models.solve.six_dof.kernels.settled`` for one halving, over the settled RMS where that is
fainter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.solve.engine.motion import SILENCE, Motion, margin_of, sampled_at
from models.solve.response import HARMONICS, SignalRecord, band_passed, lines_error
from models.solve.six_dof.setup import ERROR_OF_WAVE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.words.request import Request

# Error of a sampled signal over its change by halving the steps: first order, where the force jumps between steps.
_HALVED = 2.0
# A waveform that half the steps change by more is lost.
_LOST = 0.3


@dataclass(frozen=True)
class StepError:
    """Errors of RMS, waveform, peak and, where they are asked for, lines due to the steps, over those of ``level``."""

    rms: float
    wave: float
    peak: float
    lines: float = math.nan
    level: float = 0.0

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
        return StepError(math.inf, math.inf, math.inf, math.inf)
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
    if request.quantity == "lines":
        found = replace(found, lines=_error_of_lines(coarse, finer[:, 0], request.rate * oversampling, motion))
    return found


def _error_of_lines(coarse: NDArray[np.float64], finer: NDArray[np.float64], rate: float, motion: Motion) -> float:
    """Return the error of the lines over the largest, of first order; ``rate``: steps a second of the first signal."""
    passages = motion.bpfo if motion.passages is None else motion.passages
    found = [
        2.0
        * np.abs(SignalRecord(share * rate, signal[None], motion.sensors[:1]).coefficients(passages, HARMONICS)[0, 1:])
        for share, signal in ((1.0, coarse), (2.0, finer))
    ]
    return _HALVED * lines_error(found[1], np.abs(found[1] - found[0]))


def peaks(wave: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the largest absolute value of each sensor at the steps: the force jumps, so nothing is put between."""
    return tuple(float(highest) for highest in np.max(np.abs(wave), axis=0))

"""The angular speed of one recording of pulses: repaired, its spectrum, the error of the wheel, lines of a bearing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.family import FaultLines
from monitor.health.signal.rotation.encoder import Pattern, pattern_of
from monitor.health.signal.rotation.ias import IasSpectrum, ias_lines, ias_spectrum
from monitor.health.signal.rotation.intervals import intervals
from monitor.health.signal.rotation.repair import repaired
from monitor.health.signal.rotation.settings import TachoSettings
from monitor.health.signal.rotation.train import PulseTrain

_REASONS = {
    "too_few": "fewer than four pulses",
    "irregular": "intervals between pulses do not follow one speed; are pulses_per_revolution and the level right?",
    "stopped": "pulses begin late or end early: the shaft did not turn all the time",
}


@dataclass(frozen=True, eq=False)
class IasStudy:
    """What a recording of pulses says.

    Attributes:
        train: repaired pulses.
        missing, extra: marks without a pulse, and pulses without a mark.
        spectrum: of the angular speed.
        wheel: what repeats each turn in this recording: error of the marks, and what turns with the shaft.
        removed: whether that was taken out of the spectrum.
    """

    train: PulseTrain
    missing: int
    extra: int
    spectrum: IasSpectrum
    wheel: Pattern
    removed: bool

    def lines(self, fundamentals: Mapping[str, float]) -> dict[str, FaultLines]:
        """Return :func:`monitor.health.signal.rotation.ias.ias_lines` of the spectrum."""
        return ias_lines(self.spectrum, fundamentals)


def study(
    times: NDArray[np.float64],
    tacho: TachoSettings,
    *,
    resolution: float = 0.0,
    remove_wheel: bool = False,
) -> IasStudy:
    """Return what the pulses of a recording say of the speed.

    Args:
        times: shape (pulse,), s, never falling.
        tacho: the wheel.
        resolution: to which the times are known, s.
        remove_wheel: take out what repeats each turn, where it does.

    Raises:
        ValueError: the pulses cannot be numbered, or are too few (see :func:`intervals`); the message says why.
    """
    if times.size < 2:
        raise ValueError(f"{times.size} pulses")
    from_first = times - times[0]
    found = repaired(from_first, float(from_first[-1]), tacho.per_revolution, tacho.missing_teeth, resolution)
    if found.train is None:
        raise ValueError(f"{times.size} pulses: {_REASONS.get(found.status, found.status)}")
    plain = intervals(found.train)
    wheel = pattern_of(plain)
    removed = remove_wheel and wheel.repeatable
    used = intervals(found.train, wheel.error) if removed else plain
    return IasStudy(found.train, found.missing, found.extra, ias_spectrum(used, tacho.ratio), wheel, removed)

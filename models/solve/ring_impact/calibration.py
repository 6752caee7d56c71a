"""Scale the model of impacts on rings to a machine by one defect of known size (BEAT, section 7 and Eq. 33).

What lies between bearing and sensor, and what the model lacks, becomes one gain of the impacts; what is left of the
measured RMS becomes the noise of slip. Other defects, speeds and loads of that machine are then predicted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.solve.ring_impact.rig import RingImpactRig
from models.solve.ring_impact.solver import noise_level, solve
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene

Addition = Literal["quadrature", "linear"]


@dataclass(frozen=True)
class Measured:
    """What was measured of one defect of known size.

    Attributes:
        rms: root mean square of the record, m/s2.
        kurtosis: fourth central moment over the squared variance, or None where it is not known.
        noise: RMS of the same machine without the defect, m/s2, or None; not used where the kurtosis is known.
    """

    rms: float
    kurtosis: float | None = None
    noise: float | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        if not (math.isfinite(self.rms) and self.rms > 0.0):
            raise ValueError(f"rms must be positive and finite, got {self.rms!r}")
        if self.kurtosis is not None and not (math.isfinite(self.kurtosis) and self.kurtosis >= 1.0):
            raise ValueError(f"kurtosis must be finite and 1 at least, got {self.kurtosis!r}")
        if self.noise is not None and not 0.0 <= self.noise < self.rms:
            raise ValueError(f"noise must lie between 0 and the RMS {self.rms!r}, got {self.noise!r}")


def noise_to_add(measured: float, simulated: float, addition: Addition = "quadrature") -> float:
    """Return the RMS of the noise that makes up a measured RMS (Eq. 33).

    Printed is the difference of both ("linear"); that of independent signals is the root of the difference of squares.

    Raises:
        ValueError: if more was simulated than measured.
    """
    if simulated > measured:
        raise ValueError(f"the simulated RMS {simulated!r} exceeds the measured one, {measured!r}: nothing is to add")
    if addition == "linear":
        return measured - simulated
    return math.sqrt(measured * measured - simulated * simulated)


def calibrate(
    scene: Scene, measured: Measured, request: Request, *, addition: Addition = "quadrature"
) -> RingImpactRig:
    """Return the parameters of a scene's machine with the gain and the noise that a measurement of it asks for.

    With the kurtosis, impacts and noise are told apart by it: the excess of a sum of independent signals is that of
    the impacts times the square of their share of the power. Without, the noise is that of the undamaged machine, or
    none.

    Args:
        scene: the machine with the defect that was measured, and its speed and load.
        request: duration, rate and direction of the record that is compared.
        addition: how RMS values add up; see ``noise_to_add``.

    Raises:
        ValueError: if the defect is not hit, or no share of noise gives the kurtosis that was measured.
    """
    rig = replace(scene.rig_as(RingImpactRig), gain=1.0, slip_noise=0.0)
    found = solve(replace(scene, rig=rig), request)
    if found.record is None or found.rms == 0.0:
        raise ValueError("defect: it is not hit, so that there is nothing to scale")
    level, excess = _level_and_excess(found.record.of())
    if measured.kurtosis is not None:
        share = (measured.kurtosis - 3.0) / excess if excess != 0.0 else math.inf
        if not 0.0 <= share <= 1.0:
            raise ValueError(
                f"kurtosis {measured.kurtosis!r} does not lie between that of noise, 3, and that of the impacts "
                f"alone, {3.0 + excess:.4g}, which the damping of the films decides"
            )
        impacts = measured.rms * share**0.25
    else:
        noise = measured.noise or 0.0
        impacts = measured.rms - noise if addition == "linear" else math.sqrt(measured.rms**2 - noise**2)
    noise = noise_to_add(measured.rms, impacts, addition)
    unit = noise_level(replace(scene, rig=rig), 1.0)
    return replace(rig, gain=impacts / level, slip_noise=noise / unit)


def _level_and_excess(signal: NDArray[np.float64]) -> tuple[float, float]:
    """Return the RMS of a signal without its mean, and its kurtosis less 3."""
    moved = signal - np.mean(signal)
    square = float(np.mean(moved**2))
    return math.sqrt(square), float(np.mean(moved**4)) / square**2 - 3.0

"""The spectral coherence of one recording over the angle of its shaft, and what it says of the lines of a bearing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing, kinematics
from monitor.health.signal.cyclic import RESOLUTION, CyclicCoherence, cyclic_coherence
from monitor.health.signal.rotation.fit import rotation_of
from monitor.health.signal.rotation.repair import repaired
from monitor.health.signal.rotation.ridge import angle_from_vibration
from monitor.health.signal.rotation.rotation import Rotation, constant
from monitor.health.signal.settings import fundamentals

HARMONICS = 4
"""Lines of each part that are looked at."""
SLIP = 0.02


@dataclass(frozen=True)
class CyclicLine:
    """The first line of a part of the bearing.

    Attributes:
        order: by its kinematics, events per revolution.
        found: order of the highest value near it.
        coherence: there, mean over the band.
        stands_out: whether that exceeds the limit of noise.
        frequency: at which the coherence is highest there, Hz.
    """

    order: float
    found: float
    coherence: float
    stands_out: bool
    frequency: float


@dataclass(frozen=True, eq=False)
class CyclicStudy:
    """Coherence of a recording, the angle of its shaft, and the first lines of a bearing, events per revolution."""

    found: CyclicCoherence
    rotation: Rotation
    orders: dict[str, float]

    def lines(self) -> dict[str, CyclicLine]:
        """Return what stands at the first line of each part that the coherence reaches."""
        return lines_of(self.found, self.orders)


def lines_of(found: CyclicCoherence, orders: Mapping[str, float]) -> dict[str, CyclicLine]:
    """Return what stands at the first line of each part that a coherence reaches.

    Args:
        orders: first line of each part, in the unit of the cyclic frequencies.
    """
    result: dict[str, CyclicLine] = {}
    for part, order in orders.items():
        near = np.abs(found.cyclic / order - 1.0) <= SLIP
        if near.any():
            place = int(np.argmax(np.where(near, found.enhanced, -np.inf)))
            top = float(found.enhanced[place])
            loudest = float(found.frequency[int(np.argmax(found.coherence[:, place]))])
            result[part] = CyclicLine(order, float(found.cyclic[place]), top, top > found.limit, loudest)
    return result


def cyclic_study(
    samples: NDArray[np.floating],
    rate: float,
    bearing: Bearing,
    rotation: Rotation,
    band: tuple[float, float] | None = None,
    resolution: float = RESOLUTION,
) -> CyclicStudy:
    """Return the coherence of a block up to the fourth line of the inner race, as far as the sampling rate allows.

    Raises:
        ValueError: see ``cyclic_coherence``.
    """
    lines = kinematics(bearing, 1.0)
    highest = min((HARMONICS + 0.5) * lines.bpfi, 0.24 * rate / rotation.speed_range[1])
    found = cyclic_coherence(samples, rate, highest, rotation, band, resolution)
    return CyclicStudy(found, rotation, fundamentals(lines))


def known_rotation(
    samples: NDArray[np.floating],
    rate: float,
    bearing: Bearing,
    speed: float | None = None,
    limits: tuple[float, float] | None = None,
    pulses: NDArray[np.float64] | None = None,
    per_revolution: int = 1,
) -> Rotation:
    """Return the angle of the shaft over a block by what is known of it.

    Args:
        speed: where it is steady, Hz.
        limits: lowest and highest speed, Hz, between which the angle is found in the vibration.
        pulses: times of the pulses of a tacho, s from the first sample.
        per_revolution: pulses of a turn.

    Raises:
        ValueError: none of the three is given, or no angle is found.
    """
    duration = samples.size / rate
    if pulses is not None:
        found = repaired(pulses, duration, per_revolution)
        if found.train is None:
            raise ValueError(f"the pulses give no angle of the shaft: {found.status}")
        return rotation_of(found.train, duration)
    if limits is not None:
        rotation, status = angle_from_vibration(samples, rate, bearing, limits)
        if rotation is None:
            raise ValueError(f"no angle of the shaft is found between {limits[0]:g} and {limits[1]:g} Hz: {status}")
        return rotation
    if speed is None:
        raise ValueError("the speed is not known: give one, or the range in which it is found in the vibration")
    return constant(speed, duration)

"""A mapping between models: a scene with the parameters of the other one, its sensors, and the error that it makes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine.rig import RigParameters
from models.solve.response import HARMONICS, Response, SignalRecord, band_lines, row_of
from models.words.request import Sensor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.words.request import Request


@dataclass(frozen=True)
class SensorMap:
    """What a sensor shows by what one of the other model shows.

    Attributes:
        sensor: of the model whose parameters the scene has.
        other: of the model that answers.
        gain: acceleration of the first over that of the second.
        loss: rate c / m of a damping that acts on the first and is not felt by the second, 1/s: the gain is divided by
            1 + loss / (i omega). Only for motions that repeat.
    """

    sensor: Sensor
    other: Sensor
    gain: float = 1.0
    loss: float = 0.0


@dataclass(frozen=True)
class Mapped:
    """A scene with the parameters of another model, and its sensors."""

    scene: Scene
    sensors: tuple[SensorMap, ...]

    def request_of(self, request: Request, sensor: Sensor) -> Request:
        """Return what the other model is asked."""
        return replace(request, sensor=self.of(sensor).other)

    def of(self, sensor: Sensor) -> SensorMap:
        """Return the counterpart of a sensor; raise a ValueError where it has none."""
        for one in self.sensors:
            if one.sensor == sensor:
                return one
        known = ", ".join(one.sensor for one in self.sensors)
        raise ValueError(f"sensor {sensor!r}: what stands for the model has {known}")

    def back(self, found: Response, first: Sensor | None = None) -> Response:
        """Return a response of the other model as one of the model whose parameters the scene had.

        ``first``: the sensor that comes first, by default one whose counterpart is first in ``found``.
        """
        known = [one for one in self.sensors if one.other in found.sensors]
        known.sort(key=lambda one: (one.sensor != first, found.sensors.index(one.other)))
        rows = [row_of(found.sensors, one.other) for one in known]
        factors = [_factors(one, found) for one in known]
        coefficients = np.array([factor * found.coefficients[row] for row, factor in zip(rows, factors, strict=True)])
        levels = [
            _level(one, found, row, coefficients[k]) for k, (one, row) in enumerate(zip(known, rows, strict=True))
        ]
        sensors: tuple[Sensor, ...] = tuple([one.sensor for one in known])
        record = found.record
        if record is not None:
            signal = np.array([one.gain * record.signal[row] for one, row in zip(known, rows, strict=True)])
            record = SignalRecord(record.rate, signal, sensors)
        harmonics = 2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1])
        share = levels[0][0] / found.rms if found.rms > 0.0 else 0.0
        return replace(
            found,
            levels=tuple(levels),
            coefficients=coefficients,
            harmonics=harmonics,
            harmonics_error=found.harmonics_error * share,
            rms_se=found.rms_se * share,
            spread=found.spread * share,
            sensors=sensors,
            record=record,
        )


def _factors(one: SensorMap, found: Response) -> complex | NDArray[np.complex128]:
    """Return what the coefficients of a sensor are multiplied with."""
    if one.loss == 0.0:
        return one.gain
    order = np.maximum(np.arange(found.coefficients.shape[1], dtype=np.float64), 1.0)
    omega: NDArray[np.float64] = 2.0 * math.pi * found.bpfo * order
    return np.asarray(one.gain / (1.0 + one.loss / (1j * omega)), dtype=np.complex128)


def _level(one: SensorMap, found: Response, row: int, coefficients: NDArray[np.complex128]) -> tuple[float, float]:
    """Return RMS and peak of a sensor; where lines have factors of their own, the peak changes as the RMS does."""
    rms, peak = (abs(one.gain) * level for level in found.levels[row])
    if one.loss == 0.0 or rms == 0.0:
        return rms, peak
    low, high = 1, len(coefficients) - 1
    if found.rms_band is not None:
        low, high = band_lines(found.bpfo, found.rms_band)
    before, now = one.gain * found.coefficients[row, low : high + 1], coefficients[low : high + 1]
    change = 2.0 * float(np.sum(np.abs(now) ** 2) - np.sum(np.abs(before) ** 2))
    after = math.sqrt(max(rms**2 + change, 0.0))
    return after, peak * after / rms


@dataclass(frozen=True)
class Mapping:
    """How one solver stands for the model whose parameters a scene has.

    Attributes:
        rig: type of those parameters.
        model, solver: what stands for it.
        adapt: returns the mapped scene; raises a ValueError that names an assumption which is not shared.
        error: predicted relative error of what a request asks.
        neglected: what both differ by, words for people.
    """

    rig: type[RigParameters]
    model: str
    solver: str
    adapt: Callable[[Scene], Mapped]
    error: Callable[[Scene, Request], float]
    neglected: str

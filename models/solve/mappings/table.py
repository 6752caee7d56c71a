"""The mappings that there are, and the bounds of their errors.

Bounds of the error of a model that stands for another, looked up from dimensionless groups of the scene.

Each is a product of powers of the groups, fitted to the true errors of random scenes, of which it covers 98 %
(``benchmarks/scenes/fit.py``). Outside of the groups' ranges none is known. The root mean square may agree by chance
where waveforms differ, so that its bounds are the widest.

A mapping between models: a scene with the parameters of the other one, its sensors, and the error that it makes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.rig import RigParameters
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.mappings.ring import (
    Ring,
    approach_of,
    bearing_stiffness,
    casing_of,
    gain_of,
    ring_of,
    rotor_of,
    with_balls,
)
from models.solve.response import HARMONICS, Response, SignalRecord, band_lines, row_of
from models.solve.rotor.rig import RotorRig
from models.words.request import Sensor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.words.request import Quantity, Request


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


Groups = dict[str, float]
# Added to a clearance over the approach, so that none has a logarithm.
_NO_CLEARANCE = 0.03
# A range of groups is believed beyond its ends by this factor.
_BEYOND = 1.05


@dataclass(frozen=True)
class Bound:
    """A bound constant * prod group ** power.

    Attributes:
        constant: with the margin for the scenes that it was fitted to.
        powers: of the groups, in their order.
    """

    constant: float
    powers: tuple[float, ...]

    def of(self, groups: Groups) -> float:
        """Return the bound of a scene."""
        logs = (power * math.log(group) for power, group in zip(self.powers, groups.values(), strict=True))
        return self.constant * math.exp(sum(logs))


@dataclass(frozen=True)
class Bounds:
    """Bounds of each quantity, from scenes whose groups are within ranges.

    Attributes:
        rms, waveform, lines: of these.
        ranges: of the groups, in their order.
        vanishing: number of first groups with which the error vanishes: below their ranges that of the ends holds.
    """

    rms: Bound
    waveform: Bound
    lines: Bound
    ranges: tuple[tuple[float, float], ...]
    vanishing: int = 1

    def look_up(self, groups: Groups, quantity: Quantity) -> float:
        """Return the bound of a quantity; raise a ValueError that names a group outside of its range."""
        known = dict(groups)
        for k, ((name, value), (low, high)) in enumerate(zip(groups.items(), self.ranges, strict=True)):
            if k < self.vanishing and value < low:
                known[name] = low
            elif not low / _BEYOND <= value <= high * _BEYOND:
                raise ValueError(f"{name} is {value:.3g}, its error is known from {low:.3g} to {high:.3g}")
        return {"waveform": self.waveform, "lines": self.lines}.get(quantity, self.rms).of(known)


def groups_of_balls(scene: Scene) -> Groups:
    """Return what decides on the error of massless balls."""
    ring = ring_of(scene)
    pressed, heavier = with_balls(scene, ring)
    approach, stiffness = approach_of(scene, ring), bearing_stiffness(scene, ring.k_c, abs(ring.force))
    natural = math.sqrt(stiffness / ring.mass)
    loaded = 2.0 * math.acos(scene.clearance / (scene.clearance + approach)) * scene.bearing.n_elements / math.tau
    return {
        "gap of unloaded balls over the approach": (pressed.clearance - scene.clearance) / approach,
        "mass of the balls over that of the ring": heavier.mass / ring.mass - 1.0,
        "clearance over the approach": scene.clearance / approach + _NO_CLEARANCE,
        "damping ratio": loaded * ring.damping / (4.0 * natural * ring.mass),
        "loaded balls": loaded,
        "ball-pass over natural frequency": math.tau * kinematics(scene.bearing, scene.speed).bpfo / natural,
    }


def groups_of_shaft(scene: Scene) -> Groups:
    """Return what decides on the error of a rigid shaft."""
    rig = scene.rig_as(RotorRig)
    stiffness = bearing_stiffness(scene, rig.k_c, 0.5 * scene.load)
    natural = math.sqrt(2.0 * stiffness / (rig.m + 2.0 * rig.end_mass))
    return {
        "stiffness of bearings over that of the shaft": max(stiffness / spring for spring in rig.shaft_stiffness),
        "ball-pass over natural frequency": math.tau * kinematics(scene.bearing, scene.speed).bpfo / natural,
        "mass of an end over that of the disc": rig.end_mass / rig.m,
        "damping ratio": scene.bearing.n_elements * rig.c_b / (4.0 * natural * rig.m),
        "clearance over the deflection": scene.clearance * stiffness / max(scene.load, 1e-9) + _NO_CLEARANCE,
    }


# By ``python -m benchmarks.scenes.fit``: of each quantity the bound, and the ranges of the groups, in their order.
_BALLS = Bounds(
    rms=Bound(0.198, (1.349, -0.333, 0.181, -0.125, 1.498, -1.130)),
    waveform=Bound(0.859, (0.746, -0.132, 0.285, 0.727, 1.540, -1.263)),
    lines=Bound(0.00958, (1.590, -0.661, 0.523, -0.181, 2.576, -0.949)),
    ranges=((0.001, 0.0318), (1.73e-4, 4.83e-3), (0.03, 1.76), (9.71e-3, 0.0777), (2.16, 4.5), (0.022, 0.222)),
    vanishing=2,
)
_SHAFT = Bounds(
    rms=Bound(2.0, (0.804, 0.724, -0.410, -0.814, 0.440)),
    waveform=Bound(3.70, (0.957, 0.118, -0.373, -0.475, 0.386)),
    lines=Bound(9520.0, (0.837, 4.607, -0.369, -0.530, 0.479)),
    ranges=((1.23e-3, 0.283), (0.033, 0.3), (0.0883, 0.554), (2.21e-3, 0.285), (0.03, 0.567)),
)
_DAMAGED_SHAFT = Bounds(
    rms=Bound(16.3, (0.607, 1.056, 0.310, -0.497, -0.028)),
    waveform=Bound(20.7, (0.822, 0.081, 0.004, -0.249, 0.274)),
    lines=Bound(9.77, (0.124, 1.395, 0.411, -0.420, -0.217)),
    ranges=((1.39e-3, 0.297), (0.0379, 0.33), (0.0712, 0.577), (2.24e-3, 0.233), (0.03, 0.6)),
)
# Of balls without mass on a rotor that is unbalanced, the highest: the RMS.
_TURNING = 0.29
# Of the casing's model for a rotor whose motion repeats, the highest: the soft spring, and what the reference keeps of
# its beginning.
_SOFT_SPRING = {"waveform": 7e-3, "lines": 1e-3, "rms": 1e-3}
# Of the clearance that the inertia of balls makes, which acts in full only where they are hardly loaded.
_SHARE = 0.5


@lru_cache(maxsize=64)
def _to_casing(scene: Scene) -> Mapped:
    if not scene.repeats:
        raise ValueError("unbalance: what turns with the shaft is not solved for one ball period")
    if isinstance(scene.rig, RotorRig) and scene.rig.end_mass > 0.0:
        raise ValueError("rig.end_mass: the shaft between disc and ends bends")
    scene, ring = _ring_with_balls(scene)
    mapped = casing_of(scene, ring)
    gain, loss = gain_of(mapped), ring.ground / ring.mass
    return Mapped(mapped, tuple(SensorMap(sensor, "mo", share * gain, loss) for sensor, share in ring.sensors))


def _ring_with_balls(scene: Scene) -> tuple[Scene, Ring]:
    """Return scene and ring, with what massless balls lack to first order."""
    ring = ring_of(scene)
    return with_balls(scene, ring, _SHARE) if isinstance(scene.rig, BallInertiaRig) else (scene, ring)


@lru_cache(maxsize=64)
def _to_rotor(scene: Scene) -> Mapped:
    scene, ring = _ring_with_balls(scene)
    return Mapped(rotor_of(scene, ring), tuple(SensorMap(sensor, "a", share) for sensor, share in ring.sensors))


def _stiff(scene: Scene) -> Mapped:
    rig = scene.rig_as(RotorRig)
    if not rig.end_mass > 0.0:
        raise ValueError("rig.end_mass: ends without mass have no accelerations that a rigid shaft's could stand for")
    if rig.internal_damping > 0.0:
        raise ValueError("rig.internal_damping: a rigid shaft has none")
    return Mapped(scene, tuple(SensorMap(sensor, sensor) for sensor in ("a", "b", "c")))


def _error_of_balls(scene: Scene, request: Request) -> float:
    return _BALLS.look_up(groups_of_balls(scene), request.quantity)


def _error_of_shaft(scene: Scene, request: Request) -> float:
    if not scene.repeats and request.quantity in ("waveform", "lines"):
        raise ValueError(f"quantity {request.quantity!r}: of a motion that does not repeat, only its RMS is compared")
    damaged = any(defect.moves_balls for defect in scene.defects)
    return (_DAMAGED_SHAFT if damaged else _SHAFT).look_up(groups_of_shaft(scene), request.quantity)


def _error_of_turning_balls(scene: Scene, request: Request) -> float:
    if scene.repeats or scene.defects or request.quantity in ("waveform", "lines"):
        raise ValueError("its error is known for the RMS of an unbalanced ring without a defect")
    return _TURNING


def _error_of_soft_spring(scene: Scene, request: Request) -> float:
    del scene
    return _SOFT_SPRING.get(request.quantity, _SOFT_SPRING["rms"])


MAPPINGS: tuple[Mapping, ...] = (
    Mapping(
        BallInertiaRig,
        "six_dof",
        "periodic",
        _to_casing,
        _error_of_balls,
        "the inertia of the balls",
    ),
    Mapping(
        BallInertiaRig,
        "rotor",
        "rigid",
        _to_rotor,
        _error_of_turning_balls,
        "the inertia of the balls, and the turn of the cage in their damping",
    ),
    Mapping(
        RotorRig, "six_dof", "periodic", _to_casing, _error_of_soft_spring, "a soft spring that keeps the ring in place"
    ),
    Mapping(
        RotorRig,
        "rotor",
        "rigid",
        _stiff,
        _error_of_shaft,
        "the bending of the shaft",
    ),
)
"""All of them: from the parameters of a type to what stands for their model.

None stands for the six-degree-of-freedom model: where its assumptions coincide with the rotor's, one ball period of it
is far cheaper than any run over time.
"""

"""The mappings that there are, and the factors of their predicted errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from models.mappings.errors import Differences, of_balls, of_shaft
from models.mappings.mapping import Mapped, Mapping, SensorMap
from models.mappings.ring import casing_of, gain_of, ring_of, rotor_of
from models.rigs.ball_inertia import BallInertiaRig
from models.rigs.rotor import RotorRig

if TYPE_CHECKING:
    from models.registry import Request
    from models.scene import Scene

# Bounds of the true errors over the predicted ones (waveform, RMS, lines), from the development seeds of
# benchmarks/scenes.py, and the share of the waveform's that an RMS may have where its own happens to be small.
_BALLS = (1.4, 1.7, 1.7)
_SHAFT = (2.5, 2.5, 2.5)
_RMS_OF_WAVE, _RMS_OF_SHAFT = 0.1, 0.3
# Beside them, for motions over defects, and for those that do not repeat, which are followed for few turns only.
_FEW_PASSAGES, _FEW_TURNS = 2.0, 3.5
# A prediction to first order says nothing beyond this.
_FIRST_ORDER = 0.1
# Of a rotor's stand-in: the soft spring, and what the reference keeps of its beginning.
_STAND_IN = Differences(waveform=2e-2, rms=2e-3, lines=1.5e-3)


def _to_casing(scene: Scene) -> Mapped:
    if not scene.repeats:
        raise ValueError("unbalance: what turns with the shaft is not solved for one ball period")
    if isinstance(scene.rig, RotorRig) and scene.rig.end_mass > 0.0:
        raise ValueError("rig.end_mass: the shaft between disc and ends bends")
    ring = ring_of(scene)
    mapped = casing_of(scene, ring)
    gain, loss = gain_of(mapped), ring.ground / ring.mass
    return Mapped(mapped, tuple(SensorMap(sensor, "mo", share * gain, loss) for sensor, share in ring.sensors))


def _to_rotor(scene: Scene) -> Mapped:
    ring = ring_of(scene)
    return Mapped(rotor_of(scene, ring), tuple(SensorMap(sensor, "a", share) for sensor, share in ring.sensors))


def _stiff(scene: Scene) -> Mapped:
    rig = scene.rig_as(RotorRig)
    if not rig.end_mass > 0.0:
        raise ValueError("rig.end_mass: ends without mass have no accelerations that a rigid shaft's could stand for")
    if rig.internal_damping > 0.0:
        raise ValueError("rig.internal_damping: a rigid shaft has none")
    return Mapped(scene, tuple(SensorMap(sensor, sensor) for sensor in ("a", "b", "c")))


def _check_quantity(scene: Scene, request: Request) -> None:
    """Raise a ValueError where times or lines of motions that do not repeat would have to be compared."""
    if not scene.repeats and request.quantity in ("waveform", "lines"):
        raise ValueError(f"quantity {request.quantity!r}: of a motion that does not repeat, only its RMS is compared")


def _asked(
    found: Differences, factors: tuple[float, float, float], request: Request, of_wave: float = _RMS_OF_WAVE
) -> float:
    """Return the predicted error of what is asked."""
    values = {
        "waveform": factors[0] * found.waveform,
        "lines": factors[2] * found.lines,
    }
    value = values.get(request.quantity, factors[1] * max(found.rms, of_wave * found.waveform))
    return value if math.isfinite(value) else math.inf


def _error_of_balls(scene: Scene, request: Request) -> float:
    return _asked(of_balls(scene, request), _BALLS, request)


def _error_of_balls_by_rotor(scene: Scene, request: Request) -> float:
    _check_quantity(scene, request)
    error = _asked(of_balls(scene, request, cage_in_rate=False), _BALLS, request)
    if not scene.repeats:
        return _FEW_TURNS * error
    return error if scene.defect is None else _FEW_PASSAGES * error


def _error_of_stand_in(scene: Scene, request: Request) -> float:
    del scene
    return {"waveform": _STAND_IN.waveform, "lines": _STAND_IN.lines}.get(request.quantity, _STAND_IN.rms)


def _error_of_shaft(scene: Scene, request: Request) -> float:
    _check_quantity(scene, request)
    found = of_shaft(scene)
    return _asked(found, _SHAFT, request, _RMS_OF_SHAFT) if found.waveform <= _FIRST_ORDER else math.inf


MAPPINGS: tuple[Mapping, ...] = (
    Mapping(BallInertiaRig, "six_dof", "periodic", _to_casing, _error_of_balls, "the inertia of the balls"),
    Mapping(
        BallInertiaRig,
        "rotor",
        "rigid",
        _to_rotor,
        _error_of_balls_by_rotor,
        "the inertia of the balls, and the turn of the cage in their damping",
    ),
    Mapping(
        RotorRig, "six_dof", "periodic", _to_casing, _error_of_stand_in, "a soft spring that keeps the ring in place"
    ),
    Mapping(RotorRig, "rotor", "rigid", _stiff, _error_of_shaft, "the bending of the shaft"),
)
"""All of them: from the parameters of a type to what stands for their model.

None stands for the six-degree-of-freedom model: where its assumptions coincide with the rotor's, one ball period of it
is far cheaper than any run over time.
"""

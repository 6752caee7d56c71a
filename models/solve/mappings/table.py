"""The mappings that there are, and the bounds of their errors."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.mappings.errors import Bound, Bounds, groups_of_balls, groups_of_shaft
from models.solve.mappings.mapping import Mapped, Mapping, SensorMap
from models.solve.mappings.ring import Ring, casing_of, gain_of, ring_of, rotor_of, with_balls
from models.solve.rotor.rig import RotorRig

if TYPE_CHECKING:
    from models.machine.scene import Scene
    from models.words.request import Request

# By ``python -m benchmarks.scenes_fit``: of each quantity the bound, and the ranges of the groups, in their order.
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

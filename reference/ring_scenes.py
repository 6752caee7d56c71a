"""Scenes in which one model may stand for another: rotor, balls with inertia, six degrees of freedom."""

from __future__ import annotations

from typing import Any

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig, RigParameters
from models.machine.scene import Scene
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.registry import solvers
from models.solve.rotor.rig import RotorRig

SOLVERS = {(solver.model, solver.name): solver for solver in solvers()}
SHORT: dict[str, Any] = {"duration": 0.3, "rate": 25600.0}
CAGE = 0.2
ROTOR = RotorRig(cage_angle_a=CAGE, cage_angle_b=CAGE, m=3.0, c_n=300.0)
BALLS = BallInertiaRig(m_b=1e-4, c_ci=500.0, c_co=500.0, defect_shape="half_sine", cage_angle=CAGE)
FREE = Rig(k_i=1e5, beta_c=0.0, alpha_c=100.0, m_b=1.0, m_r=0.1)
BEARING = from_catalogue("6206")


def scene_of(rig: RigParameters, **change: Any) -> Scene:
    """Return the scene of a rig at 30 Hz and 1500 N, with other fields."""
    return Scene(**{"speed": 30.0, "load": 1500.0, "bearing": BEARING, "rig": rig} | change)

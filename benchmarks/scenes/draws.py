"""Random scenes for ``benchmarks.scenes``: in each of them at least two models can answer.

Five kinds take turns. Damping is such that motions settle within a second, so that a reference with an eighth of the
step can be afforded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Scene
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.ring_impact.rig import STEEL_DENSITY
from models.solve.rotor.rig import RotorRig
from models.words.request import Quantity, Request

BEARINGS = ("6204", "6205", "6206", "6208", "6304", "6305", "6306")
KINDS = ("balls", "rotor", "balls, defect", "shaft", "balls, unbalance")
QUANTITIES: tuple[Quantity, ...] = ("rms", "waveform", "lines")
GRAVITY = 9.81


@dataclass(frozen=True)
class Drawn:
    """A scene with the accuracy that is asked for."""

    kind: str
    seed: int
    scene: Scene
    request: Request


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def draw(seed: int, kind: str) -> Drawn:
    """Return the scene of a seed."""
    rng = np.random.default_rng(seed)
    bearing = from_catalogue(BEARINGS[rng.integers(len(BEARINGS))])
    clearance = 0.0 if rng.random() < 0.5 else log_uniform(rng, 1e-6, 15e-6)
    speed, load = log_uniform(rng, 20.0, 60.0), log_uniform(rng, 300.0, 5000.0)
    scene = Scene(speed, load, bearing=bearing, rig=_balls(rng, bearing.element_diameter), clearance=clearance)
    if kind.startswith("balls") and rng.random() < 0.5:
        scene = replace(scene, gravity=GRAVITY)
    if kind == "balls, defect":
        extent, depth = math.radians(log_uniform(rng, 1.0, 8.0)), log_uniform(rng, 2e-6, 5e-5)
        scene = replace(scene, defect=Defect(extent, depth))
    elif kind == "balls, unbalance":
        share = log_uniform(rng, 0.05, 0.3)
        scene = replace(scene, unbalance=share * load / (2.0 * math.pi * speed) ** 2)
    elif kind == "rotor":
        scene = replace(scene, rig=_rotor(rng))
    elif kind == "shaft":
        scene = replace(scene, rig=_stiff(rng))
        if rng.random() < 0.5:
            part = "outer" if rng.random() < 0.7 else "inner"
            scene = replace(
                scene, defect=Defect(math.radians(log_uniform(rng, 1.0, 8.0)), log_uniform(rng, 2e-6, 3e-5), part=part)
            )
    quantity: Quantity = QUANTITIES[rng.integers(3)] if scene.repeats else "rms"
    if kind == "balls, defect" and rng.random() < 0.25:
        quantity = "v_eq"
    low, high = (1e-2, 0.3) if quantity == "waveform" else (2e-3, 0.1)
    request = Request(
        accuracy=log_uniform(rng, low, high), quantity=quantity, duration=max(0.15, 6.0 / speed), rate=25600.0
    )
    return Drawn(kind, seed, scene, request)


def _balls(rng: np.random.Generator, diameter: float) -> BallInertiaRig:
    """Return balls from a quarter of the density of steel (hollow, ceramic) to that of steel."""
    damping, size = log_uniform(rng, 300.0, 1000.0), log_uniform(rng, 0.7, 1.5)
    steel = STEEL_DENSITY * math.pi / 6.0 * diameter**3
    return BallInertiaRig(
        m_rotor=log_uniform(rng, 0.5, 1.5),
        m_b=steel * log_uniform(rng, 0.25, 1.0),
        k_ci=size * BallInertiaRig.k_ci,
        k_co=size * BallInertiaRig.k_co,
        c_ci=damping,
        c_co=damping,
        cage_angle=float(rng.uniform(0.0, 1.0)),
        defect_shape="half_sine",
    )


def _rotor(rng: np.random.Generator) -> RotorRig:
    cage = float(rng.uniform(0.0, 1.0))
    return RotorRig(
        m=log_uniform(rng, 1.0, 3.0),
        c_n=log_uniform(rng, 200.0, 400.0),
        c_b=log_uniform(rng, 20.0, 1000.0),
        k_c=RotorRig.k_c * log_uniform(rng, 0.5, 2.0),
        cage_angle_a=cage,
        cage_angle_b=cage,
    )


def _stiff(rng: np.random.Generator) -> RotorRig:
    """Return a short, thick shaft whose ends have a mass."""
    half = log_uniform(rng, 0.02, 0.1)
    return replace(
        _rotor(rng),
        length=2.0 * half,
        a=half,
        shaft_diameter=log_uniform(rng, 0.025, 0.06),
        end_mass=log_uniform(rng, 0.2, 0.6),
        j_p=1e-2,
        j_t=1e-2,
    )

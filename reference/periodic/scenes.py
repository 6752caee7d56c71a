"""Random scenes on which engine and oracle are compared, fixed by a seed.

Every quantity is log-uniform within its range, unless said. Three kinds, drawn with the shares of ``KINDS``:

- ``any``: any bearing of ``GEOMETRIES`` on a rig whose masses are the thesis' times 0.01 to 10 and whose stiffness and
  damping are the thesis' times 0.01 to 100, each drawn by itself; 0.05 to 400 Hz, 1 N to 50 kN, clearance none (two in
  five) or 0.1 to 50 um, 0.02 to 360 degrees, 0.1 to 1500 um.
- ``thesis``: the same operating points and defects on the thesis' rig and bearing.
- ``light``: the thesis' rig at 5 to 100 Hz, 1 to 1000 N, clearance 2 to 20 um, 1 to 60 degrees, 2 to 100 um, where
  contacts open and motions that repeat lose their stability.

One scene in ten of the first two kinds is healthy; of the others one or both rows are damaged, two in five floors are
rough (0.1 to 5 um), and one in five defects stands off the load direction by up to 30 degrees (uniform). Scenes whose
highest resonance, linearised at rest, exceeds MAX_RESONANCE ball rates are marked ``beyond``: they are to be refused.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np

from reference.periodic.path import cutoff_of
from reference.periodic.rig import Geometry, OracleScene, Parameters, Rough

# Disjoint sets. A held-out set is compared once, when the engine no longer changes: the first two were, and what they
# showed has since changed the engine.
DEVELOPMENT, HELD_OUT, HELD_OUT_2, HELD_OUT_3 = 20261122, 90210914, 77120531, 31415806
SEEDS = {"development": DEVELOPMENT, "held_out": HELD_OUT, "held_out_2": HELD_OUT_2, "held_out_3": HELD_OUT_3}
MAX_RESONANCE = 1e5
KINDS = {"any": 0.7, "thesis": 0.15, "light": 0.15}

_MM, _UM, _DEG = 1e-3, 1e-6, math.pi / 180.0
THESIS_BEARING = Geometry("1205 ETN9", "ball", 12, 2, 3.56 * _MM, 18.946 * _MM, 10.2 * _DEG, 22.91 * _MM)
# Radii of the outer race as given by the maker, or pitch radius plus that of the element where it is not.
GEOMETRIES = (
    THESIS_BEARING,
    Geometry("6203", "ball", 8, 1, 3.37312 * _MM, 14.2494 * _MM, 0.0, 17.62252 * _MM),
    Geometry("6205", "ball", 9, 1, 3.97002 * _MM, 19.5199 * _MM, 0.0, 23.48992 * _MM),
    Geometry("6210", "ball", 10, 1, 6.35 * _MM, 35.025 * _MM, 0.0, 41.35 * _MM),
    Geometry("6305", "ball", 7, 1, 5.637 * _MM, 21.6925 * _MM, 0.0, 27.335 * _MM),
    Geometry("NU 202 ECP", "roller", 11, 1, 2.75 * _MM, 12.4 * _MM, 0.0, 15.15 * _MM),
    Geometry("22207", "roller", 15, 2, 5.0 * _MM, 26.75 * _MM, 12.0 * _DEG, 31.6407 * _MM),
)
_WEIGHTS = (0.3, 0.1, 0.1, 0.1, 0.1, 0.15, 0.15)
THESIS_RIG = Parameters(
    m_i=3.48,
    m_o=5.79,
    m_r=3.01,
    m_b=1.47e-3,
    k_i=75e6,
    k_r=4.25e9,
    k_c=5927e6,
    c_i=2834.1,
    c_r=186.0,
    alpha_c=154.9,
    beta_c=2.5e-5,
)
# Both line contacts of a steel roller 5.6 mm long (thesis, Eqs. 15 and 16), N/m^(10/9).
ROLLER_K_C = 3.72e8
ROUGH_PITCH = 2e-3


def scenes(seed: int, count: int) -> list[OracleScene]:
    """Return the first ``count`` scenes of a seed; a longer list begins with a shorter one."""
    return [_scene(np.random.default_rng([seed, i])) for i in range(count)]


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _scene(rng: np.random.Generator) -> OracleScene:
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    geometry = GEOMETRIES[int(rng.choice(len(GEOMETRIES), p=_WEIGHTS))] if kind == "any" else THESIS_BEARING
    rig = asdict(THESIS_RIG)
    if geometry.element == "roller":
        rig["k_c"] = ROLLER_K_C
    if kind == "any":
        for name in rig:
            rig[name] *= between(rng, 0.01, 10.0 if name.startswith("m_") else 100.0)
    light = kind == "light"
    speed = between(rng, *((5.0, 100.0) if light else (0.05, 400.0)))
    load = between(rng, *((1.0, 1000.0) if light else (1.0, 50e3)))
    loose = light or rng.random() < 0.6
    clearance = between(rng, *((2.0, 20.0) if light else (0.1, 50.0))) * _UM if loose else 0.0
    healthy = not light and rng.random() < 0.1
    extent = between(rng, *((1.0, 60.0) if light else (0.02, 360.0))) * _DEG
    depth = between(rng, *((2.0, 100.0) if light else (0.1, 1500.0))) * _UM
    rough = None
    if rng.random() < 0.4:
        sd = between(rng, 0.1, 5.0) * _UM
        rough = Rough(sd, ROUGH_PITCH, cutoff_of(geometry.element_radius), int(rng.integers(1 << 30)))
    scene = OracleScene(
        speed=speed,
        load=load,
        clearance=clearance,
        extent=0.0 if healthy else min(extent, 2.0 * math.pi),
        depth=0.0 if healthy else depth,
        rows=0 if healthy else int(rng.integers(1, geometry.rows + 1)),
        geometry=geometry,
        rough=None if healthy else rough,
        parameters=Parameters(**rig),
        position=float(rng.uniform(-30.0, 30.0)) * _DEG if not healthy and rng.random() < 0.2 else 0.0,
        kind=kind,
    )
    return replace(scene, beyond=scene.highest_resonance() * scene.period > MAX_RESONANCE)

"""Random scenes with one effect that only a simulation over time shows, from next to nothing to what matters."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Part, Scene, Slip, Waviness
from models.solve.six_dof.time_domain import simulate_time
from models.words.request import Sensor
from reference.signals import record_of

KINDS = ("unbalance", "slip", "inner_waviness", "inner_defect", "ball_defect", "mean_force_slip")
SHARES = (1e-12, 1.0)
_BALLS = ("1205 ETN9", "6205", "6305", "6208")
_ROLLERS = "NU 202 ECP"
_PARTS: dict[str, Part] = {"inner_defect": "inner", "ball_defect": "ball"}


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def plain_scene(seed: int, *, damaged: bool, balls: bool = False) -> Scene:
    """Return the scene of a seed without the effect; one in four has rollers, one in three no defect, unless told."""
    rng = np.random.default_rng([40, seed])
    rollers, kind = rng.random() < 0.25 and not balls, rng.integers(1 if damaged else 0, 3)
    defect = None
    if kind == 1:
        defect = Defect(math.radians(log_uniform(rng, 1.0, 8.0)), 500e-6)
    elif kind == 2:
        defect = Defect(math.radians(log_uniform(rng, 3.0, 20.0)), log_uniform(rng, 2e-6, 3e-5))
    rig = Rig(
        m_i=Rig.m_i * log_uniform(rng, 0.5, 2.0),
        m_o=Rig.m_o * log_uniform(rng, 0.5, 2.0),
        m_r=Rig.m_r * log_uniform(rng, 0.5, 2.0),
        k_i=Rig.k_i * log_uniform(rng, 0.2, 5.0),
        k_r=Rig.k_r * log_uniform(rng, 0.2, 2.0),
        k_c=(5e8 if rollers else Rig.k_c) * log_uniform(rng, 0.4, 2.5),
        c_i=Rig.c_i * log_uniform(rng, 0.3, 3.0),
        c_r=Rig.c_r * log_uniform(rng, 0.5, 10.0),
        beta_c=Rig.beta_c * log_uniform(rng, 0.5, 4.0),
        element="roller" if rollers else "ball",
    )
    return Scene(
        speed=log_uniform(rng, 10.0, 100.0),
        load=log_uniform(rng, 200.0, 6000.0),
        bearing=from_catalogue(_ROLLERS if rollers else str(rng.choice(_BALLS))),
        rig=rig,
        defect=defect,
        clearance=0.0 if rng.random() < 0.5 else log_uniform(rng, 5e-7, 5e-6),
    )


def with_effect(scene: Scene, kind: str, share: float, *, wide: bool = False) -> Scene:
    """Return a scene with an effect of KINDS: a share of a size at which it is plain to see.

    ``wide``: of a defect that is small, the depth is, and not the extent.
    """
    if kind == "unbalance":
        return replace(scene, unbalance=share * 0.3 * scene.load / (2.0 * math.pi * scene.speed) ** 2)
    if kind == "inner_waviness":
        return replace(scene, waviness=(Waviness(share * 1e-6, 7 + scene.bearing.n_elements // 3, "inner", 0.5),))
    if kind in ("slip", "mean_force_slip"):
        return replace(scene, slip=Slip(share * 0.02, "per_passage" if kind == "slip" else "mean_force"))
    extent, depth = (0.05, share * 1e-5) if wide else (share * 0.1, 2e-5)
    small = Defect(extent, depth, position=1.0, part=_PARTS[kind])
    if scene.defect is None:
        return replace(scene, defect=small)
    return replace(scene, more_defects=(small,))


def weak_scene(seed: int, kind: str) -> Scene:
    """Return the scene of a seed with an effect of KINDS, of any share of its size."""
    rng = np.random.default_rng([41, seed])
    damaged = kind in ("slip", "mean_force_slip")
    plain = plain_scene(seed, damaged=damaged, balls=kind == "mean_force_slip")
    return with_effect(plain, kind, log_uniform(rng, *SHARES), wide=bool(rng.random() < 0.5))


def change_over_time(
    scene: Scene, plain: Scene, *, seconds: float, step: float, sensor: Sensor = "mo"
) -> tuple[float, float]:
    """Return the RMS of what an effect changes of the acceleration of a sensor, and the change of its RMS, m/s2.

    Both are simulated over time with the same steps, s. A Hann window weighs the squares: a record has no whole number
    of turns and passages.
    """
    waves = [record_of(simulate_time(one, seconds, 51200.0, step=step)).of(sensor) for one in (scene, plain)]
    weight = np.hanning(len(waves[0]))
    ours, without, changed = (
        math.sqrt(float(np.average(one * one, weights=weight))) for one in (*waves, waves[0] - waves[1])
    )
    return changed, abs(ours - without)

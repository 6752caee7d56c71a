"""A fourth set of random scenes, balls and rollers in turn, of what the first three had few of.

Scenes follow in a fixed order in which every twelve have each kind of ``KINDS`` with balls and with rollers, so that
the first of them tell most. A quantity is log-uniform within its range unless said:

- ``pit``: shorter than the rolling element, 0.1 to 4 degrees, 1 um to 1 mm deep: the element touches both edges.
- ``edge``: 4 to 60 degrees, 3 to 200 um, one edge within 15 degrees (uniform) of the load.
- ``light``: 2 to 300 N, clearance 2 to 20 um, 0.5 to 40 degrees, 2 to 100 um, where contacts open and close.
- ``several``: two or three defects of 0.3 to 8 degrees, 2 to 200 um, apart, within 50 degrees of the load (uniform).
- ``wavy``: one to three waves of the outer race, 2 to 40 around it, 0.02 to 2 um; half have a pit.
- ``rig``: 0.05 to 60 degrees, 0.5 to 500 um on any rig: masses times 0.03 to 10, all else times 0.03 to 30, 0.1 to
  300 Hz, 2 N to 45 kN; one in twelve is healthy.

The others are at 2 to 200 Hz and 100 N to 20 kN, on the thesis' rig with masses times 0.3 to 3, stiffness times 0.2 to
5 (contacts 0.1 to 10) and damping times 0.3 to 3. Three in five have a bearing drawn at random. Clearance is none (two
in five) or 0.2 to 20 um. Floors of ``edge``, ``light`` and ``rig`` are rough in three of ten. A scene whose highest
resonance at rest exceeds MAX_RESONANCE ball rates is drawn anew, because the oracle must simulate it from rest.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np

from reference.periodic.path import cutoff_of
from reference.periodic.rig import Geometry, OracleScene, Parameters, Pit, Rough, Wave
from reference.periodic.scenes import GEOMETRIES, ROLLER_K_C, ROUGH_PITCH, THESIS_RIG, between

# Disjoint sets. The first is compared while the engine changes; the second once, when it no longer does.
DEVELOPMENT_FOURTH, FOURTH = 40061123, 27182818
SETS = {"development": (DEVELOPMENT_FOURTH, 60), "held_out": (FOURTH, 400)}
KINDS = ("pit", "several", "light", "wavy", "edge", "rig")
ELEMENTS = ("ball", "roller")
MAX_RESONANCE = 2e4

_UM, _DEG = 1e-6, math.pi / 180.0
_SPREAD = {"m": (0.3, 3.0), "k": (0.2, 5.0), "k_c": (0.1, 10.0)}
_ANY_SPREAD = {"m": (0.03, 10.0)}
# Two defects of one row keep this distance, rad.
_APART = 0.5 * _DEG
_ROUGH_KINDS = ("edge", "light", "rig")


def fourth_scenes(seed: int, count: int) -> list[OracleScene]:
    """Return the first ``count`` scenes of a seed; a longer list begins with a shorter one."""
    return [fourth_scene(seed, number) for number in range(count)]


def fourth_scene(seed: int, number: int) -> OracleScene:
    """Return one scene of a seed."""
    rng = np.random.default_rng([seed, number])
    while True:
        scene = _drawn(rng, KINDS[number // 2 % len(KINDS)], ELEMENTS[number % 2])
        if scene.highest_resonance() * scene.period <= MAX_RESONANCE:
            return scene


def _drawn(rng: np.random.Generator, kind: str, element: str) -> OracleScene:
    geometry = _geometry(rng, element)
    rig = _rig(rng, kind, element)
    any_rig, light = kind == "rig", kind == "light"
    speed = between(rng, *((0.1, 300.0) if any_rig else (2.0, 200.0)))
    load = between(rng, *((2.0, 300.0) if light else (2.0, 45e3) if any_rig else (100.0, 20e3)))
    loose = light or rng.random() < 0.6
    clearance = between(rng, *((2.0, 20.0) if light else (0.2, 20.0))) * _UM if loose else 0.0
    pits = _pits(rng, kind, geometry)
    rough = None
    if kind in _ROUGH_KINDS and rng.random() < 0.3:
        sd = between(rng, 0.1, 3.0) * _UM
        rough = Rough(sd, ROUGH_PITCH, cutoff_of(geometry.element_radius), int(rng.integers(1 << 30)))
    scene = OracleScene(
        *(speed, load, clearance, 0.0, 0.0, 0),
        geometry=geometry,
        rough=None,
        parameters=rig,
        kind=kind,
        waves=_waves(rng) if kind == "wavy" else (),
    )
    if not pits:
        return scene
    first = pits[0]
    return replace(
        scene,
        extent=first.extent,
        depth=first.depth,
        position=first.position,
        rows=first.rows,
        rough=rough,
        more=tuple(pits[1:]),
    )


def _geometry(rng: np.random.Generator, element: str) -> Geometry:
    if rng.random() < 0.4:
        known = [g for g in GEOMETRIES if g.element == element]
        return known[int(rng.integers(len(known)))]
    count, pitch_radius = int(rng.integers(7, 19)), between(rng, 10e-3, 60e-3)
    radius = float(pitch_radius * math.pi / count * rng.uniform(0.55, 0.85))
    rows = 2 if rng.random() < 0.3 else 1
    angle = float(rng.uniform(0.0, 20.0 if element == "ball" else 15.0)) * _DEG if rng.random() < 0.5 else 0.0
    return Geometry("random", element, count, rows, radius, pitch_radius, angle, pitch_radius + radius)


def _rig(rng: np.random.Generator, kind: str, element: str) -> Parameters:
    rig = asdict(THESIS_RIG)
    if element == "roller":
        rig["k_c"] = ROLLER_K_C
    spread, other = (_ANY_SPREAD, (0.03, 30.0)) if kind == "rig" else (_SPREAD, (0.3, 3.0))
    for name in rig:
        rig[name] *= between(rng, *spread.get(name, spread.get(name[0], other)))
    return Parameters(**rig)


def _pits(rng: np.random.Generator, kind: str, geometry: Geometry) -> list[Pit]:
    """Return the defects of a scene, apart from each other."""
    if kind == "several":
        return _apart(rng, int(rng.integers(2, 4)), geometry)
    if kind == "wavy" and rng.random() < 0.5:
        return []
    if kind == "rig" and rng.random() < 1.0 / 12.0:
        return []
    reach = math.asin(geometry.element_radius / geometry.outer_race_radius)
    short = (0.1, min(4.0, reach / _DEG))
    extents = {"edge": (4.0, 60.0), "light": (0.5, 40.0), "rig": (0.05, 60.0)}
    depths = {"edge": (3.0, 200.0), "light": (2.0, 100.0), "rig": (0.5, 500.0)}
    extent = between(rng, *extents.get(kind, short)) * _DEG
    depth = between(rng, *depths.get(kind, (1.0, 1000.0))) * _UM
    off = float(rng.uniform(-15.0, 15.0)) * _DEG
    if kind == "edge":
        off += 0.5 * extent * (1.0 if rng.random() < 0.5 else -1.0)
    return [Pit(extent, depth, off, int(rng.integers(1, geometry.rows + 1)))]


def _apart(rng: np.random.Generator, count: int, geometry: Geometry) -> list[Pit]:
    found: list[Pit] = []
    while len(found) < count:
        extent, depth = between(rng, 0.3, 8.0) * _DEG, between(rng, 2.0, 200.0) * _UM
        pit = Pit(extent, depth, float(rng.uniform(-50.0, 50.0)) * _DEG, int(rng.integers(1, geometry.rows + 1)))
        if all(abs(pit.position - p.position) > 0.5 * (pit.extent + p.extent) + _APART for p in found):
            found.append(pit)
    return found


def _waves(rng: np.random.Generator) -> tuple[Wave, ...]:
    return tuple(
        Wave(between(rng, 0.02, 2.0) * _UM, round(between(rng, 2.0, 40.0)), float(rng.uniform(-math.pi, math.pi)))
        for _ in range(int(rng.integers(1, 4)))
    )

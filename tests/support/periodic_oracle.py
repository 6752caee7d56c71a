"""Makers and checks that tests of periodic oracle share."""

from __future__ import annotations

import math
from dataclasses import replace

from reference.periodic.path import cutoff_of
from reference.periodic.rig import OracleScene, Rough
from reference.periodic.scenes import (
    GEOMETRIES,
    ROLLER_K_C,
    THESIS_BEARING,
    THESIS_RIG,
)

ROUGH = Rough(1e-6, 2e-3, cutoff_of(THESIS_BEARING.element_radius), 3)


def thesis_scene(
    speed: float,
    load: float,
    extent_deg: float = 0.0,
    depth: float = 0.0,
    *,
    clearance: float = 0.0,
    rough: Rough | None = None,
) -> OracleScene:
    rows = 1 if extent_deg else 0
    return OracleScene(speed, load, clearance, math.radians(extent_deg), depth, rows, THESIS_BEARING, rough, THESIS_RIG)


SPALL = thesis_scene(40.0, 4000.0, 20.0, 20e-6)


ROLLERS = replace(SPALL, geometry=GEOMETRIES[-1], parameters=replace(THESIS_RIG, k_c=ROLLER_K_C), rows=2, rough=ROUGH)

"""Makers and checks that tests of evidence share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.identify.evidence import DIRECTIONS, Direction, Peak, accelerance, modes
from models.identify.space import bearing_directions
from models.machine.rig import Rig
from tests.models.identify.cases import BEARING

LIGHT = replace(Rig(), m_i=0.4, m_o=0.6, m_r=0.3, k_i=2e7, k_r=3.4e8, c_i=300.0, c_r=30.0, beta_c=1e-5)


LOADS = (1000.0, 2000.0)


def peaks_of(rig: Rig, *, absolute: bool = False, directions: tuple[Direction, ...] = DIRECTIONS) -> list[Peak]:
    """Return the resonances of a rig at both loads, without error, with 0.5 % and 10 % of uncertainty."""
    found: list[Peak] = []
    for load in LOADS:
        across, along = bearing_directions(BEARING, load, rig.k_c, 0.0)
        for direction in directions:
            k_b = along if direction == "along" else across
            own = modes(rig, BEARING, np.array([k_b]))
            levels = np.abs(accelerance(rig, BEARING, np.array([k_b]), own.frequency))
            for f, z, a in zip(own.frequency[0].tolist(), own.damping[0].tolist(), levels[0].tolist(), strict=True):
                peak = Peak(load, direction, f, 0.005 * f, z, 0.1 * z)
                found.append(replace(peak, accelerance=a, accelerance_sd=0.1 * a) if absolute else peak)
    return found

"""Scenes over whose pits contacts open, and the order with which errors fall."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Scene

HEALTHY = Scene(40.0, 4000.0)
PIT = Defect(math.radians(4.236), 500e-6)
BARREL = replace(from_catalogue("1205 ETN9"), designation="barrel", element="roller", effective_length=8e-3)
OPENING = {
    "pit": Scene(30.0, 2000.0, defect=PIT),
    "rollers, pit": Scene(40.0, 4000.0, BARREL, Rig(k_c=1.2e9, element="roller"), PIT),
    "spall": replace(HEALTHY, defect=Defect(math.radians(20.0), 20e-6)),
}


def slope(errors: list[float]) -> float:
    """Return the exponent with which errors fall, each with half the step of the one before."""
    return float(-np.polyfit(np.arange(len(errors)), np.log2(errors), 1)[0])


def relative(found: NDArray[np.float64], exact: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean((found - exact) ** 2) / np.mean(exact**2)))

"""Makers and checks that tests of identify share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def stand_in(rig: Any, clearance: float, extents: np.ndarray) -> np.ndarray:
    """Return features that depend smoothly on all parameters but alpha_c, and on f_r with many minima."""
    f_r = math.sqrt(rig.k_r * (1.0 / rig.m_r + 1.0 / rig.m_o)) / (2.0 * math.pi)
    rms = 5.0 + 0.3 * np.sin(f_r / 150.0 * (1.0 + 20.0 * extents)) + 1e-3 * math.log(rig.c_r) + 1e5 * clearance
    a_star = (extents * 30.0) ** 0.5 * rig.m_r**0.3 * (rig.c_i / 2000.0) ** (0.1 + 5.0 * extents)
    return np.column_stack([rms * (rig.beta_c / 2e-5) ** (-5.0 * extents), a_star])

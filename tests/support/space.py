"""Makers and checks that tests of space share."""

from __future__ import annotations

import math
from dataclasses import replace

from models.identify.space import ORDER, Space
from models.machine.hertz import mean_bearing_stiffness
from models.machine.rig import natural_frequencies
from tests.models.identify.cases import BEARING


def broken(space: Space, values: dict[str, float]) -> list[str]:
    """Return which inequalities of Eq. 80 are broken that a free parameter enters, by another way than the space's."""
    limits, free = space.limits, set(space.free)
    rig = replace(space.rig, **{name: values[name] for name in ORDER if name != "clearance"})
    checks: dict[str, tuple[bool, float, tuple[float, float]]] = {
        "m_r": ("m_r" in free, values["m_r"], limits.m_r),
        "k_r": ("k_r" in free, values["k_r"], limits.k_r),
        "beta_c": ("beta_c" in free, values["beta_c"], limits.beta_c),
        "clearance": ("clearance" in free, values["clearance"], limits.clearance),
    }
    for which, f, interval in (("i", limits.f_i, limits.zeta_i), ("r", limits.f_d, limits.zeta_r)):
        beta = values[f"c_{which}"] / values[f"k_{which}"]
        used = bool(free & {f"c_{which}", f"k_{which}"})
        checks[f"zeta_{which}"] = (used, 0.5 * beta * 2.0 * math.pi * f, interval)
    for name, f, interval in (("zeta_1", limits.f_1, limits.zeta_1), ("zeta_2", limits.f_2, limits.zeta_2)):
        omega = 2.0 * math.pi * f
        ratio = 0.5 * (values["alpha_c"] / omega + values["beta_c"] * omega)
        checks[name] = (bool(free & {"alpha_c", "beta_c"}), ratio, interval)
    resonant = bool(free & {"m_r", "k_r", "m_i", "m_o", "k_i", "k_c", "clearance"})
    for load in space.loads:
        matrix = mean_bearing_stiffness(BEARING, load, values["k_c"], clearance=values["clearance"], points=16)
        for direction in (0, 1):
            k_b = float(matrix[direction, direction])
            f_r = float(natural_frequencies(rig, k_b, k_b)[-1])
            checks[f"f_r {load} {direction}"] = (resonant, f_r, limits.f_r)
    slack = 1e-7
    found = [
        name for name, (used, x, (lo, hi)) in checks.items() if used and not lo - slack * lo <= x <= hi + slack * hi
    ]
    return found + (["alpha_c"] if "alpha_c" in free and not values["alpha_c"] > 0.0 else [])

"""What appendix A of the thesis prints of its gearbox, and the modes of its nine degrees of freedom."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from models.gears import published as gearbox
from models.gears.train.linear import natural_frequencies
from reference.accepted import rows_of

Array = NDArray[np.float64]


def test_rows_are_met_but_for_the_misprint() -> None:
    rows = rows_of("models.gears.published")
    assert [row.quantity for row in rows if not row.met] == ["J_1"]
    assert {row.test for row in rows} == {"A1", "A2", "A3", "A4"}


def by_hand(radius: float, k_mesh: float, k_b: float) -> Array:
    """Return the natural frequencies of three wheels in a row from springs written out one by one, Hz.

    Gear 1 turns counterclockwise and gear 3 is to its right: where they touch, gear 1 moves upwards and pushes gear 3
    along (sin 20 deg, cos 20 deg). Gear 3 turns clockwise and pushes gear 5 downwards, along (sin 20 deg, -cos 20 deg).
    """
    mass = np.diag([v for m, j in zip(gearbox.MASS, gearbox.INERTIA, strict=True) for v in (m, m, j)])
    stiffness = np.diag([k_b, k_b, 0.0] * 3)
    s, c = math.sin(math.radians(20.0)), math.cos(math.radians(20.0))
    for stretch in ([s, c, radius, -s, -c, -radius, 0, 0, 0], [0, 0, 0, s, -c, radius, -s, c, -radius]):
        stiffness += k_mesh * np.outer(stretch, stretch)
    return np.sqrt(np.maximum(eigh(stiffness, mass, eigvals_only=True), 0.0)) / (2.0 * math.pi)


@pytest.mark.parametrize("module", [3e-3, 6e-3])
def test_modes_are_those_of_springs_by_hand(module: float) -> None:
    found = natural_frequencies(gearbox.appendix_train(module, profile="Mod1", bearings=2.0)).frequencies
    radius = 0.5 * 37 * module * math.cos(math.radians(20.0))
    assert found[0] == 0.0
    assert found[1:] == pytest.approx(by_hand(radius, 7.26e8, 2.0 * 1.82e9)[1:], rel=1e-9)

"""Printed figures of A. Gabrielli, doctoral thesis, University of Ferrara, 2022: Tables 3, 13, 17, 18 and Eqs. 15-17.

Every tolerance is the one that an independent study of the equations found attainable; where a figure cannot be met
more closely, the test says why. Printed RMS values are not here: they were computed with an integrator at default
tolerances and are good to about 10 %.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.machine.bearing import from_catalogue, kinematics
from models.machine.hertz import (
    bearing_stiffness,
    contact_stiffness,
    l10h_life,
    mean_bearing_stiffness,
)
from models.machine.rig import Rig, contact_damping, natural_frequencies
from models.machine.scene import Defect, Scene
from models.solve.simulate import simulate

BEARING = from_catalogue("1205 ETN9")
RIG = Rig()
G = 9.80665


@pytest.mark.parametrize(("speed", "bpfo"), [(20.0, 97.8), (30.0, 146.7), (40.0, 195.6)])
def test_table_13_bpfo(speed: float, bpfo: float) -> None:
    assert round(kinematics(BEARING, speed).bpfo, 1) == bpfo


def test_table_18_contact_damping() -> None:
    # The printed damping ratios are rounded: alpha_c may lie within 153.8 and 155.8.
    alpha, beta = contact_damping(0.0622, 0.126, 400.0, 1500.0)
    assert alpha == pytest.approx(154.9, abs=0.5)
    assert beta == pytest.approx(2.5e-5, rel=5e-4)


@pytest.mark.parametrize(("load", "k_xx", "k_yy"), [(1000.0, 102.3e6, 152.3e6), (2000.0, 128.8e6, 192.2e6)])
def test_table_17_stiffness(load: float, k_xx: float, k_yy: float) -> None:
    stiffness = mean_bearing_stiffness(BEARING, load, RIG.k_c)
    assert stiffness[1, 1] == pytest.approx(k_xx, rel=5e-3)
    assert stiffness[0, 0] == pytest.approx(k_yy, rel=5e-3)


def test_stiffness_over_the_ball_period() -> None:
    # Section 4.4.1 gives 7.5 % across the load and less than 0.02 % along it.
    spacing = 2.0 * math.pi / 24
    matrices = np.array([bearing_stiffness(BEARING, 1000.0, RIG.k_c, cage_angle=spacing * i / 64) for i in range(64)])
    swing = np.ptp(matrices, axis=0) / np.mean(np.abs(matrices), axis=0)
    assert swing[1, 1] == pytest.approx(0.075, abs=2e-3)
    assert swing[0, 0] < 2e-4


def test_natural_frequencies() -> None:
    stiffness = mean_bearing_stiffness(BEARING, 2000.0, RIG.k_c)
    f = natural_frequencies(RIG, stiffness[1, 1], stiffness[0, 0])
    assert f[[1, 3, 5]] == pytest.approx([357.1, 1543.8, 7392.6], rel=6e-3)


@pytest.mark.parametrize(
    ("designation", "printed", "to_metres"),
    [("1205 ETN9", 5927e6, 1.0), ("6210", 426124.0, 1e3**1.5)],
)
def test_contact_stiffness_of_the_geometry(designation: str, printed: float, to_metres: float) -> None:
    """Within 3 %, and not closer: the printed figures take the inner race as concave (test_figures.py).

    Eq. 17 has a misprint besides (xi belongs inside the bracket) and E' is twice Eq. 3; with all mended the printed
    geometry gives 2.7 % (1205) and 2.4 % (6210) less than the printed stiffness.
    """
    assert contact_stiffness(from_catalogue(designation)) == pytest.approx(printed * to_metres, rel=0.03)


def test_contact_stiffness_of_the_roller_bearing() -> None:
    assert contact_stiffness(from_catalogue("NU 202 ECP")) / 1e3 ** (10.0 / 9.0) == pytest.approx(172549.0, rel=1e-5)


@pytest.mark.parametrize(("load", "days"), [(3000.0, 19.5), (4000.0, 8.2), (4700.0, 5.1), (5000.0, 4.2)])
def test_table_3_life(load: float, days: float) -> None:
    assert BEARING.dynamic_load_rating is not None
    assert round(l10h_life(BEARING.dynamic_load_rating, load, 40.0) / 86400.0, 1) == days


def test_static_displacement() -> None:
    from models.machine.hertz import element_angles, static_equilibrium

    for load, micrometres in ((1000.0, 9.81), (2000.0, 15.57), (4000.0, 24.7)):
        u = static_equilibrium(element_angles(BEARING), load, RIG.k_c)
        assert u[0] * 1e6 == pytest.approx(micrometres, rel=2e-3)


@pytest.mark.parametrize(
    ("extent", "depth", "load", "speed", "casing", "resonator"),
    [
        (20.0, 20e-6, 4000.0, 40.0, 2.130, 2.491),
        (2.362, 1e-3, 1000.0, 40.0, 0.803, None),
        (4.236, 1e-3, 2000.0, 30.0, 0.736, None),
        (6.366, 1e-3, 2000.0, 40.0, 1.612, None),
    ],
)
def test_rms_of_an_independent_prototype(
    extent: float, depth: float, load: float, speed: float, casing: float, resonator: float | None
) -> None:
    """Regression against converged runs of a prototype that shares nothing with this program, printed to 3 digits.

    0.2 %: the rounding of the print, the prototype's own step, and ours.
    """
    response = simulate(Scene(speed, load, defect=Defect(math.radians(extent), depth)))
    assert response.rms / G == pytest.approx(casing, rel=2e-3)
    if resonator is not None:
        assert response.levels_of("mr")[0] / G == pytest.approx(resonator, rel=2e-3)

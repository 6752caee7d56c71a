"""Mixed contact over a spall: limits, halves, numerical integration of the printed pressures, Hertz of a sphere."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import pytest

from models.machine.ball_statics import BallStatics
from models.machine.bearing import Bearing
from models.machine.hertz import point_contact_semi_axes, point_contact_stiffness
from models.machine.spall_contact import Spall, force_over_spall, share_in_rectangle

BALL = 12.7e-3
STATICS = BallStatics(
    Bearing("T", 11, BALL, 80e-3, inner_groove_radius=0.51 * BALL, outer_groove_radius=0.51 * BALL), 35e-6, 200e9
)
DEEP = 20e-6


def whole(deflection: float) -> float:
    return STATICS.races().k_o * max(deflection, 0.0) ** 1.5


def test_the_ellipse_has_factor_three_with_the_reduced_modulus() -> None:
    """Sphere on a plane: a^3 = 3 N R / (4 E*) and N = 4/3 E* sqrt(R) d^1.5, E* = E' / 2."""
    radius, force, modulus = 5e-3, 100.0, 2.0e11
    axes = point_contact_semi_axes(radius, radius, force, "elliptic", modulus=modulus)
    assert axes == pytest.approx([(3.0 * force * radius / (4.0 * 0.5 * modulus)) ** (1.0 / 3.0)] * 2, rel=1e-6)
    stiffness = point_contact_stiffness(radius, radius, "elliptic", modulus=modulus)
    assert stiffness == pytest.approx(4.0 / 3.0 * 0.5 * modulus * math.sqrt(radius), rel=1e-6)


@pytest.mark.parametrize("depth", [5e-6, 100e-6])
def test_all_over_the_spall_beside_it_and_half_over_it(depth: float) -> None:
    everywhere = Spall(depth, 3.0, 3.0)
    assert force_over_spall(STATICS, everywhere, DEEP, 0.0, 0.0) == pytest.approx(whole(DEEP - depth), abs=1e-9)
    assert force_over_spall(STATICS, everywhere, DEEP, 2.0, 0.0) == pytest.approx(whole(DEEP), rel=1e-12)
    mean = 0.5 * (whole(DEEP) + whole(DEEP - depth))
    for angle, contact_angle in ((1.5, 0.0), (-1.5, 0.3), (0.0, 1.5), (0.2, -1.5)):
        assert force_over_spall(STATICS, everywhere, DEEP, angle, contact_angle) == pytest.approx(mean, rel=1e-9)
    assert force_over_spall(STATICS, everywhere, DEEP, 1.5, 1.5) == pytest.approx(
        0.75 * whole(DEEP) + 0.25 * whole(DEEP - depth), rel=1e-9
    )


def test_a_ball_off_the_race_feels_nothing() -> None:
    assert force_over_spall(STATICS, Spall(1e-4, 0.1, 0.5), -1e-6, 0.0, 0.0) == 0.0


@pytest.mark.parametrize("race", ["outer", "inner"])
@pytest.mark.parametrize(("angle", "contact_angle"), [(0.0, 0.1), (0.01, -0.02), (-0.012, 0.2)])
def test_the_printed_pressures_integrate_to_the_force(
    angle: float, contact_angle: float, race: Literal["inner", "outer"]
) -> None:
    """Eqs. 16 and 18 by the midpoint rule on the ellipse of Eq. 17; the spall of Fig. 14 made narrow and shallow."""
    spall = Spall(5e-6, 0.02, 0.25, 0.003, 0.05)
    k = STATICS.races().k_o if race == "outer" else STATICS.races().k_i
    side = 1.0 if race == "outer" else -1.0
    radii = STATICS.conforming_radii[1 if race == "outer" else 0]
    race_radius, groove = 40e-3 + side * BALL / 2, 0.51 * BALL
    total = 0.0
    for depth, over in ((0.0, False), (spall.depth, True)):
        force = k * (DEEP - depth) ** 1.5
        a, b = point_contact_semi_axes(*radii, force, "elliptic", modulus=STATICS.effective_modulus)
        # Cells in both directions, in units of the semi-axes.
        cells = (np.arange(2000) + 0.5) / 1000.0 - 1.0
        u, v = np.meshgrid(cells, cells)
        pressure = 1.5 * force / math.pi * np.sqrt(np.maximum(0.0, 1.0 - u * u - v * v)) * 1e-6
        along = race_radius * (angle - spall.position) + b * u
        aside = groove * (contact_angle - spall.contact_angle) + a * v
        inside = (np.abs(along) < 0.5 * race_radius * spall.extent) & (np.abs(aside) < 0.5 * groove * spall.width)
        total += float(pressure[inside == over].sum())
    found = force_over_spall(STATICS, spall, DEEP, angle, contact_angle, race)
    assert found == pytest.approx(total, rel=2e-3)
    assert k * (DEEP - spall.depth) ** 1.5 < found < k * DEEP**1.5


def test_shares_add_up() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        x, y = (np.sort(rng.uniform(-1.3, 1.3, 3)) for _ in range(2))
        parts = [share_in_rectangle((x[i], x[i + 1]), (y[j], y[j + 1])) for i in range(2) for j in range(2)]
        assert min(parts) >= -1e-12
        assert sum(parts) == pytest.approx(share_in_rectangle((x[0], x[2]), (y[0], y[2])), abs=1e-12)
    assert share_in_rectangle((-2.0, 2.0), (-2.0, 2.0)) == pytest.approx(1.0)
    assert share_in_rectangle((0.8, 2.0), (0.8, 2.0)) == pytest.approx(0.0, abs=1e-12)
    # A cap of height h of the unit sphere has the volume pi h^2 (3 - h) / 3, and half of it is above the disc.
    assert share_in_rectangle((0.6, 2.0), (-2.0, 2.0)) == pytest.approx(0.25 * 0.4**2 * 2.6)


def test_the_force_grows_with_the_deflection() -> None:
    spall = Spall(10e-6, 0.02, 0.25)
    forces = [force_over_spall(STATICS, spall, float(d), 0.011, 0.1) for d in np.linspace(0.0, 40e-6, 400)]
    assert np.all(np.diff(forces) > 0.0)


@pytest.mark.parametrize("change", [{"depth": 0.0}, {"extent": -1.0}, {"width": math.nan}, {"position": math.inf}])
def test_unusable_spalls_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        Spall(**{"depth": 1e-4, "extent": 0.1, "width": 0.5, **change})

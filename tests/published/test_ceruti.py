"""Contact stiffness of the 6305 that Ceruti (master thesis, Torino 2021) prints in Tables 2.1 and 5.1.

Table 5.1: inner ring 32.1 mm, outer ring 54.67 mm, balls of 11.274 mm, race to sphere diameter 1.08, E = 2e5 MPa,
nu = 0.3. The thesis does not print K; it follows from its own formulas with these values, in exact elliptic Hertz:
K_i = 7.253e5, K_o = 7.881e5 and K = 2.6716e5 N/mm^1.5.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from models.bearing import catalogue
from models.hertz import contact_stiffness, point_contact_stiffness, relative_radii

PER_MILLIMETRE = 1e3**1.5
MODULUS = 200.0 / 210.0
"""hertz.py has 210 GPa; every stiffness is proportional to the modulus."""


def test_stiffness_of_the_6305_with_the_grooves_of_table_5_1() -> None:
    bearing = catalogue()["6305"]
    groove = 0.5 * 1.08 * bearing.element_diameter
    grooved = replace(bearing, inner_groove_radius=groove, outer_groove_radius=groove)
    inner, outer = (
        MODULUS * point_contact_stiffness(*radii, method="elliptic") / PER_MILLIMETRE
        for radii in relative_radii(grooved)
    )
    assert inner == pytest.approx(7.253e5, rel=1e-3)
    assert outer == pytest.approx(7.881e5, rel=1e-3)
    assert MODULUS * contact_stiffness(grooved, "elliptic") / PER_MILLIMETRE == pytest.approx(2.6716e5, rel=5e-4)


# Section 2.2: K = (L^0.8 / 3.84e-5)^(10/9) of one line contact, N and mm.
def test_palmgrens_line_contact_is_the_printed_one() -> None:
    bearing = catalogue()["NU 202 ECP"]
    assert bearing.effective_length is not None
    single = ((1e3 * bearing.effective_length) ** 0.8 / 3.84e-5) ** (10.0 / 9.0)
    both = single / 2.0 ** (10.0 / 9.0)
    assert contact_stiffness(bearing) / 1e3 ** (10.0 / 9.0) == pytest.approx(both, rel=2e-3)

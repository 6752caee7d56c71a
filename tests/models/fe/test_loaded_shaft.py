"""The inner ring on a loaded shaft: harmonics of a thin ring, and the conditions of contact with the shaft."""

import math

import numpy as np
import pytest

from models.errors import WrongInputError
from models.fe.assembled import AssembledBearing
from models.fe.extra import has_extra
from models.fe.law import ElementLaw
from models.fe.loaded_shaft import POINTS, BoreHarmonics, bore_harmonics, on_loaded_shaft
from models.fe.rings import RingInfluence
from tests.models.fe.test_ring_bodies import BENDING, RADIUS, RULE, THICKNESS, WIDTH, thin

COUNT = POINTS // 2 + 1


def bearing(bending: float = 3e-10) -> AssembledBearing:
    """Return a bearing whose inner ring bends with the second harmonic alone, m/N."""
    angle = np.linspace(0.0, math.pi, 49)
    ring = RingInfluence(angle, bending * np.cos(2.0 * angle), own=bending, support="sinusoidal")
    return AssembledBearing(ElementLaw.from_power(8e9, 1.5, 1.0, 1e5), 10, 0.0, ring)


def harmonics(bending: float = 3e-10) -> BoreHarmonics:
    """Return the compliances of that ring, thin, and of a shaft."""
    n, area = np.arange(COUNT), 8e-5
    ring = np.where(n == 2, bending * math.pi * area, 0.0)
    contact = ring + np.where(n == 1, 0.0, 2e-14 / np.maximum(n, 1))
    return BoreHarmonics(contact, -ring / (math.pi * area), -ring, area)


@pytest.mark.skipif(not has_extra(), reason="scikit-fem is not installed")
def test_a_thin_ring_yields_to_each_harmonic_as_theory_says(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("models.fe.loaded_shaft.COMPUTED_HARMONICS", 4)
    found = bore_harmonics(thin(), RULE)
    bore = RADIUS - 0.5 * THICKNESS
    for n in (2, 3, 4):
        expected = bore * WIDTH * RADIUS**3 / (BENDING * (n**2 - 1.0) ** 2)
        assert found.race[n] == pytest.approx(-expected, rel=0.03)
        # The shaft is much stiffer than the ring.
        assert found.contact[n] == pytest.approx(expected, rel=0.05)
    assert found.contact[1] == found.race[1] == found.element[1] == 0.0
    assert np.all(found.contact[2:] > 0.0)


@pytest.mark.parametrize("turn", [0.0, 0.2])
def test_the_shaft_carries_the_load_and_pulls_nowhere(turn: float):
    parts, load = harmonics(), 3000.0
    found = on_loaded_shaft(bearing(), parts, load, cage_angle=turn)
    assert found.converged
    carried = found.pressure * parts.area * 2.0 * math.pi / POINTS
    assert float(carried @ np.cos(found.angle)) == pytest.approx(load)
    assert float(carried @ np.sin(found.angle)) == pytest.approx(0.0, abs=1e-6 * load)
    assert np.all(found.pressure >= 0.0)
    assert np.all(found.pressure[np.cos(found.angle) < -0.5] == 0.0)
    loads, angles = found.distribution.loads, found.distribution.angles
    assert float(loads @ np.cos(angles)) == pytest.approx(load)
    assert float(loads @ np.sin(angles)) == pytest.approx(0.0, abs=1e-6 * load)


def test_a_ring_that_does_not_bend_takes_the_loads_of_its_own():
    free = bearing(0.0)
    found = on_loaded_shaft(free, harmonics(0.0), 3000.0)
    np.testing.assert_allclose(found.distribution.loads, free.state(3000.0).loads, rtol=1e-6)


def test_a_shaft_lets_a_ring_bend_less_than_a_pressure_that_is_given():
    # The bore parts from the shaft or follows it: elements share the load more like those on a rigid ring.
    load = 3000.0
    found = on_loaded_shaft(bearing(), harmonics(), load).distribution.loads
    rigid = AssembledBearing(bearing().law, 10).state(load).loads
    alone = bearing().state(load).loads
    assert abs(found[0] - rigid[0]) < abs(alone[0] - rigid[0])


def test_a_state_that_did_not_settle_says_so(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("models.fe.loaded_shaft._MAX_ROUNDS", 1)
    assert not on_loaded_shaft(bearing(), harmonics(), 3000.0).converged


def test_wrong_input_is_refused_by_name():
    held = AssembledBearing(bearing().law, 10)
    with pytest.raises(WrongInputError, match="support 'sinusoidal'"):
        on_loaded_shaft(held, harmonics(), 100.0)
    with pytest.raises(WrongInputError, match="load"):
        on_loaded_shaft(bearing(), harmonics(), 0.0)

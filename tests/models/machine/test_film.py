"""The short journal bearing's film against differences of the force that its theory gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from models.solve.ring_impact.hits import short_bearing_film


def force(place: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """The film's force on a journal that turns at one, with clearance and viscosity factor one.

    Reynolds' equation of a short bearing whose film cavitates over half the turn, in the frame that turns with the
    line of centres: the wedge 1/2 - phi' and the squeeze e' drive it.
    """
    e = float(np.hypot(*place))
    radial = place / e
    across = np.array([-radial[1], radial[0]])
    squeeze, whirl = float(velocity @ radial), float(velocity @ across) / e
    gap = 1.0 - e * e
    wedge = 1.0 - 2.0 * whirl
    inwards = e * e / gap**2 * wedge + math.pi * (1.0 + 2.0 * e * e) / (2.0 * gap**2.5) * squeeze
    along = math.pi * e / (4.0 * gap**1.5) * wedge + 2.0 * e / gap**2 * squeeze
    return -inwards * radial + along * across


@pytest.mark.parametrize("e", [0.1, 0.4, 0.7, 0.93, 0.999])
def test_stiffness_and_damping_are_slopes_of_the_force(e: float) -> None:
    place, still = np.array([e, 0.0]), np.zeros(2)
    load = -force(place, still)
    carried = float(np.hypot(*load))
    line, step = load / carried, 1e-6 * (1.0 - e)
    stiffness = -(force(place + step * line, still) - force(place - step * line, still)) @ line / (2.0 * step)
    damping = -(force(place, step * line) - force(place, -step * line)) @ line / (2.0 * step)
    film = short_bearing_film(300.0, 200.0, thickness=(1.0 - e) * 5e-5, clearance=5e-5)
    assert film.stiffness == pytest.approx(300.0 / 5e-5 * stiffness / carried, rel=1e-5)
    assert film.damping == pytest.approx(300.0 / (5e-5 * 200.0) * damping / carried, rel=1e-5)


def test_a_thinner_film_is_stiffer_and_damps_more() -> None:
    films = [short_bearing_film(300.0, 200.0, thickness=h, clearance=2e-5) for h in (5e-6, 1e-6, 2e-7)]
    assert [f.stiffness for f in films] == sorted(f.stiffness for f in films)
    assert [f.damping for f in films] == sorted(f.damping for f in films)


@pytest.mark.parametrize(
    ("load", "speed", "thickness", "word"),
    [(0.0, 1.0, 1e-6, "load"), (1.0, 0.0, 1e-6, "speed"), (1.0, 1.0, 2e-5, "film_thickness"), (1.0, 1.0, 0.0, "film_")],
)
def test_what_it_does_not_describe(load: float, speed: float, thickness: float, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        short_bearing_film(load, speed, thickness=thickness, clearance=2e-5)

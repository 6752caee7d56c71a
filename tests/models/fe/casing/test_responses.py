"""Frequency responses of a casing against direct solutions; reciprocity, static correction, MAC, damping."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from models.fe.casing.model import Point
from models.fe.casing.modes import CasingModes, Damping, first_modes, modal_responses
from models.gears.transfer.mode_sets import assurance
from tests.models.fe.casing.casings import box, plate

pytest.importorskip("skfem", reason="needs the extra fe")
POINTS = (Point("a", (0.1, 0.1, 0.0)), Point("b", (0.3, 0.2, 0.03)))
ALPHA, BETA = 40.0, 5e-7


@functools.cache
def plate_modes(count: int = 40) -> CasingModes:
    return first_modes(plate(4), count)


@functools.cache
def columns() -> dict[str, NDArray[np.float64]]:
    return {name: column for name, column in plate(4).columns(POINTS).items() if name.endswith("z")}


def rayleigh(modes: CasingModes) -> Damping:
    # Some modes have the same frequency.
    frequency = np.unique(np.round(modes.frequency, 4))
    ratio = 0.5 * (ALPHA / (math.tau * frequency) + BETA * math.tau * frequency)
    return Damping(tuple(frequency.tolist()), tuple(ratio.tolist()))


def direct(frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Displacements by solving K + i w C - w^2 M with C = alpha M + beta K: no modes."""
    k, m = plate(4).stiffness.toarray(), plate(4).mass.toarray()
    b = np.stack(list(columns().values()), axis=1)
    found = []
    for omega in math.tau * frequency:
        dynamic = k * (1.0 + 1j * omega * BETA) - m * (omega**2 - 1j * omega * ALPHA)
        found.append(b.T @ np.linalg.solve(dynamic, b))
    return np.array(found)


def error(modes: CasingModes, frequency: NDArray[np.float64], *, static: bool) -> float:
    found = modal_responses(plate(4), modes, rayleigh(modes), frequency, columns(), columns(), "m", static=static)
    expected = direct(frequency)
    return float(np.abs(found.h - expected).max() / np.abs(expected).max())


def test_responses_with_all_modes_are_those_of_the_direct_solution() -> None:
    """The damping leaves the modes as they are, so that both are exact."""
    frequency = np.array([300.0, float(plate_modes().frequency[0]), 3000.0, 20000.0])
    every = plate_modes(plate(4).unknowns)
    for static in (True, False):
        assert error(every, frequency, static=static) < 1e-7


def test_the_static_part_of_modes_left_out_takes_most_of_their_error() -> None:
    frequency = np.array([300.0, float(plate_modes().frequency[0]), 3000.0])
    corrected, truncated = (error(plate_modes(), frequency, static=static) for static in (True, False))
    assert corrected < 2e-4
    assert truncated > 20.0 * corrected


def test_forces_and_motions_can_change_places() -> None:
    casing = box()
    every = casing.columns([Point("top", (0.1, 0.16, 0.06))])
    found = modal_responses(
        casing, first_modes(casing, 6), Damping.constant(0.02), np.array([100.0, 900.0]), every, every
    )
    np.testing.assert_allclose(found.h, found.h.transpose(0, 2, 1), atol=1e-9 * np.abs(found.h).max())
    assert found.outputs[0] == "seat1.x"
    assert "top.y" in found.outputs
    # Power into the casing at a driving point is not negative: the velocity has no part against the force.
    velocity = found.in_unit("m/s").h
    assert (np.einsum("fii->fi", velocity).real >= -1e-15).all()


def test_units_are_rates_of_each_other() -> None:
    frequency = np.array([200.0, 700.0])
    of = {unit: modal_responses(plate(4), plate_modes(), Damping.constant(0.01), frequency, columns(), columns(), unit)
          for unit in ("m", "m/s", "m/s2")}  # fmt: skip
    for unit in ("m/s", "m/s2"):
        np.testing.assert_allclose(of["m"].in_unit(unit).h, of[unit].h, rtol=1e-12)


def test_modes_agree_with_themselves_and_are_told_apart() -> None:
    shapes = plate_modes().shapes
    found = assurance(shapes[:, :6], shapes[:, :6])
    np.testing.assert_allclose(np.diag(found), 1.0)
    assert found[~np.eye(6, dtype=bool)].max() < 0.2


def test_damping_is_linear_between_its_points_and_constant_beyond() -> None:
    damping = Damping((500.0, 1000.0), (0.08, 0.04))
    np.testing.assert_allclose(damping.at(np.array([100.0, 750.0, 2000.0])), [0.08, 0.06, 0.04])
    for frequency, ratio in (((2.0, 1.0), (0.1, 0.1)), ((1.0,), (0.1, 0.2)), ((1.0,), (1.0,)), ((), ())):
        with pytest.raises(ValueError, match="damping: "):
            Damping(frequency, ratio)

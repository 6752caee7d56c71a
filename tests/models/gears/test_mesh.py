"""Mesh stiffness as tables: look-up against a slow oracle, courses against their closed forms, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.gears.teeth.mesh import GearTableError, MeshStiffness

TEETH = (3, 5)
BASE = np.array([4.0, 6.0, 5.0, 3.0])


def slow(table: np.ndarray, turns: float) -> float:
    """Interpolate linearly among three copies of a period, as numpy does."""
    places = np.arange(-table.size, 2 * table.size) / table.size
    return float(np.interp(math.fmod(turns, 1.0), places, np.tile(table, 3)))


@settings(max_examples=40, deadline=None)
@given(driver=st.floats(-50.0, 50.0), driven=st.floats(-50.0, 50.0))
def test_stiffness_and_error_are_those_of_the_tables(driver, driven):
    rng = np.random.default_rng(5)
    tables = [rng.uniform(0.0, 0.4, 4 * z) for z in (3, 5, 3, 5)]
    k, e = MeshStiffness(*TEETH, BASE, *tables).at(driver, driven)
    expected = slow(BASE, math.fmod(driver, 1.0) * 3) - slow(tables[0], driver) - slow(tables[1], driven)
    assert k == pytest.approx(expected, abs=1e-9)
    assert e == pytest.approx(slow(tables[2], driver) + slow(tables[3], driven), abs=1e-9)


def test_a_loss_is_met_by_one_tooth_alone_and_the_stiffness_never_falls_below_zero():
    loss = np.zeros(12)
    loss[4:8] = 5.0
    mesh = MeshStiffness(*TEETH, BASE, driver_loss=loss)
    k, _ = mesh.at(np.arange(12) / 12, 0.0)
    np.testing.assert_allclose(k, [*BASE, 0.0, 1.0, 0.0, 0.0, *BASE], atol=1e-12)
    assert mesh.mean == pytest.approx(4.5 - 5.0 / 3.0)


def test_scaling_keeps_the_course():
    mesh = MeshStiffness(*TEETH, BASE, driven_loss=np.linspace(0.0, 1.0, 20))
    scaled = mesh.scaled_to(7e8)
    assert scaled.mean == pytest.approx(7e8)
    turns = np.linspace(0.0, 3.0, 50)
    np.testing.assert_allclose(scaled.at(turns, 0.6 * turns)[0] / 7e8, mesh.at(turns, 0.6 * turns)[0] / mesh.mean)


@settings(max_examples=30, deadline=None)
@given(ratio=st.floats(1.0, 3.0), share=st.floats(0.0, 0.9))
def test_a_rectangular_course_has_its_mean_and_its_two_levels_for_their_shares(ratio, share):
    base = MeshStiffness.rectangular(TEETH, 2.0, share, ratio).base
    assert base.mean() == pytest.approx(2.0)
    fraction = ratio % 1.0
    assert np.ptp(base) <= 2.0 * share * (1.0 + 1e-12)
    if 0.01 < fraction < 0.99:
        assert np.ptp(base) == pytest.approx(2.0 * share)
    assert base[0] == pytest.approx(2.0 * (1.0 + share * (min(1.0, 128 * fraction) - fraction)))


def test_harmonics_are_found_again():
    mesh = MeshStiffness.harmonic(TEETH, 10.0, [2.0, 1.0], [0.3, -1.0], samples=32)
    lines = 2.0 * np.fft.rfft(mesh.base) / 32
    assert lines[0].real / 2.0 == pytest.approx(10.0)
    np.testing.assert_allclose(lines[1:4], [2.0 * np.exp(-0.3j), np.exp(1.0j), 0.0], atol=1e-12)


def test_a_course_and_its_harmonics_as_text_agree():
    grid = np.arange(64) / 64
    rows = "\n".join(f"{p},{5e8 + 1e8 * math.cos(math.tau * p - 0.5)!r}" for p in grid)
    course = MeshStiffness.from_csv(TEETH, f"# measured\npitch,stiffness_newton_per_m\n{rows}\n", samples=64)
    orders = f"order,stiffness_newton_per_m,phase_deg\n0,5e8,0\n1,1e8,{math.degrees(0.5)}\n"
    np.testing.assert_allclose(course.base, MeshStiffness.from_csv(TEETH, orders, samples=64).base, rtol=1e-12)


def test_an_error_of_the_pitch_is_met_on_every_tooth():
    text = "pitch,stiffness_newton_per_m,error_um\n0,4,0\n0.5,2,10\n1,4,0\n"
    mesh = MeshStiffness.from_csv(TEETH, text)
    k, e = mesh.at((np.arange(3) + 0.25) / 3, 0.0)
    np.testing.assert_allclose(k, 3.0)
    np.testing.assert_allclose(e, 5e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "k.csv: expected a line of column names"),
        ("phase,k\n0,1\n", "k.csv, line 1: expected the columns pitch,stiffness_newton_per_m"),
        ("pitch,stiffness_newton_per_m\n", "k.csv: expected lines of numbers"),
        ("pitch,stiffness_newton_per_m\n0,1\n\n0.5,abc\n", "k.csv, line 4: expected 2 finite numbers, got '0.5,abc'"),
        ("pitch,stiffness_newton_per_m\n0,1\n0,2\n", "k.csv, line 3: expected pitch to ascend"),
        ("pitch,stiffness_newton_per_m\n0,1\n0.5,-2\n", "k.csv, line 3: expected a stiffness not below zero"),
        ("pitch,stiffness_newton_per_m\n0,1\n1,2\n", "k.csv, line 3: expected at pitch 1 what stands at pitch 0"),
        ("pitch,stiffness_newton_per_m\n0,0\n", "k.csv: expected a stiffness that is not zero"),
        ("order,stiffness_newton_per_m\n1,1\n", "got no order 0"),
        ("order,stiffness_newton_per_m\n0,1\n1,2\n", "got a least value of -1"),
        ("order,stiffness_newton_per_m\n0,1\n64,2\n", "k.csv, line 3: expected whole orders from 0 to below 64"),
    ],
)
def test_a_text_that_cannot_be_used_is_refused_with_its_line(text, message):
    with pytest.raises(GearTableError) as refused:
        MeshStiffness.from_csv(TEETH, text, "k.csv")
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"base": np.zeros(4)}, "base must not be negative"),
        ({"base": np.array([1.0, math.nan])}, "base must be finite, sample 1"),
        ({"driver_loss": np.zeros(5)}, r"driver_loss must have the shape \(12,\)"),
        ({"driven_error": np.zeros(12)}, r"driven_error must have the shape \(20,\)"),
        ({"driver_teeth": 0}, "driver_teeth must be a whole number"),
    ],
)
def test_a_table_that_cannot_be_is_refused_by_name(arguments, message):
    with pytest.raises(ValueError, match=message):
        MeshStiffness(**{"driver_teeth": 3, "driven_teeth": 5, "base": BASE, **arguments})

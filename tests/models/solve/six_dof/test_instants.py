"""Instants at which contacts change: found where they are, however short a contact or a gap, and kept to the order."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Scene
from models.solve.six_dof.kernels import instants as kernels
from models.solve.six_dof.kernels.period import Period, PeriodTrace, blank_trace, mean_square
from models.solve.six_dof.kernels.settled import fourier_coefficients
from models.solve.six_dof.kernels.step import P_CLEARANCE
from reference.periods import orbit_of, period_of, run
from tests.support.orders import OPENING, relative, slope

ONE_ROW = from_catalogue("6205")
LOADED = Scene(40.0, 4000.0, ONE_ROW)
RIG = Rig()
SLACK = replace(RIG, alpha_c=0.01 * RIG.alpha_c, beta_c=0.01 * RIG.beta_c)
CHATTERING = Scene(3.0, 10.0, rig=SLACK, defect=OPENING["pit"].defect, clearance=20e-6)


def run_on(period: Period, periods: int) -> tuple[NDArray[np.float64], PeriodTrace]:
    """Return the velocities after some periods from rest, (2, 3), and what the last one recorded."""
    state, trace = np.zeros((2, 6)), blank_trace(period)
    for _ in range(periods):
        state = run(period, state, trace)
    return state[:, 1::2], trace


def pressed(fold: int) -> Period:
    """Return a healthy period in which all balls stay in contact."""
    period = period_of(LOADED, 192, fold=fold)
    parameter = period.parameter.copy()
    parameter[P_CLEARANCE] = -2e-5
    return period._replace(parameter=parameter)


ORDERS = {
    "none": (pressed, 0, 0),
    "two": (lambda fold: period_of(LOADED, 192, fold=fold), 2, 2),
    "forty": (lambda fold: period_of(CHATTERING, 1024, fold=fold), 40, 50),
    "six, of rollers": (lambda fold: period_of(OPENING["rollers, pit"], 256, fold=fold), 6, 6),
}


@pytest.mark.parametrize("name", list(ORDERS))
def test_order_whatever_the_number_of_instants(name: str) -> None:
    made, least, most = ORDERS[name]
    exact, trace = run_on(made(32), 2)
    assert least <= int(trace.instants.sum()) <= most
    errors, levels, lines = [], [], []
    first_lines = fourier_coefficients(trace, made(32), 12)
    for fold in (1, 2, 4):
        found, coarse = run_on(made(fold), 2)
        assert coarse.instants.sum() == trace.instants.sum()
        errors.append(relative(found, exact))
        levels.append(abs(mean_square(coarse, 0) / mean_square(trace, 0) - 1.0))
        lines.append(float(np.abs(fourier_coefficients(coarse, made(fold), 12) - first_lines)[0, 1:].max()))
    for each in (errors, levels, lines):
        assert 3.5 < slope(each) < 6.0


@given(st.floats(0.0, 1.0), st.floats(-1.0, 1.0), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
def test_a_cubic_tells_its_first_crossing(q0: float, q1: float, r0: float, r1: float) -> None:
    t = np.linspace(0.0, 1.0, 4001)[1:]
    a, b = 3.0 * (q1 - q0) - 2.0 * r0 - r1, r0 + r1 - 2.0 * (q1 - q0)
    gap = q0 + t * (r0 + t * (a + t * b))
    margin = kernels.GRAZING * (abs(a) + abs(b))
    place, certain = kernels._crossing(q0, r0, q1, r1, False)
    assert certain
    below = np.flatnonzero(gap < 0.0)
    if q1 < 0.0 or gap.min() < -margin - 1e-6:
        assert 0.0 <= place <= 1.0
        # It may pass by extrema that do not leave the margin.
        assert place >= t[below[0]] - 1e-3
        assert gap[t < place - 1e-3].min(initial=0.0) >= -margin - 1e-6
        assert abs(q0 + place * (r0 + place * (a + place * b))) < 1e-6
    elif gap.min() > -margin + 1e-6:
        assert place == 2.0


def test_an_extremum_near_zero_is_looked_at() -> None:
    """A parabola whose lowest point, in its middle, is less off zero than the share of its bend that may be wrong."""
    bend = 4.0
    for off in (0.5 * kernels.GRAZING * bend, -0.5 * kernels.GRAZING * bend):
        place, certain = kernels._crossing(1.0 + off, -4.0, 1.0 + off, 4.0, True)
        assert not certain
        assert place == pytest.approx(0.5)
    assert kernels._crossing(1.2, -4.0, 1.2, 4.0, True) == (2.0, True)
    place, certain = kernels._crossing(0.75, -4.0, 0.75, 4.0, True)
    assert certain
    assert place == pytest.approx(0.25)


def test_instants_do_not_depend_on_the_grid() -> None:
    """The orbit over a pit, on grids of which none divides another."""
    counts, levels = [], []
    for steps in (257, 389, 601, 911):
        period, state = orbit_of(OPENING["pit"], steps)
        trace = blank_trace(period)
        run(period, state, trace)
        counts.append(int(trace.instants.sum()))
        levels.append(math.sqrt(mean_square(trace, 0)))
    assert len(set(counts)) == 1
    assert np.ptp(levels) < 1e-3 * levels[-1]

"""The inner ring on a meshed shaft: balance, reciprocity, a stiff shaft, and what parts."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from models.fe.bearings.assembly import AssembledBearing
from models.fe.bearings.bearing import analytic_law
from models.fe.bearings.ring_bodies import bore_load, influence_load, ring_influence
from models.fe.meshes.geometry import FeGeometry, fe_geometry
from models.fe.meshes.shaft_mesh import ShaftMeshRule
from models.fe.meshes.sizing import MeshRule
from models.fe.shafts.fit_contact import Fit
from models.fe.shafts.solid_shaft import FitRule, FittedState, SolidShaft
from models.machine.bearing import catalogue_entry

pytest.importorskip("skfem", reason="needs the extra fe")

COARSE = FitRule(
    angles=9,
    layers=2,
    ring=MeshRule(patch=1.6, size=1.6, growth=3.0, along=2, end=0.5, coarse=1.5),
    shaft=ShaftMeshRule(eighth=2, size=0.5, finest=0.5),
)


@functools.cache
def geometry() -> FeGeometry:
    """Return the NU 202 of the thesis."""
    return fe_geometry(catalogue_entry("NU 202 ECP"))


@functools.cache
def fitted() -> SolidShaft:
    """Return the inner ring on its shaft."""
    return SolidShaft(geometry(), COARSE)


@functools.cache
def bearing() -> AssembledBearing:
    """Return the bearing with the analytic law of its rollers and a rigid outer ring."""
    return AssembledBearing(analytic_law(geometry()), geometry().n_elements)


def solve(load: float = 1000.0, *, between: bool = False, fit: Fit = "touching") -> FittedState:
    """Return the state of the bearing on its shaft."""
    return fitted().solve(bearing(), load, between=between, fit=fit)


def test_forces_balance_and_nothing_pulls() -> None:
    for between in (False, True):
        state = solve(between=between)
        assert state.converged
        many = np.where((state.angles < 1e-9) | (state.angles > math.pi - 1e-9), 1.0, 2.0)
        assert float(many * np.cos(state.angles) @ state.loads) == pytest.approx(1000.0, rel=1e-8)
        assert state.pressure.min() >= -1e-9 * state.pressure.max()
        assert math.radians(60.0) < state.parted < math.radians(120.0)
        assert state.loads[-1] == 0.0
        assert state.displacement > 0.0


def test_shaft_that_holds_the_bore_pulls_and_is_stiffer_or_equal() -> None:
    touching, held = solve(), solve(fit="held")
    assert held.pressure.min() < 0.0
    assert held.converged
    assert held.loads.sum() == pytest.approx(touching.loads.sum(), rel=0.02)


def test_loads_grow_with_the_load_and_the_contact_is_receding() -> None:
    """Without clearance the touching zone would not depend on the load of a linear law; rollers nearly have one."""
    small, large = solve(100.0), solve(10000.0)
    assert small.parted == pytest.approx(large.parted, abs=math.pi / 8.0 + 1e-9)
    assert large.loads[0] > 50.0 * small.loads[0]


def test_matrices_are_reciprocal() -> None:
    problem = fitted()._problem(bearing(), 1000.0, between=True)
    assert problem.bodies == pytest.approx(problem.bodies.T, abs=1e-9 * np.abs(problem.bodies).max())
    back = 0.25 * problem.many * problem.elements_by_bore.T
    assert problem.bore_by_elements == pytest.approx(back, abs=1e-9 * np.abs(back).max())
    weighted = problem.many[:, None] * problem.elements
    assert weighted == pytest.approx(weighted.T, abs=1e-6 * np.abs(weighted).max())


def test_shares_on_shaft_are_those_of_rigid_rings_within_percents() -> None:
    rigid, state = bearing().state(1000.0), solve()
    loaded = state.loads > 0.0
    assert state.loads[loaded] == pytest.approx(rigid.loads[: len(state.loads)][loaded], rel=0.05)
    assert state.displacement == pytest.approx(float(rigid.displacement[0]), rel=0.3)


def test_exchanges_that_do_not_end_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("models.fe.shafts.fit_contact._EXCHANGES", 0)
    assert not solve().converged


def test_clearance_narrows_the_zone() -> None:
    state = fitted().solve(replace(bearing(), clearance=2e-5), 1000.0)
    assert state.converged
    assert np.count_nonzero(state.loads) < np.count_nonzero(solve().loads)


def test_given_pressure_is_that_of_the_assembled_bearing() -> None:
    """The sinusoidal pressure of ``models.fe.bearings.ring_bodies`` on the same mesh: another way to its numbers."""
    load = influence_load(geometry())
    own = ring_influence(geometry(), "inner", load, balanced=True, rule=COARSE.ring)
    bore = bore_load(geometry(), load, rule=COARSE.ring)
    expected = replace(bearing(), inner=own, bore_load=bore).state(1000.0)
    state = solve(fit="sinusoidal")
    assert state.converged
    assert state.loads == pytest.approx(expected.loads[: len(state.loads)], rel=0.01)
    assert state.displacement == pytest.approx(float(expected.displacement[0]), rel=0.01)
    assert state.bore_line == pytest.approx(expected.bore_line, rel=0.02)


def test_cut_bodies_leave_out_the_unloaded_half() -> None:
    state = SolidShaft(geometry(), COARSE, cut=True).solve(bearing(), 1000.0)
    assert state.converged
    assert len(state.angles) == 3
    assert state.loads[0] + 2.0 * float(np.cos(state.angles[1:]) @ state.loads[1:]) == pytest.approx(1000.0)

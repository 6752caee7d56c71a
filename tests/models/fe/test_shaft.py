"""A meshed shaft on its supports: against beams, a cantilever, statics, and a solve without condensation."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from models.fe.meshes.shaft_mesh import ShaftMeshRule, Step, shaft_mesh
from models.fe.shafts.shaft import PER_SEAT, ShaftModel, ShaftSeat, ShaftSupport, SteppedShaft, condense_shaft
from models.fe.shafts.spring import RadialSpring, bearing_spring, table_spring
from models.machine.bearing import from_catalogue
from models.machine.hertz import contact_stiffness
from models.machine.load_distribution import stiffness_against_load
from models.machine.shaft_beam import Shaft, element_matrices

pytest.importorskip("skfem", reason="needs the extra fe")

SPRING = RadialSpring((1e-6, 1e-5), (200.0, 200.0 * 10.0 ** (10.0 / 9.0)))
SLENDER = SteppedShaft(
    steps=(Step(0.35, 0.02), Step(0.25, 0.03)),
    loaded=ShaftSeat(0.0, 0.01),
    supports=(ShaftSupport(ShaftSeat(0.25, 0.254), SPRING), ShaftSupport(ShaftSeat(0.59, 0.594), SPRING)),
)
COARSE = ShaftMeshRule(eighth=1, size=2.0, finest=0.5)


def beam_end_shift(shaft: SteppedShaft, load: float, springs: list[float]) -> float:
    """Return the shift of the first end by Timoshenko beams on linear springs at the middles of the seats, m."""
    marks = {0.0, shaft.length, shaft.loaded.middle, *(support.seat.middle for support in shaft.supports)}
    marks |= {sum(step.length for step in shaft.steps[:i]) for i in range(len(shaft.steps))}
    places = sorted(marks)
    k = np.zeros((2 * len(places), 2 * len(places)))
    for i, (low, high) in enumerate(itertools.pairwise(places)):
        number = int(np.searchsorted(np.cumsum([step.length for step in shaft.steps]), 0.5 * (low + high)))
        step = shaft.steps[number]
        beam = Shaft(high - low, step.diameter, step.bore, 1, shaft.modulus, shaft.poisson)
        # Shift along x and turn about y of both ends.
        own = np.ix_([0, 4, 6, 10], [0, 4, 6, 10])
        k[2 * i : 2 * i + 4, 2 * i : 2 * i + 4] += element_matrices(beam)[0][own]
    for support, spring in zip(shaft.supports, springs, strict=True):
        at = 2 * places.index(support.seat.middle)
        k[at, at] += spring
    force = np.zeros(len(k))
    force[2 * places.index(shaft.loaded.middle)] = load
    return float(np.linalg.solve(k, force)[0])


@functools.cache
def slender() -> ShaftModel:
    """Return the model of the slender shaft, which several tests share."""
    return ShaftModel(SLENDER, COARSE)


def test_shaft_slender_beam() -> None:
    model = slender()
    for load in (50.0, 400.0):
        state = model.solve(load)
        secants = [abs(r / q) for r, q in zip(state.reactions, state.seats[:, 0], strict=True)]
        assert state.converged
        assert state.end == pytest.approx(beam_end_shift(SLENDER, load, secants), rel=0.02)


def test_shaft_reactions_statics() -> None:
    state = slender().solve(300.0)
    first, second = (support.seat.middle for support in SLENDER.supports)
    overhang = (first - SLENDER.loaded.middle) / (second - first)
    assert state.reactions == pytest.approx([300.0 * (1.0 + overhang), -300.0 * overhang], rel=1e-6)
    assert [SPRING.displacement_at(abs(r)) for r in state.reactions] == pytest.approx(
        np.abs(state.seats[:, 0]).tolist()
    )


def test_shaft_play_and_third_support() -> None:
    """Springs with play, and one support more than statics determines; its force is that of its spring."""
    loose = replace(SPRING, displacement=(1.1e-5, 2e-5), play=1e-5)
    supports = (
        ShaftSupport(ShaftSeat(0.25, 0.254), loose, 50.0),
        ShaftSupport(ShaftSeat(0.4, 0.404), SPRING),
        ShaftSupport(ShaftSeat(0.59, 0.594), loose),
    )
    state = ShaftModel(replace(SLENDER, supports=supports), COARSE).solve(300.0)
    assert state.converged
    places = np.array([support.seat.middle for support in supports])
    held = [s.spring.force(float(q))[0] for s, q in zip(supports, state.seats[:, 0], strict=True)]
    assert held == pytest.approx(state.reactions.tolist(), rel=1e-6)
    assert state.reactions.sum() == pytest.approx(300.0, rel=1e-6)
    moment = float(places @ state.reactions) - 50.0 * state.seats[0, 2]
    assert moment == pytest.approx(300.0 * SLENDER.loaded.middle, abs=1e-3)


def test_shaft_not_converged_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("models.fe.shafts.shaft._STEPS", 1)
    assert not slender().solve(300.0).converged


def test_shaft_cantilever() -> None:
    length, radius = 0.4, 0.01
    shaft = SteppedShaft(
        (Step(length + 0.02, 2.0 * radius),),
        ShaftSeat(0.0, 0.01),
        (ShaftSupport(ShaftSeat(length, length + 0.02), SPRING, 1.0),),
    )
    second, arm = math.pi * radius**4 / 4.0, length - 0.005
    bent = arm**2 * (3.0 * length - arm) / (6.0 * 210e9 * second)
    sheared = arm / (6.0 / 7.0 * 80.8e9 * math.pi * radius**2)
    found = condense_shaft(shaft, COARSE)
    assert found.observed_flexibility[0] == pytest.approx(bent + sheared, rel=0.015)
    assert found.volume == pytest.approx(math.pi * radius**2 * (length + 0.02), rel=2e-3)


def test_shaft_condensed_rigid() -> None:
    """Rigid motions of all seats together cost nothing and carry the observed surfaces with them."""
    found = slender().condensed
    places = np.array([support.seat.middle for support in SLENDER.supports])
    shift, turn = np.zeros(len(found.stiffness)), np.zeros(len(found.stiffness))
    shift[::PER_SEAT] = 1.0
    turn[::PER_SEAT], turn[2::PER_SEAT] = -places, 1.0
    size = np.abs(found.stiffness).max()
    assert found.stiffness @ shift == pytest.approx(np.zeros(len(shift)), abs=1e-7 * size)
    assert found.stiffness @ turn == pytest.approx(np.zeros(len(shift)), abs=1e-7 * size)
    assert found.observed_motion @ shift == pytest.approx([1.0, 1.0])
    assert found.observed_motion @ turn == pytest.approx([0.0, -SLENDER.loaded.middle], abs=1e-6)
    assert found.carried @ shift == pytest.approx(1.0)


def test_shaft_last_end() -> None:
    turned = replace(
        SLENDER,
        steps=SLENDER.steps[::-1],
        loaded=ShaftSeat(0.59, 0.6),
        supports=tuple(ShaftSupport(ShaftSeat(0.6 - s.seat.end, 0.6 - s.seat.begin), SPRING) for s in SLENDER.supports),
    )
    assert turned.loaded_end == "last"
    there, here = ShaftModel(turned, COARSE).solve(100.0), slender().solve(100.0)
    assert there.stiffness == pytest.approx(here.stiffness, rel=1e-6)
    assert there.seat_stiffness == pytest.approx(here.seat_stiffness, rel=1e-6)


@pytest.mark.parametrize("order", [1, 2])
def test_shaft_mesh_volume(order: int) -> None:
    import skfem  # type: ignore[import-untyped]

    steps = (Step(0.02, 0.025, 0.004), Step(0.03, 0.05), Step(0.01, 0.03))
    mesh = shaft_mesh(steps, {"seat": (0.02, 0.05)}, ShaftMeshRule(eighth=2, order=order))
    basis = skfem.Basis(mesh, mesh.elem(), intorder=4)
    exact = sum(math.pi / 8.0 * step.length * (step.diameter**2 - step.bore**2) for step in steps)
    assert float(basis.dx.min()) > 0.0
    assert float(basis.dx.sum()) == pytest.approx(exact, rel=0.03 if order == 1 else 1e-4)
    seat = skfem.FacetBasis(mesh, mesh.elem(), facets=mesh.boundaries["seat"], intorder=4)
    assert float(seat.dx.sum()) == pytest.approx(math.pi * 0.025 * 0.03, rel=0.01)


def test_shaft_refusals() -> None:
    with pytest.raises(ValueError, match=r"two supports, or one that withstands tilting"):
        replace(SLENDER, supports=SLENDER.supports[:1])
    with pytest.raises(ValueError, match=r"seat 'support0' from 0.34 to 0.36 m must lie on one step"):
        condense_shaft(
            replace(SLENDER, supports=(ShaftSupport(ShaftSeat(0.34, 0.36), SPRING), SLENDER.supports[1])), COARSE
        )
    with pytest.raises(ValueError, match="overlap"):
        condense_shaft(replace(SLENDER, loaded=ShaftSeat(0.25, 0.26)), COARSE)
    with pytest.raises(ValueError, match="steps 1 and 2 of the shaft do not touch"):
        shaft_mesh((Step(0.1, 0.02), Step(0.1, 0.05, 0.03)), {})
    with pytest.raises(ValueError, match="load must be positive"):
        slender().solve(0.0)


def test_spring_bearing() -> None:
    bearing = from_catalogue("6210")
    k_c = contact_stiffness(bearing)
    for clearance in (0.0, 1e-5):
        spring = bearing_spring(bearing, k_c, clearance)
        u, stiffness = stiffness_against_load(bearing, [3000.0], k_c, clearance=clearance)
        assert spring.displacement_at(3000.0) == pytest.approx(u[0], rel=5e-3)
        assert spring.force(float(u[0]))[1] == pytest.approx(stiffness[0, 0, 0], rel=0.03)
        assert spring.force(-float(u[0]))[0] == -spring.force(float(u[0]))[0]
    assert bearing_spring(bearing, k_c, 1e-5).force(9e-6) == (0.0, 0.0)


def test_spring_table() -> None:
    spring = table_spring([100.0, 1000.0, 5000.0], [1e-6, 8e-6, 3e-5])
    assert [spring.displacement_at(f) for f in (100.0, 1000.0, 5000.0)] == pytest.approx([1e-6, 8e-6, 3e-5])
    step = 1e-12
    slope = (spring.force(5e-6 + step)[0] - spring.force(5e-6 - step)[0]) / (2.0 * step)
    assert spring.force(5e-6)[1] == pytest.approx(slope, rel=1e-5)
    with pytest.raises(ValueError, match=r"spring.displacement needs two ascending"):
        table_spring([100.0, 1000.0], [1e-6, 1e-6])

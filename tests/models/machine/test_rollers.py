"""Rollers: the line contact's exponent of 10/9 in statics, motion and maps, against an independent integration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import Bearing, CatalogueEntry, catalogue_entry, from_catalogue, kinematics
from models.machine.contact_estimates import element_mass, estimate_stiffness
from models.machine.hertz import contact_stiffness
from models.machine.rig import Rig
from models.machine.scene import Defect, Part, Scene
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.step import P_U_1, P_U_2
from models.solve.six_dof.lanes import simulate_lanes
from models.solve.six_dof.setup import contact_power, operating_point
from models.solve.six_dof.time_domain import simulate_time
from reference.signals import recorded
from tests.oracles import six_dof_oracle as oracle
from tests.support.effort import effort_count

EXPONENT = 10.0 / 9.0
K_C = 1.2e9
SPALL = Defect(math.radians(20.0), 20e-6)
# The oracle's geometry, with rollers instead of its balls.
BARREL = replace(from_catalogue("1205 ETN9"), designation="barrel", element="roller", effective_length=8e-3)
SCENE = Scene(40.0, 4000.0, BARREL, Rig(k_c=K_C, element="roller"), SPALL)
CYLINDERS = from_catalogue("NU 202 ECP")


class RollerOracle(oracle.Oracle):
    """The oracle with another contact law: force and damping with the exponents 10/9 and 1/9."""

    k_c, exponent = K_C, EXPONENT


def settled_oracle(model: RollerOracle, periods: int, rtol: float) -> float:
    """Return the RMS of the casing along the load in the last of some periods from rest, m/s2."""
    state = model.at_rest()
    for _ in range(periods - 2):
        state, _, _ = model.period(state, 1e-6)
    state, _, _ = model.period(state, rtol)
    _, time, acceleration = model.period(state, rtol, 3000)
    return math.sqrt(float(np.trapezoid(acceleration**2, time) / (time[-1] - time[0])))


@pytest.mark.parametrize(
    "scene", [SCENE, replace(SCENE, speed=25.0, load=1500.0, defect=Defect(0.3, 8e-6))][: effort_count(quick=1, full=2)]
)
def test_against_the_oracle(scene: Scene) -> None:
    defect = scene.defect
    assert defect is not None
    case = oracle.Case(scene.speed, scene.load, defect.dphi_d, defect.h_d)
    truth = settled_oracle(RollerOracle(case), effort_count(quick=10, full=30), 10.0 ** -effort_count(quick=6, full=9))
    found = simulate(scene, accuracy=2e-4)
    assert found.status == "converged"
    assert found.rms == pytest.approx(truth, rel=3e-3)


def test_the_static_equilibrium_is_that_of_line_contacts() -> None:
    model = RollerOracle(oracle.Case(40.0, 4000.0))
    rest = model.at_rest()
    parameter = operating_point(replace(SCENE, defect=None)).parameter
    assert parameter[P_U_1] == pytest.approx(rest[1] - rest[3], rel=1e-8)
    assert parameter[P_U_2] == pytest.approx(rest[0] - rest[2], abs=1e-12)


def test_the_time_domain_has_the_same_contacts() -> None:
    found, over_time = simulate(SCENE), simulate_time(SCENE, 0.4, 51200.0, step=5e-6)
    assert over_time.status == "converged"
    assert over_time.rms == pytest.approx(found.rms, rel=3e-3)
    inner = simulate_time(replace(SCENE, defect=replace(SPALL, part="inner")), 0.2, 25600.0)
    assert inner.status in ("not_periodic", "inaccurate")
    assert not inner.repeats
    assert inner.rms > 0.1 * found.rms


def test_rollers_are_no_balls() -> None:
    """The same stiffness in newtons per metre at the static approach, another exponent: another level."""
    balls = Scene(40.0, 4000.0, defect=SPALL)
    approach = float(operating_point(replace(balls, defect=None)).parameter[P_U_1])
    k_c = balls.rig_as(Rig).k_c * approach ** (1.5 - EXPONENT)
    rollers = replace(SCENE, rig=Rig(k_c=k_c, element="roller"))
    level, ball_level = simulate(rollers).rms, simulate(balls).rms
    assert level != pytest.approx(ball_level, rel=0.02)
    assert 0.3 < level / ball_level < 3.0
    assert contact_power(BARREL) == pytest.approx(1.0 / 9.0)
    assert contact_power(balls.bearing) == 0.5


@pytest.mark.parametrize("defect", [None, SPALL, Defect(math.radians(8.0), math.inf)])
def test_a_cylindrical_bearing_is_simulated(defect: Defect | None) -> None:
    rig = Rig(k_c=contact_stiffness(CYLINDERS), element="roller")
    found = simulate(Scene(30.0, 2000.0, CYLINDERS, rig, defect))
    assert found.status == "converged"
    assert found.bpfo == pytest.approx(kinematics(CYLINDERS, 30.0).bpfo)
    assert found.rms > 0.0


NEEDLE = Bearing("needle", 16, 2.5e-3, 22.5e-3, element="roller", effective_length=9.8e-3)
ENTRIES = {
    "needle": CatalogueEntry(NEEDLE, {}, ((16, 1.0),)),
    **{name: catalogue_entry(name) for name in ("22207", "30205", "NU205", "MFPT")},
}


@pytest.mark.parametrize("name", list(ENTRIES)[: effort_count(quick=3, full=5)])
def test_cylindrical_needle_tapered_and_spherical_rollers_over_time(name: str) -> None:
    """Each part of each kind is damaged: louder than the healthy bearing, with a line of the part's own rate."""
    found = estimate_stiffness(ENTRIES[name])
    bearing, rig = ENTRIES[name].bearing, Rig(k_c=found.value, m_b=element_mass(found.bearing), element="roller")
    healthy = simulate_time(Scene(30.0, 2000.0, bearing, rig), 0.1, 25600.0, settle=0.1)
    lines = kinematics(bearing, 30.0)
    rates: dict[Part, float] = {"outer": lines.bpfo, "inner": lines.bpfi, "ball": 2.0 * lines.bsf}
    for part, rate in rates.items():
        # Deeper than any element sinks, and as wide for an element as for a race.
        defect = Defect(0.04 if part != "ball" else 0.3, 1e-3, part=part)
        damaged = simulate_time(Scene(30.0, 2000.0, bearing, rig, defect), 0.4, 25600.0)
        assert damaged.status in ("converged", "not_periodic", "inaccurate")
        # Four turns of the cage are few for a mean.
        assert damaged.rms_error - damaged.averaging_error < 0.02
        assert damaged.averaging_error < 0.3
        assert damaged.rms > 3.0 * healthy.rms
        envelope = np.abs(recorded(damaged)[0])
        spectrum = np.abs(np.fft.rfft(envelope - envelope.mean()))
        at = round(rate * 0.4)
        assert spectrum[at - 1 : at + 2].max() > 3.0 * np.median(spectrum[2 : 5 * at]), (part, rate)


def test_lanes_refuse_rollers_by_name() -> None:
    with pytest.raises(ValueError, match=r"^roller: "):
        simulate_lanes([SCENE])

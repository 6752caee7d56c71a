"""Order of convergence of each kernel: the error falls with the fourth power of the step where nothing is rough.

Healthy races and gentle waves, under loads that press all balls of the loaded zone; and pits, over which contacts open.
Slopes are fitted to the logarithms of error and step.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import Bearing, from_catalogue
from models.machine.scene import Defect, Scene, Waviness
from models.solve.angular.rig import AngularRig
from models.solve.angular.solver import trace
from models.solve.simulate import simulate
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.period import blank_trace
from models.solve.six_dof.kernels.step import STATUS_OK
from models.solve.six_dof.lanes import LaneOptions, simulate_lanes
from models.solve.six_dof.time_domain import prepare_plan
from reference.periods import period_of, run
from tests.support.orders import HEALTHY, OPENING, PIT, relative, slope

WAVY = {
    "healthy": HEALTHY,
    "13 waves": replace(HEALTHY, waviness=(Waviness(1e-6, 13),)),
    "5 waves, 8 kN": Scene(40.0, 8000.0, waviness=(Waviness(2e-6, 5, phase=0.3),)),
    "9 waves, 6205": replace(HEALTHY, bearing=from_catalogue("6205"), waviness=(Waviness(2e-6, 9, phase=0.3),)),
    "gravity across": replace(HEALTHY, gravity=50.0, gravity_angle=0.5 * math.pi, waviness=(Waviness(1e-6, 13),)),
}
REFINED = (1, 2, 4)
FINE = 32


@pytest.mark.parametrize("name", list(WAVY))
def test_order_of_the_ball_period(name: str) -> None:
    """The waveform of the fourth period from rest, at the instants that all grids have."""

    def waveform(fold: int) -> NDArray[np.float64]:
        period = period_of(WAVY[name], 96, fold=fold)
        assert len(period.first) == 2
        state, trace = np.zeros((2, 6)), blank_trace(period)
        for _ in range(4):
            state = run(period, state, trace)
        return trace.wave[::fold]

    exact = waveform(FINE)
    for sensor in (0, 1):
        errors = [relative(waveform(fold)[:, sensor], exact[:, sensor]) for fold in REFINED]
        assert 3.5 < slope(errors) < 5.5
        assert errors[-1] < 1e-3


@pytest.mark.parametrize("name", ["healthy", "13 waves"])
def test_order_of_the_settled_level(name: str) -> None:
    """The RMS that is answered with, quadrature and search included."""
    exact = simulate(WAVY[name], steps_per_period=4096, tolerance=1e-11).rms
    steps = (96, 192, 384)
    errors = [abs(simulate(WAVY[name], steps_per_period=n, tolerance=1e-11).rms / exact - 1.0) for n in steps]
    assert 3.5 < slope(errors) < 5.5


def test_order_over_kinks_that_steps_end_on() -> None:
    scene = replace(HEALTHY, defect=Defect(math.radians(20.0), 20e-6))
    exact = simulate(scene, steps_per_period=8192, tolerance=1e-11).rms
    errors = [abs(simulate(scene, steps_per_period=n, tolerance=1e-11).rms / exact - 1.0) for n in (512, 1024, 2048)]
    assert 3.3 < slope(errors) < 5.5


@pytest.mark.parametrize(
    "scene",
    [
        WAVY["13 waves"],
        replace(HEALTHY, waviness=(Waviness(5e-7, 7, phase=0.3), Waviness(3e-7, 4, "inner"))),
        replace(HEALTHY, unbalance=2e-3, gravity=9.81, gravity_angle=1.0),
    ],
)
def test_order_of_the_time_domain(scene: Scene) -> None:
    """The waveform of 20 ms from rest."""
    coarse, samples = 1.0 / 19200.0, 384

    def waveform(fold: int) -> NDArray[np.float64]:
        wave = np.empty((fold * samples, 2))
        plan = prepare_plan(scene, fold * samples * (coarse / fold))
        assert kernels.run(np.zeros((2, 6)), wave, coarse / fold, plan) == STATUS_OK
        return wave[::fold]

    exact = waveform(FINE)
    for sensor in (0, 1):
        errors = [relative(waveform(fold)[:, sensor], exact[:, sensor]) for fold in REFINED]
        assert 3.5 < slope(errors) < 5.5


@pytest.mark.parametrize(("name", "most"), [("pit", 2e-6), ("rollers, pit", 2e-6)])
def test_order_of_the_ball_period_where_contacts_open(name: str, most: float) -> None:
    """The velocities after four periods from rest."""

    def end(fold: int) -> NDArray[np.float64]:
        period = period_of(OPENING[name], 128, fold=fold)
        state, trace = np.zeros((2, 6)), blank_trace(period)
        for _ in range(4):
            state = run(period, state, trace)
        return state[:, 1::2]

    exact = end(128)
    errors = [relative(end(fold), exact) for fold in (1, 2, 4, 8, 16)]
    assert 3.2 < slope(errors) < 5.0
    assert errors[-1] < most


@pytest.mark.parametrize(("name", "most"), [("pit", 2e-6), ("rollers, pit", 2e-5)])
def test_order_of_the_time_domain_where_contacts_open(name: str, most: float) -> None:
    """The waveform of the resonator in 20 ms from rest."""
    coarse, samples = 1.0 / 19200.0, 384

    def waveform(fold: int) -> NDArray[np.float64]:
        wave = np.empty((fold * samples, 2))
        plan = prepare_plan(OPENING[name], fold * samples * (coarse / fold))
        assert kernels.run(np.zeros((2, 6)), wave, coarse / fold, plan) == STATUS_OK
        return wave[::fold, 1]

    exact = waveform(64)
    errors = [relative(waveform(fold), exact) for fold in (1, 2, 4, 8, 16)]
    assert 3.2 < slope(errors) < 5.0
    assert errors[-1] < most


def test_order_of_the_lanes_without_instants() -> None:
    """Steps then end neither on kinks nor where contacts open: the order is one, from a small error on."""
    scenes = [replace(HEALTHY, defect=PIT), OPENING["spall"]]
    options = LaneOptions(tolerance=1e-7, instants=False)
    levels = np.array(
        [simulate_lanes(scenes, replace(options, steps_per_period=n)).rms for n in (256, 512, 1024, 4096)]
    )
    for k, (low, high, most) in enumerate(((1.0, 4.0, 2e-5), (0.3, 2.5, 2e-4))):
        errors = np.abs(levels[:-1, k] / levels[-1, k] - 1.0).tolist()
        assert low < slope(errors) < high
        assert errors[-1] < most


@pytest.mark.parametrize("scene", [HEALTHY, Scene(20.0, 1000.0), replace(HEALTHY, defect=PIT), OPENING["spall"]])
def test_order_of_the_lanes(scene: Scene) -> None:
    """RMS and lines of the settled motion; lanes model no waves, so that the balls' passages alone drive it."""
    steps = (128, 256, 512) if scene.speed < 30.0 else (64, 128, 256)
    found, exact = (
        [simulate_lanes([scene], LaneOptions(steps_per_period=n, tolerance=1e-9, instants=True)) for n in counts]
        for counts in (steps, (2048,))
    )
    truth = exact[0]
    levels = [abs(float(f.rms[0] / truth.rms[0]) - 1.0) for f in found]
    lines = [float(np.abs(f.harmonics - truth.harmonics).max() / truth.rms[0]) for f in found]
    assert 3.5 < slope(levels) < 6.0
    assert 3.5 < slope(lines) < 6.0


@pytest.mark.parametrize("defect", [None, Defect(math.radians(7.0), 100e-6, width=math.radians(30.0), support="a")])
def test_order_of_the_angle(defect: Defect | None) -> None:
    """The angular speed of a shaft on two ball bearings in half a turn, at the angles that all steps have."""
    bearing = Bearing("", 11, 12.7e-3, 80e-3)
    right = replace(bearing, n_elements=10)
    scene = Scene(100.0, 600.0, bearing, AngularRig(), defect, second_bearing=right, axial_load=200.0, unbalance=1e-4)
    step = 8e-6 * 2.0 * math.pi * scene.speed

    def speed(fold: int) -> NDArray[np.float64]:
        return trace(scene, 0.5, step / fold).ias[::fold]

    exact = speed(16)
    shared = np.arange(600)
    errors = [relative(speed(fold)[shared], exact[shared]) for fold in REFINED]
    assert slope(errors) > 3.5
    assert errors[0] < 1e-2

"""Gravity, waves and pits of the outer race, sensor direction and any row in the periodic solver, by the time domain.

Both share the step and nothing else: positions, paths, steps, quadrature and search are the periodic solver's own. Its
error is estimated, that of the time domain found by halving its step.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Waviness
from models.solve.simulate import simulate
from models.solve.six_dof.time_domain import simulate_time
from tests.support.effort import effort_count

SPALL = Defect(math.radians(20.0), 20e-6)
SCENE = Scene(40.0, 4000.0, defect=SPALL)
QUARTER = 0.5 * math.pi
STEPS = (5e-6, 2.5e-6) if effort_count(quick=1, full=0) else (2.5e-6, 1.25e-6)

SCENES: dict[str, tuple[Scene, float]] = {
    "gravity along the load": (replace(SCENE, gravity=9.81), 0.0),
    "gravity across it": (replace(SCENE, gravity=9.81, gravity_angle=QUARTER), 0.0),
    "ten times gravity across it, light": (replace(SCENE, load=500.0, gravity=98.1, gravity_angle=QUARTER), 0.0),
    "gravity, clearance": (replace(SCENE, gravity=9.81, gravity_angle=1.0, clearance=5e-6), 0.0),
    "waves": (replace(SCENE, defect=None, waviness=(Waviness(1e-6, 13),)), 0.0),
    "waves of several orders": (
        replace(SCENE, defect=None, waviness=(Waviness(5e-7, 2, phase=0.4), Waviness(3e-7, 24), Waviness(2e-7, 7))),
        0.0,
    ),
    "waves and a spall": (replace(SCENE, waviness=(Waviness(1e-6, 13, phase=0.3),)), 0.0),
    "waves and a rough spall of both rows": (
        replace(SCENE, defect=replace(SPALL, floor=Floor("rough", seed=3), rows=2), waviness=(Waviness(5e-7, 5),)),
        0.0,
    ),
    "sensor across": (SCENE, QUARTER),
    "sensor between": (replace(SCENE, gravity=9.81, gravity_angle=0.7), 0.6),
    "the second row": (replace(SCENE, defect=replace(SPALL, first_row=1)), 0.0),
    "the second row, off the load": (replace(SCENE, defect=replace(SPALL, first_row=1, position=0.3)), 0.4),
    "three pits in two rows, two of them rough": (
        replace(
            SCENE,
            defect=Defect(math.radians(8.0), 20e-6, Floor("rough", seed=3), position=-0.2),
            more_defects=(
                Defect(math.radians(5.0), 10e-6, position=0.1, rows=2),
                Defect(math.radians(9.0), 15e-6, Floor("rough", seed=8), position=0.5, first_row=1),
            ),
        ),
        0.0,
    ),
    "one row of balls": (
        replace(SCENE, bearing=from_catalogue("6205"), waviness=(Waviness(1e-6, 9),), gravity=9.81),
        0.0,
    ),
}


@pytest.mark.parametrize("name", list(SCENES))
def test_it_is_what_the_time_domain_comes_to(name: str) -> None:
    scene, direction = SCENES[name]
    found = simulate(scene, direction=direction, accuracy=2e-4)
    assert found.status == "converged"
    unit = (math.cos(direction), math.sin(direction))
    coarse, fine = (
        simulate_time(scene, 40.0 / found.bpfo, 51200.0, settle=0.25, direction=unit, step=step) for step in STEPS
    )
    for ours, rough, truth in (
        (found.rms, coarse.rms, fine.rms),
        tuple(answer.levels_of("mr")[0] for answer in (found, coarse, fine)),
    ):
        # Its own estimate (three times, as of all that is called converged), and what halving the step changes.
        assert ours == pytest.approx(truth, abs=3.0 * found.rms_error * ours + 2.0 * abs(rough - truth) + 3e-4 * truth)
    assert found.peak == pytest.approx(fine.peak, rel=2e-2)


@pytest.mark.parametrize("name", ["waves and a spall", "the second row, off the load", "gravity across it"])
def test_its_waveform_is_that_of_the_time_domain(name: str) -> None:
    scene, direction = SCENES[name]
    found = simulate(scene, direction=direction, steps_per_period=4096, tolerance=1e-8)
    unit = (math.cos(direction), math.sin(direction))
    signal = simulate_time(scene, 0.1, 51200.0, settle=0.25, direction=unit, step=1.25e-6).acceleration(51200.0, 0.1)
    expected = found.acceleration(51200.0, 0.1, 2.0 * math.pi * math.fmod(0.25 * found.bpfo, 1.0))
    difference = np.abs(np.fft.rfft(signal - expected)[: round(0.1 * 10e3)]) / len(expected)
    assert np.sqrt(2.0 * np.sum(difference**2)) < 5e-3 * found.rms


def test_gravity_along_the_load_is_more_load() -> None:
    weight = 100.0 * (SCENE.rig_as(Rig).m_o + SCENE.rig_as(Rig).m_r)
    heavy, loaded = simulate(replace(SCENE, gravity=100.0)), simulate(replace(SCENE, load=SCENE.load + weight))
    assert heavy.rms == pytest.approx(loaded.rms, rel=1e-9)
    assert heavy.coefficients == pytest.approx(loaded.coefficients, abs=1e-7 * loaded.rms)
    turned = simulate(replace(SCENE, gravity=100.0, gravity_angle=2.0 * math.pi))
    assert turned.rms == pytest.approx(heavy.rms, rel=1e-6)


def test_gravity_alone_loads_the_bearing() -> None:
    """Without a load the whole scene turns with gravity: the same level in gravity's own direction."""
    alone = replace(SCENE, load=0.0, gravity=100.0, defect=None, waviness=(Waviness(1e-6, 12),))
    down = simulate(alone, accuracy=1e-5)
    assert down.status == "converged"
    pitch = 2.0 * math.pi / SCENE.bearing.n_elements
    turned = replace(alone, gravity_angle=pitch, waviness=(Waviness(1e-6, 12, phase=-12.0 * pitch),))
    assert simulate(turned, direction=pitch, accuracy=1e-5).rms == pytest.approx(down.rms, rel=1e-4)


def test_a_sensor_sees_the_projection() -> None:
    along, across, between, behind = (
        simulate(SCENE, direction=d, steps_per_period=512) for d in (0.0, QUARTER, 0.6, math.pi)
    )
    c, s = math.cos(0.6), math.sin(0.6)
    scale = along.rms
    expected = c * along.coefficients + s * across.coefficients
    assert between.coefficients == pytest.approx(expected, abs=1e-4 * scale)
    assert behind.coefficients == pytest.approx(-along.coefficients, abs=1e-4 * scale)
    assert across.rms != pytest.approx(along.rms, rel=0.1)


def test_the_rows_are_alike_half_a_pitch_apart() -> None:
    """The second row is the first with a lag: the same level, the odd lines turned by half a turn."""
    first, second = (
        simulate(replace(SCENE, defect=replace(SPALL, first_row=r)), steps_per_period=1024, tolerance=1e-9)
        for r in (0, 1)
    )
    assert second.rms == pytest.approx(first.rms, rel=1e-4)
    sign = (-1.0) ** np.arange(60)
    assert second.coefficients[0, :60] == pytest.approx(sign * first.coefficients[0, :60], abs=1e-3 * first.rms)


@pytest.mark.parametrize("change", [{"gravity": 1e-9}, {"waviness": (Waviness(1e-15, 13),)}])
def test_effects_set_in_continuously(change: dict[str, object]) -> None:
    plain, with_effect = simulate(SCENE), simulate(replace(SCENE, **change))
    assert with_effect.rms == pytest.approx(plain.rms, rel=1e-6)

"""Each effect against an independent integration, and what it looks like to the monitor: envelope lines and names."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import Kinematics, catalogue_entry, from_catalogue, kinematics
from models.machine.contact_estimates import element_mass, estimate_stiffness
from models.machine.rig import Rig
from models.machine.scene import Defect, Part, Scene, Slip, Waviness
from models.path.contour import part_paths
from models.solve.response import Response
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.step import P_DIRECTION_1, P_DIRECTION_2, STATUS_OK
from models.solve.six_dof.time_domain import prepare_plan, simulate_time
from monitor.health.name.naming import name_fault
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.signal.transform import EnvelopeSpectrum
from reference.signals import record_of, recorded
from tests.oracles.time_domain_oracle import Case, Oracle, edge_depth
from tests.support.effort import effort_count

BASE = Scene(40.0, 4000.0)
RATE = 25600.0
# The contact modes ring in this band; above it stands the casing's resonance, which little damage excites alike.
BAND = (500.0, 5000.0)

CASES = {
    "outer": (
        Case(40.0, 4000.0, "outer", 0.1, 5e-4),
        replace(BASE, defect=Defect(0.1, 5e-4)),
    ),
    "inner": (
        Case(40.0, 4000.0, "inner", 0.1, 5e-4),
        replace(BASE, defect=Defect(0.1, 5e-4, part="inner")),
    ),
    "inner, wide, second row": (
        Case(40.0, 4000.0, "inner", 0.5, 2e-5, rows=(1,)),
        replace(BASE, defect=Defect(0.5, 2e-5, part="inner", first_row=1)),
    ),
    "ball, both rows": (
        Case(40.0, 4000.0, "ball", 0.3, 1e-3, rows=(0, 1)),
        replace(BASE, defect=Defect(0.3, 1e-3, part="ball", rows=2)),
    ),
    "ball, with a floor": (
        Case(40.0, 4000.0, "ball", 0.6, 1e-5),
        replace(BASE, defect=Defect(0.6, 1e-5, part="ball")),
    ),
    "a defect of each part": (
        Case(
            *(40.0, 4000.0, "outer", 0.1, 5e-4),
            others=(Case(40.0, 4000.0, "inner", 0.2, 3e-5), Case(40.0, 4000.0, "ball", 0.3, 1e-3, rows=(1,))),
        ),
        replace(
            BASE,
            defect=Defect(0.1, 5e-4),
            more_defects=(Defect(0.2, 3e-5, part="inner"), Defect(0.3, 1e-3, part="ball", first_row=1)),
        ),
    ),
    "waviness of both races": (
        Case(40.0, 4000.0, waves=((1e-6, 13, "outer", 0.3), (5e-7, 7, "inner", 1.0))),
        replace(BASE, waviness=(Waviness(1e-6, 13, "outer", 0.3), Waviness(5e-7, 7, "inner", 1.0))),
    ),
    "unbalance": (
        Case(40.0, 4000.0, unbalance=2e-3),
        replace(BASE, unbalance=2e-3),
    ),
    "gravity and clearance": (
        Case(40.0, 4000.0, gravity=9.81, gravity_angle=1.0, clearance=5e-6),
        replace(BASE, gravity=9.81, gravity_angle=1.0, clearance=5e-6),
    ),
    "everything": (
        Case(30.0, 2000.0, "inner", 0.2, 3e-5, (0,), ((3e-7, 5, "inner", 0.2),), 1e-4, 9.81, 0.5, 3e-6),
        Scene(
            30.0,
            2000.0,
            defect=Defect(0.2, 3e-5, part="inner"),
            clearance=3e-6,
            waviness=(Waviness(3e-7, 5, "inner", 0.2),),
            unbalance=1e-4,
            gravity=9.81,
            gravity_angle=0.5,
        ),
    ),
}


def relative(found: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2)))


@pytest.mark.parametrize("name", list(CASES))
def test_against_the_oracle(name: str) -> None:
    """From rest, both sensors, both directions, at the default step: waveforms to 1e-3 of their RMS."""
    case, scene = CASES[name]
    h = 1.0 / 102400.0
    samples = effort_count(quick=200, full=4000)
    truth = Oracle(case).run(np.linspace(0.0, (samples - 1) * h, samples))
    plan = prepare_plan(scene, samples * h)
    for k, direction in enumerate(((1.0, 0.0), (0.0, 1.0))):
        wave, state = np.empty((samples, 2)), np.zeros((2, 6))
        plan.parameter[[P_DIRECTION_1, P_DIRECTION_2]] = direction
        assert kernels.run(state, wave, h, plan) == STATUS_OK
        assert relative(wave[:, 0], truth[:, 0, k]) < 1e-3
        assert relative(wave[:, 1], truth[:, 1, k]) < 1e-3


@pytest.mark.parametrize(
    ("part", "contacts"), [("outer", ["outer"]), ("inner", ["inner"]), ("ball", ["spot_outer", "spot_inner"])]
)
def test_paths_are_the_geometry_of_points_and_circles(part: Part, contacts: list[str]) -> None:
    half, h_d = 0.07, 15e-6
    paths = part_paths(BASE.bearing, Defect(2.0 * half, h_d, part=part, position=0.4))
    assert len(paths) == len(contacts)
    for path, contact, centre in zip(paths, contacts, (0.4, 0.4 + math.pi), strict=False):
        x = np.linspace(-half, half, 57)
        depth, slope = path(x + centre)
        truth = np.array([min(edge_depth(half - abs(a), contact), h_d) for a in x])
        assert depth == pytest.approx(math.cos(BASE.bearing.contact_angle) * truth, abs=1e-13)
        off_kinks = np.min(np.abs(x[:, None] + centre - path.kinks()), axis=1) > 1e-6
        ahead, behind = path(x + centre + 1e-7)[0], path(x + centre - 1e-7)[0]
        assert slope[off_kinks] == pytest.approx(((ahead - behind) / 2e-7)[off_kinks], abs=1e-6)


def damaged(part: Part, designation: str, speed: float, duration: float) -> Response:
    """Return one second or a few of a pit on one part, whose elements slip a little unless one of them is damaged."""
    extent = math.radians(16.0 if part == "ball" else 4.0)
    defect = Defect(extent, 5e-4, part=part)
    slip = None if part == "ball" else Slip(0.0035, seed=2)
    bearing, rig = from_catalogue(designation), Rig()
    if bearing.element == "roller":
        k_c = estimate_stiffness(catalogue_entry(designation))
        rig = Rig(k_c=k_c.value, m_b=element_mass(k_c.bearing), element="roller")
    scene = Scene(speed, 3000.0, bearing, rig, defect=defect, slip=slip)
    return simulate_time(scene, duration, RATE)


def features_in_noise(response: Response, lines: Kinematics) -> BlockFeatures:
    """Return the features of the signal in noise."""
    signal = recorded(response)[0]
    noisy = signal + np.random.default_rng(0).normal(0.0, 0.2 * float(np.std(signal)), signal.size)
    settings = FeatureSettings(RATE, (BAND,), fundamentals(lines), speed=lines.speed, speed_sd=0.0)
    return block_features(noisy.astype(np.float32), RATE, settings)


@pytest.mark.parametrize(
    ("designation", "speed", "duration"),
    [("1205 ETN9", 30.0, 2.0), ("6205", 40.0, 1.0), ("6205", 20.0, 5.0), ("NU205", 30.0, 2.0)],
)
@pytest.mark.parametrize("part", ["outer", "inner", "ball"])
def test_the_monitor_names_the_damaged_part(part: Part, designation: str, speed: float, duration: float) -> None:
    response = damaged(part, designation, speed, duration)
    lines = kinematics(from_catalogue(designation), speed)
    features = features_in_noise(response, lines)
    naming = name_fault(features.sought[0], lines, features.families[0], verified=features.shaft is not None)
    # The cage is deeper than the ball that it turns, and a second hardly tells its twelfth multiple from the ball.
    assert naming.fault in ((part, "ball|cage") if part == "ball" and duration < 2.0 else (part,))
    assert naming.families[part].speed_factor == pytest.approx(1.0, abs=2e-3)


def prominence(spectrum: EnvelopeSpectrum, frequency: float) -> float:
    """Return a line's amplitude over the median around it (twenty bins to either side)."""
    at, amplitude = round(frequency / spectrum.resolution), spectrum.amplitude
    return float(amplitude[at - 1 : at + 2].max() / np.median(amplitude[at - 20 : at + 21]))


@pytest.mark.parametrize("designation", ["6205", "NU205"])
def test_lines_and_sidebands_of_each_part(designation: str) -> None:
    """BPFO alone; BPFI with sidebands of the shaft; twice BSF with sidebands of the cage; nothing between them."""
    parts: tuple[Part, ...] = ("outer", "inner", "ball")
    found = {part: damaged(part, designation, 30.0, 4.0) for part in parts}
    lines = kinematics(from_catalogue(designation), 30.0)
    features = {part: features_in_noise(response, lines) for part, response in found.items()}
    combs = {
        "outer": (lines.bpfo, 0.0),
        "inner": (lines.bpfi, lines.speed),
        "ball": (2.0 * lines.bsf, lines.ftf),
    }
    for part, (line, side) in combs.items():
        comb = [line, 2.0 * line] if side == 0.0 else [line, line - side, line + side, 2.0 * line + side]
        for other in parts:
            clear = [prominence(features[other].envelopes[0], f) for f in comb]
            assert (min(clear) > 10.0) == (part == other), (part, other, clear)
        between = [prominence(features[part].envelopes[0], f) for f in (line - 0.5 * side, line + 0.5 * side) if side]
        assert all(level < 6.0 for level in between), (part, between)
    for shift in (-lines.speed, lines.speed):
        assert prominence(features["outer"].envelopes[0], lines.bpfo + shift) < 8.0
    # The sum of a family over the mean envelope is highest in the signal of its own part.
    for part in parts:
        sums = {other: features[other].lines[0][part].total / features[other].envelopes[0].mean for other in parts}
        assert max(sums, key=lambda other: sums[other]) == part, sums


def test_two_defects_have_the_lines_of_both() -> None:
    """A pit of either race, of unlike depth, each with its own family, sidebands only about that of the inner race."""
    bearing = from_catalogue("6205")
    pit, lines = Defect(math.radians(4.0), 5e-4), kinematics(bearing, 30.0)
    scene = Scene(30.0, 3000.0, bearing=bearing, defect=pit, slip=Slip(0.0035, seed=2))
    both = replace(scene, more_defects=(replace(pit, part="inner"),))
    alone, together = (features_in_noise(simulate_time(s, 4.0, RATE), lines).envelopes[0] for s in (scene, both))
    for line in (lines.bpfo, 2.0 * lines.bpfo, lines.bpfi, lines.bpfi - lines.speed, lines.bpfi + lines.speed):
        assert prominence(together, line) > 10.0
    assert prominence(alone, lines.bpfi) < 6.0


def test_an_unbalance_is_a_line_of_the_shaft() -> None:
    response = simulate_time(replace(BASE, unbalance=1e-3), 1.0, RATE)
    heavier = simulate_time(replace(BASE, unbalance=2e-3), 1.0, RATE)
    assert response.status in ("not_periodic", "inaccurate")
    assert not response.repeats
    record = record_of(response)
    assert record.line(40.0) > 20.0 * max(record.line(55.0), record.line(25.0))
    assert record_of(heavier).line(40.0) == pytest.approx(2.0 * record.line(40.0), rel=1e-2)


def test_waviness_sounds_at_its_order() -> None:
    """Waves of order n k of an outer race with n balls lift all balls of a row at once: lines at k BPFO."""
    scene = replace(BASE, bearing=from_catalogue("6205"), waviness=(Waviness(5e-7, 9),))
    response = simulate_time(scene, 1.0, RATE)
    assert response.status == "converged"
    healthy = simulate_time(replace(scene, waviness=()), 1.0, RATE)
    lines = kinematics(scene.bearing, scene.speed)
    assert record_of(response).line(lines.bpfo) > 1.5 * record_of(healthy).line(lines.bpfo)
    inner = simulate_time(replace(scene, waviness=(Waviness(5e-7, 9, "inner"),)), 1.0, RATE)
    assert inner.status in ("not_periodic", "inaccurate")
    assert not inner.repeats
    assert record_of(inner).line(lines.bpfi) > 20.0 * record_of(healthy).line(lines.bpfi)


def test_gravity_along_the_load_is_more_load() -> None:
    rig = BASE.rig_as(Rig)
    heavy = simulate_time(replace(BASE, gravity=100.0), 0.2, RATE)
    loaded = simulate_time(replace(BASE, load=BASE.load + 100.0 * (rig.m_o + rig.m_r)), 0.2, RATE)
    assert recorded(heavy) == pytest.approx(recorded(loaded), abs=1e-9)
    upwards = simulate_time(replace(BASE, gravity=100.0, gravity_angle=math.pi), 0.2, RATE)
    assert upwards.rms < heavy.rms

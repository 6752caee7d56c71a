"""The model of impacts on rings: closed forms, limits, and its kernel against scipy.

Scaling the model of impacts on rings to a machine, which here is the same model with other gain and noise.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Defect, Part, Scene
from models.solve.response import PASSBAND
from models.solve.ring_impact.hits import hits_on, short_bearing_film, zones_of
from models.solve.ring_impact.kernel import HALF_SINE, RECTANGLE, ImpactPulses, RingModes, Turn, add_response
from models.solve.ring_impact.rig import Pulse, RingImpactRig, RingSection
from models.solve.ring_impact.solver import (
    SOLVER,
    Addition,
    MeasuredLevel,
    calibrate,
    films,
    matrices,
    modes_of,
    natural_frequencies,
    noise_level,
    noise_to_add,
)
from models.solve.simulate import simulate
from models.words.request import Request
from tests.oracles import ring_impact_oracle as oracle

BEARING = from_catalogue("6205")
RIG = RingImpactRig()
DEFECT = Defect(0.02, 1e-4)
SCENE = Scene(30.0, 1000.0, bearing=BEARING, rig=RIG, defect=DEFECT)
LINES = kinematics(BEARING, SCENE.speed)
SHAPES = {"rectangle": RECTANGLE, "half_sine": HALF_SINE}
PARTS: tuple[Part, ...] = ("outer", "ball", "inner")


def on(part: Part, **changes: Any) -> Scene:
    return replace(SCENE, defect=replace(DEFECT, part=part), **changes)


def wave_of(modes: RingModes, pulses: ImpactPulses, n: int, h: float, turn: Turn | None = None) -> NDArray[np.float64]:
    wave = np.zeros(n)
    add_response(wave, h, modes, pulses, turn or Turn(0.0, 0.0), np.empty((3, len(modes.rate)), np.complex128))
    return wave


def pulses_of(scene: Scene, begin: float, end: float) -> ImpactPulses:
    rig = scene.rig_as(RingImpactRig)
    hits = hits_on(scene, 0, begin, end)
    return ImpactPulses(hits.start, hits.force, rig.pulse_width, SHAPES[rig.pulse])


# Matrices and natural frequencies.


def test_damping_is_symmetric_semidefinite_of_rank_two_and_stiffness_definite() -> None:
    mass, damping, stiffness = matrices(replace(SCENE, rig=replace(RIG, c_of=20.0, c_if=70.0, k_of=3e7)))
    assert np.array_equal(damping, damping.T)
    assert np.array_equal(stiffness, stiffness.T)
    assert np.linalg.matrix_rank(damping) == 2
    assert np.linalg.eigvalsh(damping)[0] == pytest.approx(0.0, abs=1e-12)
    assert np.array_equal(damping @ np.ones(3), np.zeros(3))
    assert np.linalg.eigvalsh(stiffness)[0] > 0.0
    assert stiffness @ np.ones(3) == pytest.approx([RIG.k_o, 0.0, RIG.k_i], rel=1e-12)
    assert np.array_equal(np.diagonal(mass), [RIG.m_o, RIG.element_mass(BEARING), RIG.m_i])


# The frequencies of the study that gives the films their defaults, with the element of 2.1 g that it took.
@pytest.mark.parametrize(
    ("film", "expected"),
    [(1e7, (4253, 10612, 15713)), (1e8, (5265, 11698, 49501)), (1e9, (6884, 21157, 156502))],
)
def test_natural_frequencies_of_the_study(film: float, expected: tuple[int, int, int]) -> None:
    scene = replace(SCENE, rig=replace(RIG, k_of=film, k_if=film, m_b=2.1e-3))
    assert natural_frequencies(scene) == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize("part", PARTS)
def test_static_compliance_of_the_modes(part: Part) -> None:
    _, _, stiffness = matrices(SCENE)
    modes = modes_of(SCENE, part)
    at_rest = float(np.sum((-modes.weight / modes.rate).real))
    assert at_rest == pytest.approx(np.linalg.inv(stiffness)[0, PARTS.index(part)], rel=1e-9)


def test_ring_frequencies_and_stiffness_of_a_section() -> None:
    """Eq. 17 with n = 2 is 6 / sqrt(5) sqrt(EI / mu R^4); higher orders are those of a thin ring."""
    ring = RingSection(2.1e11, 4e-10, 1.2, 0.02)
    beam = math.sqrt(2.1e11 * 4e-10 / (1.2 * 0.02**4)) / (2.0 * math.pi)
    assert [ring.frequency(n) / beam for n in (2, 3, 4)] == pytest.approx([2.68328, 7.58947, 14.5521], rel=1e-5)
    rig = RIG.with_rings(ring, replace(ring, radius=0.01))
    assert rig.m_o == pytest.approx(2.0 * math.pi * 0.02 * 1.2)
    assert math.sqrt(rig.k_o / rig.m_o) / (2.0 * math.pi) == pytest.approx(ring.frequency())
    assert rig.k_i == pytest.approx(8.0 * rig.k_o)
    with pytest.raises(ValueError, match="order"):
        ring.frequency(1)


def test_films_of_a_journal_follow_load_and_speed() -> None:
    scene = replace(SCENE, rig=replace(RIG, film_thickness=1e-6, film_clearance=1e-5))
    outer, inner = films(scene)
    assert outer == inner
    assert outer == short_bearing_film(
        zones_of(scene)[0].largest, 2.0 * math.pi * SCENE.speed, thickness=1e-6, clearance=1e-5
    )
    loaded, faster = films(replace(scene, load=2000.0))[0], films(replace(scene, speed=60.0))[0]
    assert (loaded.stiffness, loaded.damping) == pytest.approx((2.0 * outer.stiffness, 2.0 * outer.damping))
    assert (faster.stiffness, faster.damping) == pytest.approx((outer.stiffness, 0.5 * outer.damping))
    assert np.array_equal(matrices(scene)[2][1], [-outer.stiffness, 2.0 * outer.stiffness, -outer.stiffness])
    found = simulate(scene, duration=0.1, rate=25600.0, accuracy=5e-3)
    assert (found.status, found.repeats) == ("uncalibrated", True)
    with pytest.raises(ValueError, match="a film needs a load"):
        simulate(replace(scene, load=0.0), duration=0.1)


# The kernel.


@pytest.mark.parametrize("shape", ["rectangle", "half_sine"])
@pytest.mark.parametrize("part", PARTS)
def test_response_is_that_of_scipy(part: Part, shape: Pulse) -> None:
    """From rest through the first hits, with wide pulses, of which two overlap; positions are none of the samples'."""
    rig = replace(RIG, pulse=shape, pulse_width=1.3e-4, c_of=60.0, m_b=2e-3)
    position, end, h = 0.3, 0.03, 7.3e-6
    scene = replace(on(part, rig=rig), defect=replace(DEFECT, part=part, position=position))
    geometry = oracle.Geometry(9, BEARING.element_diameter, BEARING.pitch_diameter, SCENE.speed)
    machine = oracle.Machine(
        rig.m_o, 2e-3, rig.m_i, rig.k_o, rig.k_of, rig.k_if, rig.k_i, rig.c_of, rig.c_if, shape, rig.pulse_width
    )
    found = pulses_of(scene, 0.0, end)
    ring = np.linspace(-np.pi, np.pi, 20001)[:-1]
    largest = 1000.0 / (9.0 * float(np.mean(np.maximum(np.cos(ring), 0.0) ** 1.5 * np.cos(ring))))
    radius = {
        "outer": 0.5 * (BEARING.pitch_diameter + BEARING.element_diameter),
        "ball": 0.5 * BEARING.element_diameter,
    }
    width = 0.02 * radius.get(part, 0.5 * (BEARING.pitch_diameter - BEARING.element_diameter))
    scale = largest * (1.0 + (width / BEARING.element_diameter) ** 2)
    expected = [
        (t, scale * oracle.share(psi, 0.5))
        for t, psi in oracle.hits(geometry, part, position, end)
        if math.cos(psi) > 0
    ]
    assert len(expected) >= 2
    assert found.start == pytest.approx([t for t, _ in expected], abs=1e-12)
    assert found.force == pytest.approx([f for _, f in expected], rel=1e-5)
    again = [(t + 0.4 * rig.pulse_width, 0.5 * f) for t, f in expected[:1]]
    driven = sorted(expected + again)
    pulses = ImpactPulses(np.array([t for t, _ in driven]), np.array([f for _, f in driven]), found.width, found.shape)
    turn = Turn(0.4, 2.0 * math.pi * 31.0)
    n = int(end / h)
    t = h * np.arange(n, dtype=np.float64)
    z, v, a = oracle.motion(machine, PARTS.index(part), driven, t)
    still = wave_of(modes_of(scene, part), pulses, n, h)
    assert np.max(np.abs(still - a)) < 1e-7 * np.max(np.abs(a))
    angle, rate = 2.0 * (turn.begin + turn.rate * t), 2.0 * turn.rate
    seen = (a - rate**2 * z) * np.cos(angle) - 2.0 * rate * v * np.sin(angle)
    turned = wave_of(modes_of(scene, part), pulses, n, h, turn)
    assert np.max(np.abs(turned - seen)) < 1e-7 * np.max(np.abs(a))


@pytest.mark.parametrize("part", PARTS)
def test_steps_make_no_error(part: Part) -> None:
    """Exact at every step, whatever their length: no order of convergence, only rounding."""
    modes, pulses = modes_of(SCENE, part), pulses_of(on(part), -0.3, 0.1)
    turn = Turn(0.1, 100.0)
    fine = wave_of(modes, pulses, 64001, 1e-6, turn)
    for every in (2, 10, 64):
        coarse = wave_of(modes, pulses, 64000 // every + 1, every * 1e-6, turn)
        assert np.max(np.abs(coarse - fine[::every])) < 1e-9 * np.max(np.abs(fine))


def test_a_pulse_stands_where_it_is_between_two_samples() -> None:
    modes, h = modes_of(SCENE, "inner"), 1.0 / 48000.0
    for share in (0.0, 0.3, 0.77):
        one = wave_of(modes, ImpactPulses(np.array([share * h]), np.ones(1), RIG.pulse_width, RECTANGLE), 40, h)
        finer = wave_of(modes, ImpactPulses(np.array([0.0]), np.ones(1), RIG.pulse_width, RECTANGLE), 4000, 0.01 * h)
        late = round(share * 100)
        assert one[1:] == pytest.approx(finer[100 - late :: 100][:39], rel=1e-9, abs=1e-9 * np.max(np.abs(finer)))


@pytest.mark.parametrize("shape", ["rectangle", "half_sine"])
def test_settled_response_is_its_fourier_series(shape: Pulse) -> None:
    """Line k is the transfer function at k BPFO times that of the pulse train, in closed form."""
    scene = replace(SCENE, rig=replace(RIG, pulse=shape), defect=replace(DEFECT, position=0.2))
    duration, rate = 12.0 / LINES.bpfo, 40000.0
    found = simulate(scene, duration=duration, rate=rate, accuracy=1e-3)
    assert (found.status, found.repeats) == ("uncalibrated", True)
    mass, damping, stiffness = matrices(scene)
    pulses = pulses_of(scene, 0.0, 1.0 / LINES.bpfo)
    k = np.arange(1, 40000)
    s = 2j * np.pi * k * LINES.bpfo
    if shape == "rectangle":
        train = (1.0 - np.exp(-s * pulses.width)) / s
    else:
        omega = math.pi / pulses.width
        train = omega * (1.0 + np.exp(-s * pulses.width)) / (s * s + omega * omega)
    dynamic = s[:, None, None] ** 2 * mass + s[:, None, None] * damping + stiffness
    transfer = s**2 * np.linalg.inv(dynamic)[:, 0, 0]
    line = LINES.bpfo * pulses.force[0] * transfer * train * np.exp(-s * pulses.start[0]) * math.cos(2.0 * 0.2)
    assert found.rms == pytest.approx(math.sqrt(2.0 * np.sum(np.abs(line) ** 2)), rel=2e-3)
    inside = k * LINES.bpfo < PASSBAND * 0.5 * rate
    assert found.record is not None
    signal = found.record.of()
    # The record begins where the filter of the record lies whole within the run.
    near = k * LINES.bpfo < 0.5 * rate
    best = np.inf
    turns = np.exp(np.outer(np.arange(len(signal)) / rate, s[near]))
    for first in range(60):
        wave = 2.0 * np.real(turns @ (line[near] * np.exp(s[near] * first / rate)))
        best = min(best, float(np.sqrt(np.mean((wave - signal) ** 2))))
    rest = math.sqrt(2.0 * np.sum(np.abs(line[near & ~inside]) ** 2))
    assert best < rest + 1e-3 * found.rms


# Hard cases.


@pytest.mark.parametrize(
    "change",
    [
        {"c_of": 1e5, "c_if": 1e5},
        {"k_of": 1e12, "k_if": 1e12},
        {"k_of": 1e3, "k_if": 1e3, "c_of": 1.0, "c_if": 1.0},
        {"pulse_width": 1e-7},
        {"pulse_width": 2e-2},
        {"m_b": 1e-7},
    ],
    ids=str,
)
def test_extreme_parameters(change: dict[str, float]) -> None:
    """Finite, and as the exponential of the system's matrix says, after one pulse."""
    from scipy.linalg import expm

    scene = replace(SCENE, rig=replace(RIG, **change))
    rig = scene.rig_as(RingImpactRig)
    mass, damping, stiffness = matrices(scene)
    h, n = 1e-5, 200
    pulse = ImpactPulses(np.zeros(1), np.ones(1), rig.pulse_width, RECTANGLE)
    wave = wave_of(modes_of(scene, "inner"), pulse, n, h)
    inverse = np.linalg.inv(mass)
    system = np.zeros((7, 7))
    system[:3, 3:6], system[3:6, :3], system[3:6, 3:6] = np.eye(3), -inverse @ stiffness, -inverse @ damping
    system[5, 6] = 1.0 / rig.m_i
    expected = []
    for t in h * np.arange(n):
        state = expm(system * min(t, rig.pulse_width)) @ np.eye(7)[6]
        if t > rig.pulse_width:
            state[6] = 0.0
            state = expm(system * (t - rig.pulse_width)) @ state
        expected.append((system @ state)[3])
    assert np.max(np.abs(wave - expected)) < 1e-5 * np.max(np.abs(expected))


def test_modes_that_coincide_are_parted() -> None:
    """At the critical damping between two of three modes, where eigenvectors do not span the space."""

    def real_ones(damping: float) -> int:
        scene = replace(SCENE, rig=replace(RIG, c_of=damping, c_if=damping))
        return int(np.sum(modes_of(scene, "outer").rate.imag == 0.0))

    low, high = 1e2, 1e4
    assert real_ones(low) == 0 < real_ones(high)
    while high - low > 4e-14 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if real_ones(middle) == 0 else (low, middle)
    pulse = ImpactPulses(np.zeros(1), np.ones(1), RIG.pulse_width, RECTANGLE)
    waves = [
        wave_of(modes_of(replace(SCENE, rig=replace(RIG, c_of=c, c_if=c)), "outer"), pulse, 500, 2e-6)
        for c in (0.999 * high, low, high, 1.001 * high)
    ]
    largest = np.max(np.abs(waves[0]))
    assert np.max(np.abs(waves[1] - waves[2])) < 1e-5 * largest
    assert np.max(np.abs(waves[1] - 0.5 * (waves[0] + waves[3]))) < 1e-4 * largest


def test_films_that_hardly_damp_are_refused() -> None:
    with pytest.raises(ValueError, match="the films damp it too little"):
        simulate(replace(SCENE, rig=replace(RIG, c_of=1e-6, c_if=1e-6)))


def test_no_load_is_silence() -> None:
    found = simulate(replace(SCENE, load=0.0), duration=0.1)
    assert (found.rms, found.status) == (0.0, "converged")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"m_o": 0.0}, "rig.m_o"),
        ({"c_of": -1.0}, "rig.c_of"),
        ({"pulse": "triangle"}, "rig.pulse"),
        ({"film_thickness": 1e-6}, "belong together"),
        ({"film_thickness": 2e-6, "film_clearance": 1e-6}, "rig.film_thickness must be less"),
        ({"noise_weights": ()}, "rig.noise_weights"),
        ({"noise_seed": -1}, "rig.noise_seed"),
        ({"load_factor": math.nan}, "rig.load_factor"),
    ],
)
def test_senseless_parameters_are_refused_by_name(change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        replace(RIG, **change)


def test_effects_that_it_lacks_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="gravity, changing_speed: ring_impact does not describe this"):
        SOLVER.solve(replace(SCENE, gravity=9.81, speed_slope=1.0), Request())
    with pytest.raises(ValueError, match=r"rig\.m_b must be given"):
        Scene(30.0, 1000.0, bearing=replace(BEARING, element="roller"), rig=RIG)
    assert RingImpactRig(**RIG.as_dict()) == RIG


def test_what_its_rig_is_refused_by_other_models() -> None:
    with pytest.raises(ValueError, match="six_dof takes the parameters of Rig, got RingImpactRig"):
        simulate(replace(SCENE, model="six_dof"))


RING_CALIBRATION_RIG = RingImpactRig(k_impact=60.0, c_of=100.0, c_if=100.0)
RING_CALIBRATION_DEFECT = Defect(0.03, 1e-3, part="inner")
RING_CALIBRATION_SCENE = Scene(
    30.0, 1000.0, bearing=from_catalogue("6205"), rig=RING_CALIBRATION_RIG, defect=RING_CALIBRATION_DEFECT
)
REQUEST = Request(duration=1.0, rate=25600.0, accuracy=1e-2)


def record(scene: Scene) -> NDArray[np.float64]:
    found = simulate(scene, duration=1.0, rate=25600.0, accuracy=1e-2)
    assert found.record is not None
    return found.record.of()


def measured(scene: Scene) -> MeasuredLevel:
    x = record(scene)
    return MeasuredLevel(float(np.std(x)), float(np.mean(x**4) / np.mean(x**2) ** 2))


def machine() -> RingImpactRig:
    """A machine unlike the model: 1/50 of its amplitude, noise of another seed."""
    noise = 0.5 * float(np.std(record(RING_CALIBRATION_SCENE))) / 50.0
    return replace(
        RING_CALIBRATION_RIG, gain=0.02, slip_noise=noise / noise_level(RING_CALIBRATION_SCENE, 1.0), noise_seed=17
    )


def test_gain_and_noise_of_a_machine_are_found_and_predict_its_other_defects() -> None:
    there = machine()
    found = calibrate(RING_CALIBRATION_SCENE, measured(replace(RING_CALIBRATION_SCENE, rig=there)), REQUEST)
    assert found.gain == pytest.approx(there.gain, rel=0.02)
    assert found.slip_noise == pytest.approx(there.slip_noise, rel=0.05)
    for change in (
        {"defect": replace(RING_CALIBRATION_DEFECT, dphi_d=0.1)},
        {"defect": replace(RING_CALIBRATION_DEFECT, part="outer")},
        {"load": 3000.0},
        {"speed": 45.0},
    ):
        other = replace(RING_CALIBRATION_SCENE, **change)
        ours, theirs = measured(replace(other, rig=found)), measured(replace(other, rig=there))
        assert ours.rms == pytest.approx(theirs.rms, rel=0.02)
        assert ours.kurtosis == pytest.approx(theirs.kurtosis, rel=0.1)


@pytest.mark.parametrize("addition", ["quadrature", "linear"])
def test_known_noise_leaves_the_impacts_the_rest(addition: Addition) -> None:
    alone = float(np.std(record(RING_CALIBRATION_SCENE)))
    found = calibrate(RING_CALIBRATION_SCENE, MeasuredLevel(5.0, noise=3.0), REQUEST, addition=addition)
    impacts = 4.0 if addition == "quadrature" else 2.0
    assert found.gain == pytest.approx(impacts / alone, rel=1e-3)
    assert noise_level(replace(RING_CALIBRATION_SCENE, rig=found)) == pytest.approx(3.0, rel=1e-9)
    assert float(np.std(record(replace(RING_CALIBRATION_SCENE, rig=found)))) == pytest.approx(
        math.hypot(impacts, 3.0), rel=0.03
    )


def test_rms_alone_is_all_impacts() -> None:
    found = calibrate(RING_CALIBRATION_SCENE, MeasuredLevel(5.0), REQUEST)
    assert found.slip_noise == 0.0
    assert float(np.std(record(replace(RING_CALIBRATION_SCENE, rig=found)))) == pytest.approx(5.0, rel=1e-3)


def test_levels_have_a_unit_once_a_measurement_has_set_the_gain() -> None:
    asked: dict[str, Any] = {"duration": 0.2, "rate": 25600.0, "accuracy": 5e-2}
    found = calibrate(RING_CALIBRATION_SCENE, MeasuredLevel(5.0), REQUEST)
    for rig in (found, replace(RING_CALIBRATION_RIG, calibrated="declared")):
        assert rig.scaled
        assert simulate(replace(RING_CALIBRATION_SCENE, rig=rig), **asked).status in ("not_periodic", "inaccurate")
    assert not RING_CALIBRATION_RIG.scaled
    assert simulate(RING_CALIBRATION_SCENE, **asked).status == "uncalibrated"


def test_noise_that_makes_up_an_rms() -> None:
    assert noise_to_add(5.0, 4.0) == pytest.approx(3.0)
    assert noise_to_add(5.0, 4.0, "linear") == pytest.approx(1.0)
    assert noise_to_add(5.0, 5.0) == 0.0
    with pytest.raises(ValueError, match="exceeds the measured one"):
        noise_to_add(4.0, 5.0)


def test_what_cannot_be_calibrated_is_refused() -> None:
    with pytest.raises(ValueError, match="it is not hit"):
        calibrate(replace(RING_CALIBRATION_SCENE, load=0.0), MeasuredLevel(5.0), REQUEST)
    with pytest.raises(ValueError, match="does not lie between that of noise"):
        calibrate(RING_CALIBRATION_SCENE, MeasuredLevel(5.0, kurtosis=500.0), REQUEST)
    with pytest.raises(ValueError, match="rms"):
        MeasuredLevel(0.0)
    with pytest.raises(ValueError, match="kurtosis"):
        MeasuredLevel(1.0, 0.9)
    with pytest.raises(ValueError, match="noise"):
        MeasuredLevel(1.0, noise=1.0)

"""What Ceruti (master thesis, Torino 2021) prints: contact stiffness, rows C1 to C5, and his spectra in kind.

The lines are sought by the program's own features, in the envelope of his band, 500 to 10,000 Hz.

Table 5.1: inner ring 32.1 mm, outer ring 54.67 mm, balls of 11.274 mm, race to sphere diameter 1.08, E = 2e5 MPa,
nu = 0.3. The thesis does not print K; it follows from its own formulas with these values, in exact elliptic Hertz:
K_i = 7.253e5, K_o = 7.881e5 and K = 2.6716e5 N/mm^1.5.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from models.machine.bearing import catalogue, from_catalogue, kinematics
from models.machine.hertz import contact_stiffness, point_contact_stiffness, relative_radii
from models.machine.scene import Part, Scene
from models.published.acceptance import AcceptanceRow
from models.published.ceruti import (
    SPEED,
    STEP,
    damaged,
    end_peak_value,
    kept,
    peak_value,
    rotor,
    run,
)
from models.solve.response import Response
from models.solve.rotor.elastic import shaft_of
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import Rigid
from models.words.request import Request, Sensor
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from reference.accepted import rows_of

PER_MILLIMETRE = 1e3**1.5
MODULUS = 200.0 / 210.0
"""hertz.py has 210 GPa; every stiffness is proportional to the modulus."""


def test_stiffness_of_the_6305_with_the_grooves_of_table_5_1() -> None:
    bearing = catalogue()["6305"]
    groove = 0.5 * 1.08 * bearing.element_diameter
    grooved = replace(bearing, inner_groove_radius=groove, outer_groove_radius=groove)
    inner, outer = (
        MODULUS * point_contact_stiffness(*radii, method="elliptic") / PER_MILLIMETRE
        for radii in relative_radii(grooved)
    )
    assert inner == pytest.approx(7.253e5, rel=1e-3)
    assert outer == pytest.approx(7.881e5, rel=1e-3)
    assert MODULUS * contact_stiffness(grooved, "elliptic") / PER_MILLIMETRE == pytest.approx(2.6716e5, rel=5e-4)


# Section 2.2: K = (L^0.8 / 3.84e-5)^(10/9) of one line contact, N and mm.
def test_palmgrens_line_contact_is_the_printed_one() -> None:
    bearing = catalogue()["NU 202 ECP"]
    assert bearing.effective_length is not None
    single = ((1e3 * bearing.effective_length) ** 0.8 / 3.84e-5) ** (10.0 / 9.0)
    both = single / 2.0 ** (10.0 / 9.0)
    assert contact_stiffness(bearing) / 1e3 ** (10.0 / 9.0) == pytest.approx(both, rel=2e-3)


def test_default_stiffness_of_the_rotor_is_that_of_table_5_1() -> None:
    assert RotorRig.k_c == pytest.approx(2.6716e5 * PER_MILLIMETRE, rel=1e-4)


def rows() -> list[AcceptanceRow]:
    return rows_of("models.published.ceruti")


def test_rows_have_the_status_that_they_can_have() -> None:
    found = Counter((row.test, row.status) for row in rows())
    assert found == {
        ("C1", "EXACT"): 8,
        ("C2", "REPRO"): 1,
        ("C3", "REPRO"): 5,
        ("C4", "QUAL"): 13,
        ("C5", "NO"): 19,
    }


@pytest.mark.parametrize("number", range(27))
def test_row_is_within_its_tolerance(number: int) -> None:
    row = [r for r in rows() if r.status != "NO"][number]
    assert row.met, f"{row.test} {row.quantity}: printed {row.printed}, obtained {row.obtained:.5g}"


def test_damage_at_a_is_felt_most_at_a_and_least_at_b() -> None:
    parts: tuple[Part, ...] = ("outer", "inner", "ball")
    for part in parts:
        scene = damaged(part)
        a, c, b = (peak_value(run(scene), sensor, scene) for sensor in ("a", "c", "b"))
        assert a > c > b
        # A force at A moves A, C and B as 1/m + a^2/J_t : 1/m : 1/m - a^2/J_t, which is 5 : 3 : 1.
        assert a / c == pytest.approx(5.0 / 3.0, rel=0.1)
        # The forces of B, whose balls are pressed anew, add to what is left of it there.
        assert c / b == pytest.approx(3.0, rel=0.35)


# C5: the accelerations of ends without mass do not exist.
def test_elastic_ends_without_mass_do_not_converge() -> None:
    scene = rotor()
    sides: tuple[Sensor, ...] = ("a", "b")
    for side in sides:
        peaks = [end_peak_value(run(scene, elastic=True, step=STEP / k), scene, side) for k in (1, 2, 4)]
        assert peaks[1] > 1.7 * peaks[0]
        assert peaks[2] > 1.7 * peaks[1]
    discs = [peak_value(run(scene, elastic=True, step=STEP / k), "c", scene) for k in (1, 2, 4)]
    assert max(discs) / min(discs) < 1.0 + 1e-4


def test_elastic_ends_with_a_mass_converge() -> None:
    scene = rotor(end_mass=0.3)
    for side in ("a", "b"):
        coarse, fine, finest = (peak_value(run(scene, elastic=True, step=STEP / k), side, scene) for k in (1, 2, 4))
        # What is left is where the steps meet the peak, which falls within some of them.
        assert abs(fine - finest) < 5e-3 * finest
        assert abs(coarse - finest) < 2e-2 * finest


def test_most_of_the_elastic_peak_value_is_what_is_left_of_the_beginning() -> None:
    """Printed 291.4, ours 671; from the static equilibrium and settled, it is below 5 mm/s2."""
    request = Request(duration=1.0, rate=25600.0, accuracy=5e-3)
    assert shaft_of(rotor()).solve(request).peak < 10e-3


LINES = kinematics(from_catalogue("6305"), SPEED)
RATE = 25600.0


@cache
def settled(scene: Scene, duration: float = 4.0) -> Response:
    return Rigid(scene).solve(Request(duration=duration, rate=RATE, accuracy=2e-2))


@cache
def features(scene: Scene, sensor: Sensor, duration: float = 4.0) -> BlockFeatures:
    x = settled(scene, duration).acceleration(RATE, duration, sensor=sensor)
    settings = FeatureSettings(RATE, ((500.0, 10_000.0),), fundamentals(LINES), speed=SPEED)
    return block_features(x, RATE, settings)


def envelope(scene: Scene, sensor: Sensor, duration: float = 4.0) -> Callable[[float], float]:
    """Return the amplitude of the envelope's line at a frequency, the highest of the three nearest."""
    found = features(scene, sensor, duration).envelopes[0]
    amplitude = np.asarray(found.amplitude, dtype=np.float64)

    def line(frequency: float) -> float:
        at = round(frequency / found.resolution)
        return float(np.max(amplitude[max(at - 1, 1) : at + 2]))

    return line


def first_line(scene: Scene, sensor: Sensor, duration: float = 4.0) -> float:
    """Return the frequency of the highest line of the envelope."""
    found = features(scene, sensor, duration).envelopes[0]
    return float(np.argmax(found.amplitude)) * found.resolution


def test_healthy_with_equal_balls_has_falling_multiples_of_bpfo() -> None:
    """Fig. 6.4."""
    line = envelope(rotor(0.0), "c")
    levels = [line(k * LINES.bpfo) for k in range(1, 7)]
    assert levels == sorted(levels, reverse=True)
    assert first_line(rotor(0.0), "c") == pytest.approx(LINES.bpfo, abs=0.3)
    assert features(rotor(0.0), "c").indicators.kurtosis == pytest.approx(5.0, abs=0.5)


def test_balls_half_a_pitch_apart_cancel_odd_multiples_at_the_disc() -> None:
    """Fig. 6.9: 2 BPFO is first; A and B keep the odd multiples."""
    scene = rotor(math.pi / 7.0)
    assert first_line(scene, "c") == pytest.approx(2.0 * LINES.bpfo, abs=0.3)
    odd = {sensor: envelope(scene, sensor)(LINES.bpfo) for sensor in ("a", "b", "c")}
    assert odd["c"] < 0.05 * min(odd["a"], odd["b"])


def test_outer_race() -> None:
    """Fig. 6.15: multiples of BPFO that fall slowly, higher at A than at C than at B."""
    scene = damaged("outer")
    levels = [[envelope(scene, sensor)(k * LINES.bpfo) for k in range(1, 7)] for sensor in ("a", "c", "b")]
    assert all(a > c > b for a, c, b in zip(*levels, strict=True))
    assert levels[0][5] > 0.4 * levels[0][0]
    assert first_line(scene, "a") == pytest.approx(LINES.bpfo, abs=0.3)
    assert features(scene, "a").indicators.kurtosis > 50.0
    scores = {name: lines.score for name, lines in features(scene, "a").lines[0].items()}
    assert max(scores, key=lambda name: scores[name]) == "outer"


def test_inner_race() -> None:
    """Fig. 6.20: f_s is first at A, then BPFI, with sidebands f_s apart; less at B."""
    scene, span = damaged("inner"), 8.0
    line = envelope(scene, "a", span)
    assert first_line(scene, "a", span) == pytest.approx(SPEED, abs=0.15)
    assert line(SPEED) > line(LINES.bpfi) > line(LINES.bpfi + SPEED)
    for side in (-2.0, -1.0, 1.0):
        assert line(LINES.bpfi + side * SPEED) > 0.7 * line(LINES.bpfi)
    assert envelope(scene, "b", span)(LINES.bpfi) < 0.5 * line(LINES.bpfi)
    scores = {name: lines.score for name, lines in features(scene, "a", span).lines[0].items()}
    assert max(scores, key=lambda name: scores[name]) == "inner"


def test_ball() -> None:
    """Fig. 6.24: 2 BPFO, 2 BSF with sidebands FTF apart, FTF; these hardly at B."""
    scene, span = damaged("ball"), 8.0
    at_a, at_b = envelope(scene, "a", span), envelope(scene, "b", span)
    spin = 2.0 * LINES.bsf
    for frequency in (spin - LINES.ftf, spin, spin + LINES.ftf):
        assert at_a(frequency) > 0.6 * at_a(2.0 * LINES.bpfo)
        assert at_b(frequency) < 0.4 * at_a(frequency)
    assert at_a(LINES.ftf) > 0.6 * at_a(2.0 * LINES.bpfo)
    assert first_line(scene, "b", span) == pytest.approx(2.0 * LINES.bpfo, abs=0.15)


def kurtosis(scene: Scene, sensor: Sensor) -> float:
    """Kurtosis of the printed run, unfiltered."""
    signal = kept(run(scene), sensor, scene)
    swing = signal - np.mean(signal)
    return float(np.mean(swing**4) / np.mean(swing**2) ** 2)


def test_kurtosis_tells_damage() -> None:
    """67, 75 and 59 at A over outer race, inner race and ball in the study, 5 of healthy bearings with equal balls."""
    assert kurtosis(rotor(0.0), "a") == pytest.approx(5.0, abs=0.5)
    assert max(kurtosis(rotor(), sensor) for sensor in ("a", "b", "c")) < 5.0
    studies: tuple[tuple[Part, float], ...] = (("outer", 67.0), ("inner", 75.0), ("ball", 59.0))
    for part, study in studies:
        assert kurtosis(damaged(part), "a") == pytest.approx(study, rel=0.05)


def test_a_shorter_rotor_feels_the_defect_alike_everywhere() -> None:
    """Section 6.2.1."""
    ratios = []
    for length in (0.8, 0.4, 0.1):
        scene = damaged("outer", rotor(length=length))
        levels = settled(scene, 1.0).levels
        ratios.append(levels[0][1] / levels[1][1])
    assert ratios[0] > 3.0 > ratios[1] > 1.1 > ratios[2] > 0.9


def test_eccentricity_raises_the_line_of_the_shaft_and_the_peaks() -> None:
    """Figs. 6.27 to 6.29. At 0.1 mm ours has the envelope's first shaft line at 2 f_s."""
    scenes = [rotor(math.pi / 7.0, eccentricity) for eccentricity in (0.0, 1e-5, 1e-4)]
    raw = []
    for scene in scenes:
        record = settled(scene).record
        assert record is not None
        raw.append(record.line(SPEED, "c"))
    assert raw[1] > 5.0 * raw[0]
    assert raw[2] > 5.0 * raw[1]
    assert envelope(scenes[1], "c")(SPEED) > 20.0 * envelope(scenes[0], "c")(SPEED)
    assert envelope(scenes[2], "c")(2.0 * SPEED) > envelope(scenes[2], "c")(SPEED)
    peaks = [settled(scene).levels_of("c")[1] for scene in scenes]
    assert peaks == sorted(peaks)


@pytest.mark.parametrize("elastic", [False, True])
def test_orbits_widen_with_the_eccentricity(*, elastic: bool) -> None:
    """Figs. 6.28 and 6.31."""
    widths = []
    for eccentricity in (0.0, 1e-5, 1e-4):
        found = run(rotor(eccentricity=eccentricity), elastic=elastic)
        orbit = found.c[len(found.c) // 2 :]
        widths.append(float(np.ptp(orbit.imag)) * float(np.ptp(orbit.real)))
        assert np.max(np.abs(orbit.imag)) < 1e-3
    assert widths[0] < widths[1] < widths[2]

"""What Sassi, Badri and Thomas (JVC 13(11), 2007) print: rows S1 to S3, and their spectra in kind.

The lines are sought by the program's own features. Fig. 12 compares BEAT with a recording of Case Western Reserve
University, defect 0.72 mm on the inner race of a 6205 at 1750 rpm; the recording at hand is 209_0, 0.53 mm at 1797 rpm.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import loadmat

from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Defect, Part, Scene
from models.published.acceptance import AcceptanceRow
from models.published.beat import DEFECT_SIZE, inner_race_scene
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.ring_impact.solver import MeasuredLevel, calibrate, noise_level, solve
from models.words.request import Request
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from reference.accepted import rows_of
from reference.once import made_once
from streams.types.block import STANDARD_GRAVITY

RATE, DURATION = 12_000.0, 5.0
BEARING = from_catalogue("6205")
REQUEST = Request(duration=DURATION, rate=RATE, accuracy=2e-2)
CWRU_SPEED = 1797.0 / 60.0


def rows() -> list[AcceptanceRow]:
    return rows_of("models.published.beat")


def test_rows_have_the_status_that_they_can_have() -> None:
    found = Counter((row.test, row.status) for row in rows())
    assert found == {("S1", "EXACT"): 17, ("S2", "CALIB"): 4, ("S3", "NO"): 5}


def test_rows_are_within_their_tolerance() -> None:
    missed = [
        f"{row.test} {row.quantity}, {row.status}: printed {row.printed}, obtained {row.obtained:.5g}"
        for row in rows()
        if row.status != "NO" and not row.met
    ]
    assert not missed


def test_what_is_not_reproduced_says_what_is_missing() -> None:
    missing = [row for row in rows() if row.status == "NO"]
    assert all("not printed" in row.note and not row.met for row in missing)
    assert all(abs(row.difference) > 0.04 for row in missing)


DAMPED = RingImpactRig(c_of=100.0, c_if=100.0)
"""Films that let one impact die down before the next, as on the recordings; the study's own do not."""
SIZED: dict[Part, float] = {"outer": 0.02, "inner": 0.03, "ball": 0.1}


def features(x: NDArray[np.float64], speed: float) -> BlockFeatures:
    lines = fundamentals(kinematics(BEARING, speed))
    return block_features(x, RATE, FeatureSettings(RATE, ((500.0, 0.45 * RATE),), lines, speed=speed))


def depth(found: BlockFeatures, frequency: float) -> float:
    """Return the largest value of the envelope spectrum within 1 Hz of a line, over its median below 400 Hz."""
    envelope = found.envelopes[0]
    amplitude = np.asarray(envelope.amplitude, dtype=np.float64)
    near = np.abs(envelope.frequency - frequency) < 1.0
    return float(amplitude[near].max() / np.median(amplitude[envelope.frequency < 400.0]))


@cache
def simulated(part: Part, *, load_turns: bool = False) -> BlockFeatures:
    """Features of a defect, with noise of a tenth of its RMS."""
    defect = Defect(SIZED[part], 1e-3, part=part)
    scene = Scene(CWRU_SPEED, 1000.0, bearing=BEARING, rig=DAMPED, defect=defect, load_turns=load_turns)
    alone = solve(scene, replace(REQUEST, duration=1.0)).rms
    noise = 0.1 * alone / noise_level(scene, 1.0)
    x = solve(replace(scene, rig=replace(DAMPED, slip_noise=noise)), REQUEST).acceleration(RATE, DURATION)
    return features(x, CWRU_SPEED)


# Section 3.2 and Fig. 5.


def test_outer_race_makes_lines_of_bpfo_without_sidebands() -> None:
    found, lines = simulated("outer"), kinematics(BEARING, CWRU_SPEED)
    assert found.lines[0]["outer"].detected
    assert found.lines[0]["outer"].score > 5.0 * max(found.lines[0][name].score for name in ("inner", "ball", "cage"))
    for k in (1, 2, 3):
        assert depth(found, k * lines.bpfo) > 50.0
        for side in (-CWRU_SPEED, CWRU_SPEED):
            # No more than noise, of which the largest of some bins is taken.
            assert depth(found, k * lines.bpfo + side) < 5.0


def test_inner_race_makes_lines_of_bpfi_and_of_the_shaft_beside_them() -> None:
    found, lines = simulated("inner"), kinematics(BEARING, CWRU_SPEED)
    assert found.lines[0]["inner"].detected
    assert found.lines[0]["inner"].score > 3.0 * found.lines[0]["outer"].score
    for line in (CWRU_SPEED, 2.0 * CWRU_SPEED, *(k * lines.bpfi + m * CWRU_SPEED for k in (1, 2) for m in (-1, 0, 1))):
        assert depth(found, line) > 10.0
    # The direction of the sensor adds the double of the shaft's frequency (Eq. 30).
    assert depth(found, lines.bpfi - 2.0 * CWRU_SPEED) > 10.0


def test_ball_makes_lines_of_twice_bsf_and_of_the_cage_beside_them() -> None:
    found, lines = simulated("ball"), kinematics(BEARING, CWRU_SPEED)
    assert found.lines[0]["ball"].detected
    for line in (2.0 * lines.ftf, *(2.0 * lines.bsf + m * lines.ftf for m in (-2, 0, 2))):
        assert depth(found, line) > 10.0


def test_a_turning_load_modulates_the_outer_race_instead() -> None:
    outer, inner = simulated("outer", load_turns=True), simulated("inner", load_turns=True)
    lines = kinematics(BEARING, CWRU_SPEED)
    assert depth(outer, CWRU_SPEED) > 50.0
    assert depth(outer, lines.bpfo + CWRU_SPEED) > 0.2 * depth(outer, lines.bpfo) > 2.0
    assert depth(inner, CWRU_SPEED) < 0.1 * depth(simulated("inner"), CWRU_SPEED)


# Fig. 12 in kind, and section 7.


def recording(data_dir: Path, name: str) -> NDArray[np.float64]:
    content = loadmat(data_dir / "cwru" / f"{name}.mat")
    signal = next(value for key, value in content.items() if key.endswith("DE_time"))
    return STANDARD_GRAVITY * np.asarray(signal, np.float64).ravel()[: int(RATE * DURATION)]


def on_the_inner_race(size: float) -> Scene:
    """The drive end of that rig with a defect of a diameter, m."""
    scene = inner_race_scene()
    defect = replace(scene.defects[0], dphi_d=scene.defects[0].dphi_d * size / DEFECT_SIZE)
    return replace(scene, speed=CWRU_SPEED, rig=DAMPED, defect=defect)


def calibrated(data_dir: Path) -> RingImpactRig:
    x = features(recording(data_dir, "209_0"), CWRU_SPEED).indicators
    measured = MeasuredLevel(x.rms, x.kurtosis)
    return made_once("sassi_rig", lambda: calibrate(on_the_inner_race(0.53e-3), measured, REQUEST))


@pytest.mark.real
def test_figure_12_in_kind(data_dir: Path) -> None:
    """QUAL: lines of BPFI and 2 BPFI, the shaft's line and sidebands stand in both envelope spectra."""
    measured = features(recording(data_dir, "209_0"), CWRU_SPEED)
    scene = replace(on_the_inner_race(0.53e-3), rig=calibrated(data_dir))
    ours = features(solve(scene, REQUEST).acceleration(RATE, DURATION), CWRU_SPEED)
    for found in (measured, ours):
        assert found.lines[0]["inner"].detected
        bpfi = found.lines[0]["inner"].fundamental
        for line in (CWRU_SPEED, *(k * bpfi + m * CWRU_SPEED for k in (1, 2) for m in (-1, 0, 1))):
            assert depth(found, line) > 8.0
    # The fifth line of the cage stands 0.4 % from twice the shaft, and is taken for it.
    assert max(ours.lines[0], key=lambda name: ours.lines[0][name].score if name != "cage" else 0.0) == "inner"
    assert max(measured.lines[0], key=lambda name: measured.lines[0][name].score) == "inner"
    # Section 7: RMS and kurtosis are met by construction; the others were free.
    for name, tolerance in (("rms", 0.02), ("kurtosis", 0.1), ("shape_factor", 0.1), ("crest_factor", 0.4)):
        assert getattr(ours.indicators, name) == pytest.approx(getattr(measured.indicators, name), rel=tolerance)


@pytest.mark.real
def test_size_of_another_defect_is_not_predicted_without_the_impacting_coefficient(data_dir: Path) -> None:
    """NO: the default K_imp = 1 makes 0.18 mm as strong as 0.53 mm; measured is about half."""
    rig = calibrated(data_dir)
    small = solve(replace(on_the_inner_race(0.18e-3), rig=rig), REQUEST).rms
    large = solve(replace(on_the_inner_race(0.53e-3), rig=rig), REQUEST).rms
    ratio = (
        features(recording(data_dir, "105_0"), CWRU_SPEED).rms / features(recording(data_dir, "209_0"), CWRU_SPEED).rms
    )
    assert ratio == pytest.approx(0.55, abs=0.02)
    assert small / large == pytest.approx(1.0, abs=0.01)

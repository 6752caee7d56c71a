"""Scaling the model of impacts on rings to a machine, which here is the same model with other gain and noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Scene
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.ring_impact.solver import Addition, MeasuredLevel, calibrate, noise_level, noise_to_add
from models.solve.simulate import simulate
from models.words.request import Request

RIG = RingImpactRig(k_impact=60.0, c_of=100.0, c_if=100.0)
DEFECT = Defect(0.03, 1e-3, part="inner")
SCENE = Scene(30.0, 1000.0, bearing=from_catalogue("6205"), rig=RIG, defect=DEFECT)
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
    noise = 0.5 * float(np.std(record(SCENE))) / 50.0
    return replace(RIG, gain=0.02, slip_noise=noise / noise_level(SCENE, 1.0), noise_seed=17)


def test_gain_and_noise_of_a_machine_are_found_and_predict_its_other_defects() -> None:
    there = machine()
    found = calibrate(SCENE, measured(replace(SCENE, rig=there)), REQUEST)
    assert found.gain == pytest.approx(there.gain, rel=0.02)
    assert found.slip_noise == pytest.approx(there.slip_noise, rel=0.05)
    for change in (
        {"defect": replace(DEFECT, dphi_d=0.1)},
        {"defect": replace(DEFECT, part="outer")},
        {"load": 3000.0},
        {"speed": 45.0},
    ):
        other = replace(SCENE, **change)
        ours, theirs = measured(replace(other, rig=found)), measured(replace(other, rig=there))
        assert ours.rms == pytest.approx(theirs.rms, rel=0.02)
        assert ours.kurtosis == pytest.approx(theirs.kurtosis, rel=0.1)


@pytest.mark.parametrize("addition", ["quadrature", "linear"])
def test_known_noise_leaves_the_impacts_the_rest(addition: Addition) -> None:
    alone = float(np.std(record(SCENE)))
    found = calibrate(SCENE, MeasuredLevel(5.0, noise=3.0), REQUEST, addition=addition)
    impacts = 4.0 if addition == "quadrature" else 2.0
    assert found.gain == pytest.approx(impacts / alone, rel=1e-3)
    assert noise_level(replace(SCENE, rig=found)) == pytest.approx(3.0, rel=1e-9)
    assert float(np.std(record(replace(SCENE, rig=found)))) == pytest.approx(math.hypot(impacts, 3.0), rel=0.03)


def test_rms_alone_is_all_impacts() -> None:
    found = calibrate(SCENE, MeasuredLevel(5.0), REQUEST)
    assert found.slip_noise == 0.0
    assert float(np.std(record(replace(SCENE, rig=found)))) == pytest.approx(5.0, rel=1e-3)


def test_noise_that_makes_up_an_rms() -> None:
    assert noise_to_add(5.0, 4.0) == pytest.approx(3.0)
    assert noise_to_add(5.0, 4.0, "linear") == pytest.approx(1.0)
    assert noise_to_add(5.0, 5.0) == 0.0
    with pytest.raises(ValueError, match="exceeds the measured one"):
        noise_to_add(4.0, 5.0)


def test_what_cannot_be_calibrated_is_refused() -> None:
    with pytest.raises(ValueError, match="it is not hit"):
        calibrate(replace(SCENE, load=0.0), MeasuredLevel(5.0), REQUEST)
    with pytest.raises(ValueError, match="does not lie between that of noise"):
        calibrate(SCENE, MeasuredLevel(5.0, kurtosis=500.0), REQUEST)
    with pytest.raises(ValueError, match="rms"):
        MeasuredLevel(0.0)
    with pytest.raises(ValueError, match="kurtosis"):
        MeasuredLevel(1.0, 0.9)
    with pytest.raises(ValueError, match="noise"):
        MeasuredLevel(1.0, noise=1.0)

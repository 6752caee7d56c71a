"""The band that is found on real recordings, and what the fault lines look like in it.

The files and their measured lines are described in the README of the recordings; rates and speeds are those it gives.
"""

from __future__ import annotations

import io
import tarfile
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import loadmat

from models.machine.bearing import Bearing, kinematics
from monitor.health.signal.bands import candidate_bands, find_band
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from streams.types.block import STANDARD_GRAVITY
from tests.support.effort import effort_count

pytestmark = pytest.mark.real

DRIVE_END = Bearing("6205-2RS", 9, 0.3126, 1.537)
NICE = Bearing("NICE", 8, 0.235, 1.245)
PRONOSTIA = Bearing("PRONOSTIA", 13, 3.5, 25.6)

FAULTY = [
    ("cwru/105_0.mat", "inner"),
    ("cwru/130@6_0.mat", "outer"),
    ("cwru/209_0.mat", "inner"),
    ("mfpt/InnerRaceFault_vload_1.mat", "inner"),
    ("mfpt/InnerRaceFault_vload_4.mat", "inner"),
    ("mfpt/OuterRaceFault_vload_1.mat", "outer"),
    ("mfpt/OuterRaceFault_vload_5.mat", "outer"),
    ("hit_sm_mfs/IR5_1200.mat", "inner"),
    ("hit_sm_mfs/OR8_1200.mat", "outer"),
]
HEALTHY = ["cwru/97_Normal_0.mat", "hit_sm_mfs/Normal_1200.mat"]


def recording(path: Path) -> tuple[NDArray[np.float64], float, dict[str, float]]:
    """The first five seconds of a recording, its rate and its fundamental frequencies."""
    content = loadmat(path)
    if path.parent.name == "mfpt":
        inner = content["bearing"][0, 0]
        rate, bearing, speed, x = float(inner["sr"].ravel()[0]), NICE, float(inner["rate"].ravel()[0]), inner["gs"]
    elif path.parent.name == "cwru":
        x = next(value for name, value in content.items() if name.endswith("DE_time"))
        rate, bearing, speed = 48_000.0 if "Normal" in path.name else 12_000.0, DRIVE_END, 1797.0 / 60.0
    else:
        x = next(value for name, value in content.items() if not name.startswith("__"))
        rate, bearing, speed = 51_200.0, DRIVE_END, 20.0
    lines = fundamentals(kinematics(bearing, speed))
    return np.asarray(x, np.float64).ravel()[: int(5.0 * rate)], rate, lines


def modulation(features: BlockFeatures, fault: str) -> float:
    """Root of the sum of squares of the modulation depths of a family's lines."""
    return float(np.linalg.norm(features.families[0][fault].amplitude))


@pytest.mark.parametrize(("name", "fault"), FAULTY)
def test_the_band_found_shows_the_fault_about_as_well_as_the_whole_range_or_better(
    data_dir: Path, name: str, fault: str
) -> None:
    x, rate, lines = recording(data_dir / name)
    band = find_band([x], rate, lines)
    found = block_features(x, rate, FeatureSettings(rate, (band,), lines))
    whole = block_features(x, rate, FeatureSettings(rate, ((0.005 * rate, 0.49 * rate),), lines))
    assert found.lines[0][fault].detected
    # A narrower band has less noise but also fewer independent samples: depth is won at some cost in contrast.
    contrast = found.lines[0][fault].score / whole.lines[0][fault].score
    depth = modulation(found, fault) / modulation(whole, fault)
    assert contrast > 0.9
    assert contrast * depth > 0.8
    best = max(found.lines[0], key=lambda family: found.lines[0][family].score)
    assert best == fault


@pytest.mark.parametrize("name", HEALTHY)
def test_a_healthy_machine_keeps_the_whole_range(data_dir: Path, name: str) -> None:
    x, rate, lines = recording(data_dir / name)
    assert find_band([x], rate, lines) == candidate_bands(rate, lines["inner"])[0]


@pytest.mark.skipif(effort_count(quick=1, full=0) == 1, reason="751 files; SPALLWATCH_EFFORT=full runs it")
def test_a_band_learned_while_healthy_shows_the_fault_that_comes(data_dir: Path) -> None:
    lines, rate = fundamentals(kinematics(PRONOSTIA, 27.5)), 25_600.0
    wanted = [*range(20, 80), *range(736, 752)]
    records: dict[int, NDArray[np.float64]] = {}
    with tarfile.open(data_dir / "femto" / "Bearing2_4.tar.bz2") as archive:
        for member in archive:
            name = Path(member.name).name
            if name.startswith("acc_") and int(name[4:9]) in wanted:
                stream = archive.extractfile(member)
                assert stream is not None
                text = np.loadtxt(io.BytesIO(stream.read()), delimiter=",", usecols=4)
                records[int(name[4:9])] = text * STANDARD_GRAVITY
    band = find_band([records[k] for k in wanted[:60]], rate, lines)
    settings = FeatureSettings(rate, (band,), lines, speed=27.5, average_blocks=16)
    found: list[BlockFeatures] = []
    for part in (wanted[40:60], wanted[60:76]):
        features: BlockFeatures | None = None
        for k in part:
            features = block_features(records[k], rate, settings, features and features.recent)
        assert features is not None
        found.append(features)
    before, after = found
    assert after.families[0]["outer"].score > 2.0 * after.families[0]["outer"].threshold
    assert after.speed_factor == pytest.approx(155.0 / lines["outer"], abs=0.01)
    assert after.lines[0]["outer"].total > 3.0 * before.lines[0]["outer"].total
    assert not before.families[0]["outer"].detected

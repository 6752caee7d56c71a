"""The real recordings: counts, rates, units, speeds and samples, against their README and a slow parse."""

from __future__ import annotations

import lzma
import tarfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_array_equal

from streams.open import open_source
from streams.types.block import Block
from streams.types.spec import ChannelSpec, SourceSpec
from tests.oracles.text_oracle import parse_slowly
from tests.support.effort import effort_count

pytestmark = pytest.mark.real

FULL_ONLY = pytest.mark.skipif(effort_count(quick=1, full=0) == 1, reason="515 files and more: SPALLWATCH_EFFORT=full")


def blocks(path: Path, **settings: Any) -> list[Block]:
    items = list(open_source(SourceSpec("test", str(path), **settings)))
    assert all(isinstance(item, Block) for item in items), [item for item in items if not isinstance(item, Block)]
    return [item for item in items if isinstance(item, Block)]


def slow_members(path: Path, wanted: set[str]) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    with tarfile.open(path) as archive:
        for member in archive:
            stream = archive.extractfile(member) if member.name in wanted else None
            if stream is not None:
                found[member.name] = stream.read()
            if len(found) == len(wanted):
                break
    return found


@pytest.mark.parametrize(
    ("name", "count", "speed", "load"),
    [
        pytest.param("Bearing1_1.tar.bz2", 2803, 30.0, 4000.0, marks=FULL_ONLY),
        # In quick effort test_bands reads the first of these archives, and test_pronostia the second.
        pytest.param("Bearing2_4.tar.bz2", 751, 27.5, 4200.0, marks=FULL_ONLY),
        pytest.param("Bearing3_1.tar.xz", 515, 25.0, 5000.0, marks=FULL_ONLY),
        ("Bearing2_7.tar.xz", 230, 27.5, 4200.0),
    ],
)
def test_pronostia_runs(data_dir: Path, name: str, count: int, speed: float, load: float) -> None:
    found = blocks(data_dir / "femto" / name)
    assert len(found) == count
    assert [block.sequence for block in found] == list(range(1, len(found) + 1))
    # The stamps of 2122 and 2123 of Bearing1_1 are wrong by hours; the time of a block comes from its number alone.
    assert [block.elapsed for block in found] == [10.0 * i for i in range(len(found))]
    assert {block.samples.shape for block in found} == {(2, 2560)}
    assert {(block.rate, block.speed, block.load, block.units) for block in found} == {
        (25600.0, speed, load, ("g", "g"))
    }
    assert len({block.content_hash for block in found}) == len(found)
    folder = name.partition(".")[0]
    chosen = {f"{folder}/acc_{number:05d}.csv": number for number in (1, 2, 97, 200)}
    for path, data in slow_members(data_dir / "femto" / name, set(chosen)).items():
        block = found[chosen[path] - 1]
        assert block.name == path
        assert_array_equal(block.samples, parse_slowly(data, ",")[4:].astype(np.float32))


def test_count_of_an_archive_needs_no_iteration(data_dir: Path) -> None:
    assert len(open_source(SourceSpec("test", str(data_dir / "femto" / "Bearing2_7.tar.xz")))) == 230


@pytest.mark.parametrize(
    ("name", "rate", "rpm", "channels"),
    [
        ("97_Normal_0", 48000, 1796, 2),
        ("105_0", 12000, 1797, 3),
        ("118_0", 12000, 1796, 3),
        ("130@6_0", 12000, 1796, 3),
        ("209_0", 12000, 1797, 3),
    ],
)
def test_cwru(data_dir: Path, name: str, rate: float, rpm: float, channels: int) -> None:
    path = data_dir / "cwru" / f"{name}.mat"
    (block,) = blocks(path, block_s="file")
    assert (block.rate, block.units, block.elapsed, block.start) == (rate, ("g",) * channels, 0, None)
    assert block.channels == ("drive_end", "fan_end", "base")[:channels]
    assert block.speed == pytest.approx(rpm / 60)
    loaded = scipy.io.loadmat(path)
    for row, end in zip(block.samples, ("DE", "FE", "BA"), strict=False):
        (key,) = [key for key in loaded if key.endswith(f"_{end}_time")]
        assert_array_equal(row, loaded[key].ravel())
    (pattern,) = blocks(path, block_s="file", channels=(ChannelSpec("de", key="X*_DE_time", unit="g"),))
    assert_array_equal(pattern.samples[0], block.samples[0])


@pytest.mark.parametrize(
    ("name", "pounds"),
    [
        ("InnerRaceFault_vload_1", 0),
        ("InnerRaceFault_vload_4", 150),
        ("OuterRaceFault_vload_1", 25),
        ("OuterRaceFault_vload_5", 200),
    ],
)
def test_mfpt(data_dir: Path, name: str, pounds: float) -> None:
    (block,) = blocks(data_dir / "mfpt" / f"{name}.mat", block_s="file")
    assert block.samples.shape == (1, 146484)
    assert (block.rate, block.units, block.speed) == (48828, ("g",), 25)
    assert block.load == pytest.approx(pounds * 4.4482216152605)
    loaded = scipy.io.loadmat(data_dir / "mfpt" / f"{name}.mat")["bearing"]["gs"][0, 0]
    assert_array_equal(block.samples[0], loaded.ravel())


@pytest.mark.parametrize("name", ["IR5_1200", "Normal_1200", "OR8_1200"])
def test_hit_sm(data_dir: Path, name: str) -> None:
    (block,) = blocks(data_dir / "hit_sm_mfs" / f"{name}.mat", block_s="file")
    assert block.samples.shape == (1, 262144)
    assert (block.rate, block.units, block.speed, block.load) == (51200, ("unknown",), 20, None)


def test_ims(data_dir: Path) -> None:
    found = blocks(data_dir / "ims_samples")
    assert [block.samples.shape[0] for block in found] == [8, 8, 4, 4, 4]
    assert {(block.samples.shape[1], block.rate) for block in found} == {(20480, 20000.0)}
    assert found[0].start == datetime(2003, 10, 22, 12, 6, 24, tzinfo=UTC).timestamp()
    assert found[0].elapsed == 0
    assert found[3].elapsed == pytest.approx((found[3].start or 0) - (found[0].start or 0))
    for block in found:
        data = lzma.decompress((data_dir / "ims_samples" / block.name).read_bytes())
        assert_array_equal(block.samples, parse_slowly(data, "\t").astype(np.float32))
    # The machine had been stopped when the last file of the second test was written.
    assert np.std(found[-1].samples) < 0.002

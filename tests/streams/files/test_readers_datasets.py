"""Paderborn and Ferrara: files made after the descriptions, as none of them is at hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_array_equal

from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.spec import ChannelSpec, SourceError, SourceSpec


def paderborn(path: Path, channels: dict[str, Any]) -> Path:
    records = np.zeros(
        (1, len(channels)), dtype=[("Name", object), ("Type", object), ("Data", object), ("Raster", object)]
    )
    for index, (name, data) in enumerate(channels.items()):
        records[0, index] = (name, "double", np.atleast_2d(data), "HostService")
    scipy.io.savemat(path, {path.stem: {"Info": "x", "X": np.zeros((1, 3)), "Y": records, "Description": "d"}})
    return path


def test_paderborn_is_recognised_by_its_names(tmp_path: Path) -> None:
    vibration = np.random.default_rng(0).normal(size=6400)
    others = {"force": np.full(400, 1000.0), "phase_current_1": np.zeros(6400), "speed": np.full(400, 1500.0)}
    for number in (2, 10, 1):
        paderborn(tmp_path / f"N15_M07_F10_K001_{number}.mat", {**others, "vibration_1": vibration + number})
    blocks = list(open_source(SourceSpec("s", str(tmp_path))))
    assert [item.name for item in blocks] == [f"N15_M07_F10_K001_{number}.mat" for number in (1, 2, 10)]
    for item, number in zip(blocks, (1, 2, 10), strict=True):
        assert isinstance(item, Block)
        assert_array_equal(item.samples, [vibration + number])
        assert (item.rate, item.speed, item.load) == (64000.0, 25.0, 1000.0)
        assert (item.channels, item.units) == (("vibration_1",), ("unknown",))


@pytest.mark.parametrize(
    ("channels", "status"),
    [
        ({"force": np.ones(9)}, "wrong_shape"),
        ({"vibration_1": np.zeros((1, 0))}, "empty"),
        ({"vibration_1": "x"}, "wrong_shape"),
    ],
)
def test_paderborn_without_a_vibration(channels: dict[str, Any], status: str, tmp_path: Path) -> None:
    path = paderborn(tmp_path / "N09_M07_F10_KA01_1.mat", {**channels, "torque": np.ones(5)})
    (item,) = open_source(SourceSpec("s", f"dataset:paderborn:{path}"))
    assert isinstance(item, Rejected)
    assert item.status == status


@pytest.mark.parametrize(
    ("name", "rate", "speed", "load"),
    [
        ("D1_a_1000N_20Hz.txt", 51200.0, 20.0, 1000.0),
        ("D2a_2000N_30Hz.txt", 25600.0, 30.0, 2000.0),
        ("D2.b 2000 N 40 Hz.txt", 51200.0, 40.0, 2000.0),
        ("D3c/1000N/20Hz/signal.txt", 51200.0, 20.0, 1000.0),
    ],
)
def test_ferrara(name: str, rate: float, speed: float, load: float, tmp_path: Path) -> None:
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    samples = np.round(np.random.default_rng(1).normal(size=int(rate)), 6)
    path.write_text("\n".join(map(str, samples)) + "\n")
    (tmp_path / "readme.txt").write_text("Acceleration signals")
    channel = ChannelSpec("casing", unit="g")
    (block,) = open_source(SourceSpec("s", f"dataset:ferrara:{tmp_path}", block_s=1.0, channels=(channel,)))
    assert isinstance(block, Block)
    assert (block.rate, block.speed, block.load) == (rate, speed, load)
    assert_array_equal(block.samples[0], samples)


def test_ferrara_does_not_guess(tmp_path: Path) -> None:
    (tmp_path / "signal_01.txt").write_text("1.0\n2.0\n")
    url = f"dataset:ferrara:{tmp_path}"
    with pytest.raises(SourceError, match="rate_hz is missing"):
        open_source(SourceSpec("s", url, channels=(ChannelSpec("casing", unit="g"),)))
    with pytest.raises(SourceError, match="with its unit is missing"):
        open_source(SourceSpec("s", url, rate=51200.0))

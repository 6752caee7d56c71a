"""Rows of a tacho among those of a file: told by their samples, or by their titles where these allow it."""

from __future__ import annotations

import io
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from monitor.commands.init.command import command
from monitor.config.load import load_config
from monitor.service.setup import open_configured
from streams.files.sidecar import pulse_pattern
from streams.files.survey import surveyed_rows
from streams.types.block import Block
from streams.types.samples import Samples
from tests.streams.format_makers import hdf5_bytes

RATE = 2000.0
TIME = np.arange(4000) / RATE
NOISE = np.random.default_rng(0).normal(size=TIME.size)
PHASE = 25.0 * TIME + 0.51
TWO = np.where(PHASE % 1.0 < 0.1, 5.0, 0.0) + 0.02 * NOISE
NARROW = np.exp(-(((PHASE % 1.0) - 0.5) ** 2) / 2e-4)
ROWS = {
    "two levels without a name": ("column_2", TWO, "tacho", 50),
    "two levels, German": ("Drehgeber", TWO, "tacho", 50),
    "two levels that are called rpm": ("rpm", TWO, "tacho", 50),
    "narrow pulses of a keyphasor": ("Keyphasor [V]", NARROW, "tacho", 50),
    "narrow pulses, Italian": ("contagiri", NARROW, "tacho", 50),
    "narrow pulses without a name": ("ch2", NARROW, "tacho", 50),
    "a vibration that is a sine": ("ch2", np.sin(2 * np.pi * 25.0 * TIME), "vibration", None),
    "noise that is clipped": ("ch2", np.clip(NOISE, -0.5, 0.5), "vibration", None),
    "noise": ("ch2", NOISE, "vibration", None),
    "a tacho that stands": ("Trigger", 0.01 * NOISE, "tacho", 0),
    "samples that alternate": ("ch2", np.where(np.arange(4000) % 2, 1.0, -1.0), "vibration", None),
    "a dead row": ("ch2", np.zeros(TIME.size), "vibration", None),
    "the speed over time": ("tacho", 1500.0 + NOISE, "speed", None),
    "rpm": ("n [rpm]", 1500.0 + NOISE, "speed", None),
    "giri al minuto": ("giri/min", 1500.0 + NOISE, "speed", None),
    "an index of samples": ("index", np.arange(4000.0), "index", None),
    "a switch": ("door", (TIME > 1.0).astype(float), "other", None),
}


@pytest.mark.parametrize("case", ROWS)
def test_rows_are_told_apart(case: str) -> None:
    title, row, kind, pulses = ROWS[case]
    names = ("acc", title)
    first, found = surveyed_rows(Samples(np.vstack([NOISE, row]), names=names, channels=names), None, RATE)
    assert first.kind == "vibration"
    assert found.kind == kind
    assert (None if found.tacho is None else found.tacho.pulses) == pulses
    if pulses:
        assert found.tacho is not None
        assert found.tacho.per_second == pytest.approx(25.0, rel=0.03)


def test_rows_of_a_data_set_are_what_it_says() -> None:
    (found,) = surveyed_rows(Samples(TWO[np.newaxis], names=("x",)), "g", RATE)
    assert (found.kind, found.tacho) == ("vibration", None)


def test_files_of_pulses_are_told_by_their_names() -> None:
    assert pulse_pattern(["a.tdms", "a.pulses.csv", "b.tdms"]) == "{stem}.pulses.csv"
    assert pulse_pattern(["run/a.csv", "run/a.tacho"]) == "{stem}.tacho"
    assert pulse_pattern(["a.pulses.csv", "b.pulses.csv"]) is None
    assert pulse_pattern(["a.csv", "b.pulses.csv"]) is None


def init(folder: Path, monkeypatch: pytest.MonkeyPatch, *options: str) -> tuple[str, Block]:
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(
        command, ["in", "--bearing", "6205", "--unit", "g", "--start-utc", "2024-05-01", "--yes", *options]
    )
    assert done.exit_code == 0, done.output
    config = load_config(folder / "config.toml")
    block = next(iter(open_configured(config, config.source[0])))
    assert isinstance(block, Block), block
    return done.output, block


def test_init_offers_a_row_of_pulses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "in").mkdir()
    rows = "".join(f"{t:.4f},{a:.4f},{b:.3f}\n" for t, a, b in zip(TIME, NOISE, TWO, strict=True))
    (tmp_path / "in" / "a.csv").write_text(f"time,acc,Trigger\n{rows}")
    said, block = init(tmp_path, monkeypatch, "--pulses-per-revolution", "2")
    assert "a tacho, 50 pulses in the first file" in said
    config = load_config(tmp_path / "config.toml")
    assert (config.operating.tacho_channel, config.operating.pulses_per_revolution) == ("Trigger", 2)
    assert config.operating.speed_hz is None
    assert [channel.name for channel in config.channel] == ["acc"]
    assert block.channels == ("acc", "Trigger")
    assert "problem" not in said


def test_init_offers_files_of_pulses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "in").mkdir()
    rows = "".join(f"{t:.4f},{a:.4f}\n" for t, a in zip(TIME, NOISE, strict=True))
    (tmp_path / "in" / "a.csv").write_text(f"time,acc\n{rows}")
    (tmp_path / "in" / "a.pulses.csv").write_text("pulses\n" + "".join(f"{0.01 + k / 25:.4f}\n" for k in range(50)))
    said, block = init(tmp_path, monkeypatch)
    assert "pulses of a tacho: {stem}.pulses.csv beside the files" in said
    assert "left out" not in said
    assert block.pulses is not None
    assert block.pulses.times.size == 50
    assert "problem" not in said


@pytest.mark.parametrize("good", [True, False])
def test_init_offers_an_array_of_pulses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, good: bool) -> None:
    (tmp_path / "in").mkdir()
    for number in range(2):
        stream = io.BytesIO(hdf5_bytes(NOISE[np.newaxis].astype(np.float32), RATE))
        with h5py.File(stream, "a") as file:
            times = 0.01 + np.arange(50) / 25.0
            file.create_dataset("Tacho/times", data=times if good else -times).attrs["unit"] = "s"
        (tmp_path / "in" / f"{number}.h5").write_bytes(stream.getvalue())
    said, block = init(tmp_path, monkeypatch, *(() if good else ("--speed-hz", "25")))
    assert (block.pulses is not None) == good
    assert ("pulses of a tacho: Tacho/times in the files" in said) == good

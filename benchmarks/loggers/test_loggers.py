"""What is drawn stands in the files; what is wrong is called wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import soundfile
from numpy.testing import assert_allclose

from benchmarks.common import effort_count
from benchmarks.loggers.fuzz import MUTATIONS, base, run, verdict
from benchmarks.loggers.generate import generate
from benchmarks.loggers.judge import ASKED, MISSED, REFUSED, RIGHT, WRONG, configuration_of, judge
from benchmarks.loggers.plan import GRAVITY, PER_UNIT, LoggerTruth, TrueChannel, TrueFile, read_truth
from benchmarks.loggers.shapes import FILE, SPELLINGS
from benchmarks.loggers.trial import judged
from benchmarks.loggers.ways import BlockRead, Came

TRUTH = LoggerTruth(
    0,
    "csv",
    4096.0,
    [TrueChannel("a"), TrueChannel("b")],
    [TrueFile(["x.csv"], 1e9, [1.0, 2.0]), TrueFile(["y.csv"], 1e9 + 60, [1.0, 2.0], lost="zeros")],
)
CHANNELS = [{"name": "a", "unit": "g"}, {"name": "b", "unit": "g"}]


def came(**changes: object) -> Came:
    blocks = [
        BlockRead("x.csv", "ok", "", frozenset(), 1e9, {"a": 1.0, "b": 2.0}),
        BlockRead("y.csv", "nan", "samples are lost", frozenset(), 1e9 + 60, {"a": float("nan"), "b": float("nan")}),
    ]
    changed = replace(blocks[0], **changes)  # pyright: ignore[reportArgumentType]
    return Came([changed, blocks[1]], rate=4096.0, channels=CHANNELS)


def test_right_where_all_is_as_it_was_written() -> None:
    assert judge(TRUTH, came()).word == RIGHT


@pytest.mark.parametrize(
    ("changes", "fact"),
    [({"rms": {"a": 1.0, "b": 2.01}}, "level"), ({"rms": {"a": 2.0, "b": 1.0}}, "level"), ({"time": 1e9 + 1}, "times")],
)
def test_silently_wrong(changes: dict[str, object], fact: str) -> None:
    assert judge(TRUTH, came(**changes)).facts[fact] == WRONG


def test_a_flag_of_the_clock_is_a_doubt_of_the_time_alone() -> None:
    doubted = came(time=1e9 + 1, flags=frozenset({"clock"}))
    assert judge(TRUTH, doubted).word == RIGHT
    assert judge(TRUTH, came(rms={"a": 1.1, "b": 2.0}, flags=frozenset({"clock"}))).facts["level"] == WRONG


def test_words_for_what_is_not_read() -> None:
    assert judge(TRUTH, came(time=None)).facts["times"] == MISSED
    assert judge(TRUTH, Came(refused="x.csv: line 3")).word == REFUSED
    asked = replace(came(), asked=["--unit"])
    assert judge(TRUTH, asked).facts["level"] == ASKED
    filled = came()
    filled.blocks[1] = BlockRead("y.csv", "ok", "", frozenset(), 1e9 + 60, {"a": 0.9, "b": 1.9})
    assert judge(TRUTH, filled).facts["level"] == WRONG
    filled.blocks[1] = replace(filled.blocks[1], flags=frozenset({"filled"}))
    assert judge(TRUTH, filled).word == RIGHT
    one = replace(came(), channels=CHANNELS[:1])
    assert judge(TRUTH, one).facts["channels"] == WRONG


def test_a_seed_gives_the_same_files(tmp_path: Path) -> None:
    first, again = generate(18, tmp_path / "a"), generate(18, tmp_path / "b")
    assert first == again
    assert read_truth(tmp_path / "a" / "truth.json").files == first.files
    path = first.files[0].paths[0]
    assert (tmp_path / "a" / "data" / path).read_bytes() == (tmp_path / "b" / "data" / path).read_bytes()


@pytest.mark.parametrize("seed", [24, 35, 45])
def test_levels_of_the_truth_are_those_of_the_files(tmp_path: Path, seed: int) -> None:
    truth = generate(seed, tmp_path / "logger")
    path, channel = tmp_path / "logger" / "data" / truth.files[0].paths[0], truth.channels[0]
    if truth.format == "wav":
        samples, rate = soundfile.read(path)
        stored = samples * GRAVITY * (channel.scale or 1.0)
        assert rate == truth.rate_hz
    elif truth.format == "mat":
        found = scipy.io.loadmat(path)
        found = found["data"][0, 0] if "data" in found else found
        stored = found[channel.key.rpartition(".")[2]][:, channel.column - 1] * PER_UNIT[channel.unit]
    else:
        stored = np.loadtxt(path, skiprows=5)[:, 0] * PER_UNIT[channel.unit]
    assert_allclose(np.std(stored), truth.files[0].rms[0], rtol=1e-4)


def test_a_plain_logger_is_read_in_all_ways(tmp_path: Path) -> None:
    row = judged(24, str(tmp_path))
    assert [row[f"by_{way}"] for way in ("init", "hand", "read")] == [RIGHT] * 3
    assert row["questions"] == ""


def test_the_configuration_by_hand_says_what_no_file_states() -> None:
    unknown = replace(TRUTH, unknowable=["rate"])
    assert "rate_hz = 4096" in (configuration_of(unknown) or "")
    assert "rate_hz" not in (configuration_of(TRUTH) or "")


def test_a_file_of_the_fuzz_is_read_and_one_that_lies_is_found(tmp_path: Path) -> None:
    mutant = base(np.random.default_rng(0), "mat")
    assert verdict(mutant, tmp_path) == (RIGHT, "")
    mutant.shape.at[FILE]["unit"] = {"g": "m/s2", "m/s2": "g"}[mutant.shape.units[0]]
    mutant.shape.at[FILE].pop("units", None)
    assert verdict(mutant, tmp_path)[0] == WRONG


def test_a_contradiction_of_rates_is_one_in_the_file(tmp_path: Path) -> None:
    mutant = MUTATIONS["rate contradicts, same scope"](np.random.default_rng(1), base(np.random.default_rng(1), "hdf5"))
    assert mutant.contradicts
    assert verdict(mutant, tmp_path)[0] == RIGHT
    mutant.contradicts = False
    assert verdict(mutant, tmp_path)[0] == REFUSED


def test_no_statement_is_taken_silently_where_another_contradicts_it() -> None:
    rows, lines = run(effort_count(quick=300, full=10_000), 1, list(SPELLINGS))
    assert sum(row["right"] for row in rows) >= 290
    assert not [line for line in lines if line.startswith(("wrong", "crashed"))]

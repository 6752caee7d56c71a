"""Files of one channel each: told by their names, read together, and never a channel that alternates."""

from __future__ import annotations

import gzip
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import spallwatch as sw
from monitor.commands.init.command import command
from monitor.config.load import load_config
from monitor.service.setup import open_configured
from streams.files.groups import labels_of, members_of, name_groups
from streams.open import open_source
from streams.recording.source import Recording
from streams.types.block import Block, Rejected
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.streams.folders import CHANNELS, RATE, Rig, csv_bytes, noise, verdicts
from tests.streams.makers import tar_file

COUNT = 200


def names(pattern: str, *words: Sequence[object]) -> list[str]:
    return [pattern.format(*found) for found in itertools.product(*words)]


NUMBERS = range(3)
CERTAIN = {
    "numbered channels in folders of dates": (
        ["2024/11/04/081500_ch1.csv.gz", "2024/11/04/081500_ch2.csv.gz"],
        "ch1 ch2",
    ),
    "ends of a machine": (names("{:04d}_{}.tdms", NUMBERS, ["DE", "NDE"]), "DE NDE"),
    "axes": (names("m_{:04d}_{}.wav", NUMBERS, "XYZ"), "X Y Z"),
    "axes behind a word": (names("acc{}_{:04d}.wav", "XYZ", NUMBERS), "accX accY accZ"),
    "letters": (names("{:04d}-{}.h5", NUMBERS, "AB"), "A B"),
    "folders": (names("{}/{:04d}.csv", ["ch1", "ch2"], NUMBERS), "ch1 ch2"),
    "folders below others": (names("press/{}/{:04d}.csv", ["DE", "NDE"], NUMBERS), "DE NDE"),
    "a word in the middle": (names("acc_{}_{:04d}.csv", "hv", NUMBERS), "h v"),
    "a number behind a word": (names("Kanal {} 2024-01-0{}.csv", range(1, 4), range(1, 4)), "1 2 3"),
    "ends and axes": (names("{}_{}_{:04d}.npy", ["DE", "NDE"], "XY", NUMBERS), "DE_X DE_Y NDE_X NDE_Y"),
    "places behind digits": (names("vib{}{}.csv", range(1, 14), ["DE", "NDE"]), "DE NDE"),
    "axes behind digits": (names("{:03d}{}.wav", NUMBERS, "xyz"), "x y z"),
    "in brackets": (names("rec ({}) [{}].csv", range(1, 4), ["DE", "NDE"]), "DE NDE"),
    "behind a plus": (names("rec{}+{}.csv", range(1, 4), "XY"), "X Y"),
    "before an at": (names("{}@{:04d}.csv", ["ch1", "ch2"], NUMBERS), "ch1 ch2"),
    "brackets": (names("vib_{:03d}_[1]_{}.csv", NUMBERS, ["de", "nde"]), "de nde"),
}
SEQUENCES = {
    "dates and times": names("{}_{}.csv", ["20241104", "20241105"], ["081500", "091500"]),
    "numbers": ["1.csv", "2.csv", "3.csv"],
    "runs": names("run{}/{:04d}.csv", range(1, 4), NUMBERS),
    "days": names("{}/{}/{}.csv", ["01", "02"], ["01", "02", "03"], ["a"]),
    "months": names("Nov0{}_{}.csv", range(1, 4), ["0815", "0915"]),
    "logs": ["log1.csv", "log2.csv", "log3.csv"],
    "letters alone": ["a.csv", "b.csv", "c.csv"],
    "conditions": names("{}_{}.csv", ["healthy", "outer", "inner"], ["1000", "2000"]),
    "one channel": names("{}_ch1.csv", ["081500", "091500"]),
    "numbers of one word": names("ch_{:04d}.csv", range(30)),
    "numbers behind one word": names("ch{:04d}.csv", range(8)),
    "numbers behind one word of a folder": names("{}/acc{:03d}.csv", ["a", "e"], range(8)),
    "stamps of Zulu time": names("2024010{}T081500Z.csv", range(1, 5)),
    "parts of runs": names("run{}{}.csv", range(1, 4), "ab"),
    "stamps in points": ["2004.02.12.10.32.39", "2004.02.12.10.42.39"],
}


@pytest.mark.parametrize("case", CERTAIN)
def test_names_of_channels_are_groups(case: str) -> None:
    paths, labels = CERTAIN[case]
    found = name_groups(paths)
    assert found is not None
    assert (found.is_certain, found.is_exact) == (True, True)
    assert labels_of(found.patterns) == tuple(labels.split())
    leads = [path for path in paths if members_of(found.patterns, path)]
    read = [(lead, *members_of(found.patterns, lead)) for lead in leads]
    assert sorted(itertools.chain(*read)) == sorted(paths)


@pytest.mark.parametrize("case", SEQUENCES)
def test_names_of_a_sequence_are_none(case: str) -> None:
    assert name_groups(SEQUENCES[case]) is None


def test_a_number_keeps_the_word_that_it_belongs_to() -> None:
    found = name_groups(CERTAIN["a number behind a word"][0])
    assert found is not None
    assert found.patterns == ("Kanal 1 *.csv", "Kanal 2 *.csv", "Kanal 3 *.csv")


@given(st.permutations(names("log/{:03d}-{}.csv", range(4), ["DE", "NDE"])), st.booleans())
def test_the_order_of_names_does_not_matter(paths: list[str], lost: bool) -> None:
    found = name_groups(paths[lost:])
    assert found is not None
    # Of a pair of four, one may be lost.
    assert (found.is_certain, found.patterns) == (True, ("*-DE.csv", "*-NDE.csv"))
    assert found.is_exact == (not lost)


@pytest.mark.parametrize(
    "paths",
    [
        names("{}_{}.csv", ["081500", "082500", "083500"], [1, 2]),
        names("pump{}/{:04d}.csv", range(1, 3), NUMBERS),
        ["x.csv", "y.csv", "z.csv"],
    ],
)
def test_what_may_be_either_is_asked(paths: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = name_groups(paths)
    assert found is not None
    assert (found.is_certain, found.is_exact) == (False, True)
    for number, path in enumerate(paths):
        put(tmp_path / "data" / path, number)
    monkeypatch.chdir(tmp_path)
    options = ["data", "--yes", "--bearing", "6205", "--speed-hz", "25", "--unit", "g", "--rate-hz", str(RATE)]
    result = CliRunner().invoke(command, options)
    assert result.exit_code != 0
    assert "--files" in str(result.exception)
    for answer, count in (("together", len(found.labels)), ("sequence", 1)):
        result = CliRunner().invoke(command, [*options, "--files", answer, "--force"])
        assert result.exit_code == 0, result.output
        config = load_config(tmp_path / "config.toml")
        blocks = list(open_configured(config, config.source[0]))
        assert [len(block.channels) for block in blocks if isinstance(block, Block)] == [count] * (len(paths) // count)
    remarks = Recording.remarks.fget(recording(tmp_path / "data"))  # pyright: ignore[reportOptionalCall]
    assert any("fall into" in remark for remark in remarks)


def put(path: Path, number: int, count: int = COUNT, head: str = "") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    data = head.encode() + csv_bytes(noise(count, number))
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)


def spec(root: Path, **more: Any) -> SourceSpec:
    base: dict[str, Any] = {"rate": RATE, "block_s": "file", "channels": CHANNELS}
    return SourceSpec(**{"name": "s", "url": f"folder:{root}", **base, **more})


def recording(root: Path, **more: Any) -> Recording:
    found = open_source(spec(root, **more))
    assert isinstance(found, Recording)
    return found


PAIR = ("*_ch1.csv", "*_ch2.csv")
TWO = (ChannelSpec("de", column="ch1", unit="g"), ChannelSpec("nde", column="ch2", unit="g"))


def pairs(root: Path, count: int = 3) -> None:
    for number in range(count):
        put(root / f"{number:04d}_ch1.csv", number)
        put(root / f"{number:04d}_ch2.csv", 100 + number)


def test_groups_are_refused_unless_the_source_says_how_they_are_read(tmp_path: Path) -> None:
    pairs(tmp_path)
    with pytest.raises(SourceError, match=r'2 groups.*files = \["\*_ch1.csv", "\*_ch2.csv"\].*files = "\*"'):
        recording(tmp_path)
    assert len(list(recording(tmp_path, files=("*",)))) == 6
    alone = recording(tmp_path, files=("*_ch2.csv",))
    assert [item.name for item in alone] == [f"{number:04d}_ch2.csv" for number in range(3)]
    assert len(alone.ignored()) == 3
    items = list(recording(tmp_path, files=PAIR, channels=TWO))
    assert [(item.name, getattr(item, "channels", None)) for item in items] == [
        (f"{number:04d}_ch1.csv", ("de", "nde")) for number in range(3)
    ]
    for number, item in enumerate(items):
        assert isinstance(item, Block)
        np.testing.assert_array_equal(item.samples, [noise(COUNT, number), noise(COUNT, 100 + number)])


def test_the_counts_of_files_that_are_read_together(tmp_path: Path) -> None:
    pairs(tmp_path, 2)
    put(tmp_path / "0007_ch2.csv", 7)
    put(tmp_path / "0008_ch1.csv", 8)
    found = recording(tmp_path, files=PAIR, channels=TWO)
    items = list(found)
    assert verdicts(items)[-1] == ("0008_ch1.csv", "incomplete")
    assert isinstance(items[-1], Rejected)
    assert "0008_ch2.csv, which is recorded with it, is not there" in items[-1].reason
    # Nothing reads a second file without its first one.
    assert list(found.ignored()) == ["0007_ch2.csv"]
    assert (found.files().offered, found.files().ignored) == (4, 1)


@pytest.mark.parametrize(
    ("count", "head", "status", "words"),
    [
        (COUNT - 1, "", "wrong_shape", "200 samples, 199 in 0000_ch2.csv"),
        (COUNT, "fs=500\n", "wrong_rate", "0000_ch2.csv"),
        (COUNT, "Start: 2024-01-01T00:00:01Z\n", "wrong_shape", "begins 1 s apart"),
        (COUNT, "Einheit: g\n%%\n\n", "", ""),
    ],
)
def test_files_that_do_not_go_together_are_refused_by_both_names(
    count: int, head: str, status: str, words: str, tmp_path: Path
) -> None:
    own = "Start: 2024-01-01T00:00:00Z\nfs=1000\n"
    put(tmp_path / "0000_ch1.csv", 0, head=own)
    put(tmp_path / "0000_ch2.csv", 1, count, head or own)
    (item,) = recording(tmp_path, files=PAIR, channels=TWO)
    assert verdicts([item]) == [("0000_ch1.csv", status or "accepted")]
    if isinstance(item, Rejected):
        assert words in item.reason


def test_a_dead_first_sensor_makes_no_copies(tmp_path: Path) -> None:
    for number in range(2):
        (tmp_path / f"{number}_ch1.csv").write_bytes(csv_bytes(np.zeros(COUNT)))
        put(tmp_path / f"{number}_ch2.csv", number)
    assert [verdict for _, verdict in verdicts(list(recording(tmp_path, files=PAIR, channels=TWO)))] == ["accepted"] * 2


def test_archives_are_refused_as_folders_are(tmp_path: Path) -> None:
    members = [
        (f"{number}_ch{channel}.csv", csv_bytes(noise(COUNT, number))) for number in (1, 2) for channel in (1, 2)
    ]
    place = tar_file(tmp_path / "x.tar", members)
    with pytest.raises(SourceError, match="fall into 2 groups"):
        open_source(spec(tmp_path, url=str(place)))
    with pytest.raises(SourceError, match="archives have no files beside files"):
        open_source(spec(tmp_path, url=str(place), files=PAIR))


def test_a_watched_folder_reads_pairs_in_any_order_of_arrival(tmp_path: Path) -> None:
    rig = Rig(tmp_path, files=PAIR, channels=TWO)
    put(tmp_path / "0000_ch1.csv", 0)
    assert rig.run(1.5) == []
    put(tmp_path / "0000_ch2.csv", 100)
    assert verdicts(rig.run(4.0)) == [("0000_ch1.csv", "accepted")]
    put(tmp_path / "0001_ch2.csv", 101)
    rig.run(4.0)
    put(tmp_path / "0001_ch1.csv", 1)
    assert verdicts(rig.run(4.0)) == [("0001_ch1.csv", "accepted")]
    assert rig.source.backlog().ignored == 0
    for live, replayed in zip(rig.items, recording(tmp_path, files=PAIR, channels=TWO), strict=True):
        assert isinstance(live, Block)
        assert isinstance(replayed, Block)
        np.testing.assert_array_equal(live.samples, replayed.samples)


def test_a_watched_folder_stops_where_a_second_channel_comes(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    put(tmp_path / "0000_ch1.csv", 0)
    assert len(rig.run(4.0)) == 1
    put(tmp_path / "0000_ch2.csv", 1)
    put(tmp_path / "0001_ch1.csv", 2)
    assert rig.run(6.0) == []
    assert "fall into 2 groups" in (rig.source.problem() or "")
    (tmp_path / "0000_ch2.csv").unlink()
    assert verdicts(rig.run(6.0)) == [("0001_ch1.csv", "accepted")]
    assert rig.source.problem() is None


def test_a_recording_is_grouped_in_python_as_init_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for day in (4, 5):
        for channel in (1, 2):
            put(
                tmp_path / f"2024/11/0{day}/081500_ch{channel}.csv.gz", 10 * day + channel, head="# fs=1000\n# unit=g\n"
            )
    found = list(sw.blocks(tmp_path, block_s="file"))
    assert [list(block.channel.values) for block in found] == [["ch1", "ch2"]] * 2
    np.testing.assert_allclose(found[1].values[1] / 9.80665, noise(COUNT, 52), rtol=1e-6)
    alone = list(sw.blocks(tmp_path, block_s="file", files="*_ch2.csv.gz"))
    assert [block.sizes["channel"] for block in alone] == [1, 1]
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(command, [".", "--yes", "--bearing", "6205", "--speed-hz", "25"])
    assert result.exit_code == 0, result.output
    assert "read together, a channel each" in result.output
    config = load_config(tmp_path / "config.toml")
    assert config.source[0].files == ("*_ch1.csv.gz", "*_ch2.csv.gz")
    blocks = [item for item in open_configured(config, config.source[0]) if isinstance(item, Block)]
    assert [block.channels for block in blocks] == [("ch1", "ch2")] * 2


@pytest.mark.parametrize("patterns", [("*_ch1.csv", "ch2.csv"), ("a*", "a*"), ("",), ("/x*",), ("a?*", "b?*")])
def test_patterns_that_do_not_go_together_are_refused(patterns: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="files: "):
        spec(tmp_path, files=patterns)

"""``spallwatch init``: from the files of five loggers to a configuration with right times and levels."""

from __future__ import annotations

import ast
import json
import os
import shutil
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from examples import loggers
from examples.loggers import LOGGERS, Truth
from monitor.commands.init.command import command
from monitor.config.load import Config, load_config
from monitor.desk.text import _pair
from monitor.service.setup import open_configured
from streams.types.block import STANDARD_GRAVITY, Block, to_si
from tests.support.commands import run_command

ANSWERS = {
    "csv": ["6205-2RS", "1488 rpm"],
    "tdms": ["SKF 6206", "29.5"],
    "wav": ["6205-2RS", "10 V at 100 mV/g"],
    "hdf5": ["9 7.94 39.04", "33,2 Hz"],
    "mat": ["22207", "996 rpm"],
}
"""The two answers that each logger needs; what else is asked takes its default."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, list[Truth]]]:
    folder = tmp_path_factory.mktemp("loggers")
    return folder, loggers.write_all(folder, count=2, seconds=0.25)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def lines_for(kind: str) -> list[str]:
    """Return the lines typed for a logger: its answers where they are asked, else Enter."""
    bearing, second = ANSWERS[kind]
    return [bearing, second, "", ""]


def blocks(config: Config) -> list[Block]:
    found = [item for item in open_configured(config, config.source[0]) if isinstance(item, Block)]
    assert found
    return found


def test_the_generator_imports_nothing_of_the_project() -> None:
    tree = ast.parse(Path(loggers.__file__).read_text(encoding="utf-8"))
    imported = {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    imported |= {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    assert {name.split(".")[0] for name in imported} & {"monitor", "models", "streams", "tests", "benchmarks"} == set()


@pytest.mark.parametrize("kind", LOGGERS)
def test_two_answers_give_right_times_and_levels(
    kind: str, written: tuple[Path, dict[str, list[Truth]]], here: Path
) -> None:
    folder, truth = written
    shutil.copytree(folder / kind, here / kind)
    done = CliRunner().invoke(command, [kind, "--out", "m.toml"], input="\n".join(lines_for(kind)) + "\n")
    assert done.exit_code == 0, done.output
    config = load_config(here / "m.toml")
    assert "problem" not in done.output
    found = blocks(config)
    assert [block.start for block in found] == [pytest.approx(file.start.timestamp()) for file in truth[kind]]
    assert {block.rate for block in found} == {file.rate_hz for file in truth[kind]}
    for block, file in zip(found, truth[kind], strict=True):
        levels = []
        for channel, row, unit in zip(config.channel, block.samples, block.units, strict=True):
            si, _ = to_si(row, unit, channel.scale or 1.0, channel.sensitivity_mv_per_g)
            levels.append(float(np.std(si)) / STANDARD_GRAVITY)
        assert levels == pytest.approx(list(file.rms_g.values()), rel=1e-4)
    checked = run_command("check", "--config", "m.toml", "--json", cwd=here)
    assert checked.returncode == 0
    # Files of 0.25 s: of one logger two lines lie on multiples of 60 Hz, of another the cage turns twice too slowly.
    assert {(found["severity"], found["key"]) for found in json.loads(checked.stdout)["problems"]} <= {
        ("warning", "bearing[bearing]"),
        ("warning", "source[logger].block_s"),
    }


def test_missing_answers_are_listed_all_at_once(written: tuple[Path, dict[str, list[Truth]]], here: Path) -> None:
    np.save(here / "a.npy", np.random.default_rng(1).normal(size=2000))
    done = run_command("init", "a.npy", "--yes", cwd=here)
    assert done.returncode == 2
    assert [word in done.stderr for word in ("--bearing", "--rate-hz", "--unit")] == [True] * 3
    assert not (here / "config.toml").exists()
    answers = ("--bearing", "6205", "--rate-hz", "10 kHz", "--unit", "mV", "--speed-hz", "30")
    done = run_command("init", "a.npy", "--yes", *answers, cwd=here)
    assert done.returncode == 2
    assert "--sensitivity-mv-per-g" in done.stderr
    done = run_command("init", "a.npy", "--yes", "--json", *answers, "--sensitivity-mv-per-g", "100", cwd=here)
    values = json.loads(done.stdout)
    assert {"problems", "out"} <= set(values)
    channel = load_config(here / values["out"]).channel[0]
    assert (channel.unit, channel.scale, channel.sensitivity_mv_per_g) == ("V", 1e-3, 100.0)


def test_an_existing_file_is_replaced_only_when_told(written: tuple[Path, dict[str, list[Truth]]], here: Path) -> None:
    shutil.copytree(written[0] / "tdms", here / "tdms")
    (here / "config.toml").write_text("mine")
    options = ("tdms", "--bearing", "6205", "--speed-hz", "30")
    assert run_command("init", *options, "--yes", cwd=here).returncode == 2
    refused = CliRunner().invoke(command, [*options], input="n\n")
    assert "--force" in str(refused.exception)
    assert (here / "config.toml").read_text() == "mine"
    assert run_command("init", *options, "--yes", "--force", cwd=here).returncode == 0
    assert load_config(here / "config.toml").machine.name == "tdms"
    assert sorted(path.name for path in here.iterdir()) == ["config.toml", "tdms"]


def write_named(folder: Path, *names: str) -> None:
    """Write small CSV files whose header states all but the date."""
    folder.mkdir()
    for index, name in enumerate(names):
        rows = "".join(f"{np.sin(i + index):.4f}\n" for i in range(2000))
        (folder / name).write_text(f"# rate: 1000 Hz\nacc [g]\n{rows}")
        closed = 1704189602.0 + 86400.0 * 500 + 600.0 * index if name[0].isdecimal() else 1704189602.0 + 600.0 * index
        os.utime(folder / name, (closed, closed))


@pytest.mark.parametrize(
    ("names", "answers", "start"),
    [
        (("01-02-2024_10-00-00.csv", "01-02-2024_11-00-00.csv"), ["day_first"], 1706781600.0),
        (("01-02-2024_10-00-00.csv", "01-02-2024_11-00-00.csv"), ["month_first"], 1704189600.0),
        (("01-02-2024_10-00-00.csv", "13-02-2024_10-00-00.csv"), [], 1706781600.0),
        (("240102_1000.csv", "240102_1100.csv"), ["%y%m%d_%H%M"], 1704189600.0),
        (("a.csv", "b.csv"), ["2024-01-02T10:00", "1 h"], 1704189600.0),
        (("a.csv", "b.csv"), ["mtime"], 1704189600.0),
        (("2024-01-02.csv", "2024-01-03.csv"), [], 1704153600.0),
    ],
)
def test_dates_in_names_are_found_or_asked_for(
    names: tuple[str, ...], answers: list[str], start: float, here: Path
) -> None:
    write_named(here / "log", *names)
    typed = "".join(f"{line}\n" for line in answers)
    done = CliRunner().invoke(
        command, ["log", "--bearing", "6205", "--speed-hz", "9", "--load-newton", "400"], input=typed
    )
    assert done.exit_code == 0, done.output
    assert blocks(load_config(here / "config.toml"))[0].start == start


def test_what_cannot_be_true_is_said(here: Path) -> None:
    folder = here / "log"
    folder.mkdir()
    rows = "".join(f"{9.81 + 0.3 * np.sin(i):.4f},{1e6 * np.sin(i):.1f},1500\n" for i in range(3000))
    (folder / "2024-01-02_10-00-00.csv").write_text(f"a (g),b (g),n [rpm]\n{rows}")
    done = run_command("init", "log", "--yes", "--json", "--bearing", "6205", "--rate-hz", "3000", cwd=here)
    assert done.returncode == 2
    problems = "\n".join(json.loads(done.stdout)["problems"])
    assert "problem: " in problems
    assert "channel 'a': its mean is 9.81 g, which is gravity in m/s2" in problems
    assert "channel 'b': an RMS of 7.07e+05 g" in problems
    config = load_config(here / "config.toml")
    assert [channel.name for channel in config.channel] == ["a", "b"]
    (block,) = blocks(config)
    assert config.operating.speed_channel == "n [rpm]"
    assert block.samples[2][0] * config.operating.speed_channel_scale == pytest.approx(25.0)


def test_lost_samples_are_counted(here: Path) -> None:
    values = np.random.default_rng(0).standard_normal(4096)
    for begin in range(0, 4096, 256):
        values[begin : begin + 100] = 0.0
    (here / "a.csv").write_text("acc (g)\n" + "".join(f"{value:.5f}\n" for value in values))
    done = run_command("init", "a.csv", "--yes", "--bearing", "6205", "--speed-hz", "30", "--rate-hz", "4096", cwd=here)
    assert "1600 of 4096 samples are filled with a constant" in done.stdout


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("6206", {"DE": "6206", "NDE": "6206"}),
        ("de=6206; NDE = 9 7.94 39.04", {"DE": "6206", "NDE": "NDE"}),
        ("6206; NDE=6205", {"DE": "6206", "NDE": "6205"}),
    ],
)
def test_each_channel_may_have_its_bearing(
    words: str, expected: dict[str, str], written: tuple[Path, dict[str, list[Truth]]], here: Path
) -> None:
    shutil.copytree(written[0] / "tdms", here / "tdms")
    done = run_command("init", "tdms", "--yes", "--bearing", words, "--speed-hz", "30", cwd=here)
    assert done.returncode == 0, done.stderr
    config = load_config(here / "config.toml")
    assert {channel.name: config.bearing_of(channel).designation for channel in config.channel} == expected


def test_a_bearing_of_no_channel_is_refused(written: tuple[Path, dict[str, list[Truth]]], here: Path) -> None:
    shutil.copytree(written[0] / "tdms", here / "tdms")
    for words, answer in (("XX=6205; 6206", "'XX' is no channel; expected one of DE, NDE"), ("DE=6205", "--bearing: ")):
        done = run_command("init", "tdms", "--yes", "--bearing", words, "--speed-hz", "30", cwd=here)
        assert done.returncode == 2
        assert answer in done.stderr


def test_a_folder_that_holds_the_configuration_stays_clean(here: Path) -> None:
    write_named(here / "log", "2024-01-02_10-00-00.csv")
    done = run_command("init", "--yes", "--bearing", "6205", cwd=here / "log")
    assert done.returncode == 2
    assert "--speed-hz" in done.stderr
    done = run_command("init", "--yes", "--bearing", "6205", "--speed-hz", "estimate", cwd=here / "log")
    assert done.returncode == 0, done.stderr
    config = load_config(here / "log" / "config.toml")
    assert config.machine.state_dir == here / "log" / ".log" / "state"
    assert config.operating.speed == "estimate"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none"], "there is no 'none'"),
        (["empty"], "holds no files"),
        (["text"], "holds nothing that is recognised"),
        (["broken"], "cannot tell"),
        (["log", "--speed-hz", "1770"], "did you mean 1770 rpm"),
        (["log", "--speed-hz", "1,488 rpm"], "can be read as 1.488 or 1488"),
        (["log", "--rate-hz", "25,600"], "can be read as 25.600 or 25600"),
        (["log", "--bearing", "6999"], "not in the catalogue"),
        (["log", "--bearing", "9 40 39"], "number of elements"),
        (["log", "--unit", "mm"], "expected one of g, m/s2, V, unknown, mm/s"),
        (["log", "--start-utc", "01.02.2024"], "2026-01-31T08:00:00Z"),
        (["log", "--time-name", "%Q"], "%Q is not known"),
    ],
)
def test_wrong_input_is_answered_in_words(arguments: list[str], words: str, here: Path) -> None:
    for folder in ("empty", "text", "broken"):
        (here / folder).mkdir()
    (here / "text" / "notes.doc").write_text("no numbers")
    np.save(here / "broken" / "x.npy", np.eye(3))
    write_named(here / "log", "2024-01-02_10-00-00.csv")
    done = run_command(
        "init", *arguments, "--yes", *([] if "--bearing" in arguments else ["--bearing", "6205"]), cwd=here
    )
    assert done.returncode == 2, done.stdout
    assert words in done.stderr
    assert not (here / "config.toml").exists()


def test_exit_codes_of_init_and_check_are_those_of_what_was_written(here: Path) -> None:
    write_named(here / "log", "rec_1.csv", "rec_2.csv")
    options = ("--yes", "--bearing", "6205", "--speed-hz", "9")
    warned = run_command("init", "log", *options, "--json", cwd=here)
    found = json.loads(warned.stdout)["problems"]
    assert (warned.returncode, {text.partition(":")[0] for text in found}) == (0, {"warning"})
    assert run_command("check", cwd=here).returncode == 0
    (here / "log" / "rec_2.csv").write_text("# rate: 2000 Hz\nacc [m/s2]\n" + "1\n-1\n" * 600)
    wrong = run_command("init", "log", *options, "--force", "--json", cwd=here)
    assert wrong.returncode == 2
    assert any(text.startswith("problem: ") for text in json.loads(wrong.stdout)["problems"])
    assert run_command("check", cwd=here).returncode == 2
    shutil.rmtree(here / "log")
    assert run_command("check", cwd=here).returncode == 2
    gone = run_command("init", "log", *options, "--force", "--json", cwd=here)
    assert (gone.returncode, gone.stdout) == (2, "")


@given(st.text(st.characters(exclude_categories=("Cs",)), max_size=20), st.text(max_size=20))
def test_a_line_of_any_text_is_read_back(value: str, comment: str) -> None:
    assert tomllib.loads(_pair("key", value, comment)) == {"key": value}
    assert tomllib.loads(_pair("key", value, comment, off=True)) == {}


def test_titles_of_any_letters_find_their_rows(here: Path) -> None:
    folder = here / "log"
    folder.mkdir()
    titles = ['a"b [g]', "x*y [g]", "Ölpumpe é\\ [g]", "[0] (g)"]
    for kind in ("csv", "h5"):
        rows = np.random.default_rng(1).normal(size=(4, 3000))
        path = folder / f"2024-01-02_10-00-00.{kind}"
        if kind == "csv":
            lines = "".join(";".join(f"{value:.6f}" for value in row) + "\n" for row in rows.T)
            path.write_text(f"# rate: 3000 Hz\n{';'.join(titles)}\n{lines}", encoding="utf-8")
        else:
            with h5py.File(path, "w") as file:
                file.attrs.update(rate_hz=3000.0, unit="g")
                for title, row in zip(titles, rows, strict=True):
                    file[title.rpartition(" ")[0]] = row
        done = run_command("init", "log", "--yes", "--bearing", "6205", "--speed-hz", "9", "--force", cwd=here)
        assert done.returncode == 0, done.stderr
        (block,) = blocks(load_config(here / "config.toml"))
        order = range(4) if kind == "csv" else np.argsort([title.rpartition(" ")[0] for title in titles])
        np.testing.assert_allclose(block.samples, rows[list(order)], atol=1e-6)
        path.unlink()


def test_check_opens_the_last_file_of_many_and_a_recording(here: Path) -> None:
    names = [f"2024-01-02_{minute // 60:02d}-{minute % 60:02d}-00.csv" for minute in range(105)]
    write_named(here / "log", *names[:2])
    for name in names[2:]:
        shutil.copy(here / "log" / names[0], here / "log" / name)
    (here / "log" / names[-1]).write_text("# rate: 500 Hz\nacc [g]\n" + "1\n-1\n" * 600)
    options = ("--yes", "--bearing", "6205", "--speed-hz", "9")
    done = run_command("init", "log", *options, cwd=here)
    assert (done.returncode, "wrote config.toml" in done.stdout) == (2, True)
    assert "problem: source[logger].rate_hz: would be rejected" in done.stdout
    checked = json.loads(run_command("check", "--json", cwd=here).stdout)
    assert f"{names[0]}: 1000 Hz, 2 s, 2024-01-02T00:00:00Z" in checked["dating"]["logger"]["ends"][0]
    (problem,) = checked["problems"]
    assert (problem["severity"], problem["key"]) == ("problem", "source[logger].rate_hz")
    assert f"would be rejected, wrong_rate: {names[-1]}" in problem["came"]
    assert "write rate_hz = 500" in problem["came"]
    path = here / "03-04-2024_10-00-00.csv"
    path.write_text("# rate: 1000 Hz\n# Start: 03/04/2024 10:00:00\nacc [g]\n" + "1\n-1\n" * 1000)
    done = run_command("init", path.name, *options, "--out", "one.toml", cwd=here)
    assert done.returncode == 2
    assert "--date-order" in done.stderr
    done = run_command("init", path.name, *options, "--date-order", "month", "--out", "one.toml", cwd=here)
    assert done.returncode == 0, done.stderr
    (ends,) = json.loads(run_command("check", "--config", "one.toml", "--json", cwd=here).stdout)["dating"].values()
    assert "2024-03-04T10:00:00Z" in ends["ends"][0]

"""``spallwatch simulate`` at a speed that changes: keys, the tacho in the signal, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from models.machine.speed_profile import ramp
from monitor.commands.simulate.command import command
from monitor.commands.simulate.scene import parse_speeds

pytestmark = pytest.mark.usefixtures("empty_directory")

PIT = ["--dphi-deg", "4", "--h-d-um", "10"]


def simulate(*options: str) -> dict[str, Any]:
    result = CliRunner().invoke(command, [*options, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_a_run_up_is_as_long_as_it_says_and_its_tacho_shows_it() -> None:
    found = simulate(
        *PIT, "--speed-profile", "20:40:0.5", "--waveform", "w.csv", "--tacho", "16", "--tacho-jitter-us", "1"
    )
    assert (found["speed_min_hz"], found["speed_max_hz"]) == (20.0, 40.0)
    assert found["revolutions"] == pytest.approx(15.0)
    assert found["status"] == ("not_periodic" if found["error"] <= 1e-3 else "inaccurate")
    assert found["spread_g"] > 0.0
    header, *_ = Path("w.csv").read_text(encoding="utf-8").splitlines()
    assert header == "time_s,acceleration_g,tacho_v"
    time, _, tacho = np.loadtxt("w.csv", delimiter=",", skiprows=1).T
    assert len(time) == 25600
    rises = time[1:][(tacho[:-1] < 2.5) & (tacho[1:] >= 2.5)]
    assert len(rises) == pytest.approx(240, abs=1)
    turns = ramp(20.0, 40.0, 0.5).turns_at(rises)
    assert np.diff(turns) * 16.0 == pytest.approx(1.0, abs=0.02)


def test_hunting_takes_the_time_that_is_asked_for() -> None:
    found = simulate(*PIT, "--speed-profile", "hunt:30:10%:4", "--duration-s", "0.25")
    assert found["speed_max_hz"] == pytest.approx(33.0, rel=1e-3)
    assert found["revolutions"] == pytest.approx(7.5, rel=1e-3)
    assert "speed_min_hz" not in simulate(*PIT)


def test_a_file_is_a_table_of_speeds() -> None:
    Path("speeds.csv").write_text("time_s,speed_hz\n0,10\n1,30\n4,30\n", encoding="utf-8")
    profile = parse_speeds("speeds.csv").profile(1.0)
    assert profile.duration == 4.0
    assert profile.turns[-1] == pytest.approx(110.0)
    assert parse_speeds("coast:40:10:20").profile(1.0).speed_range == (10.0, 40.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--speed-profile", "10:40"], "expected such as 10:40:5"),
        (["--speed-profile", "hunt:25:100%:0.3"], "share of a hunting speed"),
        (["--speed-profile", "coast:10:40:5"], "ends below its beginning"),
        (["--speed-profile", "missing.csv"], "missing.csv"),
        (["--speed-profile", "10:40:5", "--speed-hz", "50"], "speed must lie within the speed_profile"),
        (["--speed-profile", "10:40:5", "--speed-slope-hz-per-s", "1"], "speed_slope must be 0"),
        (["--tacho", "8"], "--tacho is a column of --waveform"),
        (["--tacho-missing", "0.1"], "--tacho-missing belongs to --tacho"),
        (["--tacho", "4000", "--waveform", "w.csv"], "too fast for a channel"),
    ],
)
def test_what_does_not_fit_is_refused(options: list[str], words: str) -> None:
    result = CliRunner().invoke(command, [*PIT, *options])
    assert result.exit_code != 0
    assert words in f"{result.output} {result.exception}"


def test_a_file_with_other_columns_is_refused() -> None:
    Path("speeds.csv").write_text("t,v\n0,10\n", encoding="utf-8")
    with pytest.raises(ValueError, match="expected the columns time_s,speed_hz, got t,v"):
        parse_speeds("speeds.csv")


def test_a_sweep_has_points_and_events_in_the_unit_of_its_option() -> None:
    found = simulate(*PIT, "--sweep", "clearance_um=0:1")
    assert (found["parameter"], found["ended"]) == ("clearance_um", "reached")
    assert [found["points"][i]["clearance_um"] for i in (0, -1)] == pytest.approx([0.0, 1.0])
    single = simulate(*PIT, "--clearance-um", "1")
    last = found["points"][-1]
    assert last["rms_g"] == pytest.approx(single["rms_g"], rel=last["rms_error"] + single["rms_error"])
    assert last["status"] == "converged"
    text = CliRunner().invoke(command, [*PIT, "--sweep", "clearance_um=0:1"], catch_exceptions=False).output
    assert text.count("converged") == len(found["points"])
    assert sum("grazing" in line for line in text.splitlines()) == len(found["events"])


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--sweep", "speed=10:40"], "expected one of speed_hz, load_newton"),
        (["--sweep", "speed_hz=10"], "expected such as speed_hz=10:40"),
        (["--sweep", "speed_hz=10:20", "--waveform", "w.csv"], "--waveform does not go together with --sweep"),
        (["--sweep", "speed_hz=10:20", "--quantity", "lines"], "--sweep is to an accuracy of the RMS"),
        (["--sweep", "speed_hz=10:20", "--unbalance-kg-m", "1"], "unbalance"),
    ],
)
def test_a_sweep_that_is_none_is_refused(options: list[str], word: str) -> None:
    result = CliRunner().invoke(command, [*PIT, *options])
    assert result.exit_code != 0
    assert word in f"{result.output} {result.exception}"

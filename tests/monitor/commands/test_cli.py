"""The command line as a user meets it: output, exit codes, and no traceback whatever is given."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.shell_completion import BashComplete, get_completion_class

from monitor import cli
from tests.support.cli import CONFIG
from tests.support.commands import run_command

ROOT = Path(__file__).resolve().parents[3]


def run(*arguments, cwd=None):
    return run_command(*arguments, cwd=cwd)


def run_program(*arguments):
    code = "from monitor.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, cwd=ROOT
    )


@pytest.fixture
def machine(tmp_path):
    (tmp_path / "machine.toml").write_text(CONFIG)
    rng = np.random.default_rng(0)
    np.save(tmp_path / "good.npy", rng.standard_normal(12800 * 4).astype(np.float32))
    return tmp_path


def test_examples_are_listed_and_copied(tmp_path):
    tracked = ["cwru_drive_end.toml", "notebooks/name_a_recording.ipynb", "sender.py"]
    assert set(tracked) <= set(json.loads(run("examples", "--json").stdout)["examples"])
    assert run("examples", *tracked, "--out", tmp_path / "new").returncode == 0
    for name in tracked:
        assert (tmp_path / "new" / Path(name).name).read_bytes() == (ROOT / "examples" / name).read_bytes()
    refused(run("examples", "sender.py", "--out", tmp_path / "new"), "sender.py is there already")
    refused(run("examples", "nothing.toml"), "no example 'nothing.toml'", "cwru_drive_end.toml")


def refused(result, *words):
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in result.stderr
    assert result.stdout == ""


@pytest.mark.process
def test_help_lists_the_commands():
    result = run_program("--help")
    assert result.returncode == 0
    for name in ("demo", "replay", "report", "check", "bearing", "simulate", "map", "track", "warmup", "forecast"):
        assert f"  {name} " in result.stdout


@pytest.mark.parametrize(
    "name", ["demo", "replay", "report", "check", "bearing", "simulate", "map", "track", "warmup", "forecast"]
)
def test_every_command_explains_itself(name):
    result = run(name, "--help")
    assert result.returncode == 0, result.stderr
    assert len(result.stdout.splitlines()) > 5


def test_replay_prints_one_json_object_and_keeps_its_books(machine):
    result = run("replay", "good.npy", "--config", "machine.toml", "--out", "out", "--json", "--no-report", cwd=machine)
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert summary["blocks"] == summary["accepted"] == 4
    assert summary["rejected"] == {}
    assert summary["pending"] == 0
    nothing = dict.fromkeys(("fault", "fault_basis", "support", "level_of"))
    nothing |= {"disagreement": {}, "channels": ["de"]}
    assert list(summary["bearings"].values()) == [nothing]
    channel = summary["channels"]["de"]
    assert channel["stage"] == "learning"
    assert channel["fault"] is None
    assert set(channel) >= {
        "stage", "t_fs_block", "t_fs_known_block", "t_fs_utc", "t_eol_block", "fault", "fault_snr", "v_eq_mm2",
        "v_eq_lower_mm2", "v_eq_upper_mm2", "edv_status", "tt_s", "tt_lower_s", "tt_upper_s", "tt_status",
        "p_threshold", "fault_basis", "p_no_growth", "tta_s", "tta_lower_s", "tta_upper_s", "tta_status",
    }  # fmt: skip
    assert all(Path(machine / path).exists() or Path(path).exists() for path in summary["records"])


def test_replay_refuses_a_used_folder_and_resumes_it(machine):
    arguments = ("replay", "good.npy", "--config", "machine.toml", "--out", "out", "--json", "--no-report")
    first = json.loads(run(*arguments, "--limit", "2", cwd=machine).stdout)
    assert (first["blocks"], first["pending"]) == (2, 2)
    refused(run(*arguments, cwd=machine), "--resume")
    second = json.loads(run(*arguments, "--resume", cwd=machine).stdout)
    assert (second["blocks"], second["pending"]) == (4, 0)
    refused(run("replay", "good.npy", "--config", "machine.toml", "--out", "new", "--resume", cwd=machine), "--resume")


def test_wrong_inputs_are_refused_in_words(machine):
    refused(run("replay", "none.npy", "--config", "machine.toml", cwd=machine), "none.npy")
    refused(run("replay", "good.npy", "--config", "none.toml", cwd=machine), "none.toml", "cannot be read")
    refused(run("replay", "good.npy", cwd=machine), "--config")
    refused(run("replay", "good.npy", "--config", "machine.toml", "--pace", "fast", cwd=machine), "--pace")
    (machine / "broken.toml").write_text(CONFIG.replace("speed_hz", "sped_hz"))
    refused(run("check", "--config", "broken.toml", cwd=machine), "operating.sped_hz", "speed_hz")
    (machine / "nyquist.toml").write_text(CONFIG.replace("6000", "7000"))
    refused(run("check", "--config", "nyquist.toml", cwd=machine), "band_hz", "7000", "6400")
    (machine / "stateless.toml").write_text(CONFIG.replace("speed_hz = 30", ""))
    refused(run("replay", "good.npy", "--config", "stateless.toml", cwd=machine), "speed_hz")
    (machine / "empty").mkdir()
    refused(run("replay", "empty", "--config", "machine.toml", cwd=machine), "empty")
    refused(run("simulate", "--dphi-deg", "-3"), "--dphi-deg")
    refused(run("track", "none.csv", "--map", "none.nc", cwd=machine), "none.csv")
    (machine / "history.csv").write_text("time_s,rms\n0,1\n")
    refused(run("track", "history.csv", "--map", "none.nc", cwd=machine), "none.nc")
    (machine / "v.csv").write_text("time_s,v_eq_mm2\n0,0.01\n10,x\n")
    refused(run("forecast", "v.csv", cwd=machine), "v.csv", "line 3", "v_eq_mm2")
    refused(run("bearing", "--bearing", "unheard-of"), "unheard-of", "6205")


@pytest.mark.process
def test_a_program_refuses_as_its_commands_do():
    refused(run_program("replay", "none.npy", "--config", "none.toml"), "none.toml", "cannot be read")


def test_bad_blocks_are_rejected_with_their_reason_and_the_rest_goes_on(machine):
    samples = np.load(machine / "good.npy")
    samples[12800:25600] = np.nan
    samples[25600:38400] = 0.25
    np.save(machine / "bad.npy", samples)
    result = run("replay", "bad.npy", "--config", "machine.toml", "--out", "bad", "--json", "--no-report", cwd=machine)
    summary = json.loads(result.stdout)
    assert summary["rejected"] == {"nan": 1}
    assert summary["flagged"] == {"flat": 1}
    assert summary["accepted"] == 3


def test_a_replay_that_rejects_everything_prints_its_summary_and_fails(machine):
    np.save(machine / "nothing.npy", np.full((1, 100), np.nan))
    result = run("replay", "nothing.npy", "--config", "machine.toml", "--out", "out", "--no-report", cwd=machine)
    assert result.returncode == 1
    assert "0 accepted, 1 rejected" in result.stdout
    assert "first " in result.stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.parametrize(
    ("arguments", "begun", "expected"),
    [
        ([], "re", {"release", "redate", "replay", "report", "restore"}),
        (["init"], "--ra", {"--rate-hz", "--range-g"}),
        (["map"], "b", {"build"}),
    ],
)
def test_shells_complete_commands_and_options(shell, arguments, begun, expected, monkeypatch):
    monkeypatch.setattr(BashComplete, "_check_version", lambda *_: None)
    kind = get_completion_class(shell)
    completion = kind(cli.spallwatch, {}, "spallwatch", "_SPALLWATCH_COMPLETE")
    assert f"_SPALLWATCH_COMPLETE={shell}_complete" in completion.source()
    assert {item.value for item in completion.get_completions(arguments, begun)} == expected


def test_check_says_what_would_be_monitored(machine):
    result = run("check", "--config", "machine.toml", cwd=machine)
    assert result.returncode == 0
    assert "outer 107.5" in result.stdout
    values = json.loads(run("check", "--config", "machine.toml", "--json", cwd=machine).stdout)
    assert values["problems"] == []
    assert values["channel"][0]["band_hz"] == [[2000.0, 6000.0]]
    schema = json.loads(run("check", "--schema").stdout)
    assert "channel" in schema["properties"]


def test_check_lists_alarm_levels_and_notification_channels(machine):
    more = '[[alarms.level]]\nfeature = "rms"\nalert_sd = 6\ndanger_g = 3\n[notify.webhook]\nurl = "http://127.0.0.1:9/x"\n'
    (machine / "machine.toml").write_text(CONFIG + more)
    said = run("check", "--config", "machine.toml", cwd=machine).stdout
    assert "alarm rms: rms, alert 6 sd, danger 3 g\n" in said
    assert "notifications: webhook, at most 20 messages an hour\n" in said


def test_simulate_has_the_keys_of_the_interface():
    values = json.loads(run("simulate", "--dphi-deg", "20", "--h-d-um", "20", "--json").stdout)
    assert set(values) >= {
        "rms_g", "peak_g", "rms_resonator_g", "bpfo_hz", "harmonics_g", "periods", "period_change", "model", "status",
    }  # fmt: skip
    assert values["status"] == "converged"
    assert values["rms_g"] == pytest.approx(2.13, rel=0.01)
    deep = json.loads(run("simulate", "--dphi-deg", "4", "--h-d-um", "500", "--json").stdout)
    deeper = json.loads(run("simulate", "--dphi-deg", "4", "--h-d-um", "5000", "--json").stdout)
    assert deep["status"] == "converged"
    assert deep["rms_g"] == deeper["rms_g"]


def test_forecast_and_bearing_have_the_keys_of_the_interface(tmp_path):
    (tmp_path / "v.csv").write_text(
        "time_s,v_eq_mm2\n" + "".join(f"{60 * i},{0.001 + 1e-5 * i * i}\n" for i in range(40))
    )
    rows = json.loads(
        run(
            *("forecast", tmp_path / "v.csv", "--method", "thesis", "--json"),
            *("--threshold-mm2", "0.03", "--threshold-mm2", "0.05"),
        ).stdout
    )["rows"]
    assert len(rows) == 80
    assert set(rows[0]) >= {"t_issue_s", "threshold_mm2", "tt_s", "t_threshold_s", "r_squared", "status"}
    assert rows[-1]["t_threshold_s"] == pytest.approx(60 * 70, rel=1e-6)
    values = json.loads(run("bearing", "--load-newton", "2000", "--json").stdout)
    assert set(values) >= {
        "ftf_hz", "bpfo_hz", "bpfi_hz", "bsf_hz", "k_c_newton_per_m15", "k_c_geometry_newton_per_m15",
        "k_xx_newton_per_m", "k_yy_newton_per_m", "natural_frequencies_hz", "l10h_days",
    }  # fmt: skip
    assert len(values["natural_frequencies_hz"]) == 6

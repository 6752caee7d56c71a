"""``spallwatch archive``: options, JSON, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from monitor.fleet.command import lines
from monitor.fleet.place import open_index
from tests.monitor.fleet.fleet_files import CONFIG, write_files
from tests.support.commands import run_command

LEFT = ("index.db", "index.db.lock", "fleet.html")


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    (tmp_path / "m.toml").write_text(CONFIG)
    write_files(tmp_path / "good", 2)
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad/readme.rtf").write_text("no samples")
    recordings = 'recordings = ["good", "[b]ad*"]'
    (tmp_path / "fleet.toml").write_text(f'[[machine]]\nname = "press"\nconfig = "m.toml"\n{recordings}\n')
    return tmp_path


def test_replay_says_what_failed_and_resume_tries_it_again(fleet):
    command = ("archive", "replay", "fleet.toml", "--out", "out", "--workers", 1, "--json")
    ended = run_command(*command, cwd=fleet)
    assert ended.returncode == 1
    said = json.loads(ended.stdout)
    assert {
        "recordings",
        "done",
        "failed",
        "kept",
        "blocks",
        "seconds",
        "out",
        "index",
        "report",
        "cluster",
    } <= said.keys()
    assert (said["recordings"], said["done"], said["kept"], said["blocks"]) == (2, 1, 0, 2)
    ((failed),) = said["failed"]
    assert (failed["recording"], failed["status"]) == ("press/bad", "failed")
    assert "nothing that is recognised" in failed["reason"]
    page = (fleet / said["report"]).read_text()
    assert "nothing that is recognised" in page
    assert "good" in page

    refused = run_command(*command, cwd=fleet)
    assert refused.returncode == 2
    assert "--resume" in refused.stderr

    assert said["not_in_archive"] == {"recordings": 0, "first": None}
    write_files(fleet / "bad", 2, begin=100)
    write_files(fleet / "bad-2", 2)
    ended = run_command(*command, "--resume", cwd=fleet)
    assert ended.returncode == 0, ended.stderr
    said = json.loads(ended.stdout)
    assert said["not_in_archive"] == {"recordings": 1, "first": str(fleet / "bad-2")}
    assert (
        "not in this archive: 1 recordings that its patterns name since it was begun, "
        f"{fleet}/bad-2 the first; --extend adds them"
    ) in lines(said)
    assert (said["done"], said["kept"], said["failed"], said["blocks"]) == (2, 1, [], 4)
    # Complete: what only a resumed run needs is gone.
    assert {path.name for path in (fleet / "out").iterdir()} == {*LEFT, "press"}
    assert not (fleet / "out.chunks").exists()

    ended = run_command(*command, "--extend", cwd=fleet)
    assert ended.returncode == 0, ended.stderr
    said = json.loads(ended.stdout)
    assert said["added"] == {"recordings": 1, "first": str(fleet / "bad-2")}
    assert f"added: 1 recordings that the manifest names since, {fleet}/bad-2 the first" in lines(said)
    assert (said["recordings"], said["done"], said["kept"], said["blocks"]) == (3, 3, 2, 6)
    assert said["grown"] == {"recordings": 0, "first": None}
    assert "bad-2" in (fleet / said["report"]).read_text()
    assert {path.name for path in (fleet / "out").iterdir()} == {*LEFT, "press"}

    # A recording that was replayed is not read again.
    write_files(fleet / "good", 1, begin=2)
    ended = run_command(*command, "--extend", cwd=fleet)
    said = json.loads(ended.stdout)
    assert said["grown"] == {"recordings": 1, "first": str(fleet / "good")}
    assert said["blocks"] == 6
    assert (
        f"not read: files that came since into 1 recordings, {fleet}/good the first; "
        "name them as recordings of their own"
    ) in lines(said)


@pytest.mark.cluster
def test_one_zarr_store_takes_the_place_of_daily_files(fleet):
    (fleet / "bad/readme.rtf").unlink()
    write_files(fleet / "bad", 2, begin=100)
    options = ("--out", "out", "--records", "zarr", "--workers", 1, "--json")
    ended = run_command("archive", "replay", "fleet.toml", *options, cwd=fleet)
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout)["records"] == "out/records.zarr"
    assert {path.name for path in (fleet / "out").iterdir()} == {*LEFT, "records.zarr"}
    import xarray as xr

    with xr.open_zarr(fleet / "out/records.zarr", consolidated=True) as dataset:
        assert dataset.sizes["row"] == 4
    before = {path: path.stat().st_mtime_ns for path in (fleet / "out/records.zarr").rglob("*")}
    # What it was made of is gone, and nothing is left to be done.
    again = run_command("archive", "replay", "fleet.toml", *options, "--resume", cwd=fleet)
    assert again.returncode == 0, again.stderr
    said = json.loads(again.stdout)
    assert (said["done"], said["kept"], said["report"]) == (2, 2, "out/fleet.html")
    assert {path: path.stat().st_mtime_ns for path in (fleet / "out/records.zarr").rglob("*")} == before
    assert {path.name for path in (fleet / "out").iterdir()} == {*LEFT, "records.zarr"}
    assert not (fleet / "out.chunks").exists()


def test_status_is_read_from_the_index_alone(fleet):
    run_command("archive", "replay", "fleet.toml", "--out", "out", "--workers", 1, cwd=fleet)
    ended = run_command("archive", "status", "out", cwd=fleet)
    assert ended.returncode == 0
    assert "2 recordings: 1 done, 1 failed" in ended.stdout
    assert "press/bad failed: " in ended.stdout
    none = run_command("archive", "status", "press", cwd=fleet)
    assert none.returncode == 2
    assert "holds no archive" in none.stderr


def test_a_configuration_that_cannot_be_used_is_named_and_leaves_nothing(fleet):
    tracked = 'bearing = "test"\nunit = "g"\ntrack = true\nmap = "no.nc"\n'
    text = (fleet / "m.toml").read_text().replace('unit = "g"\nbearing = "test"\n', tracked, 1)
    (fleet / "m.toml").write_text(text)
    ended = run_command("archive", "replay", "fleet.toml", "--out", "out", cwd=fleet)
    assert ended.returncode == 2
    assert f"fleet.toml:1: machine press: {fleet / 'm.toml'}: channel 'de': map: " in ended.stderr
    assert not (fleet / "out").exists()
    none = run_command("archive", "status", "out", cwd=fleet)
    assert none.returncode == 2
    assert "holds no archive" in none.stderr


def test_two_runs_at_once_are_refused(fleet):
    with open_index(str(fleet / "out")):
        ended = run_command("archive", "replay", "fleet.toml", "--out", "out", cwd=fleet)
    assert ended.returncode == 2
    assert "another process replays this archive" in ended.stderr

"""What is made of the results of an archive is made once, and again after any interruption."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from monitor.fleet import finish, run
from monitor.fleet.index import Index
from tests.monitor.fleet.fleet_files import CONFIG, write_files
from tests.support.commands import run_command


class Zarr:
    """Takes the place of the module that writes the Zarr store: lists the recordings in its one file."""

    def __init__(self) -> None:
        self.written: list[list[str]] = []
        self.writings: list[str] = []
        self.interrupted = False

    def __call__(self, results: Any, records: Any, url: str, *others: Any) -> None:
        self.writings.append(others[-1])
        if self.interrupted:
            raise KeyboardInterrupt
        self.written.append([f"{result.recording} {result.status}" for result in results])
        out = Path(url)
        out.mkdir(exist_ok=True)
        (out / "zarr.json").write_text(json.dumps({"attributes": {"spallwatch_archive": 1}, "is": self.written[-1]}))


@pytest.fixture
def zarr(monkeypatch):
    found = Zarr()
    monkeypatch.setattr(finish, "zarr_writer", lambda: found)
    return found


@pytest.fixture
def fleet(tmp_path):
    (tmp_path / "m.toml").write_text(CONFIG)
    for name in ("a", "b"):
        write_files(tmp_path / name, 2)
    (tmp_path / "f.toml").write_text('[[machine]]\nname = "m"\nconfig = "m.toml"\nrecordings = ["a", "b"]\n')
    return tmp_path


def replay(fleet: Path, *options: str, code: int = 0) -> dict[str, Any]:
    command = ("archive", "replay", "f.toml", "--out", "out", "--records", "zarr", "--workers", 1, "--json")
    ended = run_command(*command, *options, cwd=fleet)
    assert ended.returncode == code, ended.stderr
    return json.loads(ended.stdout) if ended.stdout else {}


def work_of(fleet: Path) -> list[str]:
    work = fleet / "out/archive-work"
    return sorted(path.relative_to(work).as_posix() for path in work.rglob("*") if path.is_file())


def test_an_older_store_in_the_place_is_not_taken_for_that_of_recordings_tried_again(fleet, zarr):
    kept = {path: path.read_bytes() for path in (fleet / "b").iterdir()}
    for path in kept:
        path.rename(path.with_suffix(".rtf"))
    replay(fleet, code=1)
    for path, data in kept.items():
        path.write_bytes(data)
    zarr.interrupted = True
    replay(fleet, "--resume", code=1)
    replay(fleet, "--resume", code=1)
    zarr.interrupted = False
    # All are done, and the store is that of the run before.
    assert replay(fleet, "--resume")["done"] == 2
    assert zarr.written == [["a done", "b failed"], ["a done", "b done"]]
    assert work_of(fleet) == []
    # Chunks of the first writing are not those of the second one, which goes on twice.
    first, second, *again = zarr.writings
    assert first != second
    assert again == [second, second]
    replay(fleet, "--resume")
    assert len(zarr.written) == 2


def test_a_page_that_was_not_written_is_made_later(fleet, zarr, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(finish, "fleet_page", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
        replay(fleet, code=1)
    assert not (fleet / "out/fleet.html").exists()
    assert replay(fleet, "--resume")["report"] == "out/fleet.html"
    assert "m" in (fleet / "out/fleet.html").read_text()
    assert len(zarr.written) == 1
    assert work_of(fleet) == []


def test_an_archive_without_a_page_gets_one_later(fleet, zarr):
    assert replay(fleet, "--no-report")["report"] is None
    assert work_of(fleet) == ["records/m/a/result.json", "records/m/b/result.json"]
    assert replay(fleet, "--resume", "--no-report")["report"] is None
    assert replay(fleet, "--resume")["report"] == "out/fleet.html"
    assert len(zarr.written) == 1
    assert work_of(fleet) == []


@pytest.mark.parametrize("records", [True, False])
def test_a_store_of_an_older_index_is_whole_where_its_records_are_gone(fleet, zarr, records, monkeypatch):
    if records:
        monkeypatch.setattr(run, "OWN", re.compile("none"))
    replay(fleet)
    with Index(fleet / "out/index.db") as index:
        index._run("DELETE FROM meta WHERE key = 'finished'")
    assert replay(fleet, "--resume")["report"] == "out/fleet.html"
    assert len(zarr.written) == 1 + records


def content(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", [".zgroup", "time/c.0", "time/zarr.json", "zarr.json"])
def test_a_zarr_store_of_something_else_is_refused_before_anything_is_replayed(fleet, zarr, name):
    path = fleet / "out/records.zarr" / name
    path.parent.mkdir(parents=True)
    path.write_text('{"zarr_format": 3, "node_type": "group"}')
    command = ("archive", "replay", "f.toml", "--out", "out", "--records", "zarr", "--workers", 1)
    ended = run_command(*command, cwd=fleet)
    assert ended.returncode == 2
    assert f"{fleet / 'out/records.zarr'}: " in ended.stderr
    assert content(fleet / "out").keys() == {f"records.zarr/{name}", "index.db.lock"}


def test_a_store_that_this_archive_began_is_gone_on_with(fleet, zarr):
    zarr.interrupted = True
    replay(fleet, code=1)
    (fleet / "out/records.zarr/time").mkdir(parents=True)
    (fleet / "out/records.zarr/time/c.0").write_bytes(b"rows")
    zarr.interrupted = False
    assert replay(fleet, "--resume")["done"] == 2
    assert zarr.written == [["a done", "b done"]]

"""Backups: written beside a writer, verified, kept in number, and put back as a whole or refused."""

from __future__ import annotations

import random
import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from monitor.records import backup, durable, restore
from monitor.records.backup import BackupError, RefusedError, back_up, backups_of, find_backup, verify
from monitor.records.events import EventLog
from monitor.records.recover import published as recover_published
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Store
from tests.support.backup import UTC, blocks_in, contents_of, fill, places_in, publish
from tests.support.effort import effort_count
from tests.support.store_damage import CutOff, CutOffError
from tests.support.store_kill import block


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A machine with a store of 20 blocks and two published files, and a backup of it below ``backups``."""
    fill(tmp_path / "state", 20)
    publish(tmp_path, "m-20231114.nc", b"a day")
    publish(tmp_path, "m-undated.nc", b"undated")
    publish(tmp_path, "other-20231114.nc", b"of another machine")
    back_up(contents_of(tmp_path), tmp_path / "backups", keep=3, utc=UTC)
    return tmp_path


def test_a_backup_is_a_folder_of_files_and_their_manifest(made: Path) -> None:
    (folder,) = backups_of(made / "backups", "m")
    assert folder.name == "m-20261122T090000Z"
    found = verify(folder)
    assert sorted(found.files) == ["config/m.toml", "records/m-20231114.nc", "records/m-undated.nc", "state.db"]
    assert found.blocks == 20
    assert (found.manifest["machine"], found.manifest["created_utc"]) == ("m", "2026-11-22T09:00:00Z")
    # It can be read where nothing can be written beside it, and nothing was.
    assert sorted(path.name for path in folder.iterdir()) == ["config", "manifest.json", "records", "state.db"]
    assert [path.name for path in (made / "backups").iterdir() if path.name.startswith(".")] == []


def test_a_backup_beside_a_writer_is_one_moment_of_the_store(tmp_path: Path) -> None:
    """A copy in steps would begin anew with each commit, and never end."""
    fill(tmp_path / "state", 100)
    ending, written = threading.Event(), [100]

    def write() -> None:
        with Store.open(tmp_path / "state" / "state.db", machine="m") as store:
            while not ending.is_set():
                written[0] += 1
                store.commit(block(written[0]), {"detect:x": {"seen": written[0]}})

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for number in range(3):
            before = written[0] - 1
            found, _ = back_up(contents_of(tmp_path), tmp_path / "backups", keep=9, utc=UTC + number)
            assert before <= found.blocks <= written[0]
            copy = tmp_path / f"{number}.db"
            copy.write_bytes((found.folder / "state.db").read_bytes())
            assert blocks_in(copy) == found.blocks
    finally:
        ending.set()
        writer.join()


def test_only_the_newest_are_kept_and_only_those_of_the_machine_go(made: Path) -> None:
    folder = made / "backups"
    (folder / "fan-m-20261122T080000Z").mkdir()
    (folder / "m-notes").mkdir()
    removed = [back_up(contents_of(made), folder, keep=3, utc=UTC + 60 * number)[1] for number in range(1, 5)]
    assert removed == [[], [], ["m-20261122T090000Z"], ["m-20261122T090100Z"]]
    assert [path.name[-8:] for path in backups_of(folder, "m")] == ["T090200Z", "T090300Z", "T090400Z"]
    assert (folder / "fan-m-20261122T080000Z").exists()
    assert (folder / "m-notes").exists()
    # With a clock that went back, the new one stays all the same.
    new, removed = back_up(contents_of(made), folder, keep=1, utc=UTC - 86400.0)
    assert backups_of(folder, "m") == [new.folder]
    assert len(removed) == 3


def test_what_another_machine_is_writing_stays(made: Path) -> None:
    """Machines may share the folder, and the name of one may begin with that of another."""
    theirs = made / "backups" / ".m-2-20260101T000000Z.partial"
    ours = made / "backups" / ".m-20260101T000000Z.partial"
    for partial in (theirs, ours):
        partial.mkdir(parents=True)
    back_up(contents_of(made), made / "backups", keep=9, utc=UTC)
    assert (theirs.exists(), ours.exists()) == (True, False)


def test_two_in_one_second_are_two(made: Path) -> None:
    back_up(contents_of(made), made / "backups", keep=3, utc=UTC)
    assert [path.name for path in backups_of(made / "backups", "m")] == ["m-20261122T090000Z", "m-20261122T090000Z-2"]


def test_files_that_did_not_change_take_no_room_again(made: Path) -> None:
    publish(made, "m-undated.nc", b"undated, and more")
    (first,) = backups_of(made / "backups", "m")
    steps: list[str] = []
    rename = Path.rename
    monkeypatch.setattr(backup, "sync_folder", lambda folder: steps.append(f"sync {folder.name}"))
    monkeypatch.setattr(Path, "rename", lambda path, to: (steps.append(f"rename {path.name}"), rename(path, to))[1])
    monkeypatch.setattr(backup.shutil, "rmtree", lambda path, **_: steps.append(f"remove {path.name}"))
    back_up(contents_of(made), made / "backups", keep=1, utc=UTC + 60)
    place = steps.index(f"rename {first.name}")
    assert steps[place : place + 3] == [f"rename {first.name}", "sync backups", f"remove .{first.name}.partial"]

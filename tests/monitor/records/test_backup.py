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
    second, _ = back_up(contents_of(made), made / "backups", keep=3, utc=UTC + 60)
    assert (second.folder / "records" / "m-20231114.nc").samefile(first / "records" / "m-20231114.nc")
    assert (second.folder / "records" / "m-undated.nc").read_bytes() == b"undated, and more"
    # Not where the earlier copy is damaged.
    path = second.folder / "records" / "m-20231114.nc"
    path.write_bytes(b"A day")
    third, _ = back_up(contents_of(made), made / "backups", keep=3, utc=UTC + 120)
    assert (third.folder / "records" / "m-20231114.nc").read_bytes() == b"a day"


@pytest.mark.parametrize("name", ["state.db", "records/m-20231114.nc", "config/m.toml"])
def test_one_changed_byte_is_found(made: Path, name: str) -> None:
    (folder,) = backups_of(made / "backups", "m")
    data = bytearray((folder / name).read_bytes())
    data[random.Random(5).randrange(len(data))] ^= 1
    (folder / name).write_bytes(data)
    with pytest.raises(BackupError, match=f"{name}: is not as it was written"):
        verify(folder)
    before = (made / "state" / "state.db").read_bytes()
    with pytest.raises(BackupError, match="is not as it was written"):
        restore.restore(folder, "m", places_in(made), replace=True, utc=UTC)
    assert (made / "state" / "state.db").read_bytes() == before
    (folder / name).unlink()
    with pytest.raises(BackupError, match="cannot be read: No such file"):
        verify(folder)


@pytest.mark.parametrize("text", ["", "{}", '{"format": 99, "machine": "m", "files": {"state.db": {}}}', "[]"])
def test_a_manifest_that_is_none_is_refused_in_words(made: Path, text: str) -> None:
    (folder,) = backups_of(made / "backups", "m")
    (folder / "manifest.json").write_text(text)
    with pytest.raises(BackupError, match=r"manifest\.json: "):
        verify(folder)


def test_a_damaged_store_makes_no_backup_and_costs_none(made: Path) -> None:
    path = fill(made / "state", 300, 21)
    data = bytearray(path.read_bytes())
    data[3 * 4096 : 9 * 4096] = bytes(6 * 4096)
    path.write_bytes(data)
    with pytest.raises(BackupError):
        back_up(contents_of(made), made / "backups", keep=1, utc=UTC + 60)
    (folder,) = backups_of(made / "backups", "m")
    assert verify(folder).blocks == 20
    assert not list((made / "backups").glob(".*"))


def test_without_a_store_there_is_nothing_to_back_up(tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    with pytest.raises(RefusedError, match=r"state\.db: no such file"):
        back_up(contents_of(tmp_path), tmp_path / "backups", keep=1, utc=UTC)


@pytest.mark.usefixtures("refused_at_once")
def test_two_at_once_are_refused(made: Path) -> None:
    lock = durable.take_lock(made / "backups" / "m")
    with pytest.raises(RefusedError, match="another backup of machine 'm' is being written"):
        back_up(contents_of(made), made / "backups", keep=1, utc=UTC)
    assert lock is not None
    lock.close()


def test_a_backup_does_not_fill_the_disk_of_the_daemon(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backup, "free_bytes", lambda _: 200_000_000)
    with pytest.raises(
        BackupError, match=r"too full for a backup: 200 MB are free, 0\.\d MB and 200 MB for the daemon"
    ):
        back_up(contents_of(made), made / "backups", keep=1, utc=UTC + 60, min_free=200_000_000)
    assert len(backups_of(made / "backups", "m")) == 1


def cut_off_points(module: object, names: tuple[str, ...]) -> Callable[[pytest.MonkeyPatch, CutOff], None]:
    def patch(context: pytest.MonkeyPatch, cut: CutOff) -> None:
        for name in names:
            context.setattr(module, name, cut.counted(getattr(module, name)))
        for name in ("replace", "rename", "unlink"):
            context.setattr(Path, name, cut.counted(getattr(Path, name)))

    return patch


def test_a_backup_that_is_cut_off_anywhere_costs_none(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    patch = cut_off_points(backup, ("sync_file", "sync_folder", "copy_durably", "verify", "_copy_store"))
    # What is killed removes nothing of its own.
    monkeypatch.setattr(backup.shutil, "rmtree", lambda *_, **__: None)
    ended, place = True, 0
    while ended:
        place += 1
        with monkeypatch.context() as context:
            patch(context, CutOff(place))
            try:
                back_up(contents_of(made), made / "backups", keep=2, utc=UTC + place)
                ended = False
            except CutOffError:
                pass
        for folder in backups_of(made / "backups", "m"):
            assert verify(folder).blocks == 20
        assert backups_of(made / "backups", "m")
    assert place > 10


def test_into_an_empty_state_comes_all_of_it(made: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    target = tmp_path_factory.mktemp("target")
    done = restore.restore(find_backup(made / "backups", "m"), "m", places_in(target), replace=False, utc=UTC + 60)
    assert (done.aside, done.files) == (None, ("m-20231114.nc", "m-undated.nc"))
    assert blocks_in(target / "state" / "state.db") == 20
    assert (target / "records" / "m-20231114.nc").read_bytes() == b"a day"
    assert sorted(path.name for path in (target / "records").iterdir()) == ["m-20231114.nc", "m-undated.nc"]
    assert {path.name for path in (target / "state").iterdir()} <= {
        "state.db",
        "state.db-wal",
        "state.db-shm",
        "state.db.lock",
    }
    with EventLog(target / "state" / "state.db") as log:
        assert log.notices()[0][1].body["text"] == "the state is that of the backup of 2026-11-22T09:00:00Z, 20 blocks"


def test_a_store_that_is_there_is_replaced_only_when_asked_for_and_kept(made: Path) -> None:
    fill(made / "state", 5, 21)
    publish(made, "m-20231114.nc", b"a day, longer")
    (made / "records" / "m-undated.nc").unlink()
    folder = find_backup(made / "backups", "m")
    with pytest.raises(RefusedError, match="there is a store already; --replace keeps it"):
        restore.restore(folder, "m", places_in(made), replace=False, utc=UTC + 60)
    assert blocks_in(made / "state" / "state.db") == 25
    done = restore.restore(folder, "m", places_in(made), replace=True, utc=UTC + 60)
    assert blocks_in(made / "state" / "state.db") == 20
    assert done.aside is not None
    assert done.aside.name == "state.db.before-restore-20261122T090100Z"
    assert blocks_in(done.aside) == 25
    # A published file that is there may hold more than the backup.
    assert (made / "records" / "m-20231114.nc").read_bytes() == b"a day, longer"
    assert done.files == ("m-undated.nc",)
    again = restore.restore(folder, "m", places_in(made), replace=True, utc=UTC + 60)
    assert again.aside is not None
    assert (again.aside.name, blocks_in(again.aside)) == ("state.db.before-restore-20261122T090100Z-2", 20)


def test_a_damaged_store_is_kept_with_its_log(made: Path) -> None:
    for suffix in ("", "-wal"):
        (made / "state" / f"state.db{suffix}").write_bytes(b"damaged" + suffix.encode())
    done = restore.restore(find_backup(made / "backups", "m"), "m", places_in(made), replace=True, utc=UTC)
    assert done.aside is not None
    assert done.aside.read_bytes() == b"damaged"
    assert done.aside.with_name(f"{done.aside.name}-wal").read_bytes() == b"damaged-wal"
    assert blocks_in(made / "state" / "state.db") == 20


@pytest.mark.usefixtures("refused_at_once")
def test_what_cannot_be_meant_is_refused(made: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder, target = find_backup(made / "backups", "m"), tmp_path_factory.mktemp("target")
    with pytest.raises(RefusedError, match="is a backup of machine 'm', not of 'press'"):
        restore.restore(folder, "press", places_in(target), replace=False, utc=UTC)
    with pytest.raises(RefusedError, match="expected a backup of machine 'press'"):
        find_backup(made / "backups", "press")
    with Store.open(made / "state" / "state.db", machine="m"), pytest.raises(RefusedError, match="writing to it"):
        restore.restore(folder, "m", places_in(made), replace=True, utc=UTC)
    assert list(target.iterdir()) == []


def test_a_restore_for_which_there_is_no_room_leaves_all_as_it_was(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(made / "state", 5, 21)
    (made / "records" / "m-undated.nc").unlink()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    for name in ("check_store", "sync_file", "_fold_log"):
        monkeypatch.setattr(restore, name, full)
        with pytest.raises(BackupError, match="cannot be put in place"):
            restore.restore(find_backup(made / "backups", "m"), "m", places_in(made), replace=True, utc=UTC)
        monkeypatch.undo()
        assert blocks_in(made / "state" / "state.db") == 25
        assert not list((made / "state").glob("*restor*"))
        assert [path.name for path in (made / "records").iterdir() if path.name.startswith(("m-", "."))] == [
            "m-20231114.nc"
        ]


@pytest.mark.parametrize("old", [0, 25])
def test_a_restore_that_is_cut_off_anywhere_left_the_old_or_the_whole_new_state(
    made: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch, old: int
) -> None:
    names = ("sync_file", "sync_folder", "copy_durably", "check_store", "link_durably", "_fold_log", "_swap")
    patch = cut_off_points(restore, names)
    patch_database = cut_off_points(durable, ("sync_folder", "link_durably"))
    monkeypatch.setattr(recover_published, "_in_child", lambda to, files, beat: recover_published.take_files(to, files))
    folder = find_backup(made / "backups", "m")
    seen: set[int] = set()
    before = tmp_path_factory.mktemp("before")
    if old:
        fill(before / "state", old)
        publish(before, "m-20231114.nc", b"as it was")
    ended, place = True, 0
    while ended:
        place += effort_count(quick=4, full=1)
        target = tmp_path_factory.mktemp("target")
        shutil.copytree(before, target, dirs_exist_ok=True)
        with monkeypatch.context() as context:
            cut = CutOff(place)
            patch(context, cut)
            patch_database(context, cut)
            try:
                restore.restore(folder, "m", places_in(target), replace=True, utc=UTC)
                ended = False
            except CutOffError:
                pass
        # As a daemon starts.
        open_or_salvage(target / "state" / "state.db", machine="m", records_dir=target / "records")[0].close()
        found = blocks_in(target / "state" / "state.db")
        assert found in (old, 20), place
        seen.add(found)
        published = {path.name: path.read_bytes() for path in (target / "records").glob("*")}
        first = {"m-20231114.nc": b"as it was"} if old else {}
        new = {"m-20231114.nc": b"a day", "m-undated.nc": b"undated"} | first
        assert published == (new if found == 20 else first), place
        aside = list((target / "state").glob("state.db.before-restore-*"))
        if found == 20 and old:
            assert [blocks_in(path) for path in aside if not path.name.endswith(("-wal", "-shm", ".lock"))] == [old]
        else:
            assert aside == []
        assert not list((target / "state").glob("state.db.restor*"))
    assert seen == {old, 20}
    assert place > 15


def test_files_of_a_machine_whose_name_begins_alike_are_left_out(tmp_path: Path) -> None:
    fill(tmp_path / "state", 1)
    for name in ("m-20231114.nc", "m-undated.nc", "m-2-20231114.nc", "m-20231114.nc.lost-1"):
        publish(tmp_path, name, b"x")
    made, _ = back_up(contents_of(tmp_path), tmp_path / "backups", keep=1, utc=UTC)
    assert sorted(name for name in made.files if name.startswith("records/")) == [
        "records/m-20231114.nc",
        "records/m-undated.nc",
    ]


def test_the_name_of_each_new_folder_is_durable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[Path] = []
    monkeypatch.setattr(durable, "sync_folder", synced.append)
    durable.make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()
    assert synced == [tmp_path, tmp_path / "a"]
    durable.make_folder(tmp_path / "a" / "b")
    assert len(synced) == 2


def test_a_backup_durably_loses_its_name_before_its_files(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (first,) = backups_of(made / "backups", "m")
    steps: list[str] = []
    rename = Path.rename
    monkeypatch.setattr(backup, "sync_folder", lambda folder: steps.append(f"sync {folder.name}"))
    monkeypatch.setattr(Path, "rename", lambda path, to: (steps.append(f"rename {path.name}"), rename(path, to))[1])
    monkeypatch.setattr(backup.shutil, "rmtree", lambda path, **_: steps.append(f"remove {path.name}"))
    back_up(contents_of(made), made / "backups", keep=1, utc=UTC + 60)
    place = steps.index(f"rename {first.name}")
    assert steps[place : place + 3] == [f"rename {first.name}", "sync backups", f"remove .{first.name}.partial"]

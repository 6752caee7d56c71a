"""Folders for a while: those of killed processes go with the next one, and nothing else does."""

from __future__ import annotations

from models.platform.portable import FileLock
from models.platform.scratch import scratch_folder


def test_the_folder_of_a_killed_process_is_removed_by_the_next(tmp_path):
    dead, live, other = (f"work-{digit * 16}" for digit in "0ab")
    for name in (dead, live, other, "work-mine", "more-" + "0" * 16):
        (tmp_path / name).mkdir()
    (tmp_path / dead / "file").touch()
    for name in (dead, "work-mine", "more-" + "0" * 16):
        (tmp_path / f"{name}.lock").touch()
    before = set(tmp_path.iterdir())
    alive = FileLock(tmp_path / f"{live}.lock")
    assert alive.take()
    with scratch_folder("work-", tmp_path) as folder:
        made = {folder, folder.with_name(f"{folder.name}.lock")}
        gone = {tmp_path / dead, tmp_path / f"{dead}.lock"}
        assert set(tmp_path.iterdir()) == (before | made | {tmp_path / f"{live}.lock"}) - gone
        assert folder.stat().st_mode & 0o77 == 0
    assert not made & set(tmp_path.iterdir())
    alive.close()


def test_without_a_parent_it_is_in_the_temporary_folder_with_locks_or_without(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def refuse(_lock: FileLock) -> bool:
        raise OSError("no locks here")

    for take in (FileLock.take, refuse):
        monkeypatch.setattr(FileLock, "take", take)
        with scratch_folder("work-") as folder:
            assert folder.parent == tmp_path
    assert list(tmp_path.iterdir()) == []

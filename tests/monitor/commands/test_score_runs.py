"""Which files the tasks of ``score`` depend on."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from models.work.codec import encode
from monitor.commands.score import _task


def test_a_task_changes_with_each_of_its_files_and_not_with_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "records"
    folder.mkdir()
    for name, changed in (("a.nc", 100), ("b.nc", 200)):
        (folder / name).write_bytes(b"data")
        os.utime(folder / name, (changed, changed))
    before = encode(_task(folder, elsewhere=False).files)
    # Of the same size, and older than another one.
    (folder / "a.nc").write_bytes(b"atad")
    os.utime(folder / "a.nc", (150, 150))
    rewritten = encode(_task(folder, elsewhere=False).files)
    (folder / "a.nc").rename(folder / "c.nc")
    renamed = encode(_task(folder, elsewhere=False).files)
    assert len({before, rewritten, renamed}) == 3
    monkeypatch.chdir(tmp_path)
    assert _task(Path("records"), elsewhere=False).path == folder
    assert _task(Path("records"), elsewhere=False).shown == "records"

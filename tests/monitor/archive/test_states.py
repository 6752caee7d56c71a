"""The states from which histories go on: each recording has its own, and one that is gone costs time alone."""

from __future__ import annotations

import shutil

import pytest

from models.work.runner import Runner
from models.work.serial import SerialExecutor
from models.work.stores import open_store
from monitor.archive import part
from tests.monitor.archive.fleet_files import (
    CONTINUED,
    EACH,
    Dying,
    assert_same_records,
    make_archive,
    write_files,
)


def test_recordings_of_one_content_have_states_of_their_own(tmp_path, monkeypatch):
    write_files(tmp_path / "a", 12)
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    written: dict[int, set[str]] = {}
    keep = part._Replayed._kept_state

    def noting(replayed):
        name = keep(replayed)
        written.setdefault(replayed._part.recording, set()).add(name)
        return name

    monkeypatch.setattr(part._Replayed, "_kept_state", noting)
    assert make_archive(tmp_path, EACH.format('["a", "b"]'), part_blocks=5).done == 2
    assert [len(names) for names in written.values()] == [2, 2]
    assert written[1].isdisjoint(written[2])


def test_a_history_whose_state_is_gone_begins_anew(tmp_path):
    """Also where the chunks of the first attempt, which name that state, are still there."""
    write_files(tmp_path / "in")
    manifest = CONTINUED.format('"in/*.npy"')
    make_archive(tmp_path, manifest, "whole")
    with pytest.raises(KeyboardInterrupt):
        make_archive(tmp_path, manifest, part_blocks=8, runner=Runner(Dying(2), open_store(tmp_path / "chunks")))
    shutil.rmtree(tmp_path / "out/archive-work/states")
    runner = Runner(SerialExecutor(), open_store(tmp_path / "chunks"), resume=True)
    counts = make_archive(tmp_path, manifest, part_blocks=8, resume=True, runner=runner)
    assert (counts.done, counts.set_aside, runner.tally.kept) == (1, 0, 0)
    assert_same_records(tmp_path / "out/m/history", tmp_path / "whole/m/history")

"""The states from which histories go on: each recording has its own, and one that is gone costs time alone."""

from __future__ import annotations

import shutil

import pytest

from models.work.folder_store import open_store
from models.work.pool import SerialExecutor
from models.work.runner import Runner
from monitor.fleet import part
from monitor.fleet.index import Index
from monitor.fleet.manifest import ManifestError
from monitor.fleet.run import ArchivePlan, delete_work
from tests.monitor.fleet.fleet_files import (
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


@pytest.mark.parametrize("extend", [False, True])
def test_the_blocks_of_a_part_are_those_with_which_an_archive_was_begun(tmp_path, extend):
    write_files(tmp_path / "a", 2)
    make_archive(tmp_path, EACH.format('"a"'), part_blocks=200)
    with pytest.raises(ManifestError, match="was begun with --part-blocks 200, got 300"):
        make_archive(tmp_path, EACH.format('"a"'), part_blocks=300, resume=True, extend=extend)
    assert make_archive(tmp_path, EACH.format('"a"'), part_blocks=200, resume=True, extend=extend).done == 1
    assert make_archive(tmp_path, EACH.format('"a"'), resume=True, extend=extend).done == 1


@pytest.mark.parametrize(("records", "left"), [("days", 1), ("zarr", 0)])
def test_the_state_at_the_end_of_a_history_stays_where_it_can_be_extended(tmp_path, records, left):
    write_files(tmp_path / "in")
    manifest = CONTINUED.format('"in"')
    make_archive(tmp_path, manifest, records=records)
    states = tmp_path / "out/archive-work/states"
    assert len(list(states.glob("*"))) == 1
    with Index(tmp_path / "out/index.db") as index:
        delete_work(ArchivePlan(tmp_path / "manifest.toml", str(tmp_path / "out"), records), index)
    assert len(list(states.glob("*"))) == left

"""Archives: their records are those of plain replays bit for bit, also in parts, after a failure, and resumed."""

from __future__ import annotations

import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import streams.files.container
from models.words.errors import WrongInputError
from models.work.folder_store import FolderStore, open_store
from models.work.pool import SerialExecutor
from models.work.runner import Runner
from models.work.task import ChunkOutcome, Failure
from monitor.config.load import load_config
from monitor.fleet import part, replaying
from monitor.fleet.history import Position
from monitor.fleet.index import Index
from monitor.fleet.manifest import ManifestError
from monitor.fleet.part import described
from monitor.fleet.result import FAILED, SET_ASIDE
from monitor.fleet.run import ArchivePlan, Results, delete_work, replay_waiting
from monitor.fleet.setup import load_setup, send_setup
from monitor.service.replay import replay
from tests.monitor.fleet.fleet_files import (
    CONFIG,
    CONTINUED,
    DATED,
    EACH,
    Dying,
    assert_same_records,
    make_archive,
    result_of,
    write_files,
)


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recordings ``in``, and with ``one``, their replay in one go."""
    folder = tmp_path_factory.mktemp("archive")
    (folder / "m.toml").write_text(CONFIG)
    write_files(folder / "in")
    summary = replay(load_config(folder / "m.toml"), str(folder / "in"), folder / "one").summary
    # Something to lose on the way: a final stage, which a baseline and a run of blocks precede.
    assert summary["channels"]["de"]["t_fs_block"] is not None
    return folder


def position_in(index: Index) -> Position:
    """Return where the first history of an index stands."""
    checkpoint = index.checkpoint(1)
    assert checkpoint is not None
    return checkpoint.position


def digests(folder: Path) -> list[tuple[int | None, int, str]]:
    """Return day, rows and digest of each file of a recording, which stand for its records."""
    return [(file.day, file.rows, file.digest) for file in result_of(folder).files]


def digests_of(folder: Path) -> list[tuple[int | None, int, str]]:
    """Return the same of files of records."""
    files = (described(path, "m", "r").files[0] for path in sorted(folder.glob("*.nc")))
    return [(file.day, file.rows, file.digest) for file in files]


def test_a_recording_of_an_archive_has_the_records_of_a_replay(replayed):
    counts = make_archive(replayed, EACH.format('"in"'), "each")
    assert (counts.done, counts.waiting, counts.rows) == (1, 0, 22)
    assert_same_records(replayed / "each/m/in", replayed / "one/records")
    assert digests(replayed / "each/m/in")[0][:2] == (19783, 2)


@pytest.mark.parametrize("recordings", ['"in"', '"in/*.npy"'], ids=["one folder", "a glob of files"])
def test_a_history_in_parts_is_that_of_one_go(replayed, recordings, request):
    out = f"parts-{request.node.callspec.indices['recordings']}"
    counts = make_archive(replayed, CONTINUED.format(recordings), out, part_blocks=8)
    assert counts.rows == 22
    folder = replayed / out / "m/history"
    assert_same_records(folder, replayed / "one/records")
    result = result_of(folder)
    assert [file.rows for file in result.files] == [2, 12, 8]
    with sqlite3.connect(replayed / "one/state.db") as store:
        assert (result.first, result.last) == store.execute("SELECT min(time), max(time) FROM blocks").fetchone()
    assert result.summary["blocks"] == 22
    # That of its end, from which it can go on later.
    assert len(list((replayed / out / "archive-work/states").glob("*"))) == 1


TIMES = ("seconds", "blocks_per_second", "records")
_READ = streams.files.container.read_regular


@pytest.mark.parametrize(("history", "block_s"), [("each", '"file"'), ("continued", "0.05")])
def test_a_folder_in_parts_has_the_refusals_and_the_summary_of_one_go(tmp_path, block_s, history, monkeypatch):
    files = sorted(write_files(tmp_path / "in", 10).iterdir())
    shutil.copy(files[1], files[4])
    shutil.copy(files[2], files[8])
    files[5].write_bytes(b"no numbers")
    (tmp_path / "in/notes.rtf").write_text("no samples")
    config = CONFIG.replace('block_s = "file"', f"block_s = {block_s}")
    (tmp_path / "m.toml").write_text(config)
    one = replay(load_config(tmp_path / "m.toml"), str(tmp_path / "in"), tmp_path / "one").summary
    opened: list[str] = []
    monkeypatch.setattr(
        streams.files.container, "read_regular", lambda root, path: opened.append(path) or _READ(root, path)
    )
    manifest = EACH.format('"in"') + f'history = "{history}"\n'
    assert make_archive(tmp_path, manifest, config=config, part_blocks=4).done == 1
    folder = tmp_path / f"out/m/{'in' if history == 'each' else 'history'}"
    assert_same_records(folder, tmp_path / "one/records")
    found = result_of(folder).summary
    keys = one.keys() - {*TIMES} if history == "each" else {"blocks", "accepted", "rejected", "flagged", "reasons"}
    assert {key: found[key] for key in keys} == {key: one[key] for key in keys}
    assert one["rejected"].keys() >= {"duplicate", "unreadable"}
    # The bands may be chosen in a pass of its own; then each part reads the file again that the one before ended in.
    assert len(opened) <= 10 + 10 + one["blocks"] // 4


def test_a_machine_that_begins_anew_learns_anew(tmp_path):
    write_files(tmp_path / "a")
    write_files(tmp_path / "b", seed=2, begin=22, grows_from=100)
    anew = CONTINUED.format('["a", "b"]') + '[[machine.anew]]\nat = "b"\nwhy = "bearing exchanged"\n'
    assert make_archive(tmp_path, anew).recordings == 2
    first, second = (result_of(tmp_path / f"out/m/{name}").summary for name in ("history", "history-2"))
    assert [one["blocks"] for one in (first, second)] == [22, 22]
    assert [one["channels"]["de"]["t_fs_block"] is None for one in (first, second)] == [False, True]


def test_an_interrupted_history_goes_on_from_its_latest_part(replayed):
    manifest = CONTINUED.format('"in/*.npy"')
    chunks = replayed / "chunks"
    with pytest.raises(KeyboardInterrupt):
        make_archive(replayed, manifest, "cut", part_blocks=8, runner=Runner(Dying(2), open_store(chunks)))
    with Index(replayed / "cut/index.db") as index:
        assert index.left() == 1
        assert position_in(index).blocks == 15
    # Without the chunks: the index alone knows where it stands.
    others = Runner(SerialExecutor(), open_store(replayed / "others"))
    counts = make_archive(replayed, manifest, "cut", part_blocks=8, resume=True, runner=others)
    assert (counts.done, others.tally.chunks) == (1, 1)
    assert digests(replayed / "cut/m/history") == digests_of(replayed / "one/records")


def test_a_history_goes_on_from_an_index_that_is_older_than_its_latest_state(replayed, monkeypatch):
    """In object storage the index is a copy, as old as a minute where its caller was killed."""
    monkeypatch.setattr(replaying, "_NOTED_AFTER_S", 0.0)
    (replayed / "old.toml").write_text(CONTINUED.format('"in/*.npy"'))
    plan = ArchivePlan(replayed / "old.toml", str(replayed / "old"), part_blocks=8)
    path, copies = replayed / "old/index.db", []
    with Index(path) as index:

        def noted():
            if index.planned and index.checkpoint(1) is not None and not copies:
                index.settle()
                copies.append(path.read_bytes())
                return True
            return False

        with Runner(Dying(2), open_store(replayed / "old.chunks")) as runner, pytest.raises(KeyboardInterrupt):
            replay_waiting(plan, index, runner, noted)
        assert position_in(index).part == 2
    path.write_bytes(copies[0])
    with Index(path) as index, Runner(SerialExecutor()) as runner:
        assert position_in(index).part == 1
        assert replay_waiting(replace(plan, resume=True), index, runner).done == 1
    assert digests(replayed / "old/m/history") == digests_of(replayed / "one/records")


def test_what_is_wrong_with_a_recording_is_a_result_and_the_others_stand(tmp_path):
    write_files(tmp_path / "good")
    # A file that is no recording, and a folder that has gone since the archive was planned.
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad/readme.rtf").write_text("no samples")
    write_files(tmp_path / "empty", 2)
    for path in (tmp_path / "empty").iterdir():
        np.save(path, np.zeros(0, np.float32))
    counts = make_archive(tmp_path, EACH.format('["bad", "good", "empty"]'))
    assert (counts.done, counts.failed, counts.set_aside) == (1, 2, 0)
    with Index(tmp_path / "out/index.db", read_only=True) as index:
        wrong = dict(index.wrong())
        with Results(index, open_store(tmp_path / "out")) as found:
            results = list(found)
            # They are read once.
            (tmp_path / "out/m/good/result.json").unlink()
            assert [*found] == [*found] == results
    assert [one.recording for one in results] == ["bad", "good", "empty"]
    assert [one.status for one in results] == ["failed", "done", "failed"]
    assert wrong.keys() == {"m/bad", "m/empty"}
    assert all(outcome.status == FAILED for outcome in wrong.values())
    assert "holds nothing that is recognised" in (wrong["m/bad"].reason or "")
    assert "every block is rejected" in (wrong["m/empty"].reason or "")
    # Rejected blocks are records too.
    assert results[2].rows == 2


def test_a_history_ends_at_the_recording_that_cannot_be_read_and_goes_on_once_it_is_repaired(replayed, tmp_path):
    write_files(tmp_path / "in")
    manifest = CONTINUED.format('["in/20240301*", "in/20240302*", "in/20240303*"]')
    late = sorted((tmp_path / "in").iterdir())[12]
    kept = late.read_bytes()
    late.unlink()
    late.mkdir()
    counts = make_archive(tmp_path, manifest, part_blocks=8)
    assert (counts.failed, counts.rows) == (1, 12)
    assert late.name in result_of(tmp_path / "out/m/history").reason
    late.rmdir()
    late.write_bytes(kept)
    runner = Runner(SerialExecutor())
    counts = make_archive(tmp_path, manifest, part_blocks=8, resume=True, runner=runner)
    assert (counts.done, counts.failed, runner.tally.chunks) == (1, 0, 2)
    assert digests(tmp_path / "out/m/history") == digests_of(replayed / "one/records")


def test_records_of_an_attempt_that_failed_do_not_stay_beside_those_of_the_next(tmp_path):
    """A file that came short has no date that is believed; whole, its records are of a day."""
    (path,) = write_files(tmp_path / "in", 1).iterdir()
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    manifest = EACH.format('"in"')
    assert make_archive(tmp_path, manifest).failed == 1
    folder = tmp_path / "out/m/in"
    before = {one.name for one in folder.iterdir()}
    assert "m-undated.nc" in before
    (folder / "m-notes.nc").write_bytes(b"of the user")
    path.write_bytes(whole)
    assert make_archive(tmp_path, manifest, resume=True).done == 1
    listed = {file.name.rpartition("/")[2] for file in result_of(folder).files}
    assert {one.name for one in folder.iterdir()} == {*listed, "result.json", "m-notes.nc"}


def test_a_recording_without_dates_cannot_continue_another(tmp_path):
    write_files(tmp_path / "in", 3)
    for number, path in enumerate(sorted((tmp_path / "in").iterdir())):
        path.rename(path.with_name(f"{'abc'[number]}.npy"))
    undated = CONFIG.replace(DATED, "")
    counts = make_archive(tmp_path, CONTINUED.format('"in/*"'), config=undated)
    assert (counts.failed, counts.rows) == (1, 1)
    assert "cannot continue another recording" in result_of(tmp_path / "out/m/history").reason
    # They may be histories of their own.
    assert make_archive(tmp_path, EACH.format('"in/*"'), "each", config=undated).done == 3


def test_an_undated_history_in_parts_keeps_all_its_records(tmp_path):
    write_files(tmp_path / "in", 12)
    for number, path in enumerate(sorted((tmp_path / "in").iterdir())):
        path.rename(path.with_name(f"n{number:03}.npy"))
    undated = CONFIG.replace(DATED, "interval_s = 90000")
    make_archive(tmp_path, EACH.format('"in"'), "whole", config=undated)
    counts = make_archive(tmp_path, EACH.format('"in"'), part_blocks=5, config=undated)
    assert counts.rows == 12
    assert digests(tmp_path / "out/m/in") == digests(tmp_path / "whole/m/in")


def test_days_that_come_late_extend_the_file_of_their_day(tmp_path):
    write_files(tmp_path / "in", 14, hours=3.0)
    order = sorted(path.name for path in (tmp_path / "in").iterdir())
    # A logger that was read out a week later: hours of the first day come last.
    late = [order[0], *order[2:], order[1]]
    listed = ", ".join(f'"in/{name}"' for name in late)
    make_archive(tmp_path, CONTINUED.format(f"[{listed}]"), "whole")
    make_archive(tmp_path, CONTINUED.format(f"[{listed}]"), part_blocks=12)
    assert digests(tmp_path / "out/m/history") == digests(tmp_path / "whole/m/history")


class Crashing(SerialExecutor):
    """Loses the worker of each chunk of one recording."""

    def __init__(self, recording: int) -> None:
        super().__init__()
        self._label = f"recordings {recording}"

    def wait(self):
        call = self._calls[0]
        if call.label != self._label:
            return super().wait()
        self._calls.popleft()
        return ChunkOutcome(call.key, Failure("died", "the worker was lost", "no log"), 0.0, 0, "w", "x")


def test_a_recording_whose_workers_die_is_set_aside(tmp_path):
    for number in range(3):
        write_files(tmp_path / f"r{number}", 3, seed=number)
    runner = Runner(Crashing(2), open_store(tmp_path / "chunks"))
    counts = make_archive(tmp_path, EACH.format('"r*"'), runner=runner)
    assert (counts.done, counts.set_aside) == (2, 1)
    with Index(tmp_path / "out/index.db") as index:
        ((name, outcome),) = index.wrong()
    assert (name, outcome.status, outcome.log) == ("m/r1", SET_ASIDE, "no log")
    assert outcome.chunk == runner.tally.failed[0].chunk
    # Resumed, it alone is replayed.
    runner = Runner(SerialExecutor(), open_store(tmp_path / "chunks"))
    counts = make_archive(tmp_path, EACH.format('"r*"'), resume=True, runner=runner)
    assert (counts.done, runner.tally.chunks) == (3, 1)


def test_short_recordings_share_a_task_and_are_tried_alone_once_it_fails(tmp_path, monkeypatch):
    for number in range(4):
        write_files(tmp_path / f"r{number}", 1, seed=number)
    monkeypatch.setattr(replaying, "_KNOWN_TIMES", 1)
    monkeypatch.setattr(replaying, "TASK_SECONDS", 1e6)
    manifest = EACH.format('"r*"')
    together = Runner(SerialExecutor(), open_store(tmp_path / "chunks"))
    assert make_archive(tmp_path, manifest, runner=together).done == 4
    assert together.tally.chunks == 2
    # The second task is lost with its worker, and so is the second of its recordings, r2, alone.
    runner = Runner(Crashing(2), open_store(tmp_path / "others"))
    counts = make_archive(tmp_path, manifest, "crashed", runner=runner)
    assert (counts.done, counts.set_aside) == (3, 1)
    assert (runner.tally.chunks, len(runner.tally.failed)) == (3, 1)
    with Index(tmp_path / "crashed/index.db") as index:
        assert [name for name, _ in index.wrong()] == ["m/r2"]


def test_a_recording_that_raises_does_not_take_those_of_its_task_with_it(tmp_path, monkeypatch):
    for number in range(4):
        write_files(tmp_path / f"r{number}", 1, seed=number)
    monkeypatch.setattr(replaying, "_KNOWN_TIMES", 1)
    monkeypatch.setattr(replaying, "TASK_SECONDS", 1e6)
    whole = part.replay_part

    def failing(shared, one):
        if one.name == "r2":
            raise RuntimeError("the disk of the worker is full")
        return whole(shared, one)

    monkeypatch.setattr(part, "replay_part", failing)
    counts = make_archive(tmp_path, EACH.format('"r*"'))
    assert (counts.done, counts.set_aside) == (3, 1)
    with Index(tmp_path / "out/index.db") as index:
        ((name, outcome),) = index.wrong()
    assert (name, outcome.reason) == ("m/r2", "the disk of the worker is full")
    assert "RuntimeError" in (outcome.log or "")


def test_an_archive_is_not_continued_by_accident_or_with_another_manifest(tmp_path):
    write_files(tmp_path / "in", 2)
    make_archive(tmp_path, EACH.format('"in"'))
    with pytest.raises(ManifestError, match="holds an archive; --resume"):
        make_archive(tmp_path, EACH.format('"in"'))
    with pytest.raises(ManifestError, match="has changed since"):
        make_archive(tmp_path, EACH.format('"in/*"'), resume=True)
    with pytest.raises(WrongInputError, match=r"m\.toml: it or its maps have changed"):
        make_archive(tmp_path, EACH.format('"in"'), resume=True, config=CONFIG.replace("6205", "6206"))


def test_files_of_others_in_the_place_of_an_archive_stay(tmp_path):
    write_files(tmp_path / "in", 2)
    theirs = [tmp_path / "out" / name for name in ("archive-work/notes", "archive-work/inputs/a/b", "work/a", "m/b")]
    for path in theirs:
        path.parent.mkdir(parents=True)
        path.write_bytes(b"theirs")
    with pytest.raises(ManifestError, match="missing"):
        make_archive(tmp_path, EACH.format('["in", "missing"]'))
    plan = ArchivePlan(tmp_path / "manifest.toml", str(tmp_path / "out"), "zarr")
    make_archive(tmp_path, EACH.format('"in"'), records="zarr")
    with Index(tmp_path / "out/index.db") as index:
        delete_work(plan, index)
    assert [path.read_bytes() for path in theirs] == [b"theirs"] * 4
    assert sorted(path.name for path in (tmp_path / "out/archive-work").iterdir()) == ["inputs", "notes"]


@pytest.mark.parametrize("records", ["days", "zarr"])
def test_an_archive_whose_index_is_gone_is_not_begun_again_over_its_results(tmp_path, records):
    write_files(tmp_path / "in", 2)
    make_archive(tmp_path, EACH.format('"in"'), records=records)
    (tmp_path / "out/index.db").unlink()
    if records == "days":
        shutil.rmtree(tmp_path / "out/archive-work")
    before = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()}
    left = "m/in/result.json" if records == "days" else "archive-work/records/m/in/"
    with pytest.raises(ManifestError, match=f"holds {left}.* of an archive, and its index.db is gone"):
        make_archive(tmp_path, EACH.format('"in"'), records=records)
    with Index(tmp_path / "out/index.db") as index:
        assert not index.planned
    (tmp_path / "out/index.db").unlink()
    assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("out", ["", " ", "/", "//", "/.", "/tmp/..", "file:///"])
def test_an_archive_has_a_place_of_its_own(out):
    with pytest.raises(ManifestError, match="expected a folder or URL of the archive's own, got"):
        ArchivePlan(Path("fleet.toml"), out)


def test_addresses_of_messages_are_not_sent_to_workers(tmp_path):
    address = "https://ping.example/0c4f-planted"
    path = tmp_path / "m.toml"
    path.write_text(f'{CONFIG}\n[notify]\nheartbeat_url = "{address}"\n')
    store = FolderStore(tmp_path / "work")
    found = load_setup(store.url, send_setup(path, store)).config
    assert found.hash == load_config(path).hash
    assert not any(b"planted" in (store.read(name) or b"") for name in store.names())

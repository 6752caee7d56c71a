"""Results of a runner: in order, whatever the executor, the chunks, the failures and what was found done."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.words.errors import WrongInputError
from models.work import chunk
from models.work.errors import ChunksFailedError, LostFolderError
from models.work.folder_store import FolderStore
from models.work.pool import SerialExecutor
from models.work.runner import SERIAL, Runner
from models.work.task import Failure, Progress
from tests.models.work.tasks import (
    ScriptedExecutor,
    Shared,
    fails_on_odd,
    refuses_from,
    scaled,
    work,
    wrong_value,
)


def first(_count: int) -> int:
    return 0


def runs(_label: str) -> str:
    return "run"


@pytest.fixture
def store(tmp_path):
    return FolderStore(tmp_path / "chunks")


@given(st.data())
def test_results_do_not_depend_on_workers_chunks_failures_or_resume(tmp_path_factory, data):
    shared = Shared(1.5, np.arange(3.0))
    tasks = [float(i) for i in range(data.draw(st.integers(0, 12)))]
    kind = work(scaled, data.draw(st.integers(1, 4)))
    expected = np.array(list(SERIAL.run(kind, shared, tasks)))
    store = FolderStore(tmp_path_factory.mktemp("chunks"))
    losses: Counter[str] = Counter()

    def fate(label: str) -> str:
        # No chunk is lost three times.
        drawn = data.draw(st.sampled_from(["run", "late", "dies"])) if losses[label] < 2 else "run"
        losses[label] += drawn != "run"
        return drawn

    ran: set[str] = set()
    taken = data.draw(st.integers(0, len(tasks)))
    for resume in (False, True):
        executor = ScriptedExecutor(
            lambda count: data.draw(st.integers(0, count - 1)), fate, data.draw(st.integers(1, 4))
        )
        losses.clear()
        with Runner(executor, store, resume) as runner:
            found = runner.run(kind, shared, tasks)
            if not resume:
                # The first run is interrupted.
                results = [next(found) for _ in range(taken)]
                ran = set(executor.ran)
                assert np.array(results).tobytes() == expected[:taken].tobytes()
            else:
                assert np.array(list(found)).tobytes() == expected.tobytes()
                assert runner.tally.kept == len(ran)
                assert not ran & set(executor.ran)
            assert executor.greatest <= executor.most


def test_serial_is_a_plain_loop_over_objects():
    marker = object()
    assert list(SERIAL.run(work(lambda _, task: task), None, [marker])) == [marker]
    with pytest.raises(RuntimeError, match="1 is odd"):
        list(SERIAL.run(work(fails_on_odd), 0, [0, 1]))
    found = list(SERIAL.outcomes(work(fails_on_odd), 10, iter([0, 1, 2])))
    assert [(n, r.message if isinstance(r, Failure) else r) for n, r in found] == [(0, 10), (1, "1 is odd"), (2, 12)]


def test_chunks_that_fail_three_times_are_set_aside_and_listed(store):
    told: list[Progress] = []
    runner = Runner(SerialExecutor(), store, notify=told.append)
    got = []
    with pytest.raises(ChunksFailedError) as error:
        got.extend(runner.run(work(fails_on_odd), 10, [0, 2, 3, 4, 5, 6]))
    assert got == [10, 12]
    lines = str(error.value).splitlines()
    assert lines[0] == "2 of 6 chunks failed and were set aside:"
    assert lines[1:3] == ["  fails_on_odd 3: 3 is odd", "  fails_on_odd 5: 5 is odd"]
    assert str(store.url) in lines[3]
    assert [chunk.label for chunk in error.value.failed] == ["fails_on_odd 3", "fails_on_odd 5"]
    assert 'raise RuntimeError(f"{task} is odd")' in error.value.failed[0].log
    logs = [json.loads(store.read(name) or b"") for name in store.names("failed/")]
    assert len(logs) == 6
    assert all(log["kind"] == "builtins:RuntimeError" and "Traceback" in log["log"] for log in logs)
    assert (told[-1].done, told[-1].failed, told[-1].total) == (4, 2, 6)
    assert not list(store.names("started/"))
    # The others need not run again; what failed may be attempted anew.
    again = Runner(SerialExecutor(), store, resume=True)
    with pytest.raises(ChunksFailedError):
        list(again.run(work(fails_on_odd), 10, [0, 2, 3, 4, 5, 6]))
    assert len(list(store.names("failed/"))) == 6


def test_wrong_input_is_raised_when_its_turn_comes(store):
    executor = ScriptedExecutor(lambda count: count - 1, runs, 4)
    got = []
    with pytest.raises(WrongInputError) as error:
        got.extend(Runner(executor, store).run(work(refuses_from), 5, range(100)))
    assert got == [0, 1, 2, 3, 4]
    assert str(error.value) == "task 5: expected less than 5"
    assert any("refuses_from" in note for note in error.value.__notes__)
    assert len(executor.ran) < 10
    with pytest.raises(ValueError, match="invalid literal for int"):
        list(Runner(SerialExecutor(), store).run(work(wrong_value), None, [0, 1]))
    told: list[Progress] = []
    found = list(Runner(SerialExecutor(), store, notify=told.append).outcomes(work(refuses_from), 1, [0, 1]))
    assert found[0] == (0, 0)
    assert isinstance(found[1][1], Failure)
    assert found[1][1].wrong_input
    assert told[-1].failed == 1


def test_a_chunk_whose_workers_die_is_set_aside(store):
    fates = iter(["dies"] * 3 + ["run"] * 2)
    runner = Runner(ScriptedExecutor(first, lambda _: next(fates), 1), store)
    found = dict(runner.outcomes(work(scaled), Shared(1.0), [1.0, 2.0, 3.0]))
    assert isinstance(found[0], Failure)
    assert found[0].kind == "died"
    np.testing.assert_array_equal(found[2], [3.0] * 3)
    assert [chunk.label for chunk in runner.tally.failed] == ["scaled 1"]


def test_markers_of_lost_workers_count_until_they_are_cleared(store):
    def run(resume: bool) -> tuple[list[int], int]:
        runner = Runner(SerialExecutor(), store, resume)
        return list(runner.run(work(refuses_from), 9, [1])), runner.tally.kept

    assert run(True) == ([1], 0)
    (name,) = store.names("chunks/")
    key = name.rpartition("/")[2]
    store.delete(name)
    for n in range(3):
        store.write(f"started/{key}/{n}-ab", b'{"worker": "w"}')
    # Those of an earlier run of the program do not count.
    assert run(False) == ([1], 0)
    assert run(True) == ([1], 1)


@pytest.mark.parametrize("damage", [b"", b"torn"])
def test_a_torn_chunk_is_run_again(store, damage):
    expected = list(Runner(SerialExecutor(), store).run(work(refuses_from, 2), 9, range(6)))
    name = sorted(store.names("chunks/"))[1]
    whole = store.read(name)
    store.write(name, damage)
    runner = Runner(SerialExecutor(), store, resume=True)
    assert list(runner.run(work(refuses_from, 2), 9, range(6))) == expected
    assert (runner.tally.chunks, runner.tally.kept) == (3, 2)
    assert len(store.read(name) or b"") == len(whole or b"")


def test_shared_values_that_were_deleted_are_written_again(store):
    def forget(_label: str) -> str:
        for name in list(store.names("shared/")):
            store.delete(name)
        chunk._kept.clear()
        return "run"

    fates = iter([forget, runs, runs])
    runner = Runner(ScriptedExecutor(first, lambda label: next(fates)(label)), store)
    assert list(runner.run(work(refuses_from), 9, [1])) == [1]


def test_shared_values_that_are_damaged_are_written_again(store):
    list(Runner(SerialExecutor(), store).run(work(refuses_from), 9, [1]))
    for name in store.names("shared/"):
        store.write(name, b"torn")
    chunk._kept.clear()
    assert list(Runner(SerialExecutor(), store).run(work(refuses_from), 9, [2])) == [2]


def test_without_resume_nothing_of_an_earlier_run_is_used(store):
    list(Runner(SerialExecutor(), store).run(work(refuses_from), 9, [1]))
    executor = ScriptedExecutor(first, runs)
    assert list(Runner(executor, store).run(work(refuses_from), 9, [1])) == [1]
    assert executor.ran == ["refuses_from 1"]


def test_only_own_files_are_deleted_and_kept_where_asked(store):
    store.write("chunks/readme.txt", b"mine")
    with Runner(SerialExecutor(), store, keep=True) as runner:
        list(runner.run(work(refuses_from), 9, [1]))
    assert {name.split("/")[0] for name in store.names()} == {"chunks", "shared", "run.json"}
    # A caller that was killed had asked a worker to join.
    store.write("preflight/0123456789abcdef-tls___127_0_0_1_5", b"token")
    with Runner(SerialExecutor(), store, keep=False, resume=True) as runner:
        list(runner.run(work(refuses_from), 9, [1]))
    assert list(store.names()) == ["chunks/readme.txt"]
    store.delete("chunks/readme.txt")
    with Runner(SerialExecutor(), store, keep=False) as runner:
        list(runner.outcomes(work(refuses_from), 0, [1]))
    assert list(store.names("failed/"))


def test_workers_are_released_before_files_are_deleted_and_where_that_fails(store, monkeypatch):
    order = []
    executor = ScriptedExecutor(first, runs)
    monkeypatch.setattr(executor, "close", lambda: order.append("closed"))

    def refuse(_store):
        order.append("deletes")
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("models.work.runner.delete_own", refuse)
    with pytest.raises(PermissionError), Runner(executor, store, keep=False) as runner:
        list(runner.run(work(refuses_from), 9, [1]))
    assert order == ["closed", "deletes"]


def test_a_store_that_ends_with_the_run_is_not_said_to_keep_anything(store):
    runner = Runner(ScriptedExecutor(first, lambda label: "dies"), store, lasting=False)
    with pytest.raises(ChunksFailedError) as error:
        list(runner.run(work(refuses_from), 9, [1]))
    assert "kept" not in str(error.value)

    def interrupt(_count: int) -> int:
        raise KeyboardInterrupt

    runner = Runner(ScriptedExecutor(interrupt, runs), store, lasting=False)
    with pytest.raises(KeyboardInterrupt) as interrupted:
        list(runner.run(work(refuses_from), 9, [1]))
    assert not hasattr(interrupted.value, "__notes__")


def test_an_interrupted_run_says_what_is_kept(store):
    def interrupt(_count: int) -> int:
        raise KeyboardInterrupt

    executor = ScriptedExecutor(first, runs, 1)
    runner = Runner(executor, store, keep=False)
    found = runner.run(work(refuses_from), 9, [1, 2, 3])
    next(found)
    executor.choose = interrupt
    with pytest.raises(KeyboardInterrupt) as error, runner:
        next(found)
    assert error.value.__notes__ == [f"1 chunks of refuses_from are kept in {store.url}; --resume goes on from there"]
    assert len(list(store.names("chunks/"))) == 1


@pytest.mark.parametrize("stored", [True, False])
def test_tasks_follow_each_other_by_their_results(store, stored):
    def follow(task: int, result: int) -> int | None:
        assert result == task + 100
        return task + 10 if task < 20 else None

    def outcomes(resume: bool):
        runner = Runner(SerialExecutor(), store if stored else None, resume)
        found = list(runner.outcomes(work(fails_on_odd), 100, iter([0, 12, 15]), follow=follow))
        return [(n, r) for n, r in found if not isinstance(r, Failure)], found, runner.tally

    done, found, tally = outcomes(False)
    assert sorted(done) == [(0, 100), (0, 110), (0, 120), (1, 112), (1, 122)]
    assert [n for n, r in found if isinstance(r, Failure)] == [2]
    if stored:
        done, _, tally = outcomes(True)
        assert len(done) == tally.kept == 5
    with pytest.raises(ValueError, match="per_chunk 1"):
        list(SERIAL.outcomes(work(fails_on_odd, 2), 0, [], follow=follow))


def test_equal_tasks_share_a_chunk(store):
    executor = ScriptedExecutor(first, runs, 4)
    assert list(Runner(executor, store).run(work(refuses_from), 9, [1, 1, 2, 1])) == [1, 1, 2, 1]
    assert len(executor.ran) == 2
    runner = Runner(executor, store, resume=True)
    assert sorted(runner.outcomes(work(refuses_from), 9, [1, 1, 3])) == [(0, 1), (1, 1), (2, 3)]
    assert runner.tally.kept == 2


def test_runs_side_by_side_share_the_executor(store):
    executor = ScriptedExecutor(first, runs, 2)
    runner = Runner(executor, store)
    pairs = zip(runner.run(work(refuses_from), 9, range(9)), runner.run(work(fails_on_odd), 1, [0] * 9), strict=True)
    assert list(pairs) == [(n, 1) for n in range(9)]
    assert executor.greatest <= 2


def test_progress_counts_chunks_and_tells_the_time_left(store):
    told: list[Progress] = []
    executor = ScriptedExecutor(first, runs, 2)
    list(Runner(executor, store, notify=told.append).run(work(refuses_from, 2), 9, range(5)))
    assert [(p.done, p.total, p.kept, p.failed, p.name) for p in told] == [
        (n, 3, 0, 0, "refuses_from") for n in (1, 2, 3)
    ]
    assert told[-1].seconds_left == 0.0
    told.clear()
    (kept, *_) = store.names("chunks/")
    store.delete(kept)
    list(Runner(SerialExecutor(), store, True, told.append).run(work(refuses_from, 2), 9, range(5)))
    assert (told[-1].done, told[-1].kept) == (3, 2)
    told.clear()
    list(Runner(SerialExecutor(), notify=told.append).run(work(refuses_from, 2), 9, range(5)))
    assert [(p.done, p.total) for p in told] == [(1, 3), (2, 3), (3, 3)]
    told.clear()
    list(Runner(SerialExecutor(), notify=told.append).run(work(refuses_from), 9, iter(range(2)), total=2))
    assert [(p.done, p.total) for p in told] == [(1, 2), (2, 2)]


def test_a_place_where_no_chunks_can_be_kept_is_named(tmp_path):
    (tmp_path / "file").touch()
    with (
        Runner(SerialExecutor(), FolderStore(tmp_path / "file" / "chunks")) as runner,
        pytest.raises(WrongInputError, match="file/chunks: chunks cannot be kept there: Not a directory"),
    ):
        list(runner.run(work(scaled), Shared(1.0), [1.0]))


def test_a_folder_that_can_no_longer_be_written_ends_a_run_with_one_line(store, monkeypatch):
    runner = Runner(SerialExecutor(), store, keep=False)
    results = runner.run(work(refuses_from), 9, range(9))
    assert next(results) == 0
    with monkeypatch.context() as full:

        def refuse(*_: object) -> None:
            raise OSError(28, "No space left on device")

        full.setattr("os.open", refuse)
        with pytest.raises(LostFolderError) as error, runner:
            next(results)
    assert str(error.value) == (
        f"{store.url}: cannot be written: No space left on device; chunks that are done stay, --resume goes on with "
        "the others"
    )
    assert error.value.exit_code == 1
    again = Runner(SerialExecutor(), store, resume=True)
    assert list(again.run(work(refuses_from), 9, range(9))) == list(range(9))
    assert again.tally.kept == 1


def test_a_place_with_a_file_of_that_name_is_refused(tmp_path):
    (tmp_path / "run.json").write_text('{"speed": 1500}')
    with (
        pytest.raises(WrongInputError, match=r"holds a run\.json of something else"),
        Runner(SerialExecutor(), FolderStore(tmp_path)) as runner,
    ):
        list(runner.run(work(scaled), Shared(1.0), [1.0]))
    assert (tmp_path / "run.json").read_text() == '{"speed": 1500}'

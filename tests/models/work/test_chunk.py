"""What a worker does with a chunk: results in the store, and a failure for whatever stands against it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from models.work import chunk
from models.work.chunk import MAX_ATTEMPTS, chunk_key, chunk_name, clear_marks, read_chunk, run_chunk, sent_tasks
from models.work.codec import DamagedDataError, decode, digest_of, encode, name_of
from models.work.folder_store import FolderStore
from models.work.pool import SerialExecutor
from models.work.program import processor, program
from models.work.runner import Runner
from models.work.task import DIED, ChunkCall
from tests.models.work.tasks import Shared, fails_on_odd, leaks, scaled, unsendable, work


@pytest.fixture
def store(tmp_path):
    return FolderStore(tmp_path)


def call_of(store, function, shared, tasks) -> ChunkCall:
    data = encode(shared)
    store.write(f"shared/{digest_of(data)}", data)
    coded, name = encode(tasks), name_of(function)
    key = chunk_key(name, digest_of(data), coded)
    return ChunkCall(key, "some tasks", name, store.url, digest_of(data), coded, 1000, program(), caller="c0")


def test_results_are_in_the_store_and_no_marker_stays(store):
    call = call_of(store, scaled, Shared(2.0), [1.0, 2.0])
    outcome = run_chunk(call, worker="w1")
    assert (outcome.failure, outcome.worker, outcome.processor) == (None, "w1", processor())
    stored = read_chunk(store, call.key)
    assert stored is not None
    np.testing.assert_array_equal(stored.results, [[2.0] * 3, [4.0] * 3])
    assert outcome.size == len(store.read(f"chunks/{call.key[:2]}/{call.key}"))
    assert not list(store.names("started/"))
    assert call.tasks.decode("latin1") not in repr(call)
    assert replace(call, threads=True).key == call.key


def test_the_key_depends_on_all_that_results_depend_on(monkeypatch):
    keys = {
        chunk_key("a:b", "0", b"t"),
        chunk_key("a:c", "0", b"t"),
        chunk_key("a:b", "1", b"t"),
        chunk_key("a:b", "0", b"u"),
    }
    monkeypatch.setattr(chunk, "program", lambda: "another")
    assert len(keys | {chunk_key("a:b", "0", b"t")}) == 5


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        ({"program": "0" * 40}, "models.work.errors:OtherProgramError", "worker w runs another program"),
        ({"memory": 3_000_000}, "models.work.errors:MemoryNeedError", "some tasks needs 3 MB, worker w has 2 MB"),
        ({"shared": "0" * 40}, "builtins:FileNotFoundError", "workers and caller must reach the same store"),
        ({"function": "models.work.chunk:nothing"}, "models.work.codec:DamagedDataError", "this program has no"),
        ({"tasks": b"torn"}, "models.work.codec:DamagedDataError", "expected encoded data"),
    ],
)
def test_a_chunk_is_refused(store, change, kind, words):
    call = replace(call_of(store, scaled, Shared(2.0), [1.0]), **change)
    failure = run_chunk(call, memory=2_000_000, worker="w").failure
    assert failure is not None
    assert failure.kind == kind
    assert words in failure.message
    assert failure.wrong_input == kind.startswith("models.work.errors")
    (log,) = [json.loads(store.read(name)) for name in store.names("failed/")]
    assert (log["message"], log["worker"], log["label"]) == (failure.message, "w", "some tasks")
    assert not list(store.names("started/"))


def test_results_of_another_chunk_are_damage(store):
    one, other = (call_of(store, scaled, Shared(2.0), [task]) for task in (1.0, 2.0))
    assert run_chunk(other).failure is None
    for data in (store.read(chunk_name(other.key)), encode([1.0])):
        store.write(chunk_name(one.key), data)
        with pytest.raises(DamagedDataError, match=r"chunks/../.*: expected the results of this chunk, got others"):
            read_chunk(store, one.key)


def test_a_chunk_that_killed_three_workers_is_not_run_again(store):
    call = call_of(store, scaled, Shared(2.0), [1.0])

    def lose(count: int, caller: str = call.caller) -> None:
        for number in range(count):
            store.write(f"started/{call.key}/{caller}-{number}-ab", json.dumps({"worker": f"w{number}"}).encode())

    lose(MAX_ATTEMPTS - 1)
    assert run_chunk(call).failure is None
    # A success clears them.
    assert not list(store.names("started/"))
    lose(MAX_ATTEMPTS)
    failure = run_chunk(call).failure
    assert failure is not None
    assert (failure.kind, failure.message) == (DIED, "3 workers were lost while they ran it: w0, w1, w2")
    # Workers of other callers are at work on the same chunk.
    lose(MAX_ATTEMPTS, "ab")
    clear_marks(store, call.key, call.caller)
    assert run_chunk(call).failure is None
    assert len(list(store.names("started/"))) == MAX_ATTEMPTS


def test_damaged_files_are_named(store):
    call = call_of(store, scaled, Shared(2.0), [1.0])
    store.write(f"shared/{call.shared}", b"torn")
    chunk._kept.clear()
    failure = run_chunk(call).failure
    assert failure is not None
    assert failure.message.startswith(f"{store.url}/shared/{call.shared}: expected encoded data")


def test_a_chunk_that_ends_after_its_run_leaves_nothing(store, monkeypatch):
    call = call_of(store, scaled, Shared(2.0), [1.0])
    monkeypatch.setattr(chunk, "_ABANDONED_S", -1.0)
    assert run_chunk(call).failure is None
    store.delete(chunk_name(call.key))
    # The caller has deleted what is its own.
    store.delete(f"shared/{call.shared}")
    failure = run_chunk(call).failure
    assert failure is not None
    assert failure.message.endswith("its run has ended meanwhile")
    assert not list(store.names("chunks/"))


def test_what_is_told_of_a_failure_holds_no_credentials(store, monkeypatch):
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "planted-secret-1")
    failure = run_chunk(call_of(store, leaks, "https://user:planted-2@host/", [1])).failure
    assert failure is not None
    told = failure.message + failure.log + "".join(store.read(name).decode() for name in store.names("failed/"))
    assert "planted" not in told.replace('"planted', "")
    assert "https://***@host/" in failure.message


def test_a_result_that_cannot_be_kept_is_named(store):
    failure = run_chunk(call_of(store, unsendable, None, [0])).failure
    assert failure is not None
    assert failure.message.startswith("value.results[0]['a']: builtins.range")


def test_large_tasks_wait_in_the_store(store):
    tasks = [float(i) for i in range(20_000)]
    coded = encode(tasks)
    assert decode(sent_tasks(store, "k", coded)).key == "k"
    assert sent_tasks(store, "k", coded[:100]) == coded[:100]
    signed = encode([f"https://host/{number}.npy?X-Amz-Signature=planted" for number in range(2000)])
    assert sent_tasks(store, "signed", signed) == signed
    assert [*store.names()] == ["tasks/k"]
    found = list(Runner(SerialExecutor(), store, keep=False).run(work(fails_on_odd), 0, [2]))
    assert found == [2]
    with Runner(SerialExecutor(), store, keep=False) as runner:
        results = np.array(list(runner.run(work(scaled, 20_000), Shared(1.0), tasks)))
        assert len(list(store.names("tasks/"))) == 2
    np.testing.assert_array_equal(results[:, 0], tasks)
    assert list(store.names()) == ["tasks/k"]

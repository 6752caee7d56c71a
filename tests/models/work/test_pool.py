"""Threads and processes of this machine: the same results as a loop; a process that dies costs its chunk alone."""

from __future__ import annotations

import json
import multiprocessing
import os
import time
from typing import Any, cast

import numpy as np
import pytest

from models.words.errors import WrongInputError
from models.work.choose import local_runner, open_runner
from models.work.errors import MemoryNeedError
from models.work.folder_store import FolderStore
from models.work.pool import PoolExecutor
from models.work.runner import SERIAL, Runner
from models.work.task import Failure, Work
from tests.models.work.tasks import Shared, cleans_up, dies_once, fails_on_odd, process, refuses_from, scaled, work
from tests.support.waiting import wait_until

TASKS = [float(i) for i in range(7)]


@pytest.mark.process
def test_processes_give_what_a_loop_gives_and_survive_the_death_of_one(tmp_path):
    shared = Shared(0.1, np.arange(4.0))
    with open_runner(workers=2, chunks=tmp_path / "chunks", keep=True) as runner:
        expected = np.array(list(SERIAL.run(work(scaled), shared, TASKS)))
        assert np.array(list(runner.run(work(scaled, 2), shared, TASKS))).tobytes() == expected.tobytes()
        pids = set(runner.run(work(process), None, range(6)))
        assert os.getpid() not in pids
        assert 1 <= len(pids) <= 2
        waited_for = [child for child in multiprocessing.active_children() if child.name == "work"]
        assert list(runner.run(work(dies_once), str(tmp_path), range(3))) == [0, 1, 2]
        assert not list(FolderStore(tmp_path / "chunks").names("started/"))
        with pytest.raises(WrongInputError) as error:
            list(runner.run(work(refuses_from), 2, range(9)))
        assert str(error.value) == "task 2: expected less than 2"
        lazily = cast("Any", runner.run(work(cleans_up), str(tmp_path), range(3)))
        assert next(lazily) == 0
        wait_until(lambda: len(list(tmp_path.glob("temporary-*"))) == 2)
    assert waited_for
    for child in waited_for:
        # As multiprocessing does at the exit of a command that was interrupted while this one closed.
        child.join()
    # Those that are at work remove their temporary files when they are ended.
    assert not list(tmp_path.glob("temporary-*"))
    store = FolderStore(tmp_path / "chunks")
    logs = [json.loads(store.read(name) or b"") for name in store.names("failed/")]
    (died,) = (log for log in logs if log["kind"] == "died")
    assert died["message"] == "the process that ran it ended with exit code 9"
    assert died["label"] == "dies_once 2"
    # The run of the tests has a server of forks of its own.
    assert [child for child in multiprocessing.active_children() if child.name == "work"] == []


@pytest.mark.process
def test_processes_need_no_store_of_the_caller(tmp_path):
    with local_runner(2) as runner:
        assert os.getpid() not in set(runner.run(work(process), None, range(2)))
        assert runner.url is None
        # A single task needs no process.
        assert list(runner.run(work(process), None, [0])) == [os.getpid()]


@pytest.mark.parametrize("stored", [False, True])
def test_threads_give_what_a_loop_gives(tmp_path, stored):
    kind = work(scaled, 2, threads=True)
    expected = np.array(list(SERIAL.run(kind, Shared(0.1), TASKS)))
    with open_runner(workers=3, chunks=tmp_path / "chunks" if stored else None) as runner:
        assert np.array(list(runner.run(kind, Shared(0.1), TASKS))).tobytes() == expected.tobytes()
        lazily = cast("Any", runner.run(kind, Shared(0.1), iter(TASKS)))
        assert np.array([next(lazily) for _ in range(4)]).tobytes() == expected[:4].tobytes()
        lazily.close()
        outcomes = dict(runner.outcomes(work(fails_on_odd, threads=True), 0, range(4)))
        assert [isinstance(outcomes[n], Failure) for n in range(4)] == [False, True, False, True]
        assert {outcomes[0], outcomes[2]} == {0, 2}
    assert (tmp_path / "chunks").exists() == stored


def test_chunks_share_the_memory(tmp_path):
    most.clear()
    with Runner(PoolExecutor(4, memory=250), FolderStore(tmp_path)) as runner:
        assert list(runner.run(Work("count", count, 100, threads=True), None, range(12))) == [0] * 12
        assert max(most) <= 2
        with pytest.raises(MemoryNeedError) as error:
            list(runner.run(Work("large", count, 300_000_000, threads=True), None, range(2)))
    assert str(error.value) == "large 1 needs 300 MB, 0 MB are free"


def test_threads_of_a_plain_loop_are_as_many_as_the_memory_allows():
    for memory, workers in ((100, 2), (300, 1)):
        most.clear()
        with Runner(PoolExecutor(4, memory=250)) as runner:
            assert list(runner.run(Work("count", count, memory, threads=True), None, range(12))) == [0] * 12
        assert max(most) <= workers


at_work: list[int] = []
most: list[int] = []


def count(_shared: None, task: int) -> int:
    at_work.append(task)
    most.append(len(at_work))
    time.sleep(0.001)
    at_work.remove(task)
    return 0


def test_what_cannot_be_opened_is_refused(tmp_path):
    with pytest.raises(ValueError, match="workers must not be negative, got -1"):
        local_runner(-1)
    with pytest.raises(WrongInputError, match="resume: expected a folder or URL for chunks"):
        open_runner(resume=True)
    with pytest.raises(WrongInputError, match="cluster: expected a folder or URL for chunks"):
        open_runner(cluster="local")
    assert local_runner(1).executor.name == "serial"
    assert open_runner(workers=2, chunks=str(tmp_path)).executor.name == "processes"

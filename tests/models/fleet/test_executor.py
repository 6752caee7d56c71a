"""Chunks on a dask cluster: the results of one process, whatever is lost, refused or too large."""

from __future__ import annotations

import os
import socket
import ssl
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from models.fleet import roster as roster_module
from models.fleet.connect import ClusterError, RefusedWorkerError
from models.fleet.executor import ClusterExecutor
from models.words.errors import WrongInputError
from models.work.errors import ChunksFailedError, MemoryNeedError
from models.work.folder_store import FolderStore
from models.work.runner import SERIAL, Runner
from models.work.task import Work
from tests.models.fleet import jobs
from tests.models.work import tasks
from tests.support.effort import effort_count

pytestmark = pytest.mark.cluster


def files(store: FolderStore) -> list[str]:
    return [name for name in store.names() if not name.startswith(("chunks/", "shared/", "run.json"))]


def test_results_are_those_of_one_process_in_order(executor, store, capsys):
    shared = tasks.Shared(0.1, np.arange(5.0))
    work = tasks.work(tasks.scaled, 3)
    with Runner(executor, store) as runner:
        found = list(runner.run(work, shared, [0.1 * i for i in range(20)]))
    expected = list(SERIAL.run(work, shared, [0.1 * i for i in range(20)]))
    assert [value.tobytes() for value in found] == [value.tobytes() for value in expected]
    assert files(store) == []
    assert capsys.readouterr().out == ""


def test_capacity_follows_the_threads_and_chunks_run_in_several_processes(executor, store):
    assert executor.workers() == 2
    assert executor.capacity() == 4
    numbers = set(Runner(executor, store).run(tasks.work(tasks.process), None, range(12)))
    assert len(numbers) == 2


def test_all_ports_of_a_local_cluster_are_on_loopback(cluster):
    scheduler = cluster._cluster.scheduler
    assert scheduler.services["dashboard"].address == scheduler.listeners[0].bound_address[0] == "127.0.0.1"
    client = cluster.connect()
    try:
        client.wait_for_workers(2)
        # Asked of the workers themselves, once the scheduler knows both: another test ends one of them.
        assert list(client.run(jobs.listening).values()) == [["127.0.0.1"] * 2] * 2
    finally:
        client.close()


def test_workers_of_a_local_cluster_take_no_samples_of_their_stack(cluster):
    client = cluster.connect()
    try:
        client.wait_for_workers(1)
        names = client.run(jobs.periodic)
    finally:
        client.close()
    assert names
    assert all("heartbeat" in found and "profile" not in found for found in names.values())


def test_workers_of_a_local_cluster_that_are_started_again_have_its_settings(cluster):
    # What a nanny gives to the next worker, once the settings of this process are as before.
    kept = [nanny.config["distributed"]["worker"] for nanny in cluster._cluster.workers.values()]
    assert [(found["profile"]["enabled"], found["http"]["routes"]) for found in kept] == [(False, [])] * 2


def test_ports_of_a_local_cluster_ask_for_the_certificate_of_its_run(cluster):
    from distributed import Security

    client = cluster.connect()
    try:
        client.wait_for_workers(2)
        workers = client.scheduler_info()["workers"]
        pages = [found["services"]["dashboard"] for found in (client.scheduler_info(), *workers.values())]
    finally:
        client.close()
    addresses = [cluster._cluster.scheduler_address, *workers, *(worker["nanny"] for worker in workers.values())]
    assert len(addresses) == 5
    stranger = Security.temporary().get_connection_args("client")["ssl_context"]
    stranger.check_hostname, stranger.verify_mode = False, ssl.CERT_NONE
    for address in addresses:
        where = urlsplit(address)
        with (
            socket.create_connection((where.hostname, where.port), 5.0) as plain,
            stranger.wrap_socket(plain) as held,
            pytest.raises(ssl.SSLError, match=r"UNKNOWN_CA|CERTIFICATE"),
        ):
            held.recv(1)
    for port in pages:
        with pytest.raises(urllib.error.HTTPError, match="404") as refused:
            urllib.request.urlopen(f"http://127.0.0.1:{port}/info/main/workers.html", timeout=5)
        refused.value.close()


def test_libraries_within_chunks_do_not_ask_the_scheduler(cluster, executor, store):
    from dask import config

    assert list(Runner(executor, store).run(tasks.work(jobs.dask_scheduler), None, range(4))) == ["dask.local"] * 4
    client = cluster.connect()
    try:
        # Afterwards, tasks of others are as before.
        assert set(client.run(config.get, "scheduler", None).values()) == {None}
    finally:
        client.close()


def test_large_tasks_go_through_the_store(executor, store, monkeypatch):
    monkeypatch.setattr("models.work.chunk.MAX_SENT_BYTES", 100)
    sent = []
    monkeypatch.setattr(FolderStore, "write", _noting(FolderStore.write, sent))
    found = list(Runner(executor, store).run(tasks.work(jobs.repeated), 2, ["ab" * 1000]))
    assert found == ["ab" * 2000]
    assert [name for name in sent if name.startswith("tasks/")] == files(store)


def _noting(write, sent):
    def noted(self, name, data):
        sent.append(name)
        write(self, name, data)

    return noted


def test_wrong_input_is_raised_as_by_a_plain_loop(executor, store):
    with pytest.raises(WrongInputError, match=r"^task 3: expected less than 3(\n|$)"):
        list(Runner(executor, store).run(tasks.work(tasks.refuses_from), 3, range(8)))


def test_a_chunk_that_fails_is_set_aside_and_the_others_done(executor, store):
    with pytest.raises(ChunksFailedError) as caught:
        list(Runner(executor, store).run(tasks.work(tasks.fails_on_odd), 10, range(4)))
    logs = {chunk.label: chunk.log for chunk in caught.value.failed}
    assert sorted(logs) == ["fails_on_odd 2", "fails_on_odd 4"]
    assert "RuntimeError: 1 is odd" in logs["fails_on_odd 2"]
    assert len(list(store.names("chunks/"))) == 2


def test_a_lost_worker_costs_only_its_chunk(executor, store, tmp_path):
    found = list(Runner(executor, store).run(tasks.work(tasks.dies_once), str(tmp_path), range(2)))
    assert found == [0, 1]


@pytest.mark.skipif(effort_count(quick=1, full=0) == 1, reason="six seconds of restarting workers: full effort")
def test_a_chunk_that_kills_its_workers_is_set_aside(executor, store):
    with pytest.raises(ChunksFailedError) as caught:
        list(Runner(executor, store).run(tasks.work(jobs.dies_on), 1, range(3)))
    assert [chunk.label for chunk in caught.value.failed] == ["dies_on 2"]
    assert "3 workers were lost" in str(caught.value)
    assert len(list(store.names("chunks/"))) == 2


def test_a_chunk_that_fits_no_worker_is_refused_with_both_numbers(executor, store):
    work = Work("rows", tasks.scaled, memory=10**15)
    with pytest.raises(MemoryNeedError, match=r"rows 1 needs 1000000000 MB, the largest worker of local has \d+ MB"):
        list(Runner(executor, store).run(work, tasks.Shared(1.0), [1.0]))


def test_workers_of_another_program_are_refused_by_name(cluster, store, monkeypatch):
    real = roster_module.facts
    monkeypatch.setattr(roster_module.Roster, "_check_scheduler", lambda self: None)
    monkeypatch.setattr(roster_module, "facts", lambda: real() | {"program": "0" * 40})
    with pytest.raises(RefusedWorkerError, match=r"worker \d at tls://127\.0\.0\.1:\d+: spallwatch of other files"):
        ClusterExecutor(cluster, store, print)


class Elsewhere(FolderStore):
    """A folder that workers see as another one."""

    def __init__(self, folder: Path, seen: Path) -> None:
        super().__init__(folder)
        self.url = str(seen)


def test_workers_that_reach_another_folder_are_refused(cluster, tmp_path):
    with pytest.raises(RefusedWorkerError, match="all workers must reach the same"):
        ClusterExecutor(cluster, Elsewhere(tmp_path / "a", tmp_path / "b"), print)


def test_chunks_stay_away_from_workers_that_only_another_caller_accepts(cluster, executor, tmp_path, monkeypatch):
    """All workers offer memory to the first caller; the second one's store is reached by one of them."""
    monkeypatch.setattr(roster_module.Roster.wait_for, "__kwdefaults__", {"strict": False})
    monkeypatch.setattr(cluster, "workers", 1)
    (tmp_path / "seen").mkdir()
    seen = Elsewhere(tmp_path / "seen" / "chunks", Path("/proc/self/cwd/chunks"))
    client = cluster.connect()
    near, far = client.scheduler_info()["workers"]
    told: list[str] = []
    folders = client.run(os.getcwd)
    try:
        client.run(os.chdir, str(tmp_path / "seen"), workers=[near])
        with Runner(ClusterExecutor(cluster, seen, told.append), seen) as runner:
            numbers = list(runner.run(tasks.work(tasks.process), None, range(6)))
        assert numbers == list(client.run(os.getpid, workers=[near]).values()) * 6
    finally:
        client.run(os.chdir, folders[near], workers=[near])
        client.close()
    assert [far in line and "all workers must reach the same" in line for line in told] == [True]


def test_too_few_workers_are_told(cluster, store, monkeypatch):
    monkeypatch.setattr(cluster, "workers", 5)
    monkeypatch.setattr(roster_module.Roster.wait_for, "__defaults__", (0.2,))
    with pytest.raises(ClusterError, match=r"local: \d workers take part after 0 s, expected 5"):
        ClusterExecutor(cluster, store, print)

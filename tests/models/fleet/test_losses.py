"""What the executor does when workers or the scheduler are lost: with a scripted client, no processes."""

from __future__ import annotations

import operator
import pkgutil
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace
from typing import Any

import pytest

from models.fleet import executor as executor_module
from models.fleet import roster as roster_module
from models.fleet.connect import ClusterError
from models.fleet.executor import ClusterExecutor
from models.fleet.member import Membership, answer_name, facts, join, turn_name
from models.fleet.roster import SILENT_S
from models.work import chunk
from models.work.codec import encode
from models.work.folder_store import FolderStore
from models.work.program import program
from models.work.task import DIED, ChunkCall, ChunkOutcome
from tests.models.work import tasks

pytest.importorskip("distributed")

MEMORY = 10_000


class Future:
    """A future whose end the test says."""

    def __init__(self, key: str) -> None:
        self.key, self.status, self.value = key, "pending", None
        self.callbacks: list[Callable[[Future], None]] = []
        self.workers: list[str] = []

    def add_done_callback(self, function):
        self.callbacks.append(function)
        if self.done():
            function(self)

    def done(self):
        return self.status != "pending"

    def end(self, status: str, value: Any = None) -> None:
        self.status, self.value = status, value
        for function in self.callbacks:
            function(self)

    def result(self, timeout):
        assert timeout > 0
        if self.value is None:
            raise TimeoutError
        return self.value

    exception = result


class Client:
    """A client of a scheduler with some workers; it runs nothing."""

    def __init__(self, store: FolderStore, workers: list[str]) -> None:
        self.status, self.store, self.present = "running", store, workers
        self.futures: list[Future] = []
        self.at_work: dict[str, list[str]] = {}
        self.offers: dict[str, dict[str, float]] = {}
        self.heard: dict[str, float] = {}
        self.paused: dict[str, int] = {}
        self.scheduler = SimpleNamespace(set_restrictions=self.restrict)

    def run_on_scheduler(self, _function):
        return facts()

    def scheduler_info(self, n_workers):
        assert n_workers == -1
        return {
            "workers": {
                address: {
                    "last_seen": self.heard.get(address, 0.0),
                    "resources": self.offers.get(address, {}),
                    "status": "paused" if address in self.paused else "running",
                    "metrics": {"task_counts": {"executing": self.paused.get(address, 0)}},
                }
                for address in self.present
            }
        }

    def submit(self, function, *arguments, workers=(), key, pure, resources=MappingProxyType({})):
        assert pure is False
        if self.status != "running":
            raise RuntimeError("closed")
        future = Future(key)
        if function is pkgutil.resolve_name:
            assert pkgutil.resolve_name(*arguments) is join
        elif function is operator.call:
            token, resource = arguments[2], arguments[4]
            self.offers[workers[0]] = {resource: MEMORY}
            self.store.write(answer_name(token, workers[0]), token.encode())
            future.end("finished", Membership(workers[0], 1, MEMORY))
        else:
            name = arguments[1]
            assert resources == {name: 1000} | ({} if arguments[0].threads else {turn_name(name): 1})
            assert workers
            future.workers = workers
            self.futures.append(future)
        return future

    def sync(self, function, **arguments):
        return function(**arguments)

    def restrict(self, worker):
        for future in self.futures:
            future.workers = worker.get(future.key, future.workers)

    def processing(self):
        return self.at_work

    def close(self, timeout):
        self.status = "closed"

    def lose(self) -> None:
        self.status = "connecting"
        for future in self.futures:
            if not future.done():
                future.end("cancelled")


class Cluster:
    """A cluster that gives one client after another."""

    address, workers, lasting = "tls://h:1", 1, True

    def __init__(self, *clients: Client | Exception) -> None:
        self.clients = list(clients)
        self.closed = False

    def connect(self):
        client = self.clients.pop(0) if len(self.clients) > 1 else self.clients[0]
        if isinstance(client, Exception):
            raise client
        return client

    def close(self):
        self.closed = True


@pytest.fixture(autouse=True)
def fast(monkeypatch):
    monkeypatch.setattr(executor_module, "_LOOK_S", 0.0)
    monkeypatch.setattr(executor_module.time, "sleep", lambda _: None)


@pytest.fixture
def store(tmp_path):
    return FolderStore(tmp_path)


@pytest.fixture
def told() -> list[str]:
    return []


def call(store: FolderStore, number: int = 1, memory: int = 1000) -> ChunkCall:
    shared = encode(0)
    store.write("shared/s", shared)
    name = f"{tasks.__name__}:fails_on_odd"
    return ChunkCall(f"{number:040x}", f"chunk {number}", name, store.url, "s", encode([2]), memory, program())


def test_what_was_under_way_is_sent_again_to_a_scheduler_that_is_back(store, told):
    first, second = Client(store, ["tls://a:1"]), Client(store, ["tls://b:1"])
    second.present.append("tcp://10.0.0.7:5")
    executor = ClusterExecutor(Cluster(first, ClusterError("not yet"), second), store, told.append)
    for number in (1, 2):
        executor.submit(call(store, number))
    store.write(f"started/{1:040x}/-1-a", b"{}")
    # The worker of the second chunk has ended it before it went.
    assert chunk.run_chunk(call(store, 2), worker="w").failure is None
    first.lose()
    outcome = executor.wait()
    assert (outcome.key, outcome.failure, outcome.worker) == (f"{2:040x}", None, "w")
    assert [future.key.split("-")[1] for future in second.futures] == [f"{1:040x}"]
    assert list(store.names("started/")) == []
    assert "waiting up to 300 s" in told[0]
    assert "10.0.0.7:5" in told[1]
    assert "1 workers are back" in told[2]
    again = replace(outcome, key=f"{1:040x}")
    second.futures[0].end("finished", again)
    assert executor.wait() is again
    executor.close()


def test_a_scheduler_that_stays_away_ends_the_run(store, told):
    client = Client(store, ["tls://a:1"])
    cluster = Cluster(client, ClusterError("nobody answers"))
    executor = ClusterExecutor(cluster, store, told.append, reconnect_s=0.0)
    executor.submit(call(store))
    client.lose()
    with pytest.raises(ClusterError, match="was lost, and did not come back within 0 s: nobody answers"):
        executor.wait()
    executor.close()
    assert cluster.closed


def test_a_scheduler_of_this_process_does_not_come_back(store, told):
    client = Client(store, ["tls://a:1"])
    cluster = Cluster(client)
    cluster.lasting = False
    executor = ClusterExecutor(cluster, store, told.append)
    executor.submit(call(store))
    client.lose()
    with pytest.raises(ClusterError, match="the scheduler was lost"):
        executor.wait()


def killed() -> Exception:
    from distributed import KilledWorker

    last: Any = SimpleNamespace(address="tls://a:1")
    return KilledWorker("key", last, 3)


def test_a_chunk_that_only_waited_on_lost_workers_is_sent_again(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    executor.submit(call(store))
    executor._take(_ended(client.futures[-1], killed()))
    assert len({future.key for future in client.futures}) == 2
    # What is said of the future before is nothing any more.
    executor._take(client.futures[0])
    assert len(client.futures) == 2
    for number in range(3):
        store.write(f"started/{1:040x}/{call(store).caller}-{number}", b"{}")
    client.futures[-1].end("error", killed())
    outcome = executor.wait()
    assert outcome.failure is not None
    assert outcome.failure.kind == DIED
    assert "the last one at tls://a:1" in outcome.failure.message


def test_a_chunk_that_kills_its_workers_before_it_begins_is_given_up(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    executor.submit(call(store))
    for _ in range(executor_module.MAX_LOSSES):
        assert not executor._outcomes
        executor._take(_ended(client.futures[-1], killed()))
    assert executor.wait().failure is not None


def _ended(future: Future, error: Exception) -> Future:
    future.status, future.value = "error", error
    return future


def test_a_chunk_that_no_worker_has_is_sent_again_when_one_can_take_it(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    executor.submit(call(store))
    client.present = []
    executor._look()
    executor._look()
    assert executor.workers() == 0
    assert len(client.futures) == 1
    client.present = ["tls://b:1"]
    executor._look()
    assert len(client.futures) == 2
    client.at_work = {"tls://b:1": [client.futures[-1].key]}
    executor._look()
    executor._look()
    assert len(client.futures) == 2


def test_without_any_worker_the_run_ends_after_a_while(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append, idle_s=-1.0)
    executor.submit(call(store))
    client.present = []
    with pytest.raises(ClusterError, match=r"no worker for chunk 1, which needs 0 MB; 0 workers take part"):
        executor.wait()


def test_a_worker_that_comes_later_and_cannot_be_used_gets_nothing(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    client.present = ["tls://a:1", "tcp://10.0.0.7:5"]
    executor._look()
    assert executor.workers() == 1
    assert len(told) == 1
    assert "tcp://10.0.0.7:5" in told[0]
    executor._look()
    assert len(told) == 1
    client.present = ["tls://a:1", "tls://c:1"]
    executor._look()
    assert executor.workers() == 2
    assert list(store.names("preflight/")) == []


def test_workers_are_asked_while_outcomes_keep_coming(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    for number in range(3):
        executor.submit(call(store, number))
        client.futures[-1].end("finished", ChunkOutcome(f"{number:040x}", None, 0.0, 0, "w", "p"))
    client.present = ["tls://a:1", "tls://b:1"]
    assert executor.wait().key == f"{0:040x}"
    assert executor.workers() == 2


def test_an_outcome_that_went_with_its_worker_is_found_in_the_store(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    executor.submit(call(store))
    client.futures[0].end("finished", None)
    executor._take(client.futures[0])
    assert len(client.futures) == 2
    assert chunk.run_chunk(call(store), worker="w").failure is None
    client.futures[1].end("finished", None)
    assert executor.wait().worker == "w"
    assert len(client.futures) == 2


def test_chunks_go_to_the_workers_that_take_part(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    client.present = ["tls://a:1", "tls://b:1", "tcp://10.0.0.7:5"]
    executor._look()
    executor.submit(call(store))
    assert client.futures[0].workers == ["tls://a:1", "tls://b:1"]
    client.present = []
    executor._look()
    # Without a name, any worker of the scheduler could have it.
    executor.submit(call(store, 2))
    assert len(client.futures) == 1
    client.present = ["tls://c:1"]
    executor._look()
    executor._look()
    assert [future.workers for future in client.futures[1:]] == [["tls://c:1"]] * 2


def test_a_worker_that_joins_may_take_what_waits_for_others(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    for number in (1, 2):
        executor.submit(call(store, number))
    client.at_work = {"tls://a:1": [client.futures[0].key, client.futures[1].key, "of-another-caller"]}
    client.present = ["tls://a:1", "tls://b:1"]
    executor._look()
    assert [future.workers for future in client.futures] == [["tls://a:1", "tls://b:1"]] * 2


def test_a_worker_that_began_anew_at_the_same_port_is_asked_again(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    resource = executor._roster.resource
    client.offers["tls://a:1"] = {}
    executor._look()
    assert client.offers == {"tls://a:1": {resource: MEMORY}}
    assert executor.workers() == 1


def test_a_chunk_of_a_silent_worker_is_sent_again_once(store, told):
    client = Client(store, ["tls://a:1", "tls://b:1", "tls://c:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    executor.submit(call(store))
    client.at_work = {"tls://a:1": [client.futures[0].key]}
    client.heard = {"tls://b:1": SILENT_S, "tls://c:1": SILENT_S}
    executor._look()
    assert told == []
    client.heard = {"tls://b:1": SILENT_S + 1, "tls://c:1": SILENT_S + 1}
    executor._look()
    executor._look()
    assert told == ["worker tls://a:1 is silent for 30 s: others get its chunks"]
    assert executor.workers() == 2
    assert [future.workers for future in client.futures[1:]] == [["tls://b:1", "tls://c:1"]]
    # Where the next one is silent, too, it may be the chunk: it is left there, until one of both has ended it.
    client.at_work["tls://b:1"] = [client.futures[1].key]
    client.heard["tls://c:1"] += SILENT_S + 1
    for _ in range(3):
        executor._look()
    assert len(client.futures) == 2
    assert chunk.run_chunk(call(store), worker="a").failure is None
    executor._look()
    assert executor.wait().worker == "a"


def test_a_worker_that_is_paused_with_nothing_at_work_takes_no_part(store, told, monkeypatch):
    monkeypatch.setattr(roster_module, "PAUSED_S", -1.0)
    client = Client(store, ["tls://a:1", "tls://b:1", "tls://c:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    executor.submit(call(store))
    client.at_work = {"tls://a:1": [client.futures[0].key]}
    # The memory of c belongs to a chunk that will end.
    client.paused = {"tls://a:1": 0, "tls://c:1": 1}
    for _ in range(3):
        executor._look()
    assert told == ["worker tls://a:1 is paused for -1 s, its memory is full: others get its chunks"]
    assert executor.workers() == 2
    assert [future.workers for future in client.futures[1:]] == [["tls://b:1", "tls://c:1"]]
    client.paused = {}
    executor._look()
    assert executor.workers() == 3


def test_chunks_of_threads_take_no_turn(store, told):
    client = Client(store, ["tls://a:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    # What each takes, the client checks.
    for threads in (True, False):
        executor.submit(replace(call(store), key=f"{threads:040d}", threads=threads))
    assert len(client.futures) == 2


def test_a_silent_worker_that_answers_takes_part_again(store, told):
    client = Client(store, ["tls://a:1", "tls://b:1"])
    executor = ClusterExecutor(Cluster(client), store, told.append)
    client.heard = {"tls://b:1": SILENT_S + 1}
    executor._look()
    assert executor.workers() == 1
    client.heard = {"tls://b:1": SILENT_S + 1, "tls://a:1": SILENT_S}
    executor._look()
    assert executor.workers() == 2

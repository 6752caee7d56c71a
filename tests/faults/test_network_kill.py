"""Connection, sender, broker and receiver are killed at random: every block arrives, once, as it was sent."""

from __future__ import annotations

import random
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from monitor.records.store import Store
from monitor.service.ingest import Ingest
from streams.link.mqtt import MqttLink
from streams.link.sender import Link, Sender, TcpLink
from streams.reblock import samples_hash
from streams.types.spec import parse_address
from tests.support.broker import Broker
from tests.support.effort import effort_count
from tests.support.forks import Fork, Messages
from tests.support.network_kill import Made, block, config
from tests.support.proxy import Proxy
from tests.support.waiting import wait_until

pytestmark = pytest.mark.process

KILLS = effort_count(quick=2, full=50)
"""Of each kind."""


def link(url: str) -> Link:
    address = parse_address(url, "test")
    return TcpLink(address, "s", 5.0) if address.scheme == "tcp" else MqttLink(address, timeout=5.0)


def receive(messages: Messages, url: str, database: Path) -> None:
    """Commit whatever comes."""
    with Store.open(database, machine="m") as store, Ingest.open(config(url), store) as ingest:
        messages.send("open")
        ingest.run(threading.Event(), lambda record: None)


def send(messages: Messages, url: str) -> None:
    """Send a recording that never ends."""
    messages.send("open")
    Sender(Made(), link(url), pace=4.0, stall=2.0, patience=1e9).run()


class Child:
    """A process of the test that can be killed and started again."""

    def __init__(self, target: Callable[..., None], *arguments: object) -> None:
        self._target, self._arguments = target, arguments
        self._process: Fork | None = None

    def start(self) -> None:
        self._process = Fork(self._target, *self._arguments)

    def wait_for_message(self) -> None:
        assert self._process is not None
        self._process.receive()

    def kill(self) -> None:
        if self._process is not None:
            process, self._process = self._process, None
            assert process.alive, "the process ended by itself"
            process.kill()

    def restart(self) -> None:
        self.kill()
        self.start()


@contextmanager
def running(*children: Child) -> Iterator[None]:
    try:
        for child in children:
            child.start()
        for child in children:
            child.wait_for_message()
        yield
    finally:
        for child in children:
            child.kill()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def last_of(database: Path) -> int:
    with Store.open(database, read_only=True) as store:
        return store.last("s")


def wait_for_progress(database: Path, least: int) -> int:
    wait_until(lambda: last_of(database) >= least, lambda: last_of(database), every=0.05)
    return last_of(database)


def check(database: Path, last: int) -> None:
    with Store.open(database, read_only=True) as store:
        assert store.check() == []
        rows = store.rows("SELECT sequence, content_hash, status FROM blocks WHERE source = 's' ORDER BY sequence")
        changed = store.counts().get("changed", 0)
    sent = [block(number) for number in range(1, last + 1)]
    assert rows == [(b.sequence, samples_hash(b.samples, b.rate, b.channels), "ok") for b in sent]
    assert changed == 0


def kill_at_random(
    kinds: dict[str, Callable[[], None]], database: Path, generator: random.Random, finish: Callable[[int], None]
) -> None:
    """Kill each kind so many times, in random order and at random moments, then send what is left."""
    order = [kind for kind in kinds for _ in range(KILLS)]
    generator.shuffle(order)
    last = wait_for_progress(database, 1)
    for number, kind in enumerate(order):
        time.sleep(generator.uniform(0.0, 0.3))
        kinds[kind]()
        if number % 4 == 3:
            # Else a run of kills would go by before anything is sent again.
            last = wait_for_progress(database, last + 1)
    last = wait_for_progress(database, last + 1) + 50
    finish(last)
    check(database, last)


def test_tcp_with_connection_sender_and_receiver_killed(tmp_path: Path) -> None:
    generator, database, port = random.Random(7), tmp_path / "state.db", free_port()
    receiver = Child(receive, f"tcp://127.0.0.1:{port}", database)
    with Proxy(port) as proxy:
        url = f"tcp://127.0.0.1:{proxy.port}"
        sender = Child(send, url)
        with running(receiver, sender):

            def finish(last: int) -> None:
                sender.kill()
                assert Sender(Made(), link(url), limit=last, patience=60.0).run().acknowledged == last

            kinds = {
                "connection": lambda: proxy.cut(reset=generator.random() < 0.5),
                "sender": sender.restart,
                "receiver": receiver.restart,
            }
            kill_at_random(kinds, database, generator, finish)


@pytest.mark.broker
def test_mqtt_with_connection_sender_broker_and_receiver_killed(tmp_path: Path) -> None:
    generator, database = random.Random(8), tmp_path / "state.db"
    with Broker(tmp_path / "broker") as broker, Proxy(broker.port) as proxy:
        url = f"mqtt://127.0.0.1:{proxy.port}/plant/press"
        receiver, sender = Child(receive, url, database), Child(send, url)

        def restart_broker() -> None:
            broker.kill()
            broker.start()

        def finish(last: int) -> None:
            sender.kill()
            assert Sender(Made(), link(url), limit=last, stall=2.0, patience=60.0).run().acknowledged == last

        with running(receiver, sender):
            kinds = {
                "connection": lambda: proxy.cut(reset=generator.random() < 0.5),
                "sender": sender.restart,
                "receiver": receiver.restart,
                "broker": restart_broker,
            }
            kill_at_random(kinds, database, generator, finish)

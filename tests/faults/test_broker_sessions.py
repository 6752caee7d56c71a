"""Certificates, sessions and quotas of a real broker that are wrong: each block once, and the status says so."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from streams.link.mqtt import MqttLink, MqttReceiver
from streams.link.mqtt_client import end_client
from streams.link.sender import Sender, SendError
from streams.types.block import Block
from streams.types.spec import NetworkSpec, SourceSpec, parse_address
from tests.streams.tcp_peers import Recorded
from tests.support.broker import Broker
from tests.support.committing import committing
from tests.support.memory_ledger import MemoryLedger
from tests.support.receivers import make_certificate
from tests.support.waiting import wait_until

TOPIC = "plant/press"
GOES_ON_S = 5.0


def url(broker: Broker) -> str:
    return f"mqtt://127.0.0.1:{broker.port}/{TOPIC}"


@contextmanager
def receiving(broker: Broker, ledger: MemoryLedger, network: NetworkSpec) -> Iterator[MqttReceiver]:
    with MqttReceiver([SourceSpec("press", url(broker))], network) as receiver:
        receiver.open(ledger)
        yield receiver


def link(broker: Broker, network: NetworkSpec | None = None) -> MqttLink:
    return MqttLink(parse_address(url(broker), "test"), network)


# paho leaves the socket of a refused handshake to the garbage collector.
@pytest.mark.filterwarnings("ignore:Exception ignored in.*SSLSocket:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.broker
@pytest.mark.parametrize("wrong", ["expired", "elsewhere", "stranger"])
def test_a_wrong_certificate_gets_nothing_and_is_named_until_it_is_right(tmp_path: Path, wrong: str) -> None:
    right = make_certificate(tmp_path)
    made = {
        "expired": lambda: make_certificate(tmp_path, wrong, expired=True),
        "elsewhere": lambda: make_certificate(tmp_path, wrong, "DNS:elsewhere.example"),
        "stranger": lambda: make_certificate(tmp_path, wrong),
    }[wrong]()
    # The last one is of an authority that is not trusted, the others are wrong in themselves.
    words = {"expired": "expired", "elsewhere": "IP address mismatch", "stranger": "self-signed"}[wrong]
    served, trusted = tmp_path / "served.pem", tmp_path / "trusted.pem"
    key = tmp_path / "served.key"
    served.write_bytes(made.cert.read_bytes())
    key.write_bytes(made.key.read_bytes())
    trusted.write_bytes(right.cert.read_bytes() + (b"" if wrong == "stranger" else made.cert.read_bytes()))
    broker = Broker(tmp_path / "broker", "allow_anonymous true", f"certfile {served}", f"keyfile {key}")
    network, ledger = NetworkSpec(ca_file=trusted), MemoryLedger()
    with broker, receiving(broker, ledger, network) as receiver, committing(receiver, ledger):
        wait_until(lambda: words in (receiver.problem() or ""))
        assert "certificate verify failed" in (receiver.problem() or "")
        with pytest.raises(SendError, match=words):
            Sender(Recorded(range(1, 3)), link(broker, network), patience=0.0, sleep=lambda _: None).run()
        broker.kill()
        served.write_bytes(right.cert.read_bytes())
        key.write_bytes(right.key.read_bytes())
        broker.start()
        begin = time.monotonic()
        wait_until(lambda: receiver.problem() is None)
        assert time.monotonic() - begin < GOES_ON_S
        assert Sender(Recorded(range(1, 4)), link(broker, network)).run().acknowledged == 3


@pytest.mark.broker
def test_a_session_that_another_client_takes_over_loses_and_doubles_nothing(tmp_path: Path) -> None:
    """The other one even acknowledges what it gets, so that the broker forgets it."""
    ledger, ending, taken = MemoryLedger(), threading.Event(), []
    network = NetworkSpec(client_id="of-the-plant")

    def take_over() -> None:
        while not ending.is_set():
            other = Client(CallbackAPIVersion.VERSION2, client_id="of-the-plant", clean_session=False)
            other.on_message = lambda client, userdata, message: taken.append(message.payload)
            other.connect("127.0.0.1", broker.port)
            other.loop_start()
            ending.wait(0.3)
            end_client(other)
            ending.wait(1.5)

    with Broker(tmp_path / "broker") as broker, receiving(broker, ledger, network) as receiver:
        wait_until(lambda: receiver.problem() is None)
        thread = threading.Thread(target=take_over)
        thread.start()
        try:
            with committing(receiver, ledger) as items:
                wait_until(lambda: "connection to the broker lost" in (receiver.problem() or ""))
                result = Sender(Recorded(range(1, 61)), link(broker), stall=1.0).run()
        finally:
            ending.set()
            thread.join()
        assert result.acknowledged == 60
        wait_until(lambda: receiver.problem() is None)
    assert [item.sequence for item in items if isinstance(item, Block)] == list(range(1, 61))


@pytest.mark.broker
def test_what_a_quota_of_the_broker_drops_is_sent_again(tmp_path: Path) -> None:
    limits = ("allow_anonymous true", "max_inflight_messages 1", "max_queued_messages 2")
    ledger, network = MemoryLedger(), NetworkSpec()
    with Broker(tmp_path / "broker", *limits) as broker, receiving(broker, ledger, network) as receiver:
        wait_until(lambda: receiver.problem() is None)
        with committing(receiver, ledger) as items:
            result = Sender(Recorded(range(1, 21)), link(broker), stall=1.0).run()
    assert (result.acknowledged, result.reconnects > 0) == (20, True)
    assert [item.sequence for item in items if isinstance(item, Block)] == list(range(1, 21))


@pytest.mark.broker
def test_a_frame_that_the_broker_does_not_take_is_an_error_of_the_sender(tmp_path: Path) -> None:
    limits = ("allow_anonymous true", "message_size_limit 500")
    ledger, network = MemoryLedger(), NetworkSpec()
    with Broker(tmp_path / "broker", *limits) as broker, receiving(broker, ledger, network) as receiver:
        wait_until(lambda: receiver.problem() is None)
        with pytest.raises(SendError):
            Sender(Recorded(range(1, 4)), link(broker), patience=1.0).run()
        assert receiver.next(0.0) is None

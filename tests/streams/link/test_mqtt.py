"""The MQTT receiver against a real broker: each block once, though both are killed and messages come again."""

from __future__ import annotations

import builtins
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from streams.link.mqtt import COMMITTED, MqttLink, MqttReceiver
from streams.link.mqtt_client import end_client, make_client
from streams.link.pulse_frame import block_frames
from streams.link.sender import Sender, SendError
from streams.link.wire import ACK, block_frame, encode_frame
from streams.types.block import Block, Rejected
from streams.types.source import LiveSource
from streams.types.spec import Address, NetworkSpec, SourceError, SourceSpec, parse_address
from tests.streams.tcp_peers import Recorded, block
from tests.support.broker import Broker
from tests.support.committing import committing
from tests.support.memory_ledger import MemoryLedger
from tests.support.pulse_frames import turning
from tests.support.waiting import PATIENCE_S, wait_until

TOPIC = "plant/press 4"


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    with Broker(tmp_path / "broker") as running:
        yield running


def spec(broker: Broker, name: str = "press", topic: str = TOPIC) -> SourceSpec:
    return SourceSpec(name, f"mqtt://127.0.0.1:{broker.port}/{topic.replace(' ', '%20')}")


def address(broker: Broker) -> Address:
    return parse_address(spec(broker).url, "test")


@contextmanager
def receiving(ledger: MemoryLedger, *specs: SourceSpec) -> Iterator[MqttReceiver]:
    with MqttReceiver(specs) as receiver:
        receiver.open(ledger)
        yield receiver


@contextmanager
def publisher(broker: Broker) -> Iterator[Callable[..., None]]:
    """Give a function that publishes and waits until the broker has it."""
    client = Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", broker.port)
    client.loop_start()

    def publish(payload: bytes, topic: str = TOPIC, **options: Any) -> None:
        client.publish(topic, payload, qos=1, **options).wait_for_publish(PATIENCE_S)

    try:
        yield publish
    finally:
        end_client(client)


def frame(sequence: int) -> bytes:
    return encode_frame(block_frame(block(sequence)))


def pulse_times(sequence: int) -> NDArray[np.float64]:
    pulses = turning(sequence).pulses
    assert pulses is not None
    return pulses.times


def connected(receiver: MqttReceiver) -> bool:
    return receiver.problem() is None


@pytest.mark.broker
def test_a_recording_arrives_whole_and_the_sender_knows(broker: Broker) -> None:
    ledger = MemoryLedger()
    with receiving(ledger, spec(broker)) as receiver:
        assert isinstance(receiver, LiveSource)
        with committing(receiver, ledger) as items:
            first = Sender(Recorded(range(1, 41), bad=(5,)), MqttLink(address(broker)), limit=20).run()
            second = Sender(Recorded(range(1, 41), bad=(5,)), MqttLink(address(broker))).run()
    assert (first.sent, first.acknowledged, first.rejected) == (19, 20, 1)
    assert (second.sent, second.skipped, second.acknowledged) == (20, 19, 40)
    assert sorted(ledger.blocks("press")) == list(range(1, 41))
    assert [item.sequence for item in items if isinstance(item, Rejected)] == [5]


@pytest.mark.broker
def test_what_is_not_committed_comes_again_after_a_restart(broker: Broker) -> None:
    ledger = MemoryLedger()
    with receiving(ledger, spec(broker)) as receiver, publisher(broker) as publish:
        wait_until(lambda: connected(receiver))
        time.sleep(0.2)
        for sequence in range(1, 6):
            publish(frame(sequence))
        deliveries = [receiver.next(PATIENCE_S) for _ in range(5)]
        for delivery in deliveries[:2]:
            assert delivery is not None
            ledger.commit(delivery.item)
            receiver.acknowledge(delivery)
        # Committed, but the process ends before the broker hears of it.
        assert deliveries[2] is not None
        ledger.commit(deliveries[2].item)
    with publisher(broker) as publish:
        publish(frame(6))
    with receiving(ledger, spec(broker)) as receiver, committing(receiver, ledger) as items:
        wait_until(lambda: 6 in ledger.blocks("press"))
    assert [(item.sequence, getattr(item, "status", "ok")) for item in items] == [
        (3, "duplicate"),
        (4, "ok"),
        (5, "ok"),
        (6, "ok"),
    ]


@pytest.mark.broker
def test_pulses_and_their_samples_come_again_together(broker: Broker) -> None:
    ledger = MemoryLedger()
    made = [(*block_frames(turning(number)),) for number in range(1, 5)]
    with receiving(ledger, spec(broker)) as receiver, publisher(broker) as publish:
        wait_until(lambda: connected(receiver))
        time.sleep(0.2)
        for payload in (*made[0], *made[1], made[2][0]):
            publish(payload)
        first, second = receiver.next(PATIENCE_S), receiver.next(PATIENCE_S)
        assert first is not None
        assert second is not None
        ledger.commit(first.item)
        receiver.acknowledge(first)
    # It ended with block 2 uncommitted, and between the pulses and the samples of block 3.
    with publisher(broker) as publish:
        for payload in (made[2][1], *made[3]):
            publish(payload)
    with receiving(ledger, spec(broker)) as receiver, committing(receiver, ledger) as items:
        wait_until(lambda: 4 in ledger.blocks("press"))
    assert [item.sequence for item in items] == [2, 3, 4]
    for item in items:
        assert isinstance(item, Block)
        assert item.pulses is not None
        np.testing.assert_array_equal(item.pulses.times, pulse_times(item.sequence))


@pytest.mark.broker
def test_retained_damaged_and_foreign_messages_make_no_blocks(broker: Broker) -> None:
    ledger = MemoryLedger()
    with publisher(broker) as publish:
        publish(frame(1), retain=True)
        with receiving(ledger, spec(broker)) as receiver:
            wait_until(lambda: connected(receiver))
            time.sleep(0.3)
            assert receiver.next(0.0) is None
            publish(frame(1), topic="plant/other")
            publish(frame(1)[:-1] + b"\0")
            wait_until(lambda: "checksum" in (receiver.problem() or ""))
            with committing(receiver, ledger):
                publish(frame(2))
                wait_until(lambda: 2 in ledger.blocks("press"))
            assert receiver.problem() is None
        assert ledger.blocks("press") == {1: "", 2: ledger.content_of("press", 2)}
    with receiving(ledger, spec(broker)) as receiver:
        wait_until(lambda: connected(receiver))
        assert receiver.next(0.3) is None


@pytest.mark.broker
def test_sources_of_one_broker_have_topics_of_their_own(broker: Broker) -> None:
    ledger = MemoryLedger()
    specs = (spec(broker), spec(broker, "saw", "plant/saw"))
    with receiving(ledger, *specs) as receiver, committing(receiver, ledger):
        Sender(Recorded(range(1, 4)), MqttLink(address(broker))).run()
        Sender(Recorded(range(1, 6)), MqttLink(parse_address(specs[1].url, "test"))).run()
    assert (len(ledger.blocks("press")), len(ledger.blocks("saw"))) == (3, 5)
    with pytest.raises(SourceError, match="same topic"):
        MqttReceiver([spec(broker), spec(broker, "saw")])


@pytest.mark.broker
def test_the_number_committed_last_is_retained(broker: Broker) -> None:
    ledger, heard = MemoryLedger(), []
    with receiving(ledger, spec(broker)) as receiver, committing(receiver, ledger):
        Sender(Recorded(range(1, 4)), MqttLink(address(broker))).run()
    client = Client(CallbackAPIVersion.VERSION2)
    client.on_message = lambda client, userdata, message: heard.append((message.retain, message.payload))
    client.connect("127.0.0.1", broker.port)
    client.subscribe(TOPIC + COMMITTED)
    client.loop_start()
    wait_until(lambda: bool(heard))
    end_client(client)
    assert heard == [(True, ACK.pack(3))]


def run(*command: str | Path) -> None:
    subprocess.run([str(part) for part in command], check=True, capture_output=True)


@pytest.mark.broker
def test_password_and_certificates_come_from_files(tmp_path: Path) -> None:
    files = {name: tmp_path / name for name in ("user", "secret", "wrong", "passwords", "key.pem", "cert.pem")}
    for name, text in (("user", "press"), ("secret", "let me in"), ("wrong", "let me out")):
        files[name].write_text(text + "\n", encoding="utf-8")
    run("mosquitto_passwd", "-b", "-c", files["passwords"], "press", "let me in")
    run(
        *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=broker"),
        *("-addext", "subjectAltName=IP:127.0.0.1", "-keyout", files["key.pem"], "-out", files["cert.pem"]),
    )
    tls = (f"certfile {files['cert.pem']}", f"keyfile {files['key.pem']}")
    broker = Broker(tmp_path / "broker", "allow_anonymous false", f"password_file {files['passwords']}", *tls)
    right = NetworkSpec(ca_file=files["cert.pem"], username_file=files["user"], password_file=files["secret"])
    ledger = MemoryLedger()
    with MqttReceiver([spec(broker)], replace(right, password_file=files["wrong"])) as receiver:
        receiver.open(ledger)
        wait_until(lambda: "no broker answers" in (receiver.problem() or ""))
        with broker:
            wait_until(lambda: "refuses: Not authorized" in (receiver.problem() or ""))
        assert "let me" not in (receiver.problem() or "")
    with broker, MqttReceiver([spec(broker)], right) as receiver:
        receiver.open(ledger)
        with committing(receiver, ledger):
            result = Sender(Recorded(range(1, 4)), MqttLink(address(broker), right)).run()
    assert result.acknowledged == 3


def test_secrets_come_from_files_only(tmp_path: Path) -> None:
    empty, gone = tmp_path / "empty", tmp_path / "gone"
    empty.write_text("\n", encoding="utf-8")
    place = Address("mqtt", "127.0.0.1", 1, "t")
    for network, words in (
        (NetworkSpec(username_file=empty), "empty"),
        (NetworkSpec(username_file=gone), "cannot be read"),
        (NetworkSpec(ca_file=gone), "ca_file"),
    ):
        with pytest.raises(SourceError, match=words):
            make_client(place, network, "id", "[[source]] press: url")
    with pytest.raises(SourceError, match="belong together"):
        NetworkSpec(cert_file=empty)


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    plain_import = builtins.__import__

    def without(name: str, *rest: Any, **options: Any) -> Any:
        if name.startswith("paho"):
            raise ModuleNotFoundError(name)
        return plain_import(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(SourceError, match=r'pip install "spallwatch\[mqtt\]"'):
        MqttReceiver([SourceSpec("press", "mqtt://127.0.0.1/t")])


def test_sender_without_broker_gives_up() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    link = MqttLink(Address("mqtt", "127.0.0.1", port, "t"), timeout=1.0)
    with pytest.raises(SendError, match="refused"):
        Sender(Recorded(range(1, 3)), link, patience=0.0, sleep=lambda _: None).run()


@pytest.mark.broker
def test_what_is_closed_leaves_no_socket_to_the_garbage_collector(broker):
    ledger = MemoryLedger()
    clients = []
    with receiving(ledger, spec(broker)) as receiver, committing(receiver, ledger):
        link = MqttLink(address(broker))
        Sender(Recorded(range(1, 3)), link).run()
        clients += [receiver._client, link._client]
        sockets = [pair for client in clients for pair in (client._sockpairR, client._sockpairW) if pair is not None]
    assert len(sockets) >= 2
    assert {pair.fileno() for pair in sockets} == {-1}

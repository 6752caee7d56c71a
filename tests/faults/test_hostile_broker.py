"""A broker that lies, against the receiver over MQTT: within seconds it goes on, and each block is committed once."""

from __future__ import annotations

import random
import struct
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest

from monitor.config.outputs import MqttSection
from monitor.service.notify.channels import Message, MqttChannel, NotifyError
from streams.link.mqtt import MqttReceiver
from streams.link.wire import block_frame, encode_frame
from streams.types.block import Rejected
from streams.types.spec import NetworkSpec, SourceSpec
from tests.streams.tcp_peers import block
from tests.support.committing import committing
from tests.support.effort import effort_count
from tests.support.hostile_broker import ACCEPTED, PUBACK, PUBLISH, HostileBroker, Session, head, packet, publish
from tests.support.memory_ledger import MemoryLedger
from tests.support.waiting import wait_until

TOPIC = "plant/press"
GOES_ON_S = 5.0
Attack = Callable[[Session], None]


def frame(sequence: int) -> bytes:
    return encode_frame(block_frame(block(sequence)))


@contextmanager
def tended(broker: HostileBroker, ledger: MemoryLedger, network: NetworkSpec | None = None) -> Iterator[MqttReceiver]:
    """Give a receiver that is looked after as the daemon does."""
    ending = threading.Event()
    with MqttReceiver([SourceSpec("press", f"mqtt://127.0.0.1:{broker.port}/{TOPIC}")], network) as receiver:
        receiver.open(ledger)

        def look() -> None:
            while not ending.wait(0.05):
                receiver.tend()

        thread = threading.Thread(target=look)
        thread.start()
        try:
            yield receiver
        finally:
            ending.set()
            thread.join()


def go_on(session: Session) -> None:
    """Send good frames."""
    session.send(publish(TOPIC, frame(1), 11) + publish(TOPIC, frame(2), 12))


def sends(data: bytes) -> Attack:
    """Send bytes once the topic is subscribed, and good frames after them."""

    def attack(session: Session) -> None:
        session.subscribed()
        session.send(bytes(data))
        go_on(session)

    return attack


def answers(data: bytes) -> Attack:
    """Send bytes in place of the answer to CONNECT, and leave."""

    def attack(session: Session) -> None:
        session.connected(data)
        raise EOFError

    return attack


NAME = struct.pack("!H", len(TOPIC)) + TOPIC.encode()
MALFORMED: dict[str, tuple[Callable[[bytes], Attack], bytes]] = {
    "no length": (sends, b"\x32" + b"\xff" * 5),
    "a kind that is none": (sends, b"\x00\x00\xf0\x00"),
    "a topic longer than the packet": (sends, packet(0x32, b"\xff\xff" + b"x" * 9)),
    "no topic": (sends, packet(0x32, b"")),
    "no number": (sends, packet(0x32, NAME)),
    "half a number": (sends, packet(0x32, NAME + b"\x00")),
    "number 0": (sends, publish(TOPIC, frame(1), mid=0)),
    "a topic that is not UTF-8": (sends, publish(b"\xff\xfe/press", frame(1))),
    "an empty topic": (sends, publish("", frame(1))),
    "a topic with wildcards": (sends, publish("plant/#", frame(1))),
    "QoS 3": (sends, publish(TOPIC, frame(1), qos=3)),
    "QoS 2, not asked for": (sends, publish(TOPIC, frame(1), qos=2)),
    "PUBREL of a message that never came": (sends, packet(0x62, b"\x00\x07")),
    "PUBACK of what was never sent": (sends, packet(0x40, b"\x01\x00") * 3),
    "PUBREC of what was never sent": (sends, packet(0x50, b"\x01\x00")),
    "an empty PUBACK": (sends, packet(0x40, b"")),
    "a second CONNACK": (sends, ACCEPTED * 2),
    "a refusal amid the session": (sends, b"\x20\x02\x00\x05"),
    "SUBACK of nothing": (sends, packet(0x90, b"")),
    "SUBACK that refuses": (sends, packet(0x90, b"\x00\x01\x80")),
    "UNSUBACK": (sends, packet(0xB0, b"\x00\x01")),
    "packets of a client": (sends, packet(0x82, b"\x00\x01\x00\x01#\x01") + packet(0xC0, b"")),
    "DISCONNECT of version 5, session taken over": (sends, packet(0xE0, b"\x8e\x00")),
    "DISCONNECT of version 5, quota exceeded": (sends, packet(0xE0, b"\x97\x00")),
    "AUTH of version 5": (sends, packet(0xF0, b"\x18\x00")),
    "PUBLISH of version 5 with a topic alias": (sends, packet(0x32, b"\x00\x00\x00\x01\x03\x23\x00\x01" + frame(1))),
    "CONNACK of version 5": (answers, packet(0x20, b"\x00\x00\x06\x21\x00\x01\x22\x00\x0a")),
    "CONNACK without a code": (answers, b"\x20\x00"),
    "CONNACK with half a code": (answers, b"\x20\x01\x00"),
    "CONNACK with a code that is none": (answers, b"\x20\x02\x00\xfe"),
    "CONNACK: another version": (answers, b"\x20\x02\x00\x01"),
    "a page in place of CONNACK": (answers, b"HTTP/1.1 400 Bad Request\r\n\r\n"),
    "a frame before CONNACK": (answers, publish(TOPIC, frame(1)) + ACCEPTED),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_after_malformed_packets_it_goes_on_and_each_block_is_committed_once(name: str) -> None:
    ledger, (attack, data) = MemoryLedger(), MALFORMED[name]
    with HostileBroker(attack(data), then=go_on) as broker, tended(broker, ledger) as receiver:
        with committing(receiver, ledger) as items:
            begin = time.monotonic()
            wait_until(lambda: {1, 2} <= set(ledger.blocks("press")), stalled_after=2 * GOES_ON_S)
            assert time.monotonic() - begin < 2 * GOES_ON_S
            wait_until(lambda: receiver.backlog().pending == 0)
        assert [item.sequence for item in items if not isinstance(item, Rejected)] == [1, 2]
        assert receiver.restarts()[0].failures == 0


@pytest.mark.parametrize("name", MALFORMED)
def test_a_notification_is_confirmed_or_fails_and_the_next_one_is_published(name: str) -> None:
    attack, data = MALFORMED[name]

    def accepted(session: Session) -> None:
        session.connected(data if attack is answers else ACCEPTED)
        session.send(data)

    def good(session: Session) -> None:
        session.connected()

    with HostileBroker(accepted, good) as broker:
        channel = MqttChannel(MqttSection(url=f"mqtt://127.0.0.1:{broker.port}/alarms"))
        begin = time.monotonic()
        with suppress(NotifyError):
            channel.send(Message("first", "text"))
        assert time.monotonic() - begin < 3 * GOES_ON_S
        channel.send(Message("second", "text"))
    assert sum(b'"second"' in body for first, body in broker.got if first & 0xF0 == PUBLISH) == 1


def test_random_packets_end_no_receiver() -> None:
    generator, ledger = random.Random(7), MemoryLedger()
    rounds = effort_count(quick=3, full=40)

    def attack(session: Session) -> None:
        session.subscribed()
        good = publish(TOPIC, frame(1), 5)
        for _ in range(60):
            data = bytearray(generator.choice((good, packet(generator.randrange(256), generator.randbytes(9)))))
            for _ in range(generator.randint(1, 3)):
                data[generator.randrange(min(12, len(data)))] = generator.randrange(256)
            session.send(bytes(data))
        raise EOFError

    with HostileBroker(*[attack] * rounds, then=go_on) as broker, tended(broker, ledger) as receiver:
        with committing(receiver, ledger):
            wait_until(lambda: {1, 2} <= set(ledger.blocks("press")))
        assert receiver.restarts()[0].failures == 0
        assert ledger.content_of("press", 2) is not None


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (publish(TOPIC, b"", qos=2), "it sends with QoS 2"),
        (packet(0x32, b"\xff\xff"), "a packet 0x32 "),
        (packet(0xE0, b"\x8e\x00"), "a packet 0xe0 breaks the protocol"),
    ],
)
def test_the_status_says_what_the_broker_sent(data: bytes, words: str) -> None:
    with HostileBroker(sends(data)) as broker, tended(broker, MemoryLedger()) as receiver:
        wait_until(lambda: f"connection to the broker lost: {words}" in (receiver.problem() or ""))


def test_a_subscription_that_is_refused_is_a_problem() -> None:
    def attack(session: Session) -> None:
        session.refuses = True
        session.subscribed()

    with HostileBroker(attack) as broker, tended(broker, MemoryLedger()) as receiver:
        wait_until(lambda: "refuses the subscription of plant/press" in (receiver.problem() or ""))


def peak_memory(work: Callable[[], object]) -> int:
    """Return the greatest memory that was allocated meanwhile, bytes."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("qos", "retain"), [(0, 0), (1, 0), (1, 1)])
def test_a_giant_message_is_refused_without_its_memory_and_answered(qos: int, retain: int) -> None:
    size = effort_count(quick=48 << 20, full=(1 << 28) - 100)
    part, ledger = bytes(1 << 20), MemoryLedger()
    giant = publish(TOPIC, b"", 7, qos, retain)[2:]

    def attack(session: Session) -> None:
        session.subscribed()
        session.send(head(0x30 | qos << 1 | retain, size) + giant)
        for begin in range(len(giant), size, len(part)):
            session.send(part[: size - begin])
        go_on(session)

    with HostileBroker(attack) as broker, tended(broker, ledger, NetworkSpec(max_frame=1 << 20)) as receiver:
        with committing(receiver, ledger):
            peak = peak_memory(lambda: wait_until(lambda: {1, 2} <= set(ledger.blocks("press"))))
        assert broker.connections == 1
        assert receiver.backlog().refused == (0 if retain else 1)
    assert peak < 16 << 20
    answered = [body for first, body in broker.got if first & 0xF0 == PUBACK]
    assert (b"\x00\x07" in answered) == (qos == 1)


def test_messages_of_qos_2_that_are_never_released_take_no_memory() -> None:
    ledger = MemoryLedger()
    payload = bytes(1 << 20)

    def attack(session: Session) -> None:
        session.subscribed()
        for number in range(1, 64):
            session.send(publish(TOPIC, payload, number, qos=2))

    broker = HostileBroker(attack, then=go_on)
    with broker, tended(broker, ledger) as receiver, committing(receiver, ledger):
        peak = peak_memory(lambda: wait_until(lambda: {1, 2} <= set(ledger.blocks("press"))))
    assert peak < 16 << 20


@pytest.mark.parametrize("qos", [0, 1])
def test_a_flood_waits_outside_while_nothing_is_committed_and_loses_nothing(qos: int) -> None:
    ledger, frames = MemoryLedger(), [frame(number) for number in range(1, 301)]
    limit = 40 * len(frames[0])

    def attack(session: Session) -> None:
        session.subscribed()
        for number, data in enumerate(frames, start=1):
            session.send(publish(TOPIC, data, number, qos))

    with HostileBroker(attack) as broker, tended(broker, ledger, NetworkSpec(max_waiting=limit)) as receiver:
        wait_until(lambda: "faster than they are committed" in (receiver.problem() or ""))
        time.sleep(0.3)
        assert receiver.backlog().pending <= 41
        assert receiver.queued_blocks() is None
        with committing(receiver, ledger) as items:
            wait_until(lambda: len(items) == len(frames), lambda: len(items))
        assert [item.sequence for item in items] == list(range(1, 301))
        assert receiver.problem() is None
    with HostileBroker(attack) as broker, tended(broker, MemoryLedger(), NetworkSpec(max_waiting=limit)) as receiver:
        wait_until(lambda: "faster than they are committed" in (receiver.problem() or ""))
        begin = time.monotonic()
    # It ends while its thread waits.
    assert time.monotonic() - begin < GOES_ON_S

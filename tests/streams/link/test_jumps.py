"""Numbers that a stream cannot have reached: refused, said, and nothing after them is lost."""

from __future__ import annotations

import logging
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from streams.link.mqtt import MqttReceiver
from streams.link.refusals import JUMP, KEY, LINK, SenderRefusals
from streams.link.sender import Link, Sender, SendError
from streams.link.wire import MAX_SEQUENCE, block_frame, encode_frame
from streams.types.block import Block
from streams.types.source import StreamCount
from streams.types.spec import SourceError, SourceSpec
from tests.streams.tcp_peers import URL, Recorded, answer, block, commit, frame, gone, link, raw, receiving
from tests.support.committing import committing
from tests.support.memory_ledger import MemoryLedger


def far(number: int) -> bytes:
    """Return a frame with any number."""
    return encode_frame(replace(block_frame(block(2)), sequence=number))


@pytest.mark.parametrize("number", [MAX_SEQUENCE, 10**12, 100_002])
def test_a_frame_far_ahead_is_refused_and_the_stream_goes_on(number: int) -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver:
        with raw(receiver) as connection:
            answer(connection)
            connection.sendall(frame(1))
            commit(receiver, ledger)
            connection.sendall(far(number))
            assert gone(connection)
        assert receiver.next(0.0) is None
        assert f"frame {number} of 'press' came after 1" in (receiver.problem() or "")
        with committing(receiver, ledger):
            result = Sender(Recorded(range(1, 11)), link(receiver)).run()
        assert (result.sent, result.acknowledged) == (9, 10)
        (notice,) = receiver.notices()
        assert (notice["kind"], notice["source"], notice["times"]) == (JUMP, "press", 1)
        assert f"spallwatch stream reset press --first {number}" in notice["text"]
        assert receiver.backlog().refused == 1
    assert sorted(ledger.blocks("press")) == list(range(1, 11))


def test_the_largest_jump_is_a_gap() -> None:
    ledger = MemoryLedger()
    with receiving(ledger, specs=[SourceSpec("press", URL, max_gap_blocks=7)]) as receiver, raw(receiver) as connection:
        answer(connection)
        connection.sendall(frame(7) + frame(14) + frame(22))
        items = [commit(receiver, ledger) for _ in range(4)]
        assert gone(connection)
    assert [item.sequence for item in items] == [6, 7, 13, 14]
    with pytest.raises(SourceError, match="max_gap_blocks"):
        SourceSpec("press", URL, max_gap_blocks=0)


def test_a_message_far_ahead_is_dropped_and_counted() -> None:
    receiver = MqttReceiver([SourceSpec("press", "mqtt://127.0.0.1/plant/press")])
    ledger = MemoryLedger()
    receiver._arrivals.open(ledger)
    acknowledged: list[int] = []
    client = SimpleNamespace(ack=lambda mid, qos: acknowledged.append(mid))

    def come(number: int, sequence: int) -> None:
        message = SimpleNamespace(topic="plant/press", retain=False, qos=1, mid=number, payload=far(sequence))
        receiver._on_message(client, None, message)

    for number, sequence in enumerate((1, MAX_SEQUENCE, MAX_SEQUENCE - 1, 2), 1):
        come(number, sequence)
    deliveries = [receiver.next(0.0) for _ in range(3)]
    assert [delivery and delivery.item.sequence for delivery in deliveries] == [1, 2, None]
    # The broker does not deliver them again; the others wait for their commit.
    assert acknowledged == [2, 3]
    assert receiver.backlog().refused == 2
    (notice,) = receiver.notices()
    assert (notice["kind"], notice["source"], notice["times"]) == (JUMP, "press", 2)
    assert receiver.notices() == []


class Claims:
    """A link to a receiver that acknowledges what it likes."""

    def __init__(self, first: int, later: int) -> None:
        self.first, self.later, self.sent = first, later, 0

    def connect(self) -> int:
        return self.first

    def send(self, frame: bytes) -> None:
        self.sent += 1

    def committed(self, timeout: float) -> int | None:
        return self.later

    def close(self) -> None:
        pass


@pytest.mark.parametrize(("first", "later"), [(MAX_SEQUENCE, 0), (11, 0), (0, MAX_SEQUENCE), (0, 11)])
def test_a_sender_refuses_an_answer_beyond_what_it_has(first: int, later: int) -> None:
    claims: Link = Claims(first, later)
    with pytest.raises(
        SendError, match=f"acknowledges block {max(first, later)}, but this recording ends with block 10"
    ):
        Sender(Recorded(range(1, 11)), claims, patience=0.0, sleep=lambda _: None).run()


def test_numbers_above_the_count_of_blocks_are_no_error() -> None:
    result = Sender(Recorded(range(91, 101)), Claims(100, 100)).run()
    assert (result.sent, result.skipped, result.acknowledged) == (0, 10, 100)


def reset_ledger(first: int, number: int) -> MemoryLedger:
    ledger = MemoryLedger()
    for sequence in range(1, number):
        ledger.commit(Block(block(sequence).samples, 100.0, ("x", "y"), ("g", "g"), "press", sequence, "old"))
    ledger.counts["press"] = StreamCount(1, first, number)
    return ledger


@pytest.mark.parametrize("first", [1, 3, 5_000_001])
def test_after_a_reset_frames_count_anew_and_blocks_go_on(first: int) -> None:
    ledger = reset_ledger(first, 4)
    with receiving(ledger) as receiver, raw(receiver) as connection:
        assert answer(connection) == first - 1
        connection.sendall(frame(first) + frame(first + 1))
        items = [commit(receiver, ledger) for _ in range(2)]
        connection.sendall(frame(first + 4) + frame(first + 1))
        items += [commit(receiver, ledger) for _ in range(3)]
        # Several commits may have one answer.
        numbers = [answer(connection)]
        while numbers[-1] < first + 4:
            numbers.append(answer(connection))
    assert first - 1 < numbers[0]
    assert numbers[-1] == first + 4
    assert [(item.sequence, getattr(item, "status", "ok")) for item in items] == [
        (4, "ok"),
        (5, "ok"),
        (7, "incomplete"),
        (8, "ok"),
        (5, "duplicate"),
    ]
    assert [item.name for item in items[:3]] == [f"press[1:{first + n}]" for n in (0, 1, 3)]
    assert f"frames {first + 2} to {first + 3} never came (2 missing)" in getattr(items[2], "reason", "")


def test_a_frame_of_before_the_reset_does_not_meet_the_old_blocks() -> None:
    ledger = reset_ledger(100, 4)
    before = ledger.blocks("press")
    with receiving(ledger) as receiver, raw(receiver) as connection:
        assert answer(connection) == 99
        connection.sendall(frame(98))
        assert gone(connection)
        assert "before 100" in (receiver.problem() or "")
        assert receiver.next(0.0) is None
    assert ledger.blocks("press") == before


def test_log_lines_of_refusals_are_few_and_nothing_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    now = [0.0]
    refusals = SenderRefusals("press", lambda: now[0])
    with caplog.at_level(logging.WARNING):
        for number in range(1000):
            refusals.add(f"connection {number}")
            refusals.add(f"key {number}", KEY, "press")
        assert len(caplog.records) == 10
        now[0] = 61.0
        refusals.tick()
        refusals.tick()
    assert len(caplog.records) == 12
    assert "995 more like this, the latest: connection 999" in caplog.text
    (notice,) = refusals.take()
    assert (notice["kind"], notice["text"], notice["times"]) == (KEY, "key 0", 1000)
    refusals.add("again", KEY, "press")
    assert refusals.take() == []
    now[0] = 3601.0
    refusals.add("an hour later", KEY, "press")
    assert [item["times"] for item in refusals.take()] == [2]
    refusals.add("a cable", LINK, "press")
    assert refusals.take() == []


def test_refused_connections_are_logged_a_few_times(caplog: pytest.LogCaptureFixture) -> None:
    with receiving(MemoryLedger()) as receiver, caplog.at_level(logging.WARNING):
        for _ in range(30):
            with raw(receiver, "lathe") as connection:
                assert gone(connection)
    lines: list[Any] = [line for line in caplog.records if "lathe" in line.getMessage()]
    assert 0 < len(lines) <= 5

"""Frames of pulses: written and read back, joined with their samples, each block once whatever comes between."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streams.link.arrivals import Arrivals
from streams.link.pulse_frame import block_frames, decode_pulses, encode_pulses
from streams.link.sender import Sender
from streams.link.wire import HEAD, JumpError, WireError, block_frame, decode_frame, encode_frame, frame_length, sealed
from streams.reblock import samples_hash
from streams.turns.pulses import Pulses
from streams.types.block import Block, Rejected
from streams.types.source import Delivery, StreamCount
from streams.types.spec import MAX_FRAME, SourceSpec
from tests.streams.tcp_peers import URL, answer, block, commit, gone, link, raw, receiving
from tests.support.committing import committing
from tests.support.effort import effort_count
from tests.support.memory_ledger import MemoryLedger
from tests.support.pulse_frames import turning

FEW = effort_count(quick=30, full=3000)


def frames(sequence: int, **how: Any) -> tuple[bytes, bytes]:
    pulses, samples = block_frames(turning(sequence, **how))
    return pulses, samples


class Turning:
    """A recording whose blocks have pulses, but for every third."""

    name = "made"

    def __init__(self, count: int) -> None:
        self.count = count

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[Block | Rejected]:
        for number in range(1, self.count + 1):
            yield block(number) if number % 3 == 0 else turning(number, number % 5)


def arrivals(ledger: MemoryLedger | None = None, **spec: Any) -> Arrivals:
    made = Arrivals({"press": SourceSpec("press", URL, **spec)}, 1 << 26)
    made.open(ledger or MemoryLedger())
    return made


def next_item(made: Arrivals) -> Block | Rejected:
    delivery = made.next(0.0)
    assert isinstance(delivery, Delivery)
    made.acknowledge(delivery)
    return delivery.item


@given(
    sequence=st.integers(1, 2**63 - 1),
    gaps=st.lists(st.floats(0.0, 10.0), max_size=40),
    per_revolution=st.none() | st.integers(1, 1_000_000),
)
def test_round_trip(sequence: int, gaps: list[float], per_revolution: int | None) -> None:
    times = np.cumsum(np.array(gaps, dtype=np.float64))
    found = decode_pulses(encode_pulses(sequence, 100.0, Pulses(times, per_revolution)))
    assert (found.sequence, found.problem, found.pulses.per_revolution) == (sequence, None, per_revolution)
    assert found.pulses.times.tobytes() == times.tobytes()


def test_layout_is_that_of_the_reference() -> None:
    data = encode_pulses(7, 100.0, Pulses(np.array([0.25, 0.5]), 60))
    assert data[:4] == b"SPW1"
    assert struct.unpack_from("<HHQdIBqH", data, 4)[:7] == (2, 1, 7, 100.0, 2, 4, -(2**63))
    (length,) = struct.unpack_from("<H", data, 37)
    assert json.loads(data[39 : 39 + length]) == {"pulses_per_revolution": 60}
    assert struct.unpack_from("<2d", data, 39 + length) == (0.25, 0.5)
    assert len(data) == 39 + length + 16 + 4 == frame_length(data)
    header = decode_frame(block_frames(turning(7))[1])
    assert header.pulses == 8


@settings(max_examples=FEW)
@given(data=st.data())
def test_any_damage_is_refused(data: st.DataObject) -> None:
    changed = bytearray(frames(3)[0])
    for place in data.draw(st.lists(st.integers(0, len(changed) - 1), min_size=1, max_size=4, unique=True)):
        changed[place] ^= 1 << data.draw(st.integers(0, 7))
    cut = data.draw(st.sampled_from([len(changed), len(changed) - 1, HEAD.size, 3]))
    with pytest.raises(WireError):
        decode_pulses(bytes(changed[:cut]))


@settings(max_examples=FEW)
@given(
    payload=st.binary(max_size=64),
    header=st.sampled_from([b"{}", b"null", b"[", b'{"pulses_per_revolution": 0}', b'{"pulses_per_revolution": 1.5}']),
    channels=st.integers(0, 2),
    kind=st.integers(1, 4),
    sequence=st.integers(0, 5),
)
def test_any_content_is_pulses_or_a_reason(
    payload: bytes, header: bytes, channels: int, kind: int, sequence: int
) -> None:
    size = channels * (2, 4, 4, 8)[kind - 1]
    count = len(payload) // size if size else 3
    head = HEAD.pack(b"SPW1", 2, channels, sequence, -1.0, count, kind, 5, len(header))
    data = sealed(head + header + payload[: count * size])
    if not sequence:
        with pytest.raises(WireError, match="a sequence is"):
            decode_pulses(data)
        return
    found = decode_pulses(data)
    assert found.sequence == sequence
    times = found.pulses.times
    assert found.problem is not None or (channels == 1 and kind == 4 and np.all(np.diff(times) >= 0.0))
    made = arrivals()
    assert made.take("press", data)
    samples = encode_frame(replace(block_frame(block(sequence)), pulses=times.size))
    assert made.take("press", samples)
    items = [next_item(made) for _ in range(1 if sequence == 1 else 2)]
    outside = np.any((np.floor(times * 100.0) < -1) | (np.floor(times * 100.0) > 64))
    assert isinstance(items[-1], Rejected) == (found.problem is not None or bool(outside))


def test_a_version_1_decoder_refuses_pulses_with_a_reason() -> None:
    with pytest.raises(WireError, match="a frame of version 1 was expected, got version 2"):
        decode_frame(frames(1)[0])
    with pytest.raises(WireError, match="a frame of version 2 was expected, got version 1"):
        decode_pulses(frames(1)[1])


def test_a_block_is_made_of_both_and_acknowledged_once() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, raw(receiver) as connection:
        assert answer(connection) == 0
        pulses, samples = frames(1)
        connection.sendall(pulses)
        assert receiver.next(0.05) is None
        assert receiver.backlog().offered == 0
        connection.sendall(samples)
        item = commit(receiver, ledger)
        assert answer(connection) == 1
        connection.sendall(pulses + samples)
        again = commit(receiver, ledger)
        assert answer(connection) == 1
        connection.sendall(b"".join(block_frames(replace(turning(1), pulses=Pulses(np.array([0.1]), 4)))))
        other = commit(receiver, ledger)
    sent = turning(1)
    assert isinstance(item, Block)
    assert item.pulses is not None
    assert sent.pulses is not None
    assert item.pulses.times.tobytes() == sent.pulses.times.tobytes()
    assert item.pulses.per_revolution == 4
    assert item.content_hash == samples_hash(sent.samples, sent.rate, sent.channels, sent.pulses)
    assert [getattr(found, "status", "ok") for found in (again, other)] == ["duplicate", "changed"]


def test_a_recording_arrives_whole_though_the_connection_breaks_between_pulses_and_samples() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver:
        with raw(receiver) as connection:
            answer(connection)
            connection.sendall(frames(1)[0] + frames(1)[1] + frames(2)[0])
            commit(receiver, ledger)
        with committing(receiver, ledger) as items:
            result = Sender(Turning(12), link(receiver)).run()
    assert (result.sent, result.acknowledged, result.skipped) == (11, 12, 1)
    assert [item.sequence for item in items] == list(range(2, 13))
    for item in items:
        assert isinstance(item, Block)
        assert (item.pulses is None) == (item.sequence % 3 == 0)


def test_a_receiver_that_began_anew_between_pulses_and_samples_has_both_sent_again() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, raw(receiver) as connection:
        answer(connection)
        connection.sendall(b"".join(frames(1)) + frames(2)[0])
        commit(receiver, ledger)
    with receiving(ledger) as receiver:
        with raw(receiver) as connection:
            assert answer(connection) == 1
            connection.sendall(frames(2)[1])
            assert gone(connection)
        assert receiver.next(0.0) is None
        with committing(receiver, ledger) as items:
            assert Sender(Turning(3), link(receiver)).run().acknowledged == 3
    assert [item.sequence for item in items] == [2, 3]
    assert all(isinstance(item, Block) for item in items)


def test_pulses_out_of_order_find_their_samples() -> None:
    made = arrivals()
    one, two = frames(1), frames(2)
    assert [made.take("press", data, token) for token, data in enumerate((two[0], one[0], one[1], two[1]))] == [
        True
    ] * 4
    found = [next_item(made), next_item(made)]
    for item in found:
        assert isinstance(item, Block)
        assert item.pulses is not None
    assert made.spent("press") == []


def test_what_the_transport_has_to_acknowledge() -> None:
    made = arrivals()
    one = frames(1)
    for token, data in enumerate((one[0], one[0], one[1])):
        assert made.take("press", data, token)
    assert made.spent("press") == [0]
    assert made.spent("press") == []
    delivery = made.next(0.0)
    assert delivery is not None
    assert made.acknowledge(delivery).tokens == (2, 1)
    for number in range(2, 60):
        assert made.take("press", frames(number)[0], number)
    assert made.spent("press") == list(range(2, 28))


def test_samples_whose_pulses_were_lost_are_not_taken() -> None:
    made = arrivals()
    assert not made.take("press", frames(1)[1])
    assert made.backlog().offered == 0
    assert made.take("press", frames(1, count=0)[0])
    assert made.take("press", frames(1, count=0)[1])
    item = next_item(made)
    assert isinstance(item, Block)
    assert item.pulses is not None
    assert item.pulses.times.size == 0


@pytest.mark.parametrize(
    ("times", "stated", "status", "words"),
    [
        ([0.1, 0.2], None, "wrong_shape", "2 pulses came before a frame that states no pulses"),
        ([0.1, 0.2], 3, "wrong_shape", "states pulses = 3"),
        ([0.2, 0.1], 2, "wrong_rate", "pulse 2 is at 0.1 s behind 0.2 s"),
        ([0.1, float("nan")], 2, "nan", "pulse 2 is not a number"),
        ([0.1, 0.7], 2, "wrong_rate", "1 of 2 pulses are outside the samples"),
    ],
)
def test_pulses_that_do_not_fit_reject_their_block(
    times: list[float], stated: int | None, status: str, words: str
) -> None:
    made = arrivals()
    payload = np.array(times, dtype="<f8").tobytes()
    made.take("press", sealed(HEAD.pack(b"SPW1", 2, 1, 1, 100.0, len(times), 4, 0, 2) + b"{}" + payload))
    assert made.take("press", encode_frame(replace(block_frame(block(1)), pulses=stated)))
    item = next_item(made)
    assert isinstance(item, Rejected)
    assert item.status == status
    assert words in item.reason
    assert item.reason.startswith("press[1]: ")


def test_pulses_too_far_ahead_are_refused() -> None:
    made = arrivals(max_gap_blocks=5)
    with pytest.raises(JumpError, match="max_gap_blocks"):
        made.take("press", frames(7)[0])


def test_a_header_states_the_pulses_of_a_channel() -> None:
    made = arrivals()
    assert made.take("press", encode_frame(block_frame(replace(block(1), pulses_per_revolution=60))))
    item = next_item(made)
    assert isinstance(item, Block)
    assert (item.pulses, item.pulses_per_revolution) == (None, 60)


def test_after_a_reset_pulses_find_their_samples_under_the_new_count() -> None:
    class Reset(MemoryLedger):
        def stream(self, source: str) -> StreamCount:
            return StreamCount(resets=1, first=1, number=8, last=7)

    made = arrivals(Reset())
    for data in frames(1):
        assert made.take("press", data)
    item = next_item(made)
    assert isinstance(item, Block)
    assert (item.sequence, item.name) == (8, "press[1:1]")
    assert item.pulses is not None


def test_frames_of_pulses_have_the_limit_of_all() -> None:
    pulses = frames(1, count=200)[0]
    with pytest.raises(WireError, match="at most 1024 bytes"):
        arrivals().take("press", pulses, limit=1024)
    with pytest.raises(WireError, match=f"at most {MAX_FRAME} bytes"):
        encode_pulses(1, 100.0, Pulses(np.zeros(MAX_FRAME // 8)))

"""The TCP receiver and the reference sender: each block once, whatever breaks between them."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import numpy as np
import pytest

from streams.link.sender import Sender, SendError, TcpLink
from streams.link.tcp import TcpReceiver
from streams.link.wire import Frame, block_frame, encode_frame
from streams.types.block import Block, Rejected
from streams.types.samples import Samples
from streams.types.source import Delivery, LiveSource
from streams.types.spec import ChannelSpec, SourceSpec, parse_address
from tests.streams.tcp_peers import URL, Recorded, answer, block, commit, frame, gone, link, raw, receiving
from tests.support.committing import committing
from tests.support.memory_ledger import MemoryLedger
from tests.support.waiting import PATIENCE_S, join


def test_receiver_is_a_live_source() -> None:
    with TcpReceiver([SourceSpec("press", URL)]) as receiver:
        assert isinstance(receiver, LiveSource)


def test_a_recording_arrives_whole() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver:
        with committing(receiver, ledger) as items:
            result = Sender(Recorded(range(1, 41)), link(receiver)).run()
        assert (result.sent, result.acknowledged, result.skipped, result.reconnects) == (40, 40, 0, 0)
        backlog = receiver.backlog()
        assert (backlog.offered, backlog.accepted, backlog.pending, backlog.oldest_age_s) == (40, 40, 0, 0.0)
    assert [item.sequence for item in items] == list(range(1, 41))
    for item in items:
        assert isinstance(item, Block)
        sent = block(item.sequence)
        np.testing.assert_array_equal(item.samples, sent.samples)
        assert (item.source, item.rate, item.channels, item.units) == ("press", 100.0, sent.channels, sent.units)
        assert item.start == sent.start


def test_nothing_is_acknowledged_before_its_commit() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, raw(receiver) as connection:
        assert answer(connection) == 0
        connection.sendall(frame(1) + frame(2))
        first, second = receiver.next(PATIENCE_S), receiver.next(PATIENCE_S)
        assert isinstance(first, Delivery)
        assert isinstance(second, Delivery)
        connection.settimeout(0.1)
        with pytest.raises(TimeoutError):
            connection.recv(8)
        connection.settimeout(PATIENCE_S)
        assert receiver.backlog().pending == 2
        receiver.acknowledge(first)
        assert answer(connection) == 1
        receiver.acknowledge(second)
        assert answer(connection) == 2
        with pytest.raises(ValueError, match="acknowledged already"):
            receiver.acknowledge(second)


def test_what_comes_again_before_the_commit_is_delivered_once() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver:
        with raw(receiver) as connection:
            answer(connection)
            connection.sendall(frame(1))
            held = receiver.next(PATIENCE_S)
            assert held is not None
        with raw(receiver) as connection:
            assert answer(connection) == 0
            connection.sendall(frame(1) + frame(2))
            second = receiver.next(PATIENCE_S)
            assert second is not None
            assert second.item.sequence == 2
            receiver.acknowledge(held)
            assert answer(connection) == 1
        assert receiver.next(0.05) is None


def test_what_comes_again_after_the_commit_is_a_duplicate_and_acknowledged() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, raw(receiver) as connection:
        answer(connection)
        other = encode_frame(Frame(1, Samples(np.zeros((1, 4), dtype="<i2"), ("x",), units=("g",), rate=100.0)))
        connection.sendall(frame(1))
        commit(receiver, ledger)
        assert answer(connection) == 1
        connection.sendall(frame(1) + other)
        again, changed = commit(receiver, ledger), commit(receiver, ledger)
        assert [getattr(item, "status", None) for item in (again, changed)] == ["duplicate", "changed"]
        assert answer(connection) == 1
        backlog = receiver.backlog()
        assert (backlog.offered, backlog.accepted, backlog.rejected, backlog.pending) == (3, 1, 2, 0)
    assert len(ledger.blocks("press")) == 1


def test_a_gap_is_stated_and_a_late_block_still_taken() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, raw(receiver) as connection:
        answer(connection)
        connection.sendall(frame(1) + frame(5) + frame(3) + frame(4))
        items = [commit(receiver, ledger) for _ in range(5)]
    assert [item.sequence for item in items] == [1, 4, 5, 3, 4]
    gap = items[1]
    assert isinstance(gap, Rejected)
    assert gap.status == "incomplete"
    assert "frames 2 to 4 never came (3 missing)" in gap.reason
    assert isinstance(items[3], Block)
    assert isinstance(items[4], Rejected)
    assert items[4].status == "changed"


def test_a_frame_whose_predecessor_was_lost_on_the_way_is_not_taken() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver:
        with raw(receiver) as connection:
            answer(connection)
            connection.sendall(encode_frame(block_frame(block(1), after=0)))
            connection.sendall(encode_frame(block_frame(block(5), after=1)))
            connection.sendall(encode_frame(block_frame(block(7), after=6)))
            assert gone(connection)
        items = [commit(receiver, ledger) for _ in range(3)]
        assert [(item.sequence, getattr(item, "status", "ok")) for item in items] == [
            (1, "ok"),
            (4, "incomplete"),
            (5, "ok"),
        ]
        assert receiver.next(0.0) is None


def test_what_is_right_by_its_checksum_but_wrong_inside_takes_its_place_and_is_forgotten_by_the_sender() -> None:
    ledger = MemoryLedger()
    spec = SourceSpec("press", URL, rate=100.0, channels=(ChannelSpec("x", unit="g"),))
    values = np.zeros((1, 4), dtype="<f4")
    frames = [
        Frame(1, Samples(values, ("x",), units=("g",), rate=50.0)),
        Frame(2, Samples(values, ("z1",), units=("m/s2",), rate=100.0)),
        Frame(3, Samples(np.zeros((2, 4), dtype="<f4"), ("z", "w"), units=("g", "g"), rate=100.0)),
        Frame(4, Samples(np.array([[1, 2], [3, 4]], dtype="<f4"), ("w", "x"), units=("V", "g"), rate=100.0)),
    ]
    with receiving(ledger, specs=[spec]) as receiver, raw(receiver) as connection:
        answer(connection)
        for item in frames:
            connection.sendall(encode_frame(item))
        items = [commit(receiver, ledger) for _ in frames]
        while answer(connection) != 4:
            pass
    assert [getattr(item, "status", "ok") for item in items] == ["wrong_rate", "wrong_unit", "wrong_shape", "ok"]
    last = items[3]
    assert isinstance(last, Block)
    np.testing.assert_array_equal(last.samples, [[3, 4]])
    assert (last.channels, last.units) == (("x",), ("g",))


def test_several_streams_share_an_address_and_each_counts_for_itself() -> None:
    ledger = MemoryLedger()
    specs = [SourceSpec("press", URL), SourceSpec("saw", URL)]
    with receiving(ledger, specs=specs) as receiver:
        with committing(receiver, ledger):
            for stream, last in (("press", 7), ("saw", 3)):
                Sender(Recorded(range(1, last + 1)), link(receiver, stream)).run()
        with raw(receiver, "saw") as connection:
            assert answer(connection) == 3
    assert (len(ledger.blocks("press")), len(ledger.blocks("saw"))) == (7, 3)


def test_sender_goes_on_where_the_receiver_is() -> None:
    ledger = MemoryLedger()
    recording = Recorded(range(1, 21), bad=(4,))
    with receiving(ledger) as receiver, committing(receiver, ledger):
        first = Sender(recording, link(receiver), limit=8).run()
        second = Sender(recording, link(receiver)).run()
        third = Sender(recording, link(receiver)).run()
    assert (first.sent, first.acknowledged, first.rejected) == (7, 8, 1)
    assert (second.sent, second.skipped, second.acknowledged) == (12, 7, 20)
    assert (third.sent, third.skipped, third.acknowledged) == (0, 19, 20)
    assert sorted(ledger.blocks("press")) == list(range(1, 21))


def test_sender_survives_a_receiver_that_forgot_everything() -> None:
    first, second = MemoryLedger(), MemoryLedger()
    with receiving(first) as receiver:
        port = receiver.port
        sender = Sender(Recorded(range(1, 31)), link(receiver), patience=PATIENCE_S)
        result: list[int] = []
        thread = threading.Thread(target=lambda: result.append(sender.run().acknowledged))
        thread.start()
        for _ in range(10):
            commit(receiver, first)
    specs = [SourceSpec("press", f"tcp://127.0.0.1:{port}")]
    with receiving(second, specs=specs) as receiver, committing(receiver, second):
        join(thread)
    assert result == [30]
    assert sorted(second.blocks("press")) == list(range(1, 31))


def test_sender_gives_up_after_its_patience_and_says_why() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    address = parse_address(f"tcp://127.0.0.1:{port}", "test")
    with pytest.raises(SendError, match="refused; blocks to 0 are committed"):
        Sender(Recorded(range(1, 3)), TcpLink(address, "press"), patience=0.0, sleep=lambda _: None).run()


def test_pace_follows_the_length_of_the_blocks() -> None:
    ledger, waits = MemoryLedger(), []
    with receiving(ledger) as receiver, committing(receiver, ledger):
        recording = Recorded(range(1, 4))
        # At a thousandth of real time a pause lasts far longer than the sending on any machine.
        Sender(recording, link(receiver), pace=1e-3, sleep=waits.append).run()
    pause = block(1, recording.samples).duration / 1e-3
    assert len(waits) == 3
    assert waits[0] == 0.0
    assert 0.9 * pause < waits[1] <= pause
    assert 1.9 * pause < waits[2] <= 2.0 * pause


def test_the_sender_of_the_documentation_works() -> None:
    path = Path(__file__).parents[3] / "examples" / "sender.py"
    program = path.read_text(encoding="utf-8")
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, committing(receiver, ledger) as items:
        exec(compile(program.replace("5777", str(receiver.port)), path.name, "exec"), {})
    assert [item.sequence for item in items] == list(range(1, 11))
    assert all(isinstance(item, Block) and item.speed == 30.0 for item in items)

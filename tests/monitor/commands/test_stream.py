"""``spallwatch stream reset``: a stream begins anew, and its records go on."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from monitor.config.load import Config, load_config
from monitor.records.events import EventLog, LoggedEvent
from monitor.records.ledger import StoreLedger
from monitor.records.publish import publish
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.system import StatusFile
from monitor.words.events import event_text
from streams.link.sender import Sender, SendError, TcpLink
from streams.link.tcp import TcpReceiver
from streams.link.wire import block_frame, encode_frame, hello
from streams.types.spec import parse_address
from tests.support.commands import run_command
from tests.support.daemon import running
from tests.support.daemons import free_port, status, tcp_machine_text
from tests.support.lost_store import blocks_of
from tests.support.network_kill import block
from tests.support.waiting import PATIENCE_S, wait_until


class Numbers:
    """A recording of certain blocks."""

    name = "s"

    def __init__(self, numbers: range) -> None:
        self.numbers = numbers

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[object]:
        return (block(number) for number in self.numbers)


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    path = tmp_path / "m.toml"
    path.write_text(tcp_machine_text(0), encoding="utf-8")
    return path


@contextmanager
def ingesting(path: Path) -> Iterator[int]:
    """Take blocks in a thread; give the port."""
    config = load_config(path)
    stop, ready, ports = threading.Event(), threading.Event(), []

    def work() -> None:
        with (
            Store.open(database(config), machine="m") as store,
            EventLog(store.path),
            Ingest.open(config, store) as found,
        ):
            receiver = found.sources[0]
            assert isinstance(receiver, TcpReceiver)
            ports.append(receiver.port)
            ready.set()
            found.run(stop)

    thread = threading.Thread(target=work)
    thread.start()
    assert ready.wait(PATIENCE_S)
    try:
        yield ports[0]
    finally:
        stop.set()
        thread.join()


def database(config: Config) -> Path:
    config.machine.state_dir.mkdir(exist_ok=True)
    return config.machine.state_dir / "state.db"


def send(port: int, numbers: range) -> tuple[int, int]:
    link = TcpLink(parse_address(f"tcp://127.0.0.1:{port}", "test"), "s", PATIENCE_S)
    result = Sender(Numbers(numbers), link, patience=0.0).run()  # pyright: ignore[reportArgumentType]
    return result.sent, result.acknowledged


def rows(path: Path) -> list[tuple[int, str, str, str]]:
    with Store.open(database(load_config(path)), read_only=True) as store:
        return store.rows("SELECT sequence, name, status, flags FROM blocks ORDER BY id")


def test_a_stream_begins_anew_with_the_same_recording(machine: Path) -> None:
    with ingesting(machine) as port:
        assert send(port, range(1, 6)) == (5, 5)
        with pytest.raises(SendError, match="this recording ends with block 3"):
            send(port, range(1, 4))
    done = run_command("stream", "reset", "s", "--config", str(machine), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"source": "s", "last": 5, "first": 1, "block": 6, "resets": 1}
    with ingesting(machine) as port:
        assert send(port, range(1, 4)) == (3, 3)
    with ingesting(machine) as port:
        assert send(port, range(1, 5)) == (1, 4)
    found = rows(machine)
    assert [row[:2] for row in found] == [
        *((number, f"s[{number}]") for number in range(1, 6)),
        *((number + 5, f"s[1:{number}]") for number in range(1, 5)),
    ]
    # The same recording has the same times; its blocks are in the order of their numbers.
    assert {row[2] for row in found} == {"ok", "clock"}
    (notice,) = log_of(machine)
    assert (notice.body["kind"], notice.body["block"], notice.open) == ("stream_reset", 6, False)


def test_a_reset_may_name_the_first_number_and_be_repeated(machine: Path) -> None:
    with ingesting(machine) as port:
        assert send(port, range(1, 3)) == (2, 2)
    for first, resets in ((5_000_001, 1), (7, 2)):
        done = run_command("stream", "reset", "s", "--first", str(first), "--config", str(machine), "--json")
        assert json.loads(done.stdout)["resets"] == resets
    with ingesting(machine) as port:
        assert send(port, range(7, 10)) == (3, 9)
    assert [row[:2] for row in rows(machine)] == [(1, "s[1]"), (2, "s[2]"), (3, "s[2:7]"), (4, "s[2:8]"), (5, "s[2:9]")]


def test_a_store_made_again_from_files_still_knows_the_count(machine: Path) -> None:
    run_command("stream", "reset", "s", "--config", str(machine))
    with ingesting(machine) as port:
        assert send(port, range(1, 3)) == (2, 2)
    assert run_command("stream", "reset", "s", "--first", "41", "--config", str(machine)).returncode == 0
    with ingesting(machine) as port:
        assert send(port, range(41, 44)) == (3, 43)
    with Store.open(database(load_config(machine)), machine="m") as store:
        with store.transaction() as connection:
            connection.execute("DROP TABLE stream_resets")
        with StoreLedger(store) as ledger:
            count = ledger.stream("s")
    assert (count.resets, count.frame_of(5), count.last) == (1, 43, 5)


def test_a_stream_silenced_by_an_earlier_version_goes_on(machine: Path) -> None:
    with ingesting(machine) as port:
        assert send(port, range(1, 4)) == (3, 3)
    with Store.open(database(load_config(machine)), machine="m") as store:
        order = store.load_states()["source:s"]
        # As one frame with this number left it.
        columns = [row[1] for row in store.rows("PRAGMA table_info(blocks)")[1:]]
        values = [str(2**63 - 1) if name == "sequence" else name for name in columns]
        poison = f"INSERT INTO blocks ({', '.join(columns)}) SELECT {', '.join(values)} FROM blocks WHERE sequence = 3"
        with store.transaction() as connection:
            connection.execute(poison)
            connection.execute("INSERT INTO records SELECT max(blocks.id), layout, row FROM records, blocks")
            text = json.dumps({**order, "sequence": 2**63 - 1})
            connection.execute("UPDATE stage_states SET state = ? WHERE name = 'source:s'", (text,))
    with ingesting(machine) as port:
        assert send(port, range(1, 6)) == (2, 5)
    assert [(row[0], row[3]) for row in rows(machine)][-2:] == [(4, ""), (5, "")]


@pytest.mark.usefixtures("refused_at_once")
def test_what_cannot_be_reset_is_named(machine: Path, tmp_path: Path) -> None:
    def refused(source: str, config: Path = machine) -> str:
        done = run_command("stream", "reset", source, "--config", str(config))
        assert done.returncode == 2
        return done.stderr

    assert "no such file" in refused("s")
    assert "'press' is not a [[source]]" in refused("press")
    folder = tmp_path / "folder.toml"
    text = tcp_machine_text(1).replace("tcp://127.0.0.1:1", "folder:in").replace('unit = "g"', 'unit = "g"\ncolumn = 1')
    folder.write_text(text, encoding="utf-8")
    assert "is not a stream" in refused("s", folder)
    with Store.open(database(load_config(machine)), machine="m"):
        assert "another process is writing" in refused("s")
    with StatusFile.open(tmp_path / "state"):
        assert "the daemon of machine m runs" in refused("s")


@pytest.mark.process
def test_a_running_daemon_logs_a_jump(tmp_path: Path) -> None:
    port, config = free_port(), tmp_path / "m.toml"
    config.write_text(tcp_machine_text(port), encoding="utf-8")
    far = encode_frame(replace(block_frame(block(1)), sequence=2**63 - 1))
    with running(config), EventLog(tmp_path / "state" / "state.db") as log:
        for _ in range(3):
            with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as connection:
                connection.sendall(hello("s") + far)
                while connection.recv(100):
                    pass
        wait_until(lambda: status(config)["sources"]["s"]["refused"] == 3)
        wait_until(lambda: log.notices())
        assert send(port, range(1, 4)) == (3, 3)
    (notice,) = log_of(config)
    assert (notice.body["kind"], notice.body["source"]) == ("stream_refused", "s")
    assert event_text(notice.body).startswith("stream refused: 127.0.0.1 (s): frame 9223372036854775807 of 's' came")


@pytest.mark.process
def test_a_lost_store_keeps_the_count_of_a_stream(tmp_path: Path) -> None:
    port, config = free_port(), tmp_path / "m.toml"
    config.write_text(tcp_machine_text(port), encoding="utf-8")
    with running(config):
        assert send(port, range(1, 3)) == (2, 2)
    assert run_command("stream", "reset", "s", "--config", str(config)).returncode == 0
    with running(config):
        assert send(port, range(1, 4)) == (3, 3)
        # At its stop the daemon gives the last publication three seconds, which a busy machine may not keep.
        wait_until(lambda: blocks_of(tmp_path / "records") == 5, every=0.1)
    for file in (tmp_path / "state").glob("state.db*"):
        file.unlink()
    with running(config):
        assert send(port, range(1, 6)) == (2, 5)
    expected = [(1, "s[1]"), (2, "s[2]"), *((number + 2, f"s[1:{number}]") for number in range(1, 6))]
    assert sorted(row[:2] for row in rows(config)) == expected


def test_a_reset_that_cannot_be_published_is_done_and_said(machine: Path) -> None:
    config = load_config(machine)
    config.machine.records_dir.write_bytes(b"")
    with Store.open(database(config), machine="m"):
        pass
    done = run_command("stream", "reset", "s", "--config", str(machine))
    assert done.returncode == 0
    assert "the change is in the store, but not published" in done.stderr
    with Store.open(database(config), read_only=True) as store, StoreLedger(store) as ledger:
        assert ledger.stream("s").resets == 1


@pytest.mark.process
def test_a_reset_is_published_before_the_next_block(machine: Path) -> None:
    config = load_config(machine)
    with ingesting(machine) as port:
        assert send(port, range(1, 3)) == (2, 2)
    with Store.open(database(config), machine="m") as store:
        assert len(publish(store, config.machine.records_dir)) == 1
    assert run_command("stream", "reset", "s", "--config", str(machine)).returncode == 0
    for file in config.machine.state_dir.glob("state.db*"):
        file.unlink()
    store, report = open_or_salvage(database(config), machine="m", records_dir=config.machine.records_dir)
    store.close()
    assert report is not None
    assert (report.saved, report.lost) == (2, 0)
    with ingesting(machine) as port:
        assert send(port, range(1, 4)) == (3, 3)
    assert [row[1] for row in rows(machine)] == ["s[1]", "s[2]", "s[1:1]", "s[1:2]", "s[1:3]"]


def log_of(path: Path) -> list[LoggedEvent]:
    with EventLog(database(load_config(path))) as log:
        return [notice for _, notice in log.notices()]

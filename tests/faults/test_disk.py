"""What the disk does to a daemon: full, over a quota, read-only, files gone. It says so, loses nothing, and goes on."""

from __future__ import annotations

import contextlib
import json
import resource
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from monitor.records.store import Store
from streams.link.sender import LinkError, TcpLink
from streams.link.wire import block_frame, encode_frame
from streams.types.spec import parse_address
from tests.support.daemon_kill import published_blocks
from tests.support.daemons import call, free_port, start, tcp_machine_text
from tests.support.effort import effort_count
from tests.support.network_kill import block
from tests.support.waiting import stop, wait_until

pytestmark = pytest.mark.process

BLOCKS = effort_count(quick=70, full=200)
RETRIES_S = effort_count(quick=5, full=15) / 10
"""Time in which a daemon tries to commit again."""


class Feeder(threading.Thread):
    """Sends blocks as far as a test lets it, and again what was not acknowledged when a connection broke."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self._link = TcpLink(parse_address(f"tcp://127.0.0.1:{port}", "test"), "s", 5.0)
        self.most = self.acknowledged = 0
        self.ended = threading.Event()

    def run(self) -> None:
        while not self.ended.is_set():
            with contextlib.suppress(LinkError):
                self._stream()
            self.ended.wait(0.05)
        self._link.close()

    def _stream(self) -> None:
        sent = self.acknowledged = self._link.connect()
        while not self.ended.is_set():
            if sent < min(self.most, self.acknowledged + 32):
                sent += 1
                self._link.send(encode_frame(block_frame(block(sent), after=sent - 1)))
            self.acknowledged = self._link.committed(0.0 if sent < self.most else 0.05) or self.acknowledged


class Machine:
    """A daemon that listens, and a sender that keeps what is not acknowledged."""

    def __init__(self, folder: Path, state: Path | None = None, records: Path | None = None) -> None:
        port = free_port()
        self.config = folder / "m.toml"
        self.state = folder / "state" if state is None else state
        self.records = folder / "records" if records is None else records
        places = f'state_dir = "{self.state}"\nrecords_dir = "{self.records}"\n'
        text = tcp_machine_text(port).replace("min_free_mb = 1\n", f"min_free_mb = 0\n{places}")
        self.config.write_text(text)
        self._said = folder / "said"
        self._feeder = Feeder(port)
        self.process = start(self.config, errors=self._said)
        self._feeder.start()

    @property
    def acknowledged(self) -> int:
        return self._feeder.acknowledged

    @property
    def said(self) -> str:
        return self._said.read_text()

    def send(self, most: int) -> None:
        """Let blocks up to this one be sent."""
        self._feeder.most = most

    def send_and_wait(self, most: int) -> None:
        self.send(most)
        wait_until(lambda: self.acknowledged == most)

    def status(self) -> dict[str, Any]:
        return json.loads((self.state / "status.json").read_text())

    def committed(self) -> int:
        with Store.open(self.state / "state.db", read_only=True) as store:
            return store.last("s")

    def finish(self) -> None:
        """Send the rest, stop the daemon, and see that every block is there once."""
        self.send_and_wait(BLOCKS)
        stop(self.process)
        assert self.process.returncode == 0, self.said
        assert "Traceback" not in self.said
        with Store.open(self.state / "state.db", machine="m") as store:
            assert store.check() == []
            assert [record.sequence for record in store.records()] == list(range(1, BLOCKS + 1))
            assert store.counts() == {"ok": BLOCKS}

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._feeder.ended.set()
        self._feeder.join()


@contextlib.contextmanager
def running(folder: Path, state: Path | None = None, records: Path | None = None) -> Iterator[Machine]:
    machine = Machine(folder, state, records)
    try:
        yield machine
    finally:
        machine.close()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 12 MB: the log of the store may take 4 MB before it is taken into the database."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = shutil.which("mount")
    options = ["-t", "tmpfs", "-o", "size=12m", "tmpfs", str(folder)]
    if mount is None or subprocess.run([mount, *options], capture_output=True, check=False).returncode:
        pytest.skip("needs the right to mount a small file system")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def fill(folder: Path) -> Path:
    """Fill a file system to the last byte; return the file that does."""
    path = folder / "filler"
    with path.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(1 << 12))
    return path


def remount(folder: Path, how: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{how}", str(folder)], check=True)


def blocks_in(folder: Path) -> int:
    """Return how many blocks the published files of a folder hold."""
    blocks = 0
    for path in folder.glob("m-*.nc"):
        with xr.open_dataset(path) as dataset:
            blocks += dataset.sizes["time"]
    return blocks


def test_on_a_full_disk_nothing_is_acknowledged_until_there_is_room(tmp_path: Path, small_disk: Path) -> None:
    with running(tmp_path, small_disk / "state", tmp_path / "records") as machine:
        machine.send_and_wait(5)
        wait_until(lambda: published_blocks(machine.config) == 5)
        filler = fill(small_disk)
        machine.send(60)
        wait_until(lambda: "the store fails, nothing is committed" in machine.said)
        time.sleep(RETRIES_S)
        stuck = machine.acknowledged
        assert 5 <= stuck < 60
        assert machine.committed() == stuck
        assert published_blocks(machine.config) >= 5
        assert machine.process.poll() is None
        filler.unlink()
        wait_until(lambda: machine.acknowledged == 60)
        assert "the store works again" in machine.said
        wait_until(lambda: machine.status()["problems"] == {})
        machine.finish()


def test_over_a_quota_nothing_is_acknowledged_until_it_is_raised(tmp_path: Path) -> None:
    with running(tmp_path) as machine:
        machine.send_and_wait(5)
        # As a quota does, the limit refuses what makes a file longer, in the midst of a write.
        limit = (machine.state / "state.db-wal").stat().st_size + 150_000
        resource.prlimit(machine.process.pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        machine.send(60)
        wait_until(lambda: "the store fails, nothing is committed" in machine.said)
        wait_until(lambda: "store" in machine.status()["problems"])
        assert machine.status()["status"] == "degraded"
        stuck = machine.acknowledged
        assert machine.committed() == stuck
        infinite = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        resource.prlimit(machine.process.pid, resource.RLIMIT_FSIZE, infinite)
        wait_until(lambda: machine.acknowledged == 60)
        wait_until(lambda: machine.status()["problems"] == {})
        machine.finish()


def test_a_folder_of_records_that_becomes_read_only_stops_no_block(tmp_path: Path, small_disk: Path) -> None:
    with running(tmp_path, records=small_disk) as machine:
        machine.send_and_wait(5)
        wait_until(lambda: blocks_in(small_disk) == 5)
        remount(small_disk, "ro")
        machine.send_and_wait(20)
        wait_until(lambda: "publisher" in machine.status()["problems"])
        assert "cannot be written" in str(machine.status()["problems"])
        assert blocks_in(small_disk) == 5
        remount(small_disk, "rw")
        wait_until(lambda: machine.status()["problems"] == {})
        wait_until(lambda: blocks_in(small_disk) == 20)
        machine.finish()


def test_a_state_that_cannot_be_written_is_refused_in_words(tmp_path: Path, small_disk: Path) -> None:
    config = tmp_path / "m.toml"
    places = f'state_dir = "{small_disk / "state"}"\n'
    config.write_text(tcp_machine_text(free_port()).replace("min_free_mb = 1\n", f"min_free_mb = 0\n{places}"))
    remount(small_disk, "ro")
    refused = call("run", "--config", str(config))
    remount(small_disk, "rw")
    assert refused.returncode == 2
    assert "Read-only file system" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_a_published_file_that_is_lost_or_damaged_is_made_again(tmp_path: Path) -> None:
    with running(tmp_path) as machine:
        machine.send_and_wait(5)
        wait_until(lambda: published_blocks(machine.config) == 5)
        (path,) = machine.records.glob("*.nc")
        for damage in (path.unlink, lambda: path.write_bytes(b"no file of records")):
            damage()
            wait_until(lambda: path.exists() and path.stat().st_size > 1000)
            assert published_blocks(machine.config) == 5
        machine.finish()


@pytest.mark.parametrize("suffix", ["", "-wal"])
def test_a_store_that_is_removed_acknowledges_nothing_until_it_is_back(tmp_path: Path, suffix: str) -> None:
    with running(tmp_path) as machine:
        machine.send_and_wait(5)
        path = machine.state / f"state.db{suffix}"
        aside = tmp_path / "aside"
        path.rename(aside)
        machine.send(20)
        wait_until(lambda: "while it was in use" in str(machine.status()["problems"]))
        assert machine.acknowledged == 5
        aside.rename(path)
        wait_until(lambda: machine.acknowledged == 20)
        wait_until(lambda: machine.status()["problems"] == {})
        machine.finish()

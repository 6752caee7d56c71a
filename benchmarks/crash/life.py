"""A short life of a machine, run as a program under the recorder; marks say what was promised, and when.

Blocks over TCP and in a folder on two days, publication, status, notices and their acknowledgement, two backups of
which one is kept, a day moved away, a restore, and a store that is lost.
"""

from __future__ import annotations

import hashlib
import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.crash.recorder import mark
from monitor.records.events import EventLog
from monitor.records.store import Store
from streams.link.sender import Sender, TcpLink
from streams.types.block import Block
from streams.types.spec import parse_address

RATE, SAMPLES = 2560.0, 256
FIRST_UTC, DAY_S = 1.7e9, 86400.0
SECOND_DAY = "2023-11-15"
"""The day after that of ``FIRST_UTC``."""
_CLI = "from monitor.cli import main; main()"
_PATIENCE_S = 300.0


@dataclass(frozen=True)
class Places:
    """The folders of a life below its base; all but the configuration and the input is recorded."""

    base: Path
    name: str = "root"

    @property
    def root(self) -> Path:
        """The folder that is recorded; states are built there, or in one with a name of the same length."""
        return self.base / self.name

    @property
    def store(self) -> Path:
        """The store of the machine."""
        return self.root / "state" / "state.db"

    @property
    def records(self) -> Path:
        """The folder of the published files."""
        return self.root / "records"

    @property
    def backups(self) -> Path:
        """The folder of the backups."""
        return self.root / "backups"

    @property
    def moved(self) -> Path:
        """The folder that days are moved to."""
        return self.root / "old" / "moved"

    @property
    def config(self) -> Path:
        """The configuration."""
        return self.base / "m.toml"


def block(number: int) -> Block:
    """Return a block of the stream; from the fourth on, they are of the second day."""
    samples = np.random.default_rng(number).standard_normal((1, SAMPLES)).astype(np.float32)
    start = FIRST_UTC + 0.1 * number + (DAY_S if number > 3 else 0.0)
    return Block(samples, RATE, ("x",), ("g",), "s", number, str(number), start=start)


def configure(places: Places) -> int:
    """Write the configuration; return the port of the stream."""
    (places.base / "in").mkdir()
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    places.config.write_text(
        '[machine]\nname = "m"\nmin_free_mb = 1\nstate_dir = "root/state"\nrecords_dir = "root/records"\n'
        '[publish]\ninterval_s = 0.3\n[web]\nenabled = false\n[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n'
        f'[operating]\nspeed_hz = 40.0\n[[source]]\nname = "s"\nurl = "tcp://127.0.0.1:{port}"\nblock_s = 0.1\n'
        f'rate_hz = {RATE}\n[[source]]\nname = "f"\nurl = "folder:in"\nformat = "csv"\nrate_hz = {RATE}\n'
        "settle_s = 0.2\nblock_s = 0.1\n"
        + "".join(
            f'[[channel]]\nname = "{name}"\nsource = "{source}"\n{column}unit = "g"\nbearing = "b"\n'
            "band_hz = [[300, 1200]]\n"
            for name, source, column in (("x", "s", ""), ("y", "f", "column = 1\n"))
        )
    )
    return port


class Life:
    """The machine, seen by those to whom it makes promises."""

    def __init__(self, places: Places) -> None:
        """Keep the places and configure the machine."""
        self.places, self.port = places, configure(places)
        self.sent = self.files = 0

    @contextmanager
    def daemon(self) -> Iterator[None]:
        """Run the daemon; it is asked to end, and its end is waited for."""
        command = [sys.executable, "-c", _CLI, "run", "--config", str(self.places.config), "--quiet"]
        with subprocess.Popen(command) as process:
            try:
                wait_until(lambda: status(self.places).get("pid") == process.pid)
                yield
            finally:
                process.send_signal(signal.SIGTERM)
                ended = process.wait(_PATIENCE_S)
        if ended:
            raise RuntimeError(f"the daemon ended with code {ended}")

    def command(self, *words: str) -> None:
        """Run a command of the program."""
        subprocess.run([sys.executable, "-c", _CLI, *words, "--config", str(self.places.config), "--quiet"], check=True)

    def send(self, count: int) -> None:
        """Send blocks one by one; each is promised once it is acknowledged."""
        for _ in range(count):
            self.sent += 1
            link = TcpLink(parse_address(f"tcp://127.0.0.1:{self.port}", "life"), "s", 5.0)
            Sender(_Recording(self.sent), link, patience=_PATIENCE_S, stall=5.0).run()
            self.promise()

    def put(self) -> None:
        """Put a file into the folder; its block is promised once the store has it."""
        self.files += 1
        values = np.random.default_rng(1000 + self.files).standard_normal(SAMPLES)
        hidden = self.places.base / "in" / f".part{self.files}"
        hidden.write_text("".join(f"{value:.6f}\n" for value in values))
        hidden.rename(self.places.base / "in" / f"2023111{4 + self.files // 2}T{self.files:02d}0000.csv")
        wait_until(lambda: self._count("f") == self.files)
        self.promise()

    def _count(self, source: str) -> int:
        with Store.open(self.places.store, read_only=True) as store:
            return store.rows("SELECT count(*) FROM blocks WHERE source = ?", source)[0][0]

    def promise(self) -> None:
        """Mark what the store holds."""
        with Store.open(self.places.store, read_only=True) as store:
            mark(blocks=blocks_of(store), states=states_of(store))

    def acknowledge(self, text: str) -> None:
        """Add a notice and acknowledge it, as the page does."""
        with EventLog(self.places.store) as log:
            name = log.notice(time.time(), {"kind": "tried", "channel": None, "severity": "alert", "text": text})
            mark(notice=name)
            log.acknowledge(name, "somebody", text, time.time())
            mark(acknowledged=name)

    def published(self) -> None:
        """Wait until the files have all blocks."""
        with Store.open(self.places.store, read_only=True) as store:
            last = store.rows("SELECT max(id) FROM blocks")[0][0]
            wait_until(lambda: store.rows("SELECT max(last_block) FROM published")[0][0] == last)

    def back_up(self) -> None:
        """Make a backup and keep no other."""
        self.command("backup", str(self.places.backups), "--keep", "1")
        (name,) = (path.name for path in self.places.backups.glob("m-*Z*"))
        mark(backup=name)

    def move_day(self) -> None:
        """Move the first day away."""
        (first, *_) = sorted(path.name for path in self.places.records.glob("m-2*.nc"))
        mark(moving=first)
        self.command("archive-days", "--before", SECOND_DAY, "--to", str(self.places.moved))


class _Recording:
    """One block, as a recording that ends with it."""

    name = "s"

    def __init__(self, last: int) -> None:
        self._last = last

    def __len__(self) -> int:
        return self._last

    def __iter__(self) -> Iterator[Block]:
        return (block(number) for number in range(1, self._last + 1))


def blocks_of(store: Store) -> dict[str, str]:
    """Return a digest of each block and record of a store, its content hash in it, by "source number"."""
    rows = store.rows(
        "SELECT source || ' ' || sequence, content_hash, blocks.name, status, flags, reason, time, elapsed, axis_time,"
        " layouts.layout, row FROM blocks JOIN records ON block = blocks.id"
        " JOIN layouts ON layouts.id = records.layout"
    )
    return {name: digest_of(repr(values)) for name, *values in rows}


def states_of(store: Store) -> dict[str, str]:
    """Return the block and a digest of the state of each stage, by its name."""
    rows = store.rows(
        "SELECT stage_states.name, source, sequence, state FROM stage_states"
        " LEFT JOIN blocks ON blocks.id = stage_states.block"
    )
    return {name: f"{source} {sequence} {digest_of(state)}" for name, source, sequence, state in rows}


def digest_of(text: str) -> str:
    """Return a short digest of a text."""
    return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


def status(places: Places) -> dict[str, Any]:
    """Return what the status file says, {} where there is none."""
    try:
        return json.loads((places.store.parent / "status.json").read_text())
    except FileNotFoundError:
        return {}


def wait_until(is_true: Callable[[], bool]) -> None:
    """Wait until something holds; TimeoutError where it never does."""
    until = time.monotonic() + _PATIENCE_S
    while not is_true():
        if time.monotonic() > until:
            raise TimeoutError("the life does not go on")
        time.sleep(0.02)


def live(life: Life) -> None:
    """Live the whole life."""
    with life.daemon():
        life.send(2)
        life.put()
        life.acknowledge("first")
        life.send(1)
        life.published()
        life.back_up()
        life.put()
        life.send(2)
        life.published()
        life.acknowledge("second")
        life.back_up()
        life.send(1)
    life.move_day()
    with life.daemon():
        life.send(2)
        life.put()
        life.published()
    life.back_up()
    life.command("restore", str(life.places.backups), "--replace")
    with life.daemon():
        life.send(1)
        life.published()
    mark(lost=True)
    for suffix in ("-wal", ""):
        life.places.store.with_name(f"state.db{suffix}").unlink(missing_ok=True)
    with life.daemon():
        life.send(1)
        life.published()
    mark(end=True)


if __name__ == "__main__":
    live(Life(Places(Path(sys.argv[1]))))

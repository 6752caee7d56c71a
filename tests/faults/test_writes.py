"""The daemon is killed at its n-th call of each kind that writes the store, its status or a published file.

``strace`` delivers the signal as the system call is entered, so that the file is left as it is between two writes, for
all that come: of the database, its log and its journal, of the status file, of a file that is being published, and the
renames, truncations and calls for durability among them. Blocks come over TCP: what was acknowledged, the sender has
forgotten, and only the store still has it.
"""

from __future__ import annotations

import contextlib
import os
import random
import re
import shutil
import signal
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.store import Store
from streams.link.sender import Sender, TcpLink
from streams.types.block import Block
from streams.types.spec import parse_address
from tests.support.daemon_kill import published_blocks
from tests.support.daemons import free_port, start, start_program, status, tcp_machine_text
from tests.support.effort import effort_count
from tests.support.network_kill import block
from tests.support.waiting import Stall, stop, wait_until

pytestmark = pytest.mark.process

BLOCKS = 6
FULL = effort_count(quick=0, full=1) == 1
MOST = {"state": 10**6, "published": 300}
"""Most places at which it is killed in full effort: every one of the store, and some of the many of a file."""
FEW = {"state": [("pwrite64", 144), ("rename", 1)], "published": [("pwrite64", 100)]}
CALLS = ("write", "pwrite64", "ftruncate", "fsync", "fdatasync", "rename", "renameat", "renameat2", "unlink", "link")
STRACE = shutil.which("strace")
NEVER = 65535
"""The highest number that strace takes."""


@pytest.fixture(scope="module", autouse=True)
def tracing() -> None:
    """Skip where processes cannot be traced; under CI strace must be there."""
    if STRACE is None:
        reason = "strace is missing (Debian package strace)"
        if os.environ.get("CI"):
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)
    if subprocess.run([STRACE, "-f", "-o", os.devnull, "true"], capture_output=True, check=False).returncode:
        pytest.skip("needs the right to trace processes")


class Recording:
    """A few blocks."""

    name = "s"

    def __len__(self) -> int:
        return BLOCKS

    def __iter__(self) -> Iterator[Block]:
        return (block(number) for number in range(1, BLOCKS + 1))


class Sending:
    """A sender in the background, which keeps what is not acknowledged and sends it again."""

    def __init__(self, port: int) -> None:
        self.acknowledged = 0
        link = TcpLink(parse_address(f"tcp://127.0.0.1:{port}", "test"), "s", 5.0)
        # A retry comes at once, so that a restart is not waited for longer than it takes.
        sender = Sender(
            Recording(), link, patience=300.0, stall=5.0, progress=self._note, sleep=lambda _: time.sleep(0.05)
        )
        self.thread = threading.Thread(target=sender.run)
        self.thread.start()

    def _note(self, committed: int) -> None:
        self.acknowledged = committed


def make(folder: Path) -> tuple[Path, int]:
    folder.mkdir()
    port = free_port()
    config = folder / "m.toml"
    config.write_text(tcp_machine_text(port))
    return config, port


def watched(config: Path, kind: str) -> list[Path]:
    """Return the files whose writes count."""
    state, records = config.parent / "state", config.parent / "records"
    if kind == "published":
        return [records / f"{prefix}m-20231114.nc{suffix}" for prefix, suffix in ((".", ".tmp"), ("", ""))] + [records]
    database = [state / f"state.db{suffix}" for suffix in ("", "-wal", "-journal", "-shm")]
    return [*database, state / "status.json", state / ".status.json.tmp", state]


def under_strace(config: Path, kind: str, call: str, n: int) -> list[str]:
    """Return the command that kills whichever process comes to its n-th call that concerns the files."""
    assert STRACE is not None
    command = [STRACE, "-f", "-q", "-o", str(config.parent / "strace")]
    for path in watched(config, kind):
        command += ["-P", str(path)]
    return [*command, "-e", f"trace={','.join(CALLS)}", "-e", f"inject={call}:signal=SIGKILL:when={n}"]


def committed(config: Path) -> list[Record]:
    """Return what the store has, as a reader beside it or after it sees it."""
    database = config.parent / "state" / "state.db"
    if not database.exists() or not database.stat().st_size:
        return []
    try:
        with Store.open(database, read_only=True) as store:
            return list(store.records())
    except StoreError as error:
        # Killed before the tables were there, or while they were made: the next writer takes that back.
        if not any(text in str(error) for text in ("is empty", "readonly database")):
            raise
        return []


def finish(config: Path, sending: Sending) -> list[Record]:
    """Let an undisturbed daemon take the rest, stop it, and return what it has."""
    daemon = start(config, "--quiet")
    try:
        wait_until(lambda: status(config).get("pid") == daemon.pid)
        # The last publication is given three seconds at the stop, which a busy machine may not keep.
        wait_until(lambda: published_blocks(config) == BLOCKS and not sending.thread.is_alive(), every=0.05)
        said = stop(daemon)
    finally:
        daemon.kill()
        daemon.communicate()
    assert daemon.returncode == 0, said
    assert published_blocks(config) == BLOCKS
    with Store.open(config.parent / "state" / "state.db", machine="m") as store:
        assert store.check() == []
        assert store.counts() == {"ok": BLOCKS}
    return committed(config)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    config, port = make(tmp_path_factory.mktemp("undisturbed") / "m")
    return finish(config, Sending(port))


def killed_at(config: Path, kind: str, call: str, n: int, sending: Sending) -> bool:
    """Run a daemon to its death at the n-th call, or to its end; return whether it, or its publisher, was killed.

    All the while every published file is opened and read.
    """
    trace = config.parent / "strace"
    daemon = start_program(config, "--quiet", prefix=under_strace(config, kind, call, n))
    asked, stall = False, Stall(lambda: sending.acknowledged)
    while daemon.poll() is None:
        stall.check()
        published = published_blocks(config)
        killed = trace.exists() and was_cut_off(trace, call)
        if not asked and (killed or (published == BLOCKS and not sending.thread.is_alive())):
            # A publisher that dies is started again by the daemon, which must be told to end.
            pid = status(config).get("pid")
            if pid is not None:
                asked = True
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGTERM)
        time.sleep(0.02)
    _, said = daemon.communicate()
    assert "Traceback" not in said, said
    return was_cut_off(trace, call)


def was_cut_off(trace: Path, call: str) -> bool:
    """Return whether a process was killed in such a call, which then has no result."""
    return re.search(rf"\b{call}(\(| resumed).*= \?$", trace.read_text(errors="replace"), re.MULTILINE) is not None


def all_places(folder: Path, kind: str, undisturbed: list[Record]) -> list[tuple[str, int]]:
    """Return at which calls a daemon can be killed: as many of each as the process that made most of them made."""
    config, port = make(folder)
    sending = Sending(port)
    killed_at(config, kind, "write", NEVER, sending)
    assert finish(config, sending) == undisturbed
    trace = (folder / "strace").read_text(errors="replace")
    found = Counter(re.findall(r"^(\d+) +(\w+)\(", trace, re.MULTILINE))
    most: dict[str, int] = {}
    for (_, call), times in found.items():
        most[call] = max(times, most.get(call, 0))
    assert most["pwrite64"] > 100
    places = [(call, n) for call, times in most.items() for n in range(1, times + 1)]
    # A rename or a truncation is rare among so many writes, and comes first.
    random.Random(20261121).shuffle(places)
    return sorted(places, key=lambda place: place[0] == "pwrite64")[: MOST[kind]]


@pytest.mark.parametrize("kind", ["state", "published"])
@pytest.mark.timeout(effort_count(quick=900, full=8 * 3600))
def test_killed_at_a_write_nothing_is_lost_and_nothing_comes_twice(
    tmp_path: Path, undisturbed: list[Record], kind: str
) -> None:
    places = all_places(tmp_path / "counted", kind, undisturbed) if FULL else FEW[kind]
    kills = 0
    for call, n in places:
        config, port = make(tmp_path / f"{call}{n}")
        sending = Sending(port)
        killed = killed_at(config, kind, call, n, sending)
        kept, acknowledged = committed(config), sending.acknowledged
        assert len(kept) >= acknowledged
        assert kept == undisturbed[: len(kept)]
        assert finish(config, sending) == undisturbed
        shutil.rmtree(config.parent)
        kills += killed
    # How often a publisher is asked depends on the time that things take, so that some places are not reached.
    assert kills >= 0.5 * len(places)

"""A restore is killed at any moment: the next start finds the old or the whole new state, and both stay readable."""

from __future__ import annotations

import multiprocessing
import random
import time
from contextlib import suppress
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from monitor.records.backup import back_up, find_backup
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.restore import restore
from tests.support.backup import UTC, blocks_in, contents_of, fill, places_in, publish
from tests.support.effort import effort_count

pytestmark = pytest.mark.process

KILLS = effort_count(quick=4, full=200)
_FORK = multiprocessing.get_context("fork")
_SIZES = (200, 90)


def restore_for_ever(target: Path, backups: list[Path], done: Connection) -> None:
    """Restore two backups in turn, and send the number of each restore that has ended."""
    for number in count():
        source = find_backup(backups[number % 2], "m")
        restore(source, "m", places_in(target), replace=True, utc=UTC + number)
        done.send(number)


def killed(target: Path, backups: list[Path], generator: random.Random) -> list[int]:
    """Kill a process that restores; return the numbers of the restores that it had ended."""
    done, theirs = _FORK.Pipe(duplex=False)
    # A fork: most of the life of a new program would be its imports.
    child = _FORK.Process(target=restore_for_ever, args=(target, backups, theirs))
    child.start()
    theirs.close()
    numbers: list[int] = [done.recv() for _ in range(generator.randrange(3))]
    time.sleep(generator.uniform(0.0, 0.05))
    child.kill()
    with suppress(EOFError):
        while True:
            numbers.append(done.recv())
    child.join()
    done.close()
    return numbers


def make_backup(folder: Path, blocks: int) -> Path:
    """Make a backup of a machine with so many blocks and a published file that says how many."""
    folder.mkdir()
    fill(folder / "state", blocks)
    publish(folder, f"m-2026{blocks:04d}.nc", str(blocks).encode())
    back_up(contents_of(folder), folder / "backups", keep=1, utc=UTC)
    return folder / "backups"


def test_killed_at_any_moment_the_old_or_the_whole_new_state_is_there(tmp_path: Path) -> None:
    backups = [make_backup(tmp_path / str(size), size) for size in _SIZES]
    generator = random.Random(20261122)
    seen: set[int] = set()
    for kill in range(KILLS):
        target = tmp_path / f"target-{kill}"
        old = generator.choice((0, 30))
        if old:
            fill(target / "state", old)
        done = killed(target, backups, generator)
        database = target / "state" / "state.db"
        database.parent.mkdir(parents=True, exist_ok=True)
        # As a daemon starts.
        open_or_salvage(database, machine="m", records_dir=target / "records")[0].close()
        found = blocks_in(database)
        last = done[-1] if done else -1
        before = _SIZES[last % 2] if done else old
        assert found in (before, _SIZES[(last + 1) % 2]), (kill, done)
        seen.add(found)
        if found in _SIZES:
            assert (target / "records" / f"m-2026{found:04d}.nc").read_bytes() == str(found).encode()
        assert not [path for path in (target / "records").glob("*") if path.name.startswith(".")]
        assert not list(database.parent.glob("state.db.restor*"))
        # Nothing was lost on the way: each store that was replaced is there still, whole.
        aside = [path for path in database.parent.glob("state.db.before-restore-*") if path.suffix != ".lock"]
        aside = [path for path in aside if not path.name.endswith(("-wal", "-shm"))]
        replaced = len(done) + (found != before) - (old == 0)
        assert len(aside) == max(0, replaced), (kill, done, found)
        if aside:
            assert blocks_in(generator.choice(aside)) in (old, *_SIZES)
    assert seen & set(_SIZES)
    assert find_backup(backups[0], "m").exists()

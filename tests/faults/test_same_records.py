"""However the same files come to records, at once, through kills and stops, replayed, resumed: they are the same."""

from __future__ import annotations

import random
import signal
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from monitor.health.record import Record
from monitor.records.store import Store
from tests.streams.folders import csv_bytes, noise
from tests.support.daemons import RATE, call, make_machine, start, status
from tests.support.effort import effort_count
from tests.support.waiting import finish, stop, wait_until

pytestmark = pytest.mark.process

FILES = effort_count(quick=24, full=240)
ENDS = effort_count(quick=1, full=20)
LEARNED = 10
MAX_BLOCKS_A_FILE = 4
"""More than the records of any file: at most two blocks of 256 samples and a remainder."""


def make(folder: Path, block_s: str) -> Path:
    """Make a machine and its files: noise, one file of no numbers, a dead sensor, and a loud end."""
    config = make_machine(folder)
    text = config.read_text().replace("block_s = 0.1", f"block_s = {block_s}")
    config.write_text(f"{text}[detect]\nlearn_blocks = {LEARNED}\nrun_in_blocks = 0\npersist_blocks = 2\n")
    inputs = folder / "in0"
    for number in range(1, FILES + 1):
        samples = noise(512, number) * (1.0 if number < 0.7 * FILES else 8.0)
        samples = {FILES // 2: np.zeros(512), FILES // 3: np.full(512, np.nan)}.get(number, samples)
        (inputs / f"f{number:05d}.csv").write_bytes(csv_bytes(samples))
    return config


def is_done(config: Path) -> bool:
    source = status(config).get("sources", {}).get("s0")
    return bool(source) and source["pending"] == 0 and source["accepted"] + source["rejected"] >= FILES


def live(config: Path, ends: int, generator: random.Random) -> None:
    """Run the daemon to the end of its files, killed or stopped so many times before."""
    for _ in range(ends):
        daemon = start(config, "--quiet")
        time.sleep(generator.uniform(0.6, 1.8))
        number = generator.choice([signal.SIGKILL, signal.SIGTERM])
        daemon.send_signal(number)
        finish(daemon)
    daemon = start(config, "--quiet")
    try:
        wait_until(lambda: daemon.poll() or (status(config).get("pid") == daemon.pid and is_done(config)))
        said = stop(daemon)
    finally:
        daemon.kill()
        daemon.communicate()
    assert daemon.returncode == 0, said


def replayed(config: Path, source: Path, out: Path, *limits: int) -> Path:
    """Replay the files, in several goes where there are limits; return the store."""
    for number, limit in enumerate([*limits, FILES * MAX_BLOCKS_A_FILE]):
        options = ["--resume"] if number else []
        made = call(
            *(
                "replay",
                str(source),
                "--config",
                str(config),
                "--out",
                str(out),
                "--json",
                "--no-report",
                "--limit",
                str(limit),
            ),
            *options,
        )
        assert made.returncode == 0, made.stderr
    return out / "state.db"


def records(database: Path) -> list[Record]:
    with Store.open(database, read_only=True) as store:
        assert store.check() == []
        return list(store.records())


@pytest.mark.timeout(effort_count(quick=900, full=1800))
def test_the_same_files_give_the_same_records_however_they_were_taken(tmp_path: Path) -> None:
    generator = random.Random(20261121)
    at_once, disturbed = tmp_path / "a", tmp_path / "b"
    for folder in (at_once, disturbed):
        folder.mkdir()
    config = make(at_once, '"file"')
    live(config, 0, generator)
    live(make(disturbed, '"file"'), ENDS, generator)
    expected = records(at_once / "state" / "state.db")
    assert len(expected) == FILES
    assert {record.status for record in expected} >= {"ok", "flat", "nan"}
    assert any(event["kind"] == "final_stage" for record in expected for event in record.events)
    assert records(disturbed / "state" / "state.db") == expected
    assert records(replayed(config, at_once / "in0", tmp_path / "c")) == expected
    cuts = sorted(generator.sample(range(1, FILES), 2))
    parts = replayed(config, at_once / "in0", tmp_path / "d", cuts[0], cuts[1] - cuts[0])
    assert records(parts) == expected


def make_cut(folder: Path, dated: bool) -> Path:
    """Make a machine of two channels whose files are of any length, with gaps, and one that cannot be read.

    Dated files go on where the one before ended, but after a gap; the last run ends with a block.
    """
    config = make_machine(folder)
    text = config.read_text()
    second = text[text.index("[[channel]]") :].replace('"x0"', '"y0"').replace("column = 1", "column = 2")
    config.write_text(f"{text}{second}[detect]\nlearn_blocks = {LEARNED}\nrun_in_blocks = 0\npersist_blocks = 2\n")
    generator, block = np.random.default_rng(7), 256
    lengths = [int(length) for length in generator.integers(30, 700, FILES)]
    gaps = {FILES // 3, FILES // 2}
    bad = 2 * FILES // 3
    lengths[-1] += -(sum(lengths[bad:]) if dated else lengths[-1]) % block
    when = datetime(2026, 3, 1, 12, tzinfo=UTC)
    for number, length in enumerate(lengths, 1):
        when += timedelta(seconds=1.0 if number in gaps else 0.0)
        samples = np.round(generator.normal(size=(length, 2)) * (1.0 if number < 0.7 * FILES else 8.0), 4)
        head = f"# start_utc: {when.isoformat()}\n" if dated else ""
        body = "".join(f"{x:.4f},{y:.4f}\n" for x, y in samples)
        path = folder / "in0" / f"f{number:05d}.csv"
        if number == bad:
            path.symlink_to(config)
        else:
            path.write_text(head + body)
        when += timedelta(seconds=length / RATE)
    return config


@pytest.mark.parametrize("dated", [False, True], ids=["undated", "dated"])
@pytest.mark.timeout(effort_count(quick=900, full=1800))
def test_blocks_that_are_cut_from_files_are_the_same_live_and_replayed(tmp_path: Path, dated: bool) -> None:
    generator = random.Random(20261121)
    at_once, disturbed = tmp_path / "a", tmp_path / "b"
    for folder in (at_once, disturbed):
        folder.mkdir()
    config = make_cut(at_once, dated)
    live(config, 0, generator)
    # Files of quick effort without dates are not interrupted: those with dates are, and those of the test above.
    if dated or ENDS > 1:
        live(make_cut(disturbed, dated), ENDS, generator)
    expected = records(at_once / "state" / "state.db")
    assert {record.status for record in expected} >= {"ok", "short", "refused"}
    assert all(set(record.channels) == {"x0", "y0"} for record in expected if record.accepted)
    times = [(record.time, record.elapsed) for record in expected if record.accepted]
    assert all((time is not None) == dated and (elapsed is not None or not dated) for time, elapsed in times)
    assert sum(elapsed is not None for _, elapsed in times) > len(times) // 4
    if dated or ENDS > 1:
        assert records(disturbed / "state" / "state.db") == expected
    assert records(replayed(config, at_once / "in0", tmp_path / "c")) == expected
    parts = replayed(config, at_once / "in0", tmp_path / "d", FILES // 4, FILES // 4)
    assert records(parts) == expected

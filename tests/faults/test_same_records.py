"""However the same files come to records, at once, through kills and stops, replayed, resumed: they are the same."""

from __future__ import annotations

import random
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from monitor.records.record import Record
from monitor.records.store import Store
from tests.effort import effort_count
from tests.faults.daemons import call, make_machine, start, status, wait_for
from tests.streams.folders import csv_bytes, noise

FILES = effort_count(quick=24, full=240)
ENDS = effort_count(quick=2, full=20)
LEARNED = 10


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
        daemon.communicate(timeout=20)
    daemon = start(config, "--quiet")
    try:
        wait_for(lambda: daemon.poll() or (status(config).get("pid") == daemon.pid and is_done(config)), 60.0)
        daemon.send_signal(signal.SIGTERM)
        _, said = daemon.communicate(timeout=20)
    finally:
        daemon.kill()
        daemon.communicate()
    assert daemon.returncode == 0, said


def replayed(config: Path, source: Path, out: Path, *limits: int) -> Path:
    """Replay the files, in several goes where there are limits; return the store."""
    for number, limit in enumerate([*limits, FILES * 2]):
        options = ["--resume"] if number else []
        made = call(
            *("replay", str(source), "--config", str(config), "--out", str(out), "--json", "--limit", str(limit)),
            *options,
        )
        assert made.returncode == 0, made.stderr
    return out / "state.db"


def records(database: Path) -> list[Record]:
    with Store.open(database, read_only=True) as store:
        assert store.check() == []
        return list(store.records())


@pytest.mark.timeout(effort_count(quick=300, full=1800))
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


def test_blocks_that_are_cut_from_files_say_the_same_live_and_replayed(tmp_path: Path) -> None:
    config = make(tmp_path, "0.1")
    (tmp_path / "in0" / f"f{FILES // 3:05d}.csv").write_bytes(csv_bytes(noise(512, 0)))
    live(config, 0, random.Random(0))
    found = records(tmp_path / "state" / "state.db")
    assert len(found) == 2 * FILES
    # A stream is cut across its files, a recording file by file: the names and digests of the pieces are their own.
    again = records(replayed(config, tmp_path / "in0", tmp_path / "out"))
    assert [replace(record, name="", content_hash="") for record in again] == [
        replace(record, name="", content_hash="") for record in found
    ]

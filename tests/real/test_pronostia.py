"""Runs to failure: onset inside its window and known in time, damaged part, end of life; restarts change nothing.

Windows are those of the requirements, from the README of the recordings. No setting was chosen on these runs; how far
each can be moved is in ``benchmarks/onset/detection.py``.
"""

from __future__ import annotations

import json
import tarfile
from collections.abc import Callable
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.health.record import Record
from monitor.records.store import Store
from monitor.service.replay import replay
from monitor.service.setup import open_configured, source_settings
from reference import recordings_folder
from reference.recordings import RUNS, Run, example
from reference.steps import Steps
from streams.types.block import Block, Rejected
from tests.support.effort import effort_count

pytestmark = [pytest.mark.real, pytest.mark.usefixtures("kept_band_choices")]

FAULTS: dict[str, dict[str, set[str | None]]] = {
    "Bearing2_4": {"horizontal": {"outer"}, "vertical": {"outer"}},
    "Bearing3_1": {"horizontal": {"outer", None}, "vertical": {"outer"}},
    # The README finds no line of the bearing in it, and ten hertz cannot separate the inner race from the balls.
    "Bearing2_7": {"horizontal": {None}, "vertical": {None}},
    "Bearing1_1": {"horizontal": {"inner|ball", None}, "vertical": {"inner|ball", None}},
}
BEARINGS = {
    "Bearing2_4": ("outer", "verdict"),
    "Bearing3_1": ("outer", "verdict"),
    "Bearing2_7": (None, None),
    "Bearing1_1": ("inner|ball", "verdict"),
}
"""What both axes say together, whatever one of them says alone."""
END_OF_LIFE = {"Bearing1_1": 2766}
LONG_RUNS = {"Bearing1_1": 2803, "Bearing2_4": 751}
"""Number of files of the runs that only full effort replays; the others hold a named race and an unnamed fault."""


Replayed = Callable[[Run], tuple[dict[str, Any], Path]]


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    """Replay a run, once for all tests; return its summary and its store."""

    @cache
    def replay_once(run: Run) -> tuple[dict[str, Any], Path]:
        config, _ = example(run.config)
        out = tmp_path_factory.mktemp("replayed") / run.name
        return replay(config, str(recordings_folder() / run.file), out).summary, out / "state.db"

    return replay_once


@pytest.mark.parametrize("run", RUNS, ids=lambda run: run.name)
def test_onset_name_and_end_of_life(replayed: Replayed, run: Run) -> None:
    if run.name in LONG_RUNS and effort_count(quick=0, full=1) == 0:
        pytest.skip(f"{LONG_RUNS[run.name]} files; SPALLWATCH_EFFORT=full runs it")
    result, database = replayed(run)
    assert result["rejected"] == {}
    assert result["pending"] == 0
    channels: dict[str, dict[str, Any]] = result["channels"]
    known = {
        name: None if found["t_fs_block"] is None else (found["t_fs_block"], found["t_fs_known_block"])
        for name, found in channels.items()
    }
    assert run.verdict(known) == "right", known
    for name, found in channels.items():
        assert found["fault"] in FAULTS[run.name][name]
        assert found["t_fs_utc"] is None
        assert found["fault_basis"] == (None if found["fault"] is None else "verdict")
    (bearing,) = result["bearings"].values()
    assert (bearing["fault"], bearing["fault_basis"]) == BEARINGS[run.name]
    assert (bearing["disagreement"], bearing["channels"]) == ({}, ["horizontal", "vertical"])
    ends = [found["t_eol_block"] for found in channels.values() if found["t_eol_block"] is not None]
    assert min(ends, default=None) == END_OF_LIFE.get(run.name)
    assert_nothing_is_named_too_early(database, run)


def assert_nothing_is_named_too_early(database: Path, run: Run) -> None:
    early = [record for record in records_of(database) if record.sequence < run.window[0]]
    assert len(early) == run.window[0] - 1
    for record in early:
        assert all(values.get("fault") is None for values in record.channels.values()), record.sequence


def records_of(database: Path) -> list[Record]:
    with Store.open(database, machine="pronostia", read_only=True) as store:
        return list(store.records())


@cache
def items_of(file: Path, config: str, count: int) -> tuple[Block | Rejected, ...]:
    settings, section = example(config)
    return tuple(islice(open_configured(settings, section, str(file)), count))


@pytest.mark.parametrize("seed", range(effort_count(quick=1, full=20)))
def test_a_run_in_pieces_gives_the_same_records(data_dir: Path, seed: int) -> None:
    """At random blocks the state is read back from the JSON of its parts."""
    run = next(run for run in RUNS if run.name == "Bearing2_7")
    items = items_of(data_dir / run.file, run.config, effort_count(quick=72, full=230))
    config, section = example(run.config)
    settings = source_settings(config, section)
    whole = Steps(settings)
    expected = [whole.take(item).to_json() for item in items]
    rng = np.random.default_rng(seed)
    cuts = set(rng.choice(len(items), 12, replace=False).tolist())
    steps, latest = Steps(settings), None
    for i, item in enumerate(items):
        if i in cuts:
            steps = Steps(settings, json.loads(json.dumps(steps.stored())), latest)
        latest = steps.take(item)
        assert latest.to_json() == expected[i]
    assert steps.stored() == whole.stored()


def first_files(archive: Path, count: int, folder: Path) -> Path:
    """Return an archive of the first so many files of one, which takes less time to decompress again and again."""
    with tarfile.open(archive) as whole, tarfile.open(folder / f"{archive.name.split('.')[0]}.tar", "w") as short:
        members = sorted((member for member in whole if member.isfile()), key=lambda member: member.name)[:count]
        for member in members:
            short.addfile(member, whole.extractfile(member))
    return Path(str(short.name))


def test_a_replay_that_is_resumed_gives_the_same_store(data_dir: Path, tmp_path: Path) -> None:
    run = next(run for run in RUNS if run.name == "Bearing2_7")
    config, _ = example(run.config)
    count, limit = effort_count(quick=48, full=230), effort_count(quick=16, full=83)
    path = str(first_files(data_dir / run.file, count, tmp_path))
    whole = replay(config, path, tmp_path / "whole", limit=count).summary
    pieces = [replay(config, path, tmp_path / "pieces", limit=limit, resume=i > 0).summary for i in range(3)]
    assert pieces[-1]["channels"] == whole["channels"]
    one, other = records_of(tmp_path / "whole" / "state.db"), records_of(tmp_path / "pieces" / "state.db")
    assert len(one) == count
    assert [record.to_json() for record in one] == [record.to_json() for record in other]

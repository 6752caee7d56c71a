"""What the tests of figures share: a run on record, and what a figure carries."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from monitor.health.record import Record
from monitor.health.signal.waterfall import SpectrumRow
from monitor.records.store import Store
from monitor.report.figures.drawing import (
    Picture,
)
from monitor.report.runs import Channel, Run, read_runs
from monitor.report.verdict import ChannelContext, judge
from monitor.words.numbers import Clock

START = 1_700_000_000.0
CLOCK = Clock(True)


def run_of(tmp_path: Path, made: list[Record], **attributes: Any) -> Run:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.describe(attributes)
        store.commit_many([(record, {}) for record in made])
        (run,) = read_runs(store)
    return run


def drawn(picture: Picture | None) -> dict[str, Any]:
    """Return what a figure carries as a program reads it, after a look at the figure itself."""
    assert picture is not None
    assert picture.svg.startswith("<svg ")
    assert 'role="img" aria-label="' in picture.svg
    assert "<style" not in picture.svg
    assert picture.caption.endswith(".")
    return json.loads(picture.json)


def numbers() -> itertools.count[int]:
    return itertools.count(1)


def context_of(run: Run, channel: Channel, clock: Clock = CLOCK, **rows: Sequence[SpectrumRow]) -> ChannelContext:
    """Return the context of a channel of a run that has these kept spectra, views or spectra of the angular speed."""
    beside = {name: {channel.name: kept} for name, kept in rows.items()}
    return ChannelContext(replace(run, **beside), channel, judge(run, channel), clock, numbers())

"""One line a bearing at the head of a report: the same verdict as that of the monitor, from the records alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from monitor.health.name.machine import weigh
from monitor.health.record import Record
from monitor.health.state import SourceState
from monitor.records.store import Store
from monitor.report.options import Options
from monitor.report.report import build_report
from monitor.report.runs import Run, read_runs
from monitor.report.statements import bearing_parts, bearings_of
from tests.oracles.page import Page
from tests.support.retrace import lived, settings_of


def run_of(folder: Path, records: list[Record], bearing: str = "one: drive; two: drive") -> Run:
    with Store.open(folder / "state.db", machine="m") as store:
        store.describe({"bearing": bearing} if bearing else {})
        store.commit_many([(record, {}) for record in records])
        return read_runs(store)[0]


def says(number: int, *, final: bool = False, **faults: str) -> Record:
    """Return a record in which the channels one and two name these parts."""
    base: dict[str, Any] = {"rms": 1.0, "quality_status": "ok", "stage": "final" if final else "healthy"}
    base |= {"t_fs": 1.0, "t_fs_block": 1} if final else {}
    channels = {
        name: base | ({"fault": fault, "fault_depth": 0.4} if fault else {})
        for name, fault in ({"one": "", "two": ""} | faults).items()
    }
    return Record("s", number, f"b{number}", str(number), elapsed=float(number), channels=channels)


def test_a_report_says_what_the_monitor_said(tmp_path: Path) -> None:
    """Over a life with rejected, late, dead and stopped blocks, some of which are named."""
    states: list[SourceState]
    states, records = lived()
    (part,) = bearing_parts(run_of(tmp_path, records))
    bearings = settings_of().bearings
    assert bearings == {"bearing": ("one", "two")}
    assert weigh([states[-1].machine], bearings)["bearing"] == part.verdict
    assert (part.verdict.fault, part.verdict.basis) == ("outer", "verdict")


@pytest.mark.parametrize(
    ("records", "words", "grade"),
    [
        ([says(n) for n in range(1, 4)], ("no part named", "–", "–", ""), "good"),
        ([says(n, one="outer") for n in range(1, 4)], ("outer race", "hint", "86 %", ""), "open"),
        (
            [says(n, final=True, one="inner|ball", two="ball") for n in range(1, 4)],
            ("rolling element", "verdict", "92 %", ""),
            "watch",
        ),
        (
            [says(n, final=True, one="outer", two="inner") for n in range(1, 4)],
            ("outer race", "verdict", "46 %", "two says inner race"),
            "watch",
        ),
    ],
    ids=["none", "hint", "verdict", "disagreement"],
)
def test_a_line_in_words(tmp_path: Path, records: list[Record], words: tuple[str, ...], grade: str) -> None:
    (part,) = bearing_parts(run_of(tmp_path, records))
    assert (part.part, part.basis, part.support, part.others) == words
    assert (part.name, part.grade, part.channels) == ("drive", grade, "one, two")


def test_channels_of_two_bearings_have_a_line_each(tmp_path: Path) -> None:
    run = run_of(tmp_path, [says(n, one="outer", two="inner") for n in range(1, 4)], "one: drive; two: free; gone: x")
    assert bearings_of(run) == {"drive": ("one",), "free": ("two",)}
    assert [(part.name, part.part) for part in bearing_parts(run)] == [("drive", "outer race"), ("free", "inner race")]


def test_records_that_do_not_name_their_bearings_have_no_line(tmp_path: Path) -> None:
    run = run_of(tmp_path, [says(n, one="outer") for n in range(1, 4)], "")
    assert bearing_parts(run) == ()


def test_the_channel_with_which_its_bearing_agrees_comes_first(tmp_path: Path) -> None:
    records = [says(n, final=True, one="inner" if n < 3 else "", two="outer") for n in range(1, 12)]
    run_of(tmp_path, records)
    build_report(tmp_path, tmp_path / "report.html", options=Options(sections=frozenset()))
    text = Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    assert "drive ▲ outer race verdict" in " ".join(text.split())
    assert text.index("Channel two") < text.index("Channel one")


def test_a_level_that_rises_with_a_neighbours_is_no_verdict_of_damage(tmp_path: Path) -> None:
    """The channel has an onset; the card of the bearing and of the channel say whose damage it hears."""
    records = [says(n, final=True, two="outer") for n in range(1, 9)]
    levels: dict[str, dict[str, Any]] = {"one": {"rms": 2.0}, "two": {"rms": 9.0, "raised": "outer"}}
    learned = {"rms_baseline": 1.0, "absolute_level": "yes"}
    channels = [{name: {**said, **learned, **levels[name]} for name, said in r.channels.items()} for r in records]
    records = [replace(record, channels=values) for record, values in zip(records, channels, strict=True)]
    run = run_of(tmp_path, records, "one: drive; two: free")
    drive, free = bearing_parts(run)
    assert (drive.grade, drive.part) == ("open", "no part named; its level rises with the damage of free")
    assert (free.grade, free.part) == ("watch", "outer race")
    build_report(tmp_path, tmp_path / "report.html", options=Options(sections=frozenset()))
    text = " ".join(Page((tmp_path / "report.html").read_text(encoding="utf-8")).text.split())
    assert "No part of its own named; its level rises with the damage of free" in text
    assert "Not known: its level rises with the damage of free." in text

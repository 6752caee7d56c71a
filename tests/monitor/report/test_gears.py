"""What a report says of the wheels of gears, and that it says nothing of machines without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from monitor.health.gears.naming import MIN_LEARNED
from monitor.health.record import Record
from monitor.records.store import Store
from monitor.report.readings import gear_findings, gears_table
from monitor.report.runs import Run, read_runs
from monitor.report.statements import said_of
from monitor.report.verdict import judge
from tests.support.stage import FIRST_BAD, life


def run_of(tmp_path: Path, records: tuple[Record, ...], names: str = "pinion, wheel") -> Run:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.describe({"gears": names})
        store.commit_many([(record, {}) for record in records])
    (run,) = read_runs(tmp_path / "state.db")
    return run


def test_the_named_wheel_and_its_indicators_are_said(tmp_path: Path) -> None:
    records = life()[1]
    run = run_of(tmp_path, records)
    (finding,) = gear_findings(run, run.channels["one"])
    assert (finding.answer, finding.known) == ("Gear wheel (a damaged tooth).", True)
    assert f"Named since block {FIRST_BAD + 2}" in finding.support
    table = gears_table(run)
    assert table is not None
    assert [row[:3] for row in table.rows] == [
        ("one", name, len(records) - MIN_LEARNED) for name in ("pinion", "wheel")
    ]
    last = records[-1].channels["one"]
    assert [row[6] for row in table.rows] == pytest.approx(last["fm4"])
    assert [row[7] for row in table.rows] == pytest.approx(last["na4"])


def test_before_the_damage_no_wheel_is_named_and_before_the_baseline_none_is_judged(tmp_path: Path) -> None:
    records = life()[1]
    run = run_of(tmp_path, records[: FIRST_BAD - 1], "pinion, other, more")
    (finding,) = gear_findings(run, run.channels["one"])
    assert finding.answer == "No gear named."
    table = gears_table(run)
    assert table is not None
    assert [row[1] for row in table.rows] == ["no. 1", "no. 2"]


def test_a_report_of_a_learning_machine_says_why(tmp_path: Path) -> None:
    run = run_of(tmp_path, life()[1][:3])
    (finding,) = gear_findings(run, run.channels["one"])
    assert (finding.answer, finding.known) == ("Not judged yet.", False)


def test_without_gears_nothing_is_said(tmp_path: Path) -> None:
    record = life()[1][0]
    values = {name: value for name, value in record.channels["one"].items() if name in ("rms", "stage")}
    run = run_of(tmp_path, (replace(record, channels={"one": values}),))
    assert gear_findings(run, run.channels["one"]) == ()
    assert gears_table(run) is None


def test_a_named_wheel_is_in_the_headline_and_in_what_to_do(tmp_path: Path) -> None:
    run = run_of(tmp_path, life()[1])
    verdict = judge(run, run.channels["one"])
    assert (verdict.grade, verdict.headline) == (
        "watch",
        "No sign of damage of the bearing; damage of gear wheel (a damaged tooth)",
    )
    said = said_of(run, run.channels["one"], None)
    assert said is not None
    assert said.key == "gear"
    assert said.action.startswith("inspect gear wheel")
    (tmp_path / "before").mkdir()
    healthy = run_of(tmp_path / "before", life()[1][: FIRST_BAD - 1])
    assert judge(healthy, healthy.channels["one"]).headline == "No sign of damage"

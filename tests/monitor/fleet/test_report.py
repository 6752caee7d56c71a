"""The page of a fleet: the worst first, what is not known withheld, and many recordings."""

from __future__ import annotations

from datetime import UTC
from zoneinfo import ZoneInfo

import pytest

from monitor.fleet.report import (
    FleetChannel,
    FleetEntry,
    FleetGrade,
    FleetTotals,
    channels_of,
    fleet_html,
    grade_of_channel,
    period_of,
    quality_of,
    shown_channels,
)
from monitor.words.situation import Situation


def channel(stage: str, **more):
    return {"stage": stage, "fault": None, "headline": f"stage {stage}", **more}


def entry(machine: str, name: str, grade: FleetGrade = "good", **more) -> FleetEntry:
    shown = () if grade == "failed" else (FleetChannel("de", grade, f"said of {name}"),)
    return FleetEntry(machine, name, f"s3://fleet/{name}", grade, shown, accepted=5, offered=6, **more)


@pytest.mark.parametrize(
    ("situation", "grade"),
    [
        (Situation(stage="end_of_life"), "bad"),
        (Situation(stage="final"), "watch"),
        (Situation(stage="final", fault="outer"), "watch"),
        (Situation(stage="final", level_of="fan"), "open"),
        (Situation(stage="final", level_of="fan", fault="outer"), "watch"),
        (Situation(stage="healthy", gear="gear:pinion"), "watch"),
        (Situation(stage="healthy"), "good"),
        (Situation(stage="healthy", fault="outer", basis="hint"), "open"),
        (Situation(stage="learning"), "open"),
        (Situation(stage=""), "open"),
    ],
)
def test_grades_of_channels(situation, grade):
    assert grade_of_channel(situation) == grade


def test_channels_with_damage_are_listed_and_else_the_worst():
    found = channels_of(
        {"channels": {"a": channel("healthy"), "b": channel("final"), "c": channel("end_of_life")}}, UTC
    )
    assert [one.name for one in shown_channels(found)] == ["c", "b"]
    found = channels_of({"channels": {"a": channel("healthy"), "b": channel("learning")}}, UTC)
    assert [one.name for one in shown_channels(found)] == ["b"]
    assert shown_channels(channels_of({}, UTC)) == ()


def test_values_in_words():
    values = {"t_fs_utc": "2024-03-05T10:00:00+00:00", "t_fs_block": 7, "calibrated": True, "fault": "outer"}
    volume = {"v_eq_mm2": 0.034, "v_eq_lower_mm2": 0.02, "v_eq_upper_mm2": 0.05, "edv_status": "ok"}
    times = {"tt_s": 7200.0, "tt_lower_s": 3600.0, "tt_upper_s": None, "tt_status": "ok"}
    rome = ZoneInfo("Europe/Rome")
    (found,) = channels_of({"channels": {"a": channel("final", **values, **volume, **times)}}, rome)
    assert (found.part, found.since, found.headline) == ("outer race", "2024-03-05 11:00", "Stage final")
    assert (found.v_eq, found.tt) == ("0.034 mm³/mm (0.02 to 0.05)", "2 h (from 60 min)")
    (found,) = channels_of({"channels": {"a": channel("final", t_fs_block=7, fault="ball", fault_basis="hint")}}, UTC)
    assert (found.part, found.since) == ("rolling element (a hint)", "block 7")


@pytest.mark.parametrize(
    ("values", "v_eq", "tt"),
    [
        ({"calibrated": False, "v_eq_mm2": 0.03, "edv_status": "ok", "tt_s": 9.0, "tt_status": "ok"}, "–", "–"),
        (
            {"calibrated": False, "v_eq_mm2": 0.03, "v_eq_relative": 1.5, "edv_status": "ok"},
            "1.5 times the first tracked value",
            "–",
        ),
        (
            {"calibrated": True, "v_eq_mm2": None, "edv_status": "no_map", "tt_s": None, "tt_status": "concave"},
            "–",
            "–",
        ),
        ({"calibrated": True, "tt_s": 9.0, "tt_status": "cannot_tell"}, "–", "–"),
        ({"calibrated": True, "tt_status": "already_crossed"}, "–", "threshold reached"),
        ({"calibrated": False, "tt_status": "already_crossed"}, "–", "–"),
    ],
)
def test_what_is_not_supported_is_withheld(values, v_eq, tt):
    (found,) = channels_of({"channels": {"a": channel("final", **values)}}, UTC)
    assert (found.v_eq, found.tt) == (v_eq, tt)
    if "no_map" in values.values():
        assert found.v_eq_why.startswith("there is no RMS map")
        assert found.tt_why.startswith("the fitted trend flattens out")


def test_quality_and_period_in_words():
    assert quality_of({"rejected": {"nan": 2, "short": 1}, "flagged": {"gap": 3}, "pending": 4}) == (
        "3 rejected (2 nan, 1 short), 3 flagged (gap), 4 pending"
    )
    assert quality_of({"rejected": {}, "flagged": {}, "pending": 0}) == ""
    assert period_of(0.0, 3600.0, 5, UTC) == "1970-01-01 00:00 to 01:00"
    assert period_of(0.0, 5.0, 5, UTC) == "1970-01-01 00:00"
    assert period_of(0.0, 90000.0, 5, UTC) == "1970-01-01 00:00 to 1970-01-02 01:00"
    assert period_of(None, None, 5, UTC) == "5 blocks without dates"
    assert period_of(None, None, 0, UTC) == "–"


def test_machines_and_recordings_are_in_order_the_worst_first():
    entries = [
        entry("a", "1"),
        entry("b", "1", "failed", reason="torn"),
        entry("b", "2"),
        entry("c", "1", "watch"),
        entry("c", "2", "good"),
        entry("c", "3", "watch"),
        entry("d", "1", "watch"),
        entry("e", "1", "bad"),
        entry("f", "1", "open"),
    ]
    fleet = FleetTotals.of(iter(entries))
    assert [machine.name for machine in fleet.ordered] == ["e", "c", "d", "b", "f", "a"]
    damaged = fleet.ordered[1]
    assert [one.recording for one in damaged.listed] == ["3", "1", "2"]
    assert damaged.worst is not None
    assert damaged.worst.recording == "3"
    assert damaged.strip == ["watch", "good", "watch"]
    assert damaged.strip_words == "Recordings in order: 2 damage, 1 no sign of damage"
    assert (fleet.total, fleet.failed, fleet.blocks) == (9, 1, 54)
    assert fleet.by_grade == [("bad", 1), ("watch", 3), ("failed", 1), ("open", 1), ("good", 3)]


def test_of_very_many_the_worst_are_listed_and_all_are_counted(monkeypatch):
    monkeypatch.setattr("monitor.fleet.report.MAX_LISTED", 4)
    monkeypatch.setattr("monitor.fleet.report.MAX_FAILURES", 1)
    grades: dict[int, FleetGrade] = {3: "watch", 9: "bad", 20: "failed", 30: "failed"}
    fleet = FleetTotals.of(entry(f"m{i % 3}", str(i), grades.get(i, "good")) for i in range(40))
    assert fleet.total == sum(machine.total for machine in fleet.machines.values()) == 40
    listed = sorted((one for machine in fleet.machines.values() for one in machine.listed), key=lambda one: one.rank)
    assert [one.recording for one in listed[:2]] == ["9", "3"]
    assert {one.recording for one in listed[2:]} == {"20", "30"}
    assert (fleet.failed, len(fleet.failures)) == (2, 1)


def test_the_page_names_what_failed_and_escapes_what_it_is_given():
    html = fleet_html(
        [
            entry("press", "one", "watch", quality="2 rejected (nan)", period="a to b"),
            entry("press", "two", "failed", reason="two.csv: <b>torn</b>", log="Traceback <i>"),
            FleetEntry("fan", "three", "three.csv", "open", offered=2),
        ],
        title="Fleet <1>",
        zone=UTC,
    )
    assert "<title>Fleet &lt;1&gt;</title>" in html
    assert "two.csv: &lt;b&gt;torn&lt;/b&gt;" in html
    assert "<pre>Traceback &lt;i&gt;</pre>" in html
    assert "No channel has a value." in html
    assert "3 recordings of 2 machines, 18 blocks" not in html
    assert "3 recordings of 2 machines, 14 blocks" in html
    assert "are listed; the numbers are those of all" not in html
    assert html.index("<strong>press</strong>") < html.index("<strong>fan</strong>")
    assert "learns its baseline from its own first blocks" in html
    assert "<script" not in html
    assert "Content-Security-Policy" in html


def test_a_page_says_where_it_leaves_recordings_out(monkeypatch):
    monkeypatch.setattr("monitor.fleet.report.MAX_LISTED", 1)
    html = fleet_html([entry("a", "1"), entry("a", "2", "watch")], title="Fleet", zone=UTC)
    assert "The worst 1 recordings are listed" in html
    assert "said of 1" not in html


def test_an_empty_fleet_has_a_page():
    assert "0 recordings of 0 machines" in fleet_html([], title="Fleet", zone=UTC)

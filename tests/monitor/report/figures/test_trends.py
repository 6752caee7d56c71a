"""Trends and final stages, with their alarms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from monitor.health.record import Record
from monitor.report.figures.trends import final_stage, trends
from monitor.report.findings import findings
from monitor.report.runs import Channel, Run
from tests.monitor.report.figures.drawing import START, context_of, drawn, run_of
from tests.oracles.lives import GRAVITY, life


def test_trends_carry_what_they_draw(run: Run, channel: Channel) -> None:
    data = drawn(trends(context_of(run, channel)))
    known = {record.sequence: record.channels.get("horizontal", {}) for record in life(start=START)}
    rms = {record.sequence: record.channels["horizontal"]["rms"] for record in life(start=START) if record.channels}
    drawn_rms = {at: value for at, value in zip(data["time_s"], data["rms_g"], strict=True) if value is not None}
    expected = {record.time: rms[record.sequence] / GRAVITY for record in life(start=START) if record.channels}
    assert drawn_rms == pytest.approx(expected, rel=1e-5)
    learned = [rms[number] for number in sorted(rms) if known[number]["stage"] == "learning"]
    assert data["rms_learned_g"] == pytest.approx(np.median(learned) / GRAVITY, rel=1e-5)
    assert data["t_fs_s"] == pytest.approx(known[500]["t_fs"])
    assert data["score_threshold"] == 4.4
    assert data["alarms_s"] == []


def test_a_final_stage_that_is_most_of_the_life_gets_no_figure_of_its_own(run: Run, channel: Channel) -> None:
    assert final_stage(context_of(run, channel)) is not None
    assert final_stage(context_of(run, run.channels["vertical"])) is None


def test_a_final_stage_is_shown_from_a_little_before_t_fs(run: Run, channel: Channel) -> None:
    context = context_of(run, channel)
    verdict, data = context.verdict, drawn(final_stage(context))
    assert verdict.t_fs is not None
    left = channel.time[-1] - verdict.t_fs.time
    time = data["time_s"] if "time_s" in data else data["rms_g"]["time_s"]
    assert verdict.t_fs.time - 0.16 * left <= time[0] < verdict.t_fs.time
    assert time[-1] == pytest.approx(channel.time[-1])


def test_alarms_stand_where_they_were_raised(tmp_path: Path) -> None:
    made = life(120, start=START, onset=100, learn=50)
    raised = {"kind": "alarm_raised", "channel": "horizontal", "block": 80, "severity": "danger", "feature": "rms"}
    made[79] = Record(**{**made[79].__dict__, "events": (raised,)})
    found = run_of(tmp_path, made)
    picture = trends(context_of(found, found.channels["horizontal"]))
    assert drawn(picture)["alarms_s"] == [pytest.approx(made[79].time)]
    assert picture is not None
    assert "danger raised (1)" in picture.svg


def life_that_recovers() -> list[Record]:
    """Records of a final stage that begins at block 100 and closes with block 150, and of a healthy machine since."""
    begun, never = life(220, start=START, onset=100, learn=50), life(220, start=START, onset=219, learn=50)
    return [*begun[:149], *never[149:]]


def test_a_final_stage_that_closed_again_is_shaded_and_said(tmp_path: Path) -> None:
    found = run_of(tmp_path, life_that_recovers())
    context = context_of(found, found.channels["horizontal"])
    verdict = context.verdict
    assert (verdict.stage, verdict.t_fs, verdict.t_fs_known) == ("healthy", None, None)
    assert [[mark.block for mark in marks] for marks in verdict.closed] == [[100, 149]]
    picture = trends(context)
    assert picture is not None
    assert "final stage that closed again (1)" in picture.svg
    assert final_stage(context) is None
    since = next(finding for finding in findings(context) if finding.question == "Since when?")
    assert since.support == "No final stage is open; 1 earlier one closed again."
    assert context_of(found, found.channels["vertical"]).verdict.closed == ()

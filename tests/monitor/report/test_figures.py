from __future__ import annotations

import base64
import itertools
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from monitor.health.record import Record, plain
from monitor.health.spectrum.kurtogram import Kurtogram
from monitor.health.waterfall import SpectrumRow
from monitor.records.store import Store
from monitor.report.data_quality import gaps, gaps_of, offered, statuses, timeline
from monitor.report.figures.damage import damaged_volume, fitted_law, forecasts
from monitor.report.figures.drawing import (
    Picture,
    log_ticks,
    new_figure,
    sparkline,
    thin,
    time_axis,
    to_svg,
    with_breaks,
)
from monitor.report.figures.kurtogram import kurtograms
from monitor.report.figures.spectrum import SpectrumView, spectra, views_of, waterfall
from monitor.report.figures.trends import final_stage, trends
from monitor.report.runs import Channel, Run, read_runs
from monitor.report.score.scoring import ALPHA
from monitor.report.verdict import ChannelContext, findings, judge
from monitor.words.numbers import Clock, figure, time_zone
from tests.effort import effort_count
from tests.oracles.lives import GRAVITY, INTERVAL, life

START = 1_700_000_000.0
CLOCK = Clock(True)


def run_of(tmp_path: Path, made: list[Record], **attributes: Any) -> Run:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.describe(attributes)
        store.commit_many([(record, {}) for record in made])
        (run,) = read_runs(store)
    return run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run_of(tmp_path_factory.mktemp("life"), life(start=START), calibrated="yes")


@pytest.fixture(scope="module")
def channel(run: Run) -> Channel:
    return run.channels["horizontal"]


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


def context_of(run: Run, channel: Channel, clock: Clock = CLOCK) -> ChannelContext:
    return ChannelContext(run, channel, judge(run, channel), clock, numbers())


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


def comb(lines: dict[float, float], resolution: float = 0.5, top: float = 900.0) -> tuple[Any, Any]:
    frequency = np.arange(0.0, top, resolution)
    amplitude = np.full(frequency.size, 0.01)
    for at, height in lines.items():
        amplitude[round(at / resolution)] = height
    return frequency, amplitude


KINEMATIC = {"outer": 97.5, "inner": 142.0, "ball": 94.0, "cage": 8.0}


def test_markers_of_a_spectrum_stand_on_its_lines() -> None:
    found = [98.5 * order for order in range(1, 6)]
    frequency, amplitude = comb(dict.fromkeys(found, 1.0))
    data = drawn(spectra([SpectrumView(frequency, amplitude, KINEMATIC, "block 7", 30.0)], "x", "outer", numbers()))
    assert data["spectra"][0]["lines_hz"]["outer"] == pytest.approx(found)
    assert max(data["spectra"][0]["amplitude_g"]) == 1.0


@pytest.mark.parametrize(
    ("fault", "label"), [("inner", "its sidebands, ±30.0 Hz"), ("ball", "its sidebands, ±8.0 Hz"), ("outer", None)]
)
def test_sidebands_are_those_of_the_part_that_turns(fault: str, label: str | None) -> None:
    frequency, amplitude = comb({142.0: 1.0, 112.0: 0.5, 172.0: 0.5, 94.0: 1.0, 86.0: 0.4, 102.0: 0.4})
    picture = spectra([SpectrumView(frequency, amplitude, KINEMATIC, "", 30.0)], "x", fault, numbers())
    assert picture is not None
    assert ("its sidebands" in picture.svg) is (label is not None)
    assert label is None or label in picture.svg


@pytest.mark.parametrize(
    ("grown", "scale"), [(5.0, "Both have the same scale."), (500.0, "Each has a scale of its own.")]
)
def test_before_and_after_say_how_far_a_line_grew(grown: float, scale: str) -> None:
    views = [SpectrumView(*comb({97.5: height}), KINEMATIC, "") for height in (0.1, 0.1 * grown)]
    picture = spectra(views, "x", "outer", numbers())
    drawn(picture)
    assert picture is not None
    assert f"grows from 0.100 to {figure(0.1 * grown)} g. {scale}" in picture.caption


def row_of(sequence: int, time: float | None, height: float = 1.0, bins: int = 900) -> SpectrumRow:
    amplitude = np.full(bins, 0.01)
    amplitude[97] = height
    return SpectrumRow("s", "horizontal", sequence, time, 1.0, (5e3, 9e3), 30.0, 1.0, True, amplitude, KINEMATIC)


def test_the_spectra_shown_are_one_before_and_one_after_the_onset(run: Run, channel: Channel) -> None:
    rows = [row_of(number, START + number) for number in range(10, 601, 10)]
    verdict = judge(run, channel)
    before, after = views_of(rows, context_of(run, channel))
    assert verdict.t_fs is not None
    assert verdict.t_fs.block is not None
    assert 100 < int(re.findall(r"block (\d+)", before.label)[0]) < verdict.t_fs.block
    assert after.label.startswith("block 600,")
    assert before.amplitude_g.max() == pytest.approx(1.0 / GRAVITY)
    (latest,) = views_of(rows, context_of(run, run.channels["vertical"]))
    assert latest.label.startswith("block 600,")
    assert views_of([], context_of(run, channel)) == []


def test_a_kurtogram_is_drawn_before_the_onset_and_now(run: Run, channel: Channel) -> None:
    flat, bright = ((0.0,), (0.0, 0.1), (0.0, 0.0, 0.1)), ((0.5,), (0.0, 9.0), (0.0, 1.0, 2.0))
    rows = [
        replace(row_of(number, START + number), kurtogram=Kurtogram(12_800.0, 12_800, levels))
        for number, levels in ((10, flat), (20, flat), (590, bright), (600, bright))
    ]
    picture = kurtograms([*rows, row_of(601, START + 601.0)], context_of(run, channel))
    before, now = drawn(picture)["kurtograms"]
    assert picture is not None
    assert (before["block"], before["best_hz"]) == (20, None)
    assert (now["block"], now["best_hz"]) == (600, [6400.0, 12800.0])
    assert (now["demodulated_hz"], now["kurtosis"][1]) == ([5e3, 9e3], [0.0, 9.0])
    assert "the highest, 9.0, stands at 6,400 to 12,800 Hz" in picture.caption
    assert "demodulated band" in picture.svg
    assert "highest kurtosis" in picture.svg
    (quiet,) = drawn(kurtograms(rows[:1], context_of(run, channel)))["kurtograms"]
    assert quiet["best_hz"] is None
    assert kurtograms([row_of(1, START)], context_of(run, channel)) is None


def test_a_waterfall_leaves_gaps_blank_and_carries_its_spectra(run: Run, channel: Channel) -> None:
    times = [START + 60.0 * place + (6000.0 if place > 20 else 0.0) for place in range(40)]
    rows = [row_of(number, time, 1.0 + number) for number, time in enumerate(times, start=1)]
    picture = waterfall(rows, context_of(run, channel))
    data = drawn(picture)
    assert picture is not None
    assert "data:image/png;base64," in picture.svg
    assert data["time_s"] == pytest.approx(times)
    codes = np.frombuffer(base64.b64decode(data["codes_base64"]), np.uint8).reshape(40, len(data["frequency_hz"]))
    low, high = data["low"], data["high"]
    amplitude = low * (high / low) ** ((codes.astype(float) - 1) / 254)
    place = int(np.searchsorted(data["frequency_hz"], 97.0, side="right")) - 1
    expected = [(1.0 + number) / GRAVITY for number in range(1, 41)]
    assert amplitude[:, place] == pytest.approx(expected, rel=0.03)
    assert waterfall(rows[:3], context_of(run, channel)) is None
    undated = [row_of(number, None) for number in range(1, 9)]
    assert waterfall(undated, context_of(run, channel)) is None


def test_volumes_are_drawn_as_recorded_with_the_truth(run: Run, channel: Channel) -> None:
    picture = damaged_volume(context_of(run, channel))
    data = drawn(picture)
    known = [value for value in data["v_eq_mm2"] if value is not None]
    recorded = channel.column("v_eq")
    assert known == pytest.approx((1e6 * recorded[np.isfinite(recorded)]).tolist(), rel=1e-5)
    assert data["thresholds_mm2"] == pytest.approx([0.05])
    assert "v_eq_lower_mm2" not in data
    assert picture is not None
    assert "The threshold of 0.05 mm³/mm is reached." in picture.caption
    assert "not calibrated" not in picture.caption


def test_volumes_of_an_uncalibrated_rig_are_drawn_relative_without_thresholds(tmp_path: Path) -> None:
    made = run_of(tmp_path, life(start=START), calibrated="no")
    channel = made.channels["horizontal"]
    picture = damaged_volume(context_of(made, channel))
    data = drawn(picture)
    recorded = channel.column("v_eq")
    recorded = recorded[np.isfinite(recorded)]
    known = [value for value in data["v_eq_relative"] if value is not None]
    assert known == pytest.approx((recorded / recorded[0]).tolist(), rel=1e-5)
    assert data["thresholds_mm2"] == []
    assert {"v_eq_mm2", "v_eq_true_mm2"}.isdisjoint(data)
    assert picture is not None
    assert "threshold" not in picture.caption
    assert "On the scale of a model that is not calibrated." in picture.caption


def test_the_cone_counts_what_lies_in_it(run: Run, channel: Channel) -> None:
    (picture,) = forecasts(context_of(run, channel))
    data = drawn(picture)
    pairs = [
        (found, true)
        for found, true in zip(data["tt_s"], data["truth_s"], strict=True)
        if found is not None and true is not None and true > 0
    ]
    inside = sum(abs(found - true) <= ALPHA * true for found, true in pairs)
    assert f"{inside / len(pairs):.0%} of {len(pairs)} lie within 20 % of the truth" in picture.caption
    assert data["truth"] == "true"


def test_without_a_truth_the_tracked_crossing_is_the_reference(tmp_path: Path) -> None:
    made = []
    for record in life():
        channels = {
            name: {key: value for key, value in values.items() if not key.endswith("_true")}
            for name, values in record.channels.items()
        }
        made.append(Record(**{**record.__dict__, "channels": channels}))
    found = run_of(tmp_path, made)
    channel = found.channels["horizontal"]
    (picture,) = forecasts(context_of(found, channel))
    data = drawn(picture)
    assert data["truth"] == "tracked"
    crossed = channel.time[np.flatnonzero(channel.column("v_eq") >= 5e-8)[0]]
    issued = [item for item in zip(data["time_s"], data["tt_s"], data["truth_s"], strict=True) if None not in item]
    assert len(issued) > 100
    for time, _, left in issued:
        assert left == pytest.approx(crossed - time, abs=1.0)
    assert "judges a forecast by its own values" in picture.caption


def test_each_of_two_thresholds_has_a_figure_where_no_interval_is_recorded(tmp_path: Path) -> None:
    made = []
    for record in life(200, onset=100, learn=40):
        values = dict(record.channels.get("horizontal", {}))
        if values.get("v_eq") is not None:
            values = {key: value for key, value in values.items() if not key.startswith(("tt_", "p_threshold"))}
            values |= {"v_th": (5e-8, 9e-8), "tt": (1e4, 3e4), "tt_status": ("ok", "ok")}
        changed = {"horizontal": plain(values)} if values else {}
        made.append(Record(**{**record.__dict__, "channels": {**record.channels, **changed}}))
    found = run_of(tmp_path, made)
    pictures = forecasts(context_of(found, found.channels["horizontal"], Clock(False)))
    assert [picture.heading for picture in pictures] == [
        "Time to the threshold of 0.05 mm³/mm",
        "Time to the threshold of 0.09 mm³/mm",
    ]
    for picture, tt in zip(pictures, (1e4, 3e4), strict=True):
        data = drawn(picture)
        assert set(data["tt_s"]) == {None, tt}
        assert "tt_lower_s" not in data


def test_the_law_is_drawn_with_its_recorded_coefficients(tmp_path: Path) -> None:
    made = []
    for record in life(200, onset=100, learn=40):
        values = dict(record.channels.get("horizontal", {}))
        if values.get("v_eq") is not None:
            tau = INTERVAL * (record.sequence - 100)
            values |= {"tt_coefficients": (1e-17, 1e-13 + 1e-18 * record.sequence, 1e-9), "r_squared": 0.987, "tt": tau}
        changed = {"horizontal": plain(values)} if values else {}
        made.append(Record(**{**record.__dict__, "channels": {**record.channels, **changed}}))
    found = run_of(tmp_path, made)
    channel = found.channels["horizontal"]
    picture = fitted_law(context_of(found, channel, Clock(False)))
    data = drawn(picture)
    assert len(data["laws"]) == 4
    assert data["laws"][-1]["coefficients_si"] == pytest.approx([1e-17, 1e-13 + 200e-18, 1e-9], rel=1e-5)
    assert data["laws"][-1]["block"] == 200
    assert picture is not None
    assert "R² of the last is 0.987." in picture.caption


def test_the_ledger_and_the_gaps_add_up(run: Run) -> None:
    table = statuses(run)
    assert sum(int(row[1] or 0) for row in table.rows) == 600
    assert offered(run, 4) == "604 blocks offered = 594 accepted + 6 rejected + 4 pending."
    (gap,) = gaps_of(run)
    assert gap[2] == pytest.approx(7200.0 + INTERVAL)
    found = gaps(run, CLOCK)
    assert found is not None
    assert found.cells[0][2] == "2 h 1 min"
    data = drawn(timeline(run, CLOCK, numbers()))
    assert (data["accepted"], data["flagged"], data["rejected"]) == (591, 3, 6)
    assert data["speed"] == {"horizontal": [30.0, 30.0, 30.0]}


def test_moments_are_written_in_the_zone_that_was_asked() -> None:
    rome = Clock(True, time_zone("Europe/Rome"))
    assert rome.moment(START) == "2023-11-14 23:13:20 CET"
    assert rome.moment(START + 200 * 86400.0).endswith("CEST")
    assert Clock(True).moment(START) == "2023-11-14 22:13:20 UTC"
    assert Clock(False).moment(5400.0) == "1 h 30 min after the first block"
    assert Clock(True).short(math.nan) == "–"
    with pytest.raises(ValueError, match="expected UTC or a name"):
        time_zone("Mars/Olympus")


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
@settings(max_examples=effort_count(quick=20, full=2000))
def test_numbers_keep_three_figures(value: float) -> None:
    said = figure(value).replace("−", "-").replace(",", "")
    assert float(said) == pytest.approx(value, rel=5.1e-3)
    assert figure(math.nan) == "–"


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), max_size=300))
@settings(max_examples=effort_count(quick=20, full=500))
def test_sparklines_stay_in_their_box(values: list[float]) -> None:
    y = np.array(values, dtype=np.float64)
    svg = str(sparkline(np.arange(y.size, dtype=np.float64), y, 'RMS of "<b>"'))
    assert "<b>" not in svg
    for x, down in re.findall(r"([-\d.]+),([-\d.]+)", svg):
        assert 0.0 <= float(x) <= 120.0
        assert 0.0 <= float(down) <= 26.0


@pytest.mark.parametrize(
    "hours", [0.01, 1.0, 30.0, 100.0, 110.0, 24.0 * 40, 24.0 * 170, 24.0 * 365 * 4.8, 24.0 * 365 * 40]
)
def test_spans_of_any_length_get_a_date_axis(hours: float) -> None:
    time = START + np.linspace(0.0, 3600.0 * hours, 50)
    axis = time_axis(time, CLOCK)
    made, (axes,) = new_figure(2.0)
    axes.plot(axis.position(time), time)
    axis.settle(axes, time[0], time[-1])
    assert 3 <= len(axes.get_xticks()) <= 10
    assert "<svg" in to_svg(made, "dates", numbers())


@given(st.lists(st.none() | st.floats(-1e6, 1e6), min_size=2, max_size=400), st.integers(4, 30))
@settings(max_examples=effort_count(quick=24, full=60))
def test_thinning_keeps_the_extremes_and_the_breaks(values: list[float | None], bins: int) -> None:
    y = np.array(values, dtype=float)
    x = np.arange(y.size, dtype=float)
    kept_x, kept_y = thin(x, y, bins)
    assert kept_x.size <= max(3 * bins, 2 * bins)
    assert np.all(np.diff(kept_x) > 0)
    np.testing.assert_array_equal(kept_y, y[kept_x.astype(int)])
    assert np.isnan(kept_y).any() == np.isnan(y).any()
    if np.isfinite(y).any():
        assert np.nanmin(kept_y) == np.nanmin(y)
        assert np.nanmax(kept_y) == np.nanmax(y)


def test_gaps_break_the_line() -> None:
    time = np.array([0.0, 1.0, 2.0, 9.0, 10.0, 11.0])
    x, y = with_breaks(time, np.ones(6))
    assert x.tolist() == [0.0, 1.0, 2.0, 5.5, 9.0, 10.0, 11.0]
    assert np.flatnonzero(np.isnan(y)).tolist() == [3]


@pytest.mark.parametrize(("decades", "ticks"), [(1.0, 4), (4.0, 5)])
def test_ticks_of_a_logarithmic_axis_do_not_crowd(decades: float, ticks: int) -> None:
    axes = Figure().subplots()
    axes.set(xscale="log", xlim=(1.0, 10.0**decades))
    log_ticks(axes.xaxis, 7, decades=decades)
    assert len([value for value in axes.get_xticks() if 1.0 <= value <= 10.0**decades]) == ticks

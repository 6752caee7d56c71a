"""V_eq, forecasts and laws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from monitor.health.record import Record, plain
from monitor.report.figures.damage import damaged_volume, fitted_law, forecasts
from monitor.report.runs import Channel, Run
from monitor.report.score.scoring import ALPHA
from monitor.words.numbers import Clock
from tests.monitor.report.figures.drawing import START, context_of, drawn, run_of
from tests.oracles.lives import INTERVAL, life


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

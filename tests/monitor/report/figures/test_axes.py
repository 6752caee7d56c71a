"""Axes, thinned lines, sparklines, numbers and moments; data quality."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from monitor.report.data_quality import gaps, gaps_of, offered, statuses, timeline
from monitor.report.figures.drawing import (
    log_ticks,
    new_figure,
    sparkline,
    thin,
    time_axis,
    to_svg,
    with_breaks,
)
from monitor.report.runs import Run
from monitor.words.numbers import Clock, figure, time_zone
from tests.monitor.report.figures.drawing import CLOCK, START, drawn, numbers
from tests.oracles.lives import INTERVAL
from tests.support.effort import effort_count


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

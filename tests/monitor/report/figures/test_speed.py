"""The section on the speed of the shaft."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from monitor.health.signal.spectra import BlockView, RawSpectra
from monitor.health.signal.waterfall import SpectrumRow
from monitor.report.comparison import speeds
from monitor.report.figures.rotation import ias_picture
from monitor.report.figures.speed import rotation_table, speed_picture, speed_words
from monitor.report.runs import Channel, Run
from monitor.report.summary import speeds_of
from monitor.words.statuses import ROTATION_REFUSALS
from tests.monitor.report.figures.drawing import context_of, drawn, numbers


def varying(run: Run, channel: Channel, refused: int = 5) -> Run:
    """Return a run whose speed varies by 4 Hz in each block; the angle of the last blocks was not found."""
    rows = channel.time.size
    status = np.full((rows, 1), "ok", dtype=object)
    status[rows - refused :] = "irregular"
    domain = np.where(status == "ok", "order", "hertz").astype(object)
    mean = np.linspace(20.0, 30.0, rows)[:, None]
    known = np.where(status == "ok", 1.0, np.nan)
    changed = {"speed": mean, "speed_min": (mean - 2.0) * known, "speed_max": (mean + 2.0) * known}
    words = {**channel.words, "rotation_status": status, "domain": domain}
    channels = {
        name: replace(channel, name=name, numbers={**channel.numbers, **changed}, words=words) for name in ("x", "y")
    }
    return replace(run, channels=channels)


def test_equal_speeds_are_drawn_once_with_their_ranges(run: Run, channel: Channel) -> None:
    found = varying(run, channel)
    picture = speed_picture(found, context_of(run, channel).clock, numbers())
    data = drawn(picture)
    assert picture is not None
    assert list(data) == ["x, y"]
    assert min(value for value in data["x, y"]["speed_min_hz"] if value is not None) == 18.0
    assert "no angle (5)" in picture.svg
    share = f"{(channel.time.size - 5) / channel.time.size:.0%}"
    assert f"x, y: spectra in orders of the shaft in {share} of" in picture.caption
    assert picture.zoom["panels"][0]["bands"]


def test_runs_are_compared_by_their_speeds(run: Run, channel: Channel) -> None:
    found = speeds_of(varying(run, channel).channels["x"])
    rows = channel.time.size
    assert found == {"least": 18.0, "highest": pytest.approx(32.0, abs=0.5), "orders": 1.0 - 5 / rows, "refused": 5}
    channels = (SimpleNamespace(name="x", speeds=values) for values in (found, {}))
    summaries: list[Any] = [SimpleNamespace(label="m", channels=(one,)) for one in channels]
    table = speeds(summaries)
    assert table is not None
    assert [row[:2] for row in table.rows] == [("m", "x")]
    assert speeds(summaries[1:]) is None


def test_blocks_without_an_angle_are_counted_with_the_reason(run: Run, channel: Channel) -> None:
    table = rotation_table(varying(run, channel))
    assert table is not None
    by_status = {row[1]: row for row in table.rows}
    assert by_status["irregular"][2:4] == (5, f"{ROTATION_REFUSALS['irregular']}; spectra in Hz")
    assert by_status["ok"][2] == channel.time.size - 5


def test_a_machine_without_a_source_of_an_angle_has_no_section(run: Run, channel: Channel) -> None:
    assert speed_words(run) == []
    assert rotation_table(run) is None
    assert speed_picture(run, context_of(run, channel).clock, numbers()) is None


def test_a_run_whose_angle_was_never_found_has_words_alone(run: Run, channel: Channel) -> None:
    found = varying(run, channel, refused=channel.time.size)
    assert speed_picture(found, context_of(run, channel).clock, numbers()) is None
    (sentence,) = speed_words(found)
    assert sentence.startswith("x, y: spectra in orders of the shaft in 0% of")


def test_the_spectrum_of_the_angular_speed_has_the_lines_of_the_part(run: Run, channel: Channel) -> None:
    raw = RawSpectra(1.0, np.ones(4), 4.0, np.ones(4))
    amplitude = np.full(2000, 1e-4)
    amplitude[round(3.0 / 0.02)] = 0.05
    ias = RawSpectra(0.02, amplitude, 0.1, np.ones(40))
    lines = {"outer": 75.0, "inner": 125.0}
    row = SpectrumRow("s", channel.name, 9, 0.0, 1.0, (0.0, 1.0), 25.0, 1.0, True, np.ones(4), lines)
    shown = replace(row, view=BlockView(1000.0, 64, raw, np.ones(4), ias))
    picture = ias_picture(context_of(run, channel, ias=[row, shown]))
    data = drawn(picture)
    assert picture is not None
    assert "BPFO 3" in picture.svg
    (found,) = data.values()
    assert found["order"][int(np.argmax(found["amplitude_rad_s"]))] == pytest.approx(3.0, abs=0.02)
    assert ias_picture(context_of(run, channel, ias=[row])) is None

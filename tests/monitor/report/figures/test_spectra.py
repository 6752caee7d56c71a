"""Spectra, kurtograms and waterfalls."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from monitor.health.signal.kurtogram import Kurtogram
from monitor.report.figures.spectrum import SpectrumView, spectra, views_of
from monitor.report.figures.waterfall import kurtograms, waterfall
from monitor.report.runs import Channel, Run
from monitor.report.verdict import judge
from monitor.words.numbers import figure
from tests.monitor.report.figures.drawing import START, context_of, drawn, numbers
from tests.oracles.lives import GRAVITY
from tests.support.figures_spectra import KINEMATIC, row_of


def comb(lines: dict[float, float], resolution: float = 0.5, top: float = 900.0) -> tuple[Any, Any]:
    frequency = np.arange(0.0, top, resolution)
    amplitude = np.full(frequency.size, 0.01)
    for at, height in lines.items():
        amplitude[round(at / resolution)] = height
    return frequency, amplitude


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


def test_the_spectra_shown_are_one_before_and_one_after_the_onset(run: Run, channel: Channel) -> None:
    rows = [row_of(number, START + number) for number in range(10, 601, 10)]
    verdict = judge(run, channel)
    before, after = views_of(context_of(run, channel, spectra=rows))
    assert verdict.t_fs is not None
    assert verdict.t_fs.block is not None
    assert 100 < int(re.findall(r"block (\d+)", before.label)[0]) < verdict.t_fs.block
    assert after.label.startswith("block 600,")
    assert before.amplitude_g.max() == pytest.approx(1.0 / GRAVITY)
    (latest,) = views_of(context_of(run, run.channels["vertical"], spectra=rows))
    assert latest.label.startswith("block 600,")
    assert views_of(context_of(run, channel, spectra=[])) == []


def test_a_kurtogram_is_drawn_before_the_onset_and_now(run: Run, channel: Channel) -> None:
    flat, bright = ((0.0,), (0.0, 0.1), (0.0, 0.0, 0.1)), ((0.5,), (0.0, 9.0), (0.0, 1.0, 2.0))
    rows = [
        replace(row_of(number, START + number), kurtogram=Kurtogram(12_800.0, 12_800, levels))
        for number, levels in ((10, flat), (20, flat), (590, bright), (600, bright))
    ]
    picture = kurtograms(context_of(run, channel, spectra=[*rows, row_of(601, START + 601.0)]))
    before, now = drawn(picture)["kurtograms"]
    assert picture is not None
    assert (before["block"], before["best_hz"]) == (20, None)
    assert (now["block"], now["best_hz"]) == (600, [6400.0, 12800.0])
    assert (now["demodulated_hz"], now["kurtosis"][1]) == ([5e3, 9e3], [0.0, 9.0])
    assert "the highest, 9.0, stands at 6,400 to 12,800 Hz" in picture.caption
    assert "demodulated band" in picture.svg
    assert "highest kurtosis" in picture.svg
    (quiet,) = drawn(kurtograms(context_of(run, channel, spectra=rows[:1])))["kurtograms"]
    assert quiet["best_hz"] is None
    assert kurtograms(context_of(run, channel, spectra=[row_of(1, START)])) is None


def test_a_waterfall_leaves_gaps_blank_and_carries_its_spectra(run: Run, channel: Channel) -> None:
    times = [START + 60.0 * place + (6000.0 if place > 20 else 0.0) for place in range(40)]
    rows = [row_of(number, time, 1.0 + number) for number, time in enumerate(times, start=1)]
    picture = waterfall(context_of(run, channel, spectra=rows))
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
    assert waterfall(context_of(run, channel, spectra=rows[:3])) is None
    undated = [row_of(number, None) for number in range(1, 9)]
    assert waterfall(context_of(run, channel, spectra=undated)) is None


def test_a_waterfall_of_a_varying_speed_is_over_orders(run: Run, channel: Channel) -> None:
    rows = []
    for number in range(1, 9):
        speed = 20.0 + number
        amplitude = np.full(800, 0.01)
        amplitude[round(3.0 * speed)] = 1.0
        lines = {part: line * speed / 30.0 for part, line in KINEMATIC.items()}
        row = replace(row_of(number, START + 60.0 * number), amplitude=amplitude, lines=lines, speed=speed)
        rows.append(replace(row, domain="order", speed_range=(speed - 2.0, speed + 2.0)))
    picture = waterfall(context_of(run, channel, spectra=rows))
    data = drawn(picture)
    assert picture is not None
    assert "order of the shaft" in picture.svg
    assert "Mean speeds are 21.0 to 28.0 Hz" in picture.caption
    codes = np.frombuffer(base64.b64decode(data["codes_base64"]), np.uint8).reshape(8, len(data["order"]))
    assert {int(row.argmax()) for row in codes} == {int(np.searchsorted(data["order"], 3.0, side="right")) - 1}
    shown = spectra(views_of(context_of(run, channel, spectra=rows)), "x", "outer", numbers())
    assert shown is not None
    assert "order of the shaft" in shown.svg
    assert "over the angle of the shaft" in shown.caption
    assert "speed from 26 to 30 Hz" in shown.heading + shown.svg


def test_over_orders_markers_stand_on_the_lines_of_the_part() -> None:
    frequency, amplitude = comb({97.5 * order: 1.0 for order in range(1, 6)})
    view = SpectrumView(frequency, amplitude, KINEMATIC, "block 7", 30.0, domain="order")
    data = drawn(spectra([view], "x", "outer", numbers()))
    assert data["spectra"][0]["lines_order"]["outer"] == pytest.approx([3.25 * order for order in range(1, 6)])

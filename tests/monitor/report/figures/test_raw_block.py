from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.health.signal.spectra import BlockView
from monitor.health.signal.transform import BlockTransform
from monitor.health.signal.waterfall import SpectrumRow
from monitor.report.figures.raw_block import raw_block
from monitor.report.figures.spectrum import shared_words
from monitor.report.runs import Channel, Run
from tests.monitor.report.figures.drawing import START, context_of, drawn
from tests.support.figures_spectra import KINEMATIC, row_of
from tests.support.velocity_signals import RATE, tone

G = 9.80665


def seen(sequence: int, velocity: float) -> SpectrumRow:
    """A block of 1 s with a line of 50 Hz, velocity RMS in m/s, and one of 1 m/s2 at 6 kHz."""
    x = tone(1.0, 50.0, velocity) + np.cos(2.0 * math.pi * 6000.0 * np.arange(round(RATE)) / RATE)
    spectra = BlockTransform(x.size, RATE, [(500.0, 5000.0)])(x.astype(np.float32), view=True).view
    assert spectra is not None
    return replace(row_of(sequence, START + sequence), view=BlockView(RATE, x.size, spectra, x))


def test_spectra_read_the_lines_of_the_block_in_the_units_of_their_axes(run: Run, channel: Channel) -> None:
    picture = raw_block(context_of(run, channel, views=[seen(10, 1e-3), seen(600, 4e-3)]))
    data = drawn(picture)
    assert picture is not None
    for block, velocity in ((10, 1.0), (600, 4.0)):
        found = np.array(data[f"block_{block}_velocity_mm_s"])
        place = int(np.argmax(found))
        assert found[place] == pytest.approx(velocity, rel=1e-3)
        assert data[f"block_{block}_velocity_frequency_hz"][place] == pytest.approx(50.0)
        near = np.abs(np.array(data[f"block_{block}_acceleration_frequency_hz"]) - 6000.0) < 30.0
        assert max(np.array(data[f"block_{block}_acceleration_g"])[near]) == pytest.approx(1.0 / G, rel=1e-3)
    assert max(data["time_s"]) <= 8.0 / 30.0
    assert "Grey: block 10, before the onset." in picture.caption
    for words in ("acceleration (g)", "velocity, RMS (mm/s)", "frequency (Hz)", "time (s)", "shaft 30.0 Hz"):
        assert words in picture.svg
    assert len(picture.svg) + len(picture.json) < 200_000


def test_without_the_unit_there_is_no_velocity_and_without_views_no_figure(run: Run, channel: Channel) -> None:
    picture = raw_block(context_of(run, channel, views=[replace(seen(600, 4e-3), absolute=False)]))
    data = drawn(picture)
    assert not any("velocity" in name for name in data)
    assert "waveform_sensor_unit" in data
    assert raw_block(context_of(run, channel)) is None
    assert raw_block(context_of(run, channel, views=[row_of(10, START)])) is None


def test_lines_on_one_peak_are_said_to_be_one() -> None:
    assert "3 × BPFO = 2 × BPFI." in shared_words({"outer": 80.0, "inner": 120.0}, 0.2)
    assert shared_words(KINEMATIC, 0.01) == ""

"""The coherence of the kept samples: the angle from the kept speeds, and its figure."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from monitor.health.record_values import COURSE_POINTS
from monitor.health.signal.cyclic import kept_coherence, rotation_of_course
from monitor.health.signal.spectra import WAVEFORM_SAMPLES, BlockView, RawSpectra
from monitor.health.signal.waterfall import SpectrumRow
from monitor.report.figures.cyclic import block_coherence
from monitor.report.runs import Channel, Run
from monitor.web import channel_view
from tests.monitor.report.figures.drawing import context_of
from tests.support.varying_speed import RATE, SECONDS, block, turns_of

NUMBER = 120


def kept(domain: str = "order") -> SpectrumRow:
    """Return the row of a block with a damaged outer race, whose speed varies by 30 %."""
    angle, speed = turns_of(NUMBER, np.random.default_rng(1000 + NUMBER))
    mean = float((angle[-1] - angle[0]) / SECONDS)
    course = np.interp(np.linspace(0.0, SECONDS, COURSE_POINTS), np.arange(angle.size) / RATE, speed)
    raw = RawSpectra(1.0, np.ones(4), 4.0, np.ones(4))
    view = BlockView(RATE, angle.size, raw, block(NUMBER)[:WAVEFORM_SAMPLES, 0])
    lines = {"outer": 3.05 * mean, "inner": 4.95 * mean}
    row = SpectrumRow("s", "x", NUMBER, 0.0, 1.0, (1500.0, 5500.0), mean, 1.0, True, np.ones(4), lines, view=view)
    return replace(row, domain=domain, speed_course=tuple(course.tolist()))


def test_the_angle_of_the_beginning_follows_from_the_kept_speeds() -> None:
    row = kept()
    assert row.speed_course is not None
    angle, _ = turns_of(NUMBER, np.random.default_rng(1000 + NUMBER))
    rotation = rotation_of_course(row.speed_course, SECONDS, WAVEFORM_SAMPLES / RATE)
    time = np.arange(WAVEFORM_SAMPLES) / RATE
    assert np.abs(rotation.turns_at(time) - (angle[:WAVEFORM_SAMPLES] - angle[0])).max() < 5e-4


def test_the_damaged_part_stands_out_over_orders(run: Run, channel: Channel) -> None:
    found = kept_coherence(kept())
    highest = float(found.cyclic[int(np.argmax(found.enhanced))])
    assert min(abs(highest / (n * 3.05) - 1.0) for n in range(1, 5)) < 0.01
    assert found.enhanced.max() > 3.0 * found.limit
    picture = block_coherence(context_of(run, channel, views=[kept()]))
    assert picture is not None
    assert picture.heading == f"Spectral coherence of block {NUMBER}"
    assert "From the 1.3 s that are kept" in picture.caption
    assert block_coherence(context_of(run, channel, views=[kept("hertz")])) is None


def test_the_page_is_given_the_mean_over_the_band(monkeypatch: pytest.MonkeyPatch) -> None:
    row = kept()
    monkeypatch.setattr(channel_view, "_view", lambda *asked: (row, row.view))
    monkeypatch.setattr(channel_view, "viewed_blocks", lambda *asked, source: [NUMBER])
    answer = channel_view.cyclic(SimpleNamespace(store=None), "x", {})  # pyright: ignore[reportArgumentType]
    found = kept_coherence(row)
    assert answer["coherence"] == pytest.approx(found.enhanced.tolist(), rel=1e-3)
    assert answer["cyclic_order"] == pytest.approx(found.cyclic.tolist(), rel=1e-5)
    assert (answer["limit"], answer["band_hz"], answer["block"]) == (found.limit, [1500.0, 5500.0], NUMBER)


def test_what_gives_no_coherence_says_so() -> None:
    with pytest.raises(ValueError, match="nothing is kept"):
        kept_coherence(replace(kept(), view=None))
    view = kept().view
    assert view is not None
    with pytest.raises(ValueError, match="needs 64 windows"):
        kept_coherence(replace(kept(), view=replace(view, waveform=view.waveform[:2000])))

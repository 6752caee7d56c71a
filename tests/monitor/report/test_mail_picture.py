"""The picture of a mail: drawn of the store, with and without a spectrum; withheld in time where it cannot be."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure
from numpy.typing import NDArray

from monitor.health.signal.waterfall import SpectrumChange, SpectrumRow
from monitor.records.database import StoreError
from monitor.records.store import Store
from monitor.report.mail_picture import Wanted, _draw_spectrum, draw
from monitor.service.notify.message import draw_picture, picture_request
from streams.types.block import STANDARD_GRAVITY
from tests.support.trends import block

START = 1.7e9


def filled(folder: Path, *, dated: bool = True, spectrum: bool = True) -> Wanted:
    """Return what is wanted of a store of 40 blocks, whose level rises from the 30th on."""
    path = folder / "state.db"
    batch = []
    for number in range(1, 41):
        level = STANDARD_GRAVITY * (1.0 if number < 30 else 5.0)
        more: dict[str, Any] = {} if dated else {"elapsed": 60.0 * number}
        record = block(number, START + 60.0 * number if dated else None, **more)
        values = {"rms": level, "h_or": 0.5 * level, "quality_status": "ok"}
        batch.append((replace(record, channels={"x": values}), {}))
    row = SpectrumRow("s", "x", 40, START, 2.0, (500.0, 2000.0), 30.0, 1.0, True, np.full(400, 0.1), {"outer": 100.0})
    with Store.open(path, machine="m") as store:
        store.commit_many(batch, spectra=[SpectrumChange(row, "newest")] if spectrum else [])
    return Wanted(path, "s", "x", dated, "m: x: danger", "outer", {"onset": START + 1800.0}, {"danger": 3 * 9.8})


def pixels(png: bytes) -> NDArray[np.float64]:
    assert png.startswith(b"\x89PNG")
    return image.imread(BytesIO(png), format="png")[:, :, :3]


def bluish(found: NDArray[np.float64]) -> int:
    """Return how many pixels are more blue than red, by the whole of a line or a part."""
    return int((found[:, :, 2] - found[:, :, 0] > 0.25).sum())


def test_it_shows_level_lines_and_spectrum(tmp_path: Path) -> None:
    wanted = filled(tmp_path)
    found = pixels(draw(wanted))
    assert found.shape == (640, 720, 3)
    # Lines of the outer race are drawn in blue over time and in the spectrum, the danger in vermilion.
    assert bluish(found[420:]) > 100
    assert bluish(-found) > 100
    unnamed = pixels(draw(replace(wanted, fault=None, levels={})))
    assert bluish(unnamed[420:]) == 0
    assert bluish(-unnamed) < bluish(-found)
    # Nothing of what came after the event.
    early = pixels(draw(replace(wanted, until=START + 1500.0, block=10, marks={"t": math.nan})))
    assert not np.array_equal(early, found)


def test_a_spectrum_of_a_varying_speed_is_over_orders() -> None:
    axes = Figure().subplots()
    row = SpectrumRow("s", "x", 1, 0.0, 2.0, (500.0, 2000.0), 25.0, 1.0, True, np.full(400, 0.1), {"outer": 100.0})
    _draw_spectrum(axes, replace(row, domain="order"), Wanted(Path(), "s", "x", True, fault="outer"))
    assert axes.get_xlabel() == "order of the shaft"
    assert np.asarray(axes.get_lines()[0].get_xdata())[0] == 4.0


def test_it_needs_no_dates_no_spectrum_but_records(tmp_path: Path) -> None:
    wanted = filled(tmp_path, dated=False, spectrum=False)
    assert pixels(draw(replace(wanted, marks={"onset": 1800.0}, absolute=False))).shape == (640, 720, 3)
    with pytest.raises(ValueError, match="has no records"):
        draw(replace(wanted, channel="y"))
    with pytest.raises(StoreError):
        draw(replace(wanted, store=tmp_path / "none.db"))


VALUES: dict[str, Any] = {"stage": "final", "fault": "outer", "t_fs": 5.0, "t_eol": None, "absolute_level": "yes"}
STATUS = {"levels": [{"rule": "rms", "feature": "rms", "alert_si": 20.0, "danger_si": None}]}


def test_what_is_asked_for_can_be_drawn(tmp_path: Path) -> None:
    found = picture_request(tmp_path / "state.db", "s", 7, START, "x", VALUES, STATUS)
    assert found is not None
    wanted = Wanted.of_json(json.dumps(found | {"title": "t", "zone": "Europe/Rome"}))
    assert (wanted.marks, wanted.levels, wanted.until, wanted.block) == ({"onset": 5.0}, {"alert": 20.0}, START, 7)
    for missing in ({"source": None}, {"block": None}, {"channel": None}, {"values": {}}):
        given: dict[str, Any] = {
            "source": "s",
            "block": 7,
            "utc": START,
            "channel": "x",
            "values": VALUES,
            "status": {},
        }
        given |= missing
        assert picture_request(tmp_path, **given) is None


@pytest.mark.process
def test_a_mail_goes_out_without_a_picture_that_fails(caplog: pytest.LogCaptureFixture) -> None:
    # Children that end, that print what is no picture, and that never draw.
    for entry in ("sys:exit", "this:s", "code:interact"):
        assert draw_picture({}, entry=entry, most_s=0.3 if entry == "code:interact" else 20.0) is None
    assert caplog.text.count("a mail goes out without its picture") == 3
    # A daemon that ends does not wait for one, and says nothing.
    assert draw_picture({}, lambda: True, entry="code:interact") is None
    assert caplog.text.count("a mail goes out without its picture") == 3

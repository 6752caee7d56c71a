"""The section on how the records were made: departures from the sources, and the floor of the defects in the map."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from models.machine.scene import Floor
from monitor.health.record import Record
from monitor.records.store import Store
from monitor.report import run_section
from monitor.report.options import Options
from monitor.report.report import build_report
from tests.oracles.page import Page

HASH = "0123456789abcdef0123456789abcdef"


def text_of(tmp_path: Path) -> str:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.describe({"map_hash": HASH})
        record = Record(
            source="s", sequence=1, name="a", content_hash="h", elapsed=0.0, channels={"x": {"stage": "healthy"}}
        )
        store.commit_many([(record, {})])
        options = Options(title="t", sections=frozenset({"provenance"}))
        page = build_report(store, tmp_path / "report.html", options=options)
        return Page(page.read_text(encoding="utf-8")).text


def test_departures_from_the_sources_are_listed(tmp_path: Path) -> None:
    text = text_of(tmp_path)
    assert "A*: lines within 2 % of BPFO, printed at BPFO; H_or (outer race lines): lines within 2 %" in text
    assert "RMS: printed with the mean" in text
    assert "R = 10 µm" not in text


def test_the_floor_of_the_map_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = SimpleNamespace(plan=SimpleNamespace(floor=Floor("rough", sd=5e-7)))
    monkeypatch.setattr(run_section, "kept_map", lambda wanted: kept if wanted == HASH else None)
    text = text_of(tmp_path)
    assert "standard deviation 0.5 µm after filtering" in text
    assert "R = 10 µm" in text

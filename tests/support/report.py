"""Makers and checks that tests of report share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from monitor.health.record import Record
from monitor.records.store import Store
from monitor.report.report import build_report
from tests.oracles.page import Page


def page_of(tmp_path: Path, source: Any, **options: Any) -> Page:
    text = build_report(source, tmp_path / "report.html", **options).read_text(encoding="utf-8")
    page = Page(text)
    assert page.open == []
    return page


def page_of_records(tmp_path: Path, made: list[Record], calibrated: str = "yes", **options: Any) -> Page:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.describe({"calibrated": calibrated})
        store.commit_many([(record, {}) for record in made])
        return page_of(tmp_path, store, **options)


def one(values: dict[str, Any], **fields: Any) -> Record:
    return Record(
        **{"source": "s", "sequence": 1, "name": "a", "content_hash": "h", "elapsed": 0.0, "channels": {"x": values}}
        | fields
    )

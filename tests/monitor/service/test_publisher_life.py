"""The publisher's child is replaced now and then, for what its libraries lose; nobody notices."""

from __future__ import annotations

from pathlib import Path

import pytest
import xarray as xr

from monitor.records.store import Store
from monitor.service import publisher as publishing
from monitor.service.publisher import Publisher
from tests.faults.test_store_kill import block
from tests.waiting import PATIENCE_S

pytestmark = pytest.mark.process


def test_another_child_takes_over_after_some_publications(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publishing, "_MAX_ANSWERS", 2)
    children: list[int | None] = []
    with Store.open(tmp_path / "state.db", machine="m") as store:
        publisher = Publisher(store, tmp_path / "records")
        try:
            for number in range(1, 6):
                store.commit(block(number), {})
                publisher.changed()
                assert publisher.finish(PATIENCE_S)
                assert publisher.problem is None
                children.append(publisher.pid)
                with xr.open_dataset(next((tmp_path / "records").glob("*.nc"))) as day:
                    assert day.sizes["time"] == number
        finally:
            publisher.close()
    # After every second publication there is none, and then another one.
    assert [pid is None for pid in children] == [False, True, False, True, False]
    assert len({pid for pid in children if pid is not None}) == 3

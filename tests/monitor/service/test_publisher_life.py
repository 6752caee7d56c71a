"""The publisher's child: when it is asked, what it mends, and that it is replaced now and then, unnoticed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import xarray as xr

from monitor.health.record import Record
from monitor.records.store import Store
from monitor.service import publisher as publishing
from monitor.service.publisher import Publisher
from tests.support.store_kill import block
from tests.support.waiting import PATIENCE_S

pytestmark = pytest.mark.process
DAY = 86400.0


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


def record(sequence: int, when: float) -> Record:
    return Record("s", sequence, f"b{sequence}", str(sequence), "ok", time=when, elapsed=0.0)


def days_of(folder: Path) -> dict[str, int]:
    found = {}
    for path in sorted(folder.glob("*.nc")):
        with xr.open_dataset(path) as dataset:
            found[path.name] = dataset.sizes["time"]
    return found


def test_the_publisher_mends_what_is_lost_and_comes_back_when_killed(tmp_path: Path) -> None:
    files = tmp_path / "records"
    with Store.open(tmp_path / "state.db", machine="m") as store:
        for sequence, when in ((1, 10.0 * DAY), (2, 11.0 * DAY)):
            store.commit(record(sequence, when), {})
        publisher = Publisher(store, files)
        try:
            assert publisher.finish(PATIENCE_S)
            assert days_of(files) == {"m-19700111.nc": 1, "m-19700112.nc": 1}
            kept = (files / "m-19700112.nc").stat().st_ino
            # A late record falls into a closed day; the other day is left alone.
            store.commit(record(3, 10.5 * DAY), {})
            publisher.changed()
            assert publisher.finish(PATIENCE_S)
            assert days_of(files) == {"m-19700111.nc": 2, "m-19700112.nc": 1}
            assert (files / "m-19700112.nc").stat().st_ino == kept
            (files / "m-19700112.nc").write_bytes(b"damaged")
            (files / "m-19700111.nc").unlink()
            publisher.changed()
            assert publisher.finish(PATIENCE_S)
            assert days_of(files) == {"m-19700111.nc": 2, "m-19700112.nc": 1}
            child = vars(vars(publisher)["_child"])["_process"]
            child.kill()
            child.wait()
            store.commit(record(4, 11.5 * DAY), {})
            publisher.changed()
            assert not publisher.finish(PATIENCE_S)
            assert publisher.problem is not None
            assert publisher.finish(PATIENCE_S)
            assert publisher.problem is None
            assert days_of(files) == {"m-19700111.nc": 2, "m-19700112.nc": 2}
        finally:
            publisher.close()
        assert publisher.pid is None


class Told:
    """A child that answers when the test says so."""

    pid, ended = 1, False

    def __init__(self, *_: str) -> None:
        self.lines: list[bytes] = []

    def answer(self, seconds: float) -> None:
        found = {"published": [], "kept": [], "deleted": [], "missing": [], "size": 0, "problem": None}
        self.lines = [json.dumps({**found, "seconds": seconds}).encode()]

    def read_lines(self, timeout: float) -> list[bytes]:
        found, self.lines = self.lines, []
        return found

    def write(self, line: bytes) -> None:
        assert line == b"0\n"

    def close_pipes(self) -> None:
        self.ended = True

    end = close_pipes


def test_pauses_follow_the_duration_all_files_are_checked_now_and_then_and_one_that_hangs_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Quick effort shortens them.
    monkeypatch.setattr(publishing, "_MIN_PAUSE_FACTOR", 20.0)
    monkeypatch.setattr(publishing, "_CHECK_TURNS", 10)
    children: list[Told] = []
    monkeypatch.setattr(publishing, "Child", lambda *given: children.append(Told(*given)) or children[-1])
    now = [0.0]
    with Store.open(tmp_path / "state.db", machine="m") as store:
        publisher = Publisher(store, tmp_path / "records", every=60.0, monotonic=lambda: now[0])

        def is_busy_at(seconds: float) -> bool:
            now[0] = seconds
            publisher.tick()
            return publisher.busy

        assert is_busy_at(0.0)
        children[0].answer(10.0)
        assert not is_busy_at(0.0)
        publisher.changed()
        assert [is_busy_at(seconds) for seconds in (60.0, 199.0, 200.0)] == [False, False, True]
        children[0].answer(0.1)
        assert not is_busy_at(200.0)
        assert [is_busy_at(200.0 + 60.0 * turn) for turn in range(1, 11)] == [False] * 9 + [True]
        assert is_busy_at(1400.0)
        assert (publisher.problem, len(children)) == (None, 1)
        assert not is_busy_at(1401.0)
        assert publisher.problem == "publishing takes longer than 600 s"
        assert children[0].ended
        assert is_busy_at(1461.0)
        assert len(children) == 2
        # The stop does not wait for it.
        assert not publisher.finish(0.01)
        publisher.close()


def test_the_publisher_asks_only_when_something_changed(tmp_path: Path) -> None:
    now = [0.0]
    with Store.open(tmp_path / "state.db", machine="m") as store:
        publisher = Publisher(store, tmp_path / "records", every=60.0, monotonic=lambda: now[0])
        try:
            assert publisher.finish(PATIENCE_S)
            now[0] = 59.0
            publisher.changed()
            publisher.tick()
            assert not publisher.busy
            now[0] = 61.0
            publisher.tick()
            assert publisher.busy
            assert publisher.finish(PATIENCE_S)
            now[0] = 1e3
            publisher.tick()
            assert not publisher.busy
        finally:
            publisher.close()

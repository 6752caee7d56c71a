"""What is new reaches who listens, and whoever does not listen is dropped."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from monitor.config.load import load_config
from monitor.records.events import EventLog
from monitor.records.store import Store
from monitor.web.machines import Machines
from monitor.web.stream import Hub
from tests.support.daemon import running
from tests.support.daemons import make_machine, status
from tests.support.pages import alarmed_machine, page_of, put_blocks
from tests.support.waiting import PATIENCE_S, wait_until

pytestmark = pytest.mark.process

Events = Iterator[tuple[str, Any]]


def until(events: Events, kind: str, wanted: Callable[[Any], bool] = lambda _: True) -> Any:
    """Return the next event of a kind that is as wanted."""
    for found, data in events:
        if found == kind and wanted(data):
            return data
    raise AssertionError(f"the stream ended without {kind}")


def test_a_new_block_reaches_who_follows_its_channel(tmp_path: Path) -> None:
    config = alarmed_machine(tmp_path, sources=2)
    put_blocks(config, 1)
    with running(config), page_of(config) as page:
        wait_until(lambda: status(config)["blocks"] == 2)
        with page.events("?machine=m&channel=x0") as events, page.events() as others:
            whole = until(events, "machines")
            assert whole["full"] is True
            assert whole["machines"][0]["channels"]["x0"]["last_block"] == 2
            put_blocks(config, 2)
            times: list[float] = []
            blocks: list[int] = []
            while len(times) < 2:
                records = until(events, "records")
                assert (records["machine"], records["channel"], records["resolution_s"]) == ("m", "x0", None)
                times += records["columns"]["time_s"]
                blocks += records["columns"]["block"]
                assert set(records["columns"]) == set(page.get("/api/channels/m/x0/records")["columns"])
            assert blocks == [3, 4]
            put_blocks(config, 3)
            assert until(events, "spectrum")["block"] > 2
            changed = until(
                others, "machines", lambda data: "x0" in data["machines"][0]["channels"] and not data["full"]
            )
            assert set(changed["machines"][0]["channels"]) <= {"x0", "x1"}
            wait_until(lambda: status(config)["blocks"] == 6)
            seen: set[str] = set()
            for kind, data in others:
                seen.add(kind)
                if kind == "machines" and data["machines"][0]["channels"].get("x0", {}).get("last_block") == 6:
                    break
            assert "records" not in seen


def test_only_channels_that_changed_are_told_again(tmp_path: Path) -> None:
    config = alarmed_machine(tmp_path, sources=2)
    with running(config), page_of(config) as page, page.events() as events:
        until(events, "machines", lambda data: data["full"])
        # A heartbeat has ages and dates, and no channel of which nothing is new.
        until(events, "machines", lambda data: not data["full"] and data["machines"][0]["channels"] == {})
        put_blocks(config, 1, source=1)
        data = until(events, "machines", lambda data: data["machines"][0]["channels"] != {})
        assert set(data["machines"][0]["channels"]) == {"x1"}


def test_an_acknowledgement_is_told(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    store = tmp_path / "state" / "state.db"
    with Store.open(store, machine="m"), EventLog(store) as log:
        log.notice(1e9, {"kind": "test", "text": "words"})
    with page_of(config) as page, page.events() as events:
        until(events, "machines")
        body = {"who": "Ada", "note": ""}
        assert page.post("/api/events/m:n1/acknowledge", body, authorization=page.bearer).status == 200
        assert until(events, "events") == {"unacknowledged": 0, "newest": None}
        with EventLog(store) as log:
            log.notice(2e9, {"kind": "test", "text": "more"})
        assert until(events, "events") == {"unacknowledged": 1, "newest": "m:n2"}


def test_an_unknown_channel_is_not_followed(tmp_path: Path) -> None:
    with page_of(make_machine(tmp_path)) as page:
        assert page.ask("/api/stream?machine=m&channel=nope").status == 404
        assert page.ask("/api/stream?machine=nope&channel=x0").status == 404


def test_a_listener_that_takes_nothing_is_dropped_and_holds_nothing_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("monitor.web.stream._POLL_S", 0.001)
    monkeypatch.setattr("monitor.web.stream._HEARTBEAT_S", 0.0)
    monkeypatch.setattr("monitor.web.machines._FRESH_S", 0.0)
    config = make_machine(tmp_path)
    hub = Hub(Machines([load_config(config)]))
    (tmp_path / "state").mkdir()
    told = tmp_path / "state" / "status.json"

    async def scene() -> tuple[int, int]:
        looking = asyncio.create_task(hub.run())
        lazy, eager = hub.messages(hub.subscribe(None)), hub.messages(hub.subscribe(None))
        await anext(lazy)
        await anext(eager)
        taken = 0
        for number in range(200):
            told.write_text(f'{{"up_s": {number}}}')
            await anext(eager)
            taken += 1
        waiting = 0
        # What waited is given, then the stream of the lazy one ends.
        async for _ in lazy:
            waiting += 1
        looking.cancel()
        await asyncio.gather(looking, return_exceptions=True)
        return taken, waiting

    taken, waiting = asyncio.run(asyncio.wait_for(scene(), PATIENCE_S))
    hub.close()
    assert taken == 200
    assert waiting <= 1


@pytest.mark.parametrize("turns", range(4))
def test_the_polling_ends_though_it_is_woken_in_the_same_moment(turns: int) -> None:
    """``asyncio.wait_for`` of Python 3.11 may swallow the cancellation."""

    async def cancel_when_woken() -> bool:
        hub = Hub(Machines([]))
        task = asyncio.create_task(hub.run())
        await asyncio.sleep(0.01)
        hub.wake()
        for _ in range(turns):
            await asyncio.sleep(0.0)
        task.cancel()
        _, waiting = await asyncio.wait([task], timeout=1.0)
        task.cancel()
        hub.close()
        return not waiting

    assert asyncio.run(cancel_when_woken())

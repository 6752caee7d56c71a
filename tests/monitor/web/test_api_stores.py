"""Stores that are not there yet, damaged or cannot be read: what the page's addresses say of their machines."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from monitor.config.load import load_config
from monitor.records.events import EventLog
from monitor.records.store import Store
from tests.support.daemon import running
from tests.support.daemons import status
from tests.support.fleet import add_machine
from tests.support.pages import alarmed_machine, page_of, put_blocks
from tests.support.waiting import wait_until

pytestmark = pytest.mark.process


def test_a_machine_that_never_ran_has_nothing_and_says_so(tmp_path: Path) -> None:
    config = alarmed_machine(tmp_path)
    with page_of(config) as page:
        (machine,) = page.get("/api/machines")["machines"]
        assert (machine["running"], machine["status"], machine["channels"]) == (False, "never_ran", {})
        assert page.get("/api/events") == {"unacknowledged": 0, "failing": {}, "events": []}
        assert page.get("/api/records") == {"files": []}
        for address in ("channels/m/x0", "channels/m/x0/records", "channels/m/x0/spectrum", "machines/m/blocks"):
            reply = page.ask(f"/api/{address}")
            assert (reply.status, list(reply.json)) == (503, ["error"]), address
            assert "it has no store" in reply.json["error"]


def test_a_damaged_store_is_an_error_in_words_and_a_new_one_is_found(tmp_path: Path) -> None:
    config = alarmed_machine(tmp_path)
    put_blocks(config, 1)
    with running(config):
        wait_until(lambda: status(config)["blocks"] == 2)
    store = tmp_path / "state" / "state.db"
    with page_of(config) as page:
        assert page.get("/api/channels/m/x0")["source"] == "s0"
        whole = store.read_bytes()
        store.rename(tmp_path / "aside")
        store.write_bytes(whole[:100] + bytes(len(whole) - 100))
        reply = page.ask("/api/channels/m/x0")
        assert reply.status == 503
        assert str(tmp_path) not in reply.json["error"]
        store.unlink()
        store.write_bytes(whole)
        assert page.get("/api/channels/m/x0")["source"] == "s0"
        with sqlite3.connect(store) as connection:
            connection.execute("DROP TABLE spectra")
        connection.close()
        assert page.ask("/api/channels/m/x0/spectrum").status == 404
    assert load_config(config).machine.name == "m"


def test_a_store_that_fails_hides_no_other_machine(tmp_path: Path) -> None:
    configs = [add_machine(tmp_path, name) for name in ("a", "b")]
    for name in ("a", "b"):
        store = tmp_path / name / "state" / "state.db"
        with Store.open(store, machine=name), EventLog(store) as log:
            log.notice(1e9, {"kind": "test", "text": f"of {name}"})
    (tmp_path / "a" / "state" / "state.db").write_bytes(b"damaged")
    with page_of(*configs) as page:
        found = page.get("/api/events")
        assert [event["id"] for event in found["events"]] == ["b:n1"]
        assert found["unacknowledged"] == 1
        assert list(found["failing"]) == ["a"]
        assert str(tmp_path) not in found["failing"]["a"]
        assert {machine["name"] for machine in page.get("/api/machines")["machines"]} == {"a", "b"}
        assert b'spallwatch_unacknowledged_events{machine="b"} 1.0' in page.ask("/metrics").body
        with page.events() as events:
            assert next(events)[1]["full"] is True
            with EventLog(tmp_path / "b" / "state" / "state.db") as log:
                log.notice(2e9, {"kind": "test", "text": "more"})
            kind, data = next(item for item in events if item[0] == "events")
            assert (kind, data) == ("events", {"unacknowledged": 2, "newest": "b:n2"})

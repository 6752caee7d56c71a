"""The page's addresses, asked over HTTP: what they say is what the store and the daemon said."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from models.maps.build import build_map
from models.maps.file import save_map
from models.maps.plan import MapPlan
from monitor.config.load import load_config
from monitor.records.events import EventLog
from monitor.records.spectra import read_block_view, read_spectra
from monitor.records.store import Store
from monitor.web.channel_view import map_of
from monitor.web.machines import Status, WatchedMachine
from tests.streams.folders import csv_bytes
from tests.support.daemon import running
from tests.support.daemons import status
from tests.support.fleet import add_machine
from tests.support.pages import Page, Reply, alarmed_machine, page_of, put_blocks
from tests.support.waiting import wait_until

pytestmark = pytest.mark.process

G = 9.80665


class Watched(NamedTuple):
    config: Path
    page: Page


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    """A machine whose daemon runs, with 60 accepted blocks, a flat and an unreadable one, and its page."""
    config = alarmed_machine(tmp_path_factory.mktemp("m"))
    put_blocks(config, 1, blocks=60)
    with running(config), page_of(config) as page:
        wait_until(lambda: status(config)["blocks"] == 60)
        (config.parent / "in0" / "f0002.csv").write_bytes(csv_bytes(np.full(256, 0.5)))
        wait_until(lambda: status(config)["blocks"] == 61)
        (config.parent / "in0" / "f0003.csv").write_bytes(b"words; and <b>more</b>\n" * 20)
        wait_until(lambda: status(config)["blocks"] == 62)
        wait_until(lambda: page.get("/api/channels/m/x0/records")["columns"]["time_s"][61:])
        yield Watched(config, page)


def store_of(watched: Watched) -> Store:
    return Store.open(watched.config.parent / "state" / "state.db", read_only=True)


def test_machines_are_what_their_daemons_say(watched: Watched) -> None:
    found = watched.page.get("/api/machines")
    (machine,) = found["machines"]
    said = status(watched.config)
    assert found["server"]["version"] == said["version"]
    assert (machine["name"], machine["running"], machine["timezone"]) == ("m", True, "UTC")
    assert machine["channels"]["x0"]["stage"] == said["channels"]["x0"]["stage"] == "learning"
    assert machine["channels"]["x0"]["alarms"][0]["rule"] == "rms"
    assert machine["pid"] == said["pid"]


def test_a_channel_says_what_its_figures_need(watched: Watched) -> None:
    found = watched.page.get("/api/channels/m/x0")
    assert found == watched.page.get("/api/machines/m/channels/x0") | {"state": found["state"]}
    assert (found["source"], found["unit"], found["dated"], found["tracked"]) == ("s0", "g", False, False)
    assert found["bearing"]["n_elements"] == 12
    assert found["orders"]["outer"] + found["orders"]["inner"] == pytest.approx(12.0)
    assert found["orders"]["cage"] * 12 == pytest.approx(found["orders"]["outer"])
    assert found["thresholds_mm2"] == [0.05]
    given, learned = found["levels"]
    assert given == {
        "rule": "rms",
        "feature": "rms",
        "side": "above",
        "column": "rms_g",
        "alert": pytest.approx(0.001),
        "danger": None,
    }
    assert (learned["column"], learned["danger"]) == ("kurtosis", None)
    assert found["marks"] == {"t_fs_s": None, "t_fs_known_s": None, "t_eol_s": None}


def test_records_are_those_of_the_store_in_the_units_of_people(watched: Watched) -> None:
    found = watched.page.get("/api/channels/m/x0/records")
    columns = found["columns"]
    assert {len(values) for values in columns.values()} == {62}
    assert (found["resolution_s"], found["dated"]) == (None, False)
    with store_of(watched) as store:
        for row, record in enumerate(store.records()):
            values = record.channels.get("x0", {})
            rms, h_or = values.get("rms"), values.get("h_or")
            assert columns["block"][row] == record.sequence
            assert columns["rms_g_min"][row] == (None if rms is None else pytest.approx(rms / G, rel=1e-6))
            h_or = h_or[0] if isinstance(h_or, tuple) else h_or
            assert columns["h_or_g_max"][row] == (None if h_or is None else pytest.approx(h_or / G, rel=1e-6))
            assert columns["v_eq_mm2_max"][row] is None
    assert sum(columns["rejected"]) == 1
    assert columns["flagged"][60] == 1
    assert columns["rms_g_min"] == columns["rms_g_max"]


def test_fewer_points_keep_the_extremes(watched: Watched) -> None:
    every = watched.page.get("/api/channels/m/x0/records")["columns"]
    few = watched.page.get("/api/channels/m/x0/records?points=10")
    assert few["resolution_s"] > 0
    assert len(few["columns"]["time_s"]) <= 10
    assert sum(few["columns"]["records"]) == 62
    for name in ("rms_g", "kurtosis", "peak_g"):
        for end, chosen in (("min", min), ("max", max)):
            whole = chosen(value for value in every[f"{name}_{end}"] if value is not None)
            assert chosen(value for value in few["columns"][f"{name}_{end}"] if value is not None) == whole
    part = watched.page.get("/api/channels/m/x0/records?from=1&to=2")["columns"]["time_s"]
    assert part == [time for time in every["time_s"] if 1 <= time <= 2]


@pytest.mark.parametrize("query", ["from=nan", "to=inf", "points=x", "points=1.5", "from=1e400"])
def test_a_query_that_is_no_number_is_refused(watched: Watched, query: str) -> None:
    reply = watched.page.ask(f"/api/channels/m/x0/records?{query}")
    assert reply.status == 400
    assert "must be a" in reply.json["error"]


def test_spectra_and_waterfall_are_those_of_the_store(watched: Watched) -> None:
    path = watched.config.parent / "state" / "state.db"
    rows = read_spectra(path, "x0")
    found = watched.page.get("/api/channels/m/x0/spectrum")
    assert found["blocks"] == [row.sequence for row in rows]
    assert found["block"] == rows[-1].sequence
    assert found["amplitude_g"] == pytest.approx(list(rows[-1].amplitude / G), rel=1e-3)
    assert found["lines_hz"] == dict(rows[-1].lines)
    first = watched.page.get(f"/api/channels/m/x0/spectrum?block={rows[0].sequence}")
    assert first["mean_g"] == pytest.approx(rows[0].mean / G)
    assert watched.page.ask("/api/channels/m/x0/spectrum?block=9999").status == 404
    water = watched.page.get("/api/channels/m/x0/waterfall?bins=10")
    assert len(water["amplitude_g"]) == len(rows)
    assert len(water["frequency_hz"]) == 10
    assert max(water["amplitude_g"][0]) == pytest.approx(rows[0].amplitude.max() / G, rel=1e-3)
    assert (water["domain"], water["varies"], water["speed_hz"][0]) == ("hertz", False, rows[0].speed)
    orders = watched.page.get("/api/channels/m/x0/waterfall?bins=10&axis=order")
    assert orders["domain"] == "order"
    assert "frequency_hz" not in orders
    edges = [value / rows[0].speed for value in water["frequency_hz"]]
    assert orders["order"] == pytest.approx(edges, rel=1e-4)
    for wrong in ("axis=rpm", "axis=order&to_hz=100"):
        assert watched.page.ask(f"/api/channels/m/x0/waterfall?{wrong}").status == 400


def test_raw_spectra_and_waveforms_are_those_of_the_store(watched: Watched) -> None:
    row = read_block_view(watched.config.parent / "state" / "state.db", "x0")
    assert row is not None
    assert row.view is not None
    raw, wave = (watched.page.get(f"/api/channels/m/x0/{part}") for part in ("raw", "waveform"))
    for found in (raw, wave):
        assert (found["block"], found["unit"], found["lines_hz"]) == (row.sequence, "g", dict(row.lines))
        assert (found["rate_hz"], found["samples"]) == (row.view.rate, row.view.samples)
        assert found["blocks"][-1] == row.sequence
    assert raw["amplitude_g"] == pytest.approx(list(row.view.spectra.amplitude / G), rel=1e-3)
    assert raw["highest_g"] == pytest.approx(list(row.view.spectra.highest / G), rel=1e-3)
    assert wave["waveform_g"] == pytest.approx(list(row.view.waveform / G), rel=1e-3, abs=1e-6)
    assert watched.page.get(f"/api/channels/m/x0/raw?block={raw['blocks'][0]}")["block"] == raw["blocks"][0]
    for part in ("raw", "waveform"):
        assert watched.page.ask(f"/api/channels/m/x0/{part}?block=9999").status == 404


def test_too_few_samples_give_no_coherence_and_say_why(watched: Watched) -> None:
    reply = watched.page.ask("/api/channels/m/x0/cyclic")
    assert reply.status == 404
    assert "got 256 samples" in reply.json["error"]


def test_a_source_without_pulses_has_no_spectrum_of_the_angular_speed(watched: Watched) -> None:
    reply = watched.page.ask("/api/channels/m/x0/ias")
    assert (reply.status, reply.json["error"]) == (404, "no spectrum of the angular speed is kept yet")


def test_levels_of_many_channels_are_those_of_their_trends(watched: Watched) -> None:
    found = watched.page.get("/api/machines/m/levels?channels=x0,nobody")["channels"]
    assert list(found) == ["x0"]
    trend = watched.page.get("/api/channels/m/x0/records?points=60")["columns"]
    expected = [value for value in trend["rms_g_max"] if value is not None]
    assert found["x0"]["rms_g"] == pytest.approx(expected, rel=1e-3)
    assert found["x0"]["latest_g"] == pytest.approx(expected[-1], rel=1e-3)
    assert len(found["x0"]["time_s"]) == len(expected) <= 60
    for wrong in ("", ",".join(f"c{n}" for n in range(41))):
        assert watched.page.ask(f"/api/machines/m/levels?channels={wrong}").status == 400


def test_the_kurtogram_is_the_latest_that_is_kept(watched: Watched) -> None:
    rows = [
        row for row in read_spectra(watched.config.parent / "state" / "state.db", "x0") if row.kurtogram is not None
    ]
    found = watched.page.get("/api/channels/m/x0/kurtogram")
    kept = rows[-1].kurtogram
    assert kept is not None
    assert (found["block"], found["nyquist_hz"]) == (rows[-1].sequence, kept.nyquist)
    assert [tuple(level) for level in found["kurtosis"]] == list(kept.levels)
    assert len(found["noise"]) == len(kept.levels)
    assert found["band_hz"] == list(rows[-1].band)
    first = watched.page.get(f"/api/channels/m/x0/kurtogram?block={rows[0].sequence}")
    assert first["block"] == rows[0].sequence
    assert watched.page.ask("/api/channels/m/x0/kurtogram?block=x").status == 400


def test_rejected_and_flagged_blocks_are_listed_with_their_reasons(watched: Watched) -> None:
    wait_until(lambda: sum(watched.page.get("/api/machines/m/blocks")["counts"].values()) == 62)
    found = watched.page.get("/api/machines/m/blocks")
    assert found["counts"] == {"flat": 1, "ok": 60, "unreadable": 1}
    assert [block["status"] for block in found["blocks"]] == ["unreadable", "flat"]
    assert found["blocks"][0]["name"] == "f0003.csv"
    assert found["blocks"][0]["reason"]
    assert watched.page.get("/api/machines/m/blocks?source=other")["blocks"] == []
    assert len(watched.page.get("/api/machines/m/blocks?limit=1")["blocks"]) == 1


def test_published_files_are_listed_and_come_whole(watched: Watched) -> None:
    published = watched.config.parent / "records" / "m-undated.nc"
    wait_until(published.exists)
    (listed,) = watched.page.get("/api/records")["files"]
    assert (listed["machine"], listed["file"]) == ("m", "m-undated.nc")
    reply = watched.page.ask("/records/m-undated.nc")
    assert reply.status == 200
    assert reply.body[:4] == b"\x89HDF"
    assert len(reply.body) == int(reply.headers["content-length"])
    assert "attachment" in reply.headers["content-disposition"]


def test_what_has_not_changed_is_not_sent_again(watched: Watched) -> None:
    first = watched.page.ask("/api/channels/m/x0/records", headers={"accept-encoding": "gzip"})
    assert first.headers["content-encoding"] == "gzip"
    assert first.json == watched.page.get("/api/channels/m/x0/records")
    again = watched.page.ask("/api/channels/m/x0/records", headers={"if-none-match": first.headers["etag"]})
    assert (again.status, again.body) == (304, b"")


def test_no_answer_names_a_folder(watched: Watched) -> None:
    addresses = ["machines", "channels/m/x0", "channels/m/x0/map", "machines/m/blocks", "events", "records", "session"]
    for address in [*(f"/api/{name}" for name in addresses), "/healthz", "/metrics", "/api/channels/m/nope/records"]:
        assert str(watched.config.parent).encode() not in watched.page.ask(address).body, address


def test_an_event_is_told_in_words_and_acknowledged(watched: Watched) -> None:
    page = watched.page
    found = page.get("/api/events")
    event = next(event for event in found["events"] if event["kind"] == "alarm_raised")
    assert event["text"].startswith("alert: RMS is ")
    assert (event["machine"], event["channel"], event["block"], event["open"]) == ("m", "x0", 1, True)
    before = found["unacknowledged"]
    reply = page.post(
        f"/api/events/{event['id']}/acknowledge", {"who": "Ada", "note": "<b>seen</b>"}, authorization=page.bearer
    )
    assert reply.status == 200
    assert reply.json["open"] is False
    assert [(item["who"], item["note"]) for item in reply.json["acknowledgements"]] == [("Ada", "<b>seen</b>")]
    assert page.get("/api/events")["unacknowledged"] == before - 1
    with EventLog(watched.config.parent / "state" / "state.db") as log:
        logged = log.event(event["id"].partition(":")[2])
        assert logged is not None
        assert [item.who for item in logged.acknowledgements] == ["Ada"]


def test_what_cannot_be_acknowledged_is_refused(watched: Watched) -> None:
    page = watched.page
    for name, body, expected in (
        ("m:1", {"who": "", "note": ""}, 400),
        ("m:1", {"who": "a\nb", "note": ""}, 400),
        ("m:1", {"who": 1, "note": ""}, 400),
        ("m:1", [1], 400),
        ("m:1", {"who": "a", "note": "x" * 2001}, 400),
        ("m:99999", {"who": "a", "note": ""}, 404),
        ("m:n99", {"who": "a", "note": ""}, 404),
        ("m:1;", {"who": "a", "note": ""}, 404),
        ("other:1", {"who": "a", "note": ""}, 404),
    ):
        reply = page.post(f"/api/events/{name}/acknowledge", body, authorization=page.bearer)
        assert (reply.status, set(reply.json)) == (expected, {"error"}), (name, body)


def test_events_come_page_by_page_each_once(watched: Watched) -> None:
    path = watched.config.parent / "state" / "state.db"
    with EventLog(path) as log:
        for number in range(25):
            log.notice(1e9 + number // 3, {"kind": "test", "channel": "x0", "text": f"number {number}"})
    whole = [event["id"] for event in watched.page.get("/api/events?limit=1000")["events"]]
    assert len(set(whole)) == len(whole) >= 26
    found: list[str] = []
    while True:
        before = f"&before={found[-1]}" if found else ""
        part = [event["id"] for event in watched.page.get(f"/api/events?limit=4{before}&machine=m")["events"]]
        found += part
        if len(part) < 4:
            break
    assert found == whole


def test_the_map_of_a_channel_and_why_there_is_none(watched: Watched, tmp_path: Path) -> None:
    assert watched.page.get("/api/channels/m/x0/map") == {"map": None, "reason": "the channel is not tracked"}
    plan = MapPlan(
        load=(4000.0,), speed=(40.0,), h_d=(0.0, 20e-6), dphi_d=(0.0, math.radians(10.0), math.radians(20.0))
    )
    rms_map = build_map(plan)
    save_map(rms_map, tmp_path / "map.nc")
    config = alarmed_machine(tmp_path)
    text = config.read_text().replace('bearing = "b"\nband_hz', 'bearing = "b"\ntrack = true\nmap = "map.nc"\nband_hz')
    config.write_text(text.replace("speed_hz = 40.0\n", "speed_hz = 40.0\nload_newton = 5000.0\n"))
    put_blocks(config, 1)
    with running(config):
        wait_until(lambda: status(config)["blocks"] == 2)
    with page_of(config) as page:
        found = page.get("/api/channels/m/x0/map")
        (tmp_path / "map.nc").write_bytes(b"no map")
        broken = page.get("/api/channels/m/x0/map")
    assert found["dphi_deg"] == pytest.approx([0.0, 10.0, 20.0])
    assert found["h_d_um"] == pytest.approx([0.0, 20.0])
    assert np.array(found["rms_g"], dtype=float) == pytest.approx(rms_map.rms[0, 0] / G, rel=1e-4, nan_ok=True)
    assert (found["load_newton"], found["calibrated"]) == (4000.0, False)
    assert (found["fault"], found["v_eq"]) == ("outer", f"r_o * dphi_d * h_d, r_o = {1e3 * rms_map.part_radius:.4g} mm")
    assert found["track"] == {"time_s": [], "dphi_deg": [], "h_d_um": [], "v_eq_mm2": []}
    assert broken["map"] is None
    assert str(tmp_path) not in broken["reason"]


def test_the_map_is_that_of_the_part_that_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = MapPlan(load=(4000.0,), speed=(40.0,), h_d=(10e-6, 20e-6), dphi_d=(0.1, 0.2))
    save_map(build_map(plan), tmp_path / "outer.nc")
    save_map(build_map(replace(plan, part="inner")), tmp_path / "inner.nc")
    config = alarmed_machine(tmp_path)
    maps = 'track = true\nmap = ["outer.nc", "inner.nc"]'
    config.write_text(config.read_text().replace('bearing = "b"\nband_hz', f'bearing = "b"\n{maps}\nband_hz'))
    put_blocks(config, 1)
    with running(config):
        wait_until(lambda: status(config)["blocks"] == 2)
    machine = WatchedMachine(load_config(config))
    for fault, shown in (("inner", "inner"), (None, "outer"), ("inner|ball", "inner")):
        monkeypatch.setattr(machine, "status", lambda fault=fault: Status(0, {"channels": {"x0": {"fault": fault}}}))
        found = map_of(machine, "x0", {})
        assert found["fault"] == shown
        assert found["v_eq"].startswith(f"r_{shown[0]} * dphi_d")
    monkeypatch.setattr(machine, "status", lambda: Status(0, {"channels": {"x0": {"fault": "ball"}}}))
    assert map_of(machine, "x0", {}) == {"map": None, "reason": "the channel has no RMS map of the part that is named"}


def many(page: Page, events: Any, **more: Any) -> Reply:
    body = {"events": events, "who": "Ada", "note": "seen", **more}
    return page.post("/api/acknowledge", body, authorization=page.bearer)


def test_many_events_are_acknowledged_each_by_itself(tmp_path: Path) -> None:
    configs = [add_machine(tmp_path, name) for name in ("a", "b")]
    stores = [load_config(config).machine.state_dir / "state.db" for config in configs]
    for store, name in zip(stores, "ab", strict=True):
        with Store.open(store, machine=name), EventLog(store) as log:
            for number in range(3):
                log.notice(1e9, {"kind": "test", "text": str(number)})
            log.notice(1e9, {"kind": "data_again"})
            log.acknowledge("n3", "Ben", "mine", 1e9)
    with page_of(*configs) as page:
        reply = many(page, ["a:n1", "b:n1", "b:n3", "a:n4", "a:n9", "c:n1", "nonsense", "a:n1"])
        assert reply.status == 200
        found = reply.json
        assert [(item["id"], item["result"]) for item in found["results"]] == [
            *(("a:n1", "acknowledged"), ("b:n1", "acknowledged"), ("b:n3", "not_open"), ("a:n4", "not_open")),
            *(("a:n9", "unknown"), ("c:n1", "unknown"), ("nonsense", "unknown")),
        ]
        assert (found["acknowledged"], found["unacknowledged"]) == (2, 2)
        given = found["results"][0]["event"]["acknowledgements"]
        assert [(item["who"], item["note"]) for item in given] == [("Ada", "seen")]
        # Ben was faster, and stays the only one.
        assert [item["who"] for item in found["results"][2]["event"]["acknowledgements"]] == ["Ben"]
        # The store of one is damaged: the other's events are acknowledged all the same.
        stores[1].write_bytes(b"no store")
        results = many(page, ["b:n2", "a:n2"]).json["results"]
        assert [item["result"] for item in results] == ["failed", "acknowledged"]
        assert str(tmp_path) not in results[0]["error"]


def test_a_wrong_request_for_many_acknowledges_nothing(watched: Watched) -> None:
    page = watched.page
    before = page.get("/api/events")["unacknowledged"]
    for events, more in (
        *(([], {}), ("m:n1", {}), ([1], {}), (None, {}), ([f"m:{number}" for number in range(1, 202)], {})),
        *((["m:1"], {"who": " "}), (["m:1"], {"who": "a\nb"}), (["m:1"], {"note": "x" * 2001}), (["m:1"], {"note": 1})),
    ):
        reply = many(page, events, **more)
        assert (reply.status, set(reply.json)) == (400, {"error"}), (events, more)
    assert page.post("/api/acknowledge", {"events": ["m:1"], "who": "Ada"}).status == 401
    assert page.get("/api/events")["unacknowledged"] == before

"""Speed and load of a PLC: read from a real server, used where they hold, recorded, and the same in a replay."""

from __future__ import annotations

import asyncio
import math
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asyncua.server.server import Server
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from monitor.config.load import Config, load_config
from monitor.config.machine import OpcUaCondition
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.neighbours.condition import ConditionProcess, Readings, follow
from monitor.service.neighbours.opcua_server import OpcUaError
from monitor.service.replay import replay
from streams.types.block import Block
from tests.support.daemons import free_port
from tests.support.effort import effort_count
from tests.support.waiting import PATIENCE_S, wait_until

START = datetime(2026, 9, 21, 14, 0, 0, tzinfo=UTC)


def block(start: float | None, duration: float = 2.0, **more: Any) -> Block:
    return Block(np.zeros((1, 100)), 100.0 / duration, ("x",), ("g",), "s", 1, "b", start=start, **more)


def test_the_latest_reading_not_after_the_middle_holds() -> None:
    readings = Readings(max_age=5.0)
    assert readings(block(0.0)).speed is None
    readings.add(2e9, 99.0, 99.0)  # A clock that was ahead, and is set.
    for utc, speed, load in ((10.0, 20.0, 500.0), (11.0, 25.0, None), (12.0, None, 700.0), (13.0, 0.0, math.inf)):
        readings.add(utc, speed, load)

    def found(start: float | None, **more: Any) -> tuple[float | None, str, float | None, str]:
        after = readings(block(start, **more))
        return after.speed, after.speed_source, after.load, after.load_source

    # Middles at 9.9, 10, 11.5, 12, 13, 18 and 18.1 s.
    assert found(8.9) == (None, "block", None, "block")
    assert found(9.0) == (20.0, "opcua", 500.0, "opcua")
    assert found(10.5) == (25.0, "opcua", None, "block")
    assert found(11.0) == (None, "block", 700.0, "opcua")
    assert found(12.0) == found(17.1) == found(None) == (None, "block", None, "block")
    # What the block itself states comes first.
    assert found(9.0, speed=7.0) == (7.0, "block", 500.0, "opcua")


def test_after_a_restart_blocks_of_before_find_their_reading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "readings"
    first = Readings(5.0, path)
    first.add(10.0, 20.0, None)
    first.add(11.0, 21.0, 3.0)
    with path.open("a") as file:
        file.write('[12.0, 99\n{"a": 1}\n[NaN, 1, 1]\n["x", 1, 1]\n\n[13.0, 23')
    again = Readings(5.0, path)
    assert [again(block(start)).speed for start in (8.0, 9.5, 14.9, 15.1)] == [None, 20.0, 21.0, None]
    # The file stays small, and keeps the latest.
    monkeypatch.setattr("monitor.service.neighbours.condition._MAX_BYTES", 2000)
    for at in range(400):
        again.add(20.0 + at, float(at), 1.0)
    assert path.stat().st_size <= 2000
    assert Readings(5.0, path)(block(418.0)).speed == 399.0
    # A place that cannot be written to is no failure.
    Readings(5.0, tmp_path / "absent" / "readings").add(1.0, 2.0, 3.0)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 100), st.floats(1, 50)), max_size=20),
    st.floats(0, 120),
    st.floats(0.1, 50),
)
def test_readings_agree_with_a_search_through_all(
    read: list[tuple[float, float]], middle: float, max_age: float
) -> None:
    read.sort(key=lambda pair: pair[0])
    readings = Readings(max_age)
    for utc, speed in read:
        readings.add(utc, speed, None)
    # The middle as the block has it.
    start = middle - 1.0
    middle = start + 1.0
    holding = [speed for utc, speed in read if utc <= middle and middle - utc <= max_age]
    assert readings(block(start)).speed == (holding[-1] if holding else None)


@contextmanager
def plc() -> Iterator[tuple[str, Any, asyncio.AbstractEventLoop]]:
    """An OPC UA server with the nodes Speed (rpm) and Load (kN); the address, a writer and its loop."""
    from asyncua import ua as typed

    ua: Any = typed
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    def run(action: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(action, loop).result(PATIENCE_S)

    async def begin() -> tuple[Server, Any]:
        server = Server()
        await server.init()
        server.set_endpoint(url)
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace("urn:plc")
        nodes = [
            await server.nodes.objects.add_variable(ua.NodeId(name, space), name, value)
            for name, value in (("Speed", 1500.0), ("Load", 2.5))
        ]
        await server.start()
        return server, nodes[0]

    url = f"opc.tcp://127.0.0.1:{free_port()}"
    server, speed = run(begin())

    def write(value: float, status: str = "Good") -> None:
        code = ua.StatusCode(getattr(ua.StatusCodes, status))
        run(server.write_attribute_value(speed.nodeid, ua.DataValue(ua.Variant(value), StatusCode=code)))

    try:
        yield url, write, loop
    finally:
        run(server.stop())
        loop.call_soon_threadsafe(loop.stop)
        thread.join(PATIENCE_S)
        loop.close()


def section_of(url: str, **more: Any) -> OpcUaCondition:
    nodes = {"speed_node": "ns=2;s=Speed", "speed_scale": 1 / 60, "load_node": "ns=2;s=Load", "load_scale": 1000.0}
    return OpcUaCondition(url=url, **{"interval_s": 0.05, **nodes, **more})


def test_nodes_of_a_real_server_are_read_with_their_quality() -> None:
    heard: list[dict[str, Any]] = []
    with plc() as (url, write, loop):
        task = asyncio.run_coroutine_threadsafe(follow(section_of(url), heard.append), loop)
        wait_until(lambda: heard)
        assert heard[0]["reading"][1:] == pytest.approx([25.0, 2500.0])
        assert heard[0]["problem"] is None
        write(1800.0)
        wait_until(lambda: heard[-1]["reading"][1] == pytest.approx(30.0))
        write(1800.0, "BadSensorFailure")
        wait_until(lambda: heard[-1]["reading"][1] is None)
        assert heard[-1]["reading"][2] == pytest.approx(2500.0)
        assert heard[-1]["problem"] == "ns=2;s=Speed: its quality is BadSensorFailure"
        task.cancel()
        lost: list[dict[str, Any]] = []
        other = asyncio.run_coroutine_threadsafe(
            follow(section_of(f"opc.tcp://127.0.0.1:{free_port()}"), lost.append), loop
        )
        wait_until(lambda: lost)
        other.cancel()
        assert "opc.tcp://127.0.0.1" in lost[0]["problem"]
        # A node that is not there is a problem, too, and the other is read on.
        absent: list[dict[str, Any]] = []
        third = asyncio.run_coroutine_threadsafe(follow(section_of(url, speed_node="ns=2;s=None"), absent.append), loop)
        wait_until(lambda: absent)
        third.cancel()
    assert absent[0]["reading"][1:] == [None, pytest.approx(2500.0)]
    assert "BadNodeIdUnknown" in absent[0]["problem"]


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "asyncua.client.client", None)
    with pytest.raises(OpcUaError, match=r'pip install "spallwatch\[opcua\]"'):
        asyncio.run(follow(section_of("opc.tcp://127.0.0.1:1"), print))


@pytest.mark.process
@pytest.mark.skipif(effort_count(quick=0, full=1) == 0, reason="starts for seconds: SPALLWATCH_EFFORT=full")
def test_the_companion_reads_beside_the_daemon(tmp_path: Path) -> None:
    with plc() as (url, _, _):
        companion = ConditionProcess(section_of(url), tmp_path)
        try:
            now = datetime.now(UTC).timestamp()
            wait_until(lambda: companion(block(now + 5.0, duration=0.01)).speed is not None)
            assert companion.problem is None
        finally:
            companion.close()


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"speed_node": None, "load_node": None}, "expected speed_node, load_node or both"),
        ({"url": "opc.tcp://me:secret@127.0.0.1"}, "a name or password does not belong here"),
        ({"speed_node": "Speed"}, "speed_node"),
        ({"cert_file": "c"}, "cert_file, key_file and server_cert_file come together"),
        ({"url": "opc.tcp://plc", "username_file": "u", "password_file": "p"}, "else nothing is encrypted"),
    ],
)
def test_a_section_that_cannot_work_is_refused(keys: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValidationError, match=expected):
        section_of(**{"url": "opc.tcp://127.0.0.1", **keys})


def watched(folder: Path, operating: str = "") -> Config:
    """A machine that watches a folder of dated CSV files, of a second each, with a PLC that nobody reaches."""
    path = folder / "m.toml"
    path.write_text(
        f'[machine]\nname = "m"\nmin_free_mb = 1\nstate_dir = "{folder / "state"}"\n'
        f'records_dir = "{folder / "records"}"\n[web]\nenabled = false\n'
        '[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n'
        f'[operating]\n{operating}[operating.opcua]\nurl = "opc.tcp://127.0.0.1:1"\n'
        'speed_node = "ns=2;s=Speed"\nload_node = "ns=2;s=Load"\n'
        f'[[source]]\nname = "s"\nurl = "folder:{folder / "in"}"\nformat = "csv"\nrate_hz = 2560\n'
        'settle_s = 0.01\nblock_s = "file"\ntime_from = "name"\ntime_name = "%Y%m%d%H%M%S"\n'
        '[[channel]]\nname = "x"\nsource = "s"\ncolumn = 1\nunit = "g"\nbearing = "b"\nband_hz = [[300, 1200]]\n'
    )
    return load_config(path)


def files(folder: Path, number: int) -> None:
    folder.mkdir()
    for at in range(number):
        samples = np.random.default_rng(at).normal(size=2560)
        name = (START + timedelta(seconds=10 * at)).strftime("%Y%m%d%H%M%S")
        (folder / f"{name}.csv").write_text("\n".join(f"{value:.5f}" for value in samples) + "\n")


def test_a_replay_without_the_plc_uses_what_the_live_run_recorded(tmp_path: Path) -> None:
    config = watched(tmp_path)
    files(tmp_path / "in", 4)
    readings = Readings(max_age=5.0)
    # Of the third block there is no reading that is young enough.
    for at, speed in ((0.0, 30.0), (10.2, 31.0), (30.1, 29.0)):
        readings.add(START.timestamp() + at, speed, 1000.0 + at)
    stop = threading.Event()
    with Store.open(tmp_path / "state" / "state.db", machine="m") as store:
        with Ingest.open(config, store, lambda: START.timestamp() + 60.0, condition=readings) as ingest:
            wait_until(lambda: ingest.step(stop) is not None and store.last("s") == 4)
        live = [store.record("s", number) for number in range(1, 5)]
    again = replay(config, str(tmp_path / "in"), tmp_path / "out").summary
    with Store.open(tmp_path / "out" / "state.db", read_only=True) as store:
        replayed = [store.record("s", number) for number in range(1, 5)]
    assert again["condition"] is not None
    assert again["condition"].endswith("for 3 blocks, unknown for 1")
    found = []
    for one, other in zip(live, replayed, strict=True):
        assert one is not None
        assert other is not None
        assert (one.status, one.reason, one.channels) == (other.status, other.reason, other.channels)
        values = one.channels.get("x", {})
        found.append((one.status, *(values.get(key) for key in ("speed", "speed_source", "load", "load_source"))))
    assert found[0] == ("ok", 30.0, "opcua", 1000.0, "opcua")
    assert found[1] == ("ok", 31.0, "opcua", 1010.2, "opcua")
    assert found[2][0] == "incomplete"
    assert live[2] is not None
    assert "not read over OPC UA" in live[2].reason
    assert found[3] == ("ok", 29.0, "opcua", 1030.1, "opcua")


def test_a_replay_without_a_live_run_says_that_it_is_missing(tmp_path: Path) -> None:
    files(tmp_path / "in", 2)
    unknown = replay(watched(tmp_path), str(tmp_path / "in"), tmp_path / "out").summary
    assert "no store of a live run" in unknown["condition"]
    assert unknown["rejected"] == {"incomplete": 2}
    # What else is configured takes its place, and the record says so.
    replay(watched(tmp_path, "speed_hz = 30.0\n"), str(tmp_path / "in"), tmp_path / "other")
    with Store.open(tmp_path / "other" / "state.db", read_only=True) as store:
        record = store.record("s", 1)
    assert record is not None
    assert record.channels["x"]["speed_source"] == "configured"


def test_the_hash_of_other_configurations_stays_and_says_what_is_read(tmp_path: Path) -> None:
    config = watched(tmp_path)
    given = config.operating
    assert given.opcua is not None

    def hash_with(**more: Any) -> str:
        changed = None if more.get("none") else section_of("opc.tcp://127.0.0.1:1", **more)
        return config.model_copy(update={"operating": given.model_copy(update={"opcua": changed})}).hash

    assert hash_with(interval_s=0.5) == hash_with(interval_s=1.0)
    assert len({hash_with(none=True), hash_with(), hash_with(max_age_s=3.0), hash_with(speed_scale=1.0)}) == 4

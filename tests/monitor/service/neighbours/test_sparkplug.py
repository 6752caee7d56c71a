"""Sparkplug B over a real broker: births, changes and deaths as the specification asks, read by another decoder."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from monitor.config.load import ConfigError
from monitor.config.outputs import SparkplugSection
from monitor.service.broker import BrokerLink
from monitor.service.neighbours.points import MachineSnapshot, channels_of
from monitor.service.neighbours.sparkplug import _MIN_REBIRTH_S, REBIRTH, Metric, Payloads, Sparkplug, _Node
from streams.link.mqtt_client import end_client
from tests.monitor.service.neighbours.machines import STATUS, Machine
from tests.support.broker import Broker
from tests.support.proxy import Proxy
from tests.support.sparkplug_decoder import BAD, GOOD, STALE, Payload, decode, rebirth_command
from tests.support.waiting import PATIENCE_S, wait_until

Heard = list[tuple[str, str | None, Payload]]


@contextlib.contextmanager
def host(port: int) -> Iterator[tuple[Client, Heard]]:
    """A host application: all messages of the group, as kind, device and payload."""
    heard: Heard = []
    asked = []

    def take(client: Any, userdata: Any, message: Any) -> None:
        _, _, kind, node, *device = message.topic.split("/")
        assert node == "pump"
        if kind != "NCMD":
            assert not message.retain
            heard.append((kind, device[0] if device else None, decode(message.payload)))

    client = Client(CallbackAPIVersion.VERSION2)
    client.on_message = take
    client.on_subscribe = lambda *_: asked.append(1)
    client.connect("127.0.0.1", port)
    client.loop_start()
    try:
        client.subscribe("spBv1.0/plant/#", qos=1)
        wait_until(lambda: asked)
        yield client, heard
    finally:
        end_client(client)


@contextlib.contextmanager
def publishing(machine: Machine, port: int) -> Iterator[Sparkplug]:
    section = SparkplugSection(url=f"mqtt://127.0.0.1:{port}/plant")
    node = Sparkplug(section, "pump", channels_of(machine.config), machine.folder)
    try:
        yield node
    finally:
        node.close(PATIENCE_S)


def check_numbers(heard: Heard) -> None:
    """Numbers begin at 0 with each birth of the node, and count on; a death has none."""
    expected = None
    for kind, _, payload in heard:
        if kind == "NDEATH":
            assert payload.seq is None
            continue
        expected = 0 if kind == "NBIRTH" or expected is None else (expected + 1) % 256
        assert payload.seq == expected


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    machine = Machine(tmp_path)
    yield machine
    machine.close()


@pytest.mark.broker
def test_births_changes_rebirth_and_death(tmp_path: Path, machine: Machine) -> None:
    machine.add()
    with Broker(tmp_path / "broker") as broker, host(broker.port) as (client, heard):
        with publishing(machine, broker.port) as node:
            wait_until(lambda: len(heard) == 3)
            machine.add(status="clipped", flags=("clipped",))
            node.changed()
            wait_until(lambda: len(heard) == 5)
            machine.show(STATUS | {"state": "failure"})
            node.changed()
            wait_until(lambda: len(heard) == 6)
            client.publish("spBv1.0/plant/NCMD/pump", b"\xff\xff")
            client.publish("spBv1.0/plant/NCMD/pump", rebirth_command())
            wait_until(lambda: len(heard) == 9)
        wait_until(lambda: len(heard) == 10)
    assert [(kind, device) for kind, device, _ in heard] == [
        *(("NBIRTH", None), ("DBIRTH", "x"), ("DBIRTH", "y")),
        *(("DDATA", "x"), ("DDATA", "y"), ("NDATA", None)),
        *(("NBIRTH", None), ("DBIRTH", "x"), ("DBIRTH", "y"), ("NDEATH", None)),
    ]
    check_numbers(heard)
    own, x, y, clipped, _, failed, again, x_again, _, death = [payload for _, _, payload in heard]

    # A birth has all metrics, each with name, alias and type.
    assert (own.by_name["bdSeq"].value, own.by_name["bdSeq"].datatype) == (0, 4)
    rebirth = own.by_name["Node Control/Rebirth"]
    assert (rebirth.value, rebirth.datatype, rebirth.alias) == (False, 11, None)
    assert own.by_name["de/fault"].value == "outer"
    assert (own.by_name["state"].value, own.by_name["device_health"].value) == ("maintenance_required", 4)
    level, size = x.by_name["rms_g"], x.by_name["v_eq_mm2"]
    assert (level.value, level.datatype, level.timestamp) == (pytest.approx(1.0), 10, 1_790_000_001_000)
    assert (size.value, size.properties) == (pytest.approx(0.02), {"Quality": GOOD, "uncertain": 1})
    assert (x.by_name["t_fs_block"].value, x.by_name["t_fs_block"].datatype) == (1, 4)
    none, old = y.by_name["v_eq_mm2"], y.by_name["rms_g"]
    assert (none.null, none.value, none.properties) == (True, None, {"Quality": BAD})
    assert (old.value, old.properties) == (pytest.approx(1.0), {"Quality": STALE})
    aliases = [metric.alias for payload in (own, x, y) for metric in payload.metrics if metric.alias is not None]
    assert len(set(aliases)) == len(aliases)

    # What changes comes by its alias alone.
    names = {metric.alias: metric.name for payload in (own, x, y) for metric in payload.metrics}
    assert all(metric.name is None and metric.datatype is None for metric in clipped.metrics)
    changed = {names[metric.alias]: metric for metric in clipped.metrics}
    assert (changed["rms_g"].value, changed["rms_g"].properties["uncertain"]) == (pytest.approx(2.0), 1)
    assert changed["flags"].value == "clipped"
    assert {names[metric.alias]: metric.value for metric in failed.metrics} == {"state": "failure", "device_health": 1}

    # Births on demand are of the present, the death is that of this connection.
    assert again.by_name["state"].value == "failure"
    assert x_again.by_name["rms_g"].value == pytest.approx(2.0)
    assert [(metric.name, metric.value) for metric in death.metrics] == [("bdSeq", 0)]


@pytest.mark.broker
def test_after_a_cut_the_death_comes_then_births_and_what_was_missed(
    tmp_path: Path, machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    reachable = threading.Event()
    reachable.set()

    class Link(BrokerLink):
        def connect(self) -> None:
            assert reachable.wait(PATIENCE_S)
            super().connect()

    monkeypatch.setattr("monitor.service.neighbours.sparkplug.BrokerLink", Link)
    machine.add()
    with (
        Broker(tmp_path / "broker") as broker,
        host(broker.port) as (_, heard),
        Proxy(broker.port) as proxy,
        publishing(machine, proxy.port) as node,
    ):
        wait_until(lambda: len(heard) == 3)
        reachable.clear()
        proxy.cut()
        wait_until(lambda: len(heard) == 4 and node.problem is not None)
        machine.add()
        machine.add()
        reachable.set()
        wait_until(lambda: len(heard) == 11)
        assert node.problem is None
    kinds = [(kind, device) for kind, device, _ in heard[3:11]]
    births = [("NBIRTH", None), ("DBIRTH", "x"), ("DBIRTH", "y")]
    assert kinds == [("NDEATH", None), *births, *([("DDATA", "x"), ("DDATA", "y")] * 2)]
    assert heard[3][2].by_name["bdSeq"].value == 0
    assert heard[4][2].by_name["bdSeq"].value == 1
    check_numbers(heard)
    names = {metric.alias: metric.name for _, _, payload in heard[4:7] for metric in payload.metrics}
    missed = [payload.metrics for kind, device, payload in heard[7:11] if device == "x"]
    assert all(metric.historical for metrics in missed for metric in metrics)
    values = [{names[metric.alias]: metric.value for metric in metrics} for metrics in missed]
    assert [found["block"] for found in values] == [2, 3]
    assert [found["rms_g"] for found in values] == pytest.approx([2.0, 3.0])
    assert "state" not in values[0]


WRONG_COMMANDS = (
    b"",
    b"\xff\xff",
    b"\x0b" * 10_000,
    b"\x12\x05\x0a\x03\xff\xfe\xfd",
    rebirth_command()[:-1],
    rebirth_command().replace(b"Rebirth", b"Reboots"),
    # A rebirth that is false, one that is a number, an alias that is not known, and another metric of 1970.
    Payloads().encode([Metric(REBIRTH, None, "flag", False, 0)], 0),
    Payloads().encode([Metric(REBIRTH, None, "int", 1, 0)], 0),
    Payloads().encode([Metric(None, 2**63, "flag", True, 0)], 0),
    Payloads().encode([Metric("x" * 60_000, 1, "text", "y" * 60_000, 0)], 0, 255),
    rebirth_command() + bytes(1 << 20),
)


@pytest.mark.broker
def test_wrong_commands_lead_to_no_births_and_a_storm_of_right_ones_to_few(tmp_path: Path, machine: Machine) -> None:
    machine.add()
    with Broker(tmp_path / "broker") as broker, host(broker.port) as (client, heard):

        def births() -> int:
            return [kind for kind, _, _ in heard].count("NBIRTH")

        with publishing(machine, broker.port) as node:
            wait_until(lambda: len(heard) == 3)
            for wrong in WRONG_COMMANDS:
                client.publish("spBv1.0/plant/NCMD/pump", wrong)
            time.sleep(1.5 * _MIN_REBIRTH_S)
            assert births() == 1
            begin = time.monotonic()
            sent = [client.publish("spBv1.0/plant/NCMD/pump", rebirth_command(), qos=1) for _ in range(500)]
            machine.add()
            node.changed()
            wait_until(lambda: any(kind == "DDATA" for kind, _, _ in heard), lambda: len(heard))
            wait_until(lambda: all(info.is_published() for info in sent))
            time.sleep(1.5 * _MIN_REBIRTH_S)
            during = births()
            assert 2 <= during <= 3 + (time.monotonic() - begin) / _MIN_REBIRTH_S
            client.publish("spBv1.0/plant/NCMD/pump", rebirth_command())
            wait_until(lambda: births() == during + 1)
            assert node.problem is None
    check_numbers(heard)


def test_numbers_of_messages_begin_anew_after_255(machine: Machine) -> None:
    node = _Node("spBv1.0/plant", "pump", channels_of(machine.config), Payloads(), 0)
    messages = node.births(MachineSnapshot(STATUS))
    for number in range(300):
        messages += node.changes(MachineSnapshot(STATUS, events=number))
    assert len(messages) == 303
    check_numbers([(topic.split("/")[2], None, decode(content)) for topic, content in messages])
    assert node.changes(MachineSnapshot(STATUS, events=299)) == []


def test_negative_integers_travel_as_their_complement() -> None:
    content = Payloads().encode([Metric("n", 1, "int", -5, 2), Metric("b", None, "flag", True, 2)], 3, 4)
    found = decode(content)
    assert (found.timestamp, found.seq) == (3, 4)
    assert [metric.value for metric in found.metrics] == [-5, True]


def test_without_the_library_it_says_what_to_install(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "google.protobuf", None)
    with publishing(machine, 1) as node:
        wait_until(lambda: node.problem is not None)
    assert node.problem is not None
    assert 'pip install "spallwatch[sparkplug]"' in node.problem


def test_a_group_is_one_name(tmp_path: Path) -> None:
    machine = Machine(tmp_path, '[publish.sparkplug]\nurl = "mqtt://127.0.0.1/plant/line"\n')
    machine.close()
    with pytest.raises(ConfigError, match=r"expected one group after the host.*found 'plant/line'"):
        _ = machine.config

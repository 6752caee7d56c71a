"""MQTT Sparkplug B: the machine as an edge node, its channels as devices.

Each connection begins with the births, which hold every metric with its latest value; changes follow by their aliases.
A worker thread reads store and status; an unreachable broker delays nothing else. Records that were committed while it
was away follow after the births, marked as historical.

The payload is a message of Protocol Buffers, declared here field by field, as in ``sparkplug_b.proto`` of version 3.0
of the specification, so that no generated file is tied to a version of the library. pysparkplug, the kept library for
Sparkplug, needs paho-mqtt before 2.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from models.words.errors import SpallwatchError
from monitor.config.load import Config
from monitor.config.outputs import SparkplugSection
from monitor.records.database import SharedConnection
from monitor.records.durable import replacing
from monitor.records.queries import StoredRecord, newest_id, records_after
from monitor.service.broker import BrokerLink, Sessions
from monitor.service.neighbours.points import (
    Kind,
    MachineChannel,
    MachinePoint,
    MachineSnapshot,
    PointPath,
    Quality,
    Snapshots,
    Value,
    channels_of,
    points_of,
)

_LOG = logging.getLogger(__name__)
STATE = "sparkplug.json"
"""File in the state folder: the number of the last connection."""
_NAMESPACE = "spBv1.0"
_MAX_ROWS = 100
_POLL_S = 1.0
_MIN_LOOK_S = 0.02
_MIN_REBIRTH_S = 2.0
_CONFIRM_S = 5.0
_LEFT_OUT = ("updated_utc",)
"""Points that change at each look."""
REBIRTH = "Node Control/Rebirth"
BD_SEQ = "bdSeq"
MISSING = 'sparkplug needs protobuf and paho-mqtt: pip install "spallwatch[sparkplug]"'
_PACKAGE = "org.eclipse.tahu.protobuf"
_FIELDS = {
    "Payload": "1 timestamp uint64, 2 metrics Metric*, 3 seq uint64, 4 uuid string, 5 body bytes",
    "Metric": "1 name string, 2 alias uint64, 3 timestamp uint64, 4 datatype uint32, 5 is_historical bool, "
    "6 is_transient bool, 7 is_null bool, 9 properties PropertySet, 10 int_value uint32, 11 long_value uint64, "
    "12 float_value float, 13 double_value double, 14 boolean_value bool, 15 string_value string, 16 bytes_value bytes",
    "PropertySet": "1 keys string*, 2 values PropertyValue*",
    "PropertyValue": "1 type uint32, 2 is_null bool, 3 int_value uint32, 7 boolean_value bool, 8 string_value string",
}
_INT32, _INT64, _DOUBLE, _BOOLEAN, _STRING = 3, 4, 10, 11, 12
_DATATYPES: dict[Kind | str, tuple[int, str]] = {
    "int": (_INT64, "long_value"),
    "float": (_DOUBLE, "double_value"),
    "text": (_STRING, "string_value"),
    "flag": (_BOOLEAN, "boolean_value"),
}
"""Data type of a kind, and the field of its value."""
_QUALITY: dict[Quality, int] = {"good": 192, "uncertain": 192, "old": 500, "bad": 0}
"""Codes of the property ``Quality``: good, stale, bad; there is none for a reservation."""
Message = tuple[str, bytes]
"""Topic and payload."""


class SparkplugError(SpallwatchError):
    """No payload can be made; the message says what to install."""


@dataclass(frozen=True)
class Metric:
    """One metric.

    Attributes:
        name: None where the alias stands for it.
        kind: of a point, or "flag".
        time: ms since 1970 UTC.
        typed: whether its data type is sent, as births do.
        quality: None: none is sent.
    """

    name: str | None
    alias: int | None
    kind: Kind | str
    value: Value
    time: int
    typed: bool = True
    historical: bool = False
    quality: Quality | None = None


class Payloads:
    """Encodes and decodes payloads."""

    def __init__(self) -> None:
        """Declare the message.

        Raises:
            SparkplugError: protobuf is missing.
        """
        try:
            from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
        except ModuleNotFoundError:
            raise SparkplugError(MISSING) from None
        pool = descriptor_pool.DescriptorPool()
        pool.Add(_file_of(descriptor_pb2))
        self._payload: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.Payload"))

    def encode(self, metrics: Iterable[Metric], time: int, seq: int | None = None) -> bytes:
        """Return a payload made at ``time`` (ms since 1970 UTC); a death has no ``seq``."""
        payload = self._payload(timestamp=time)
        if seq is not None:
            payload.seq = seq
        for metric in metrics:
            _fill(payload.metrics.add(), metric)
        return payload.SerializeToString()

    def asks_rebirth(self, content: bytes) -> bool:
        """Return whether a command to the node asks for its births; False for what is no payload."""
        from google.protobuf.message import DecodeError

        try:
            payload = self._payload.FromString(content)
        except DecodeError:
            return False
        return any(metric.name == REBIRTH and metric.boolean_value for metric in payload.metrics)


def _fill(message: Any, metric: Metric) -> None:
    """Write a metric into its message."""
    datatype, field = _DATATYPES[metric.kind]
    if metric.name is not None:
        message.name = metric.name
    if metric.alias is not None:
        message.alias = metric.alias
    message.timestamp = metric.time
    if metric.typed:
        message.datatype = datatype
    if metric.historical:
        message.is_historical = True
    if metric.value is None:
        message.is_null = True
    elif isinstance(metric.value, int) and field == "long_value":
        # Signed integers travel as the two's complement.
        message.long_value = metric.value & 0xFFFF_FFFF_FFFF_FFFF
    else:
        setattr(message, field, metric.value)
    if metric.quality is not None:
        message.properties.keys.append("Quality")
        message.properties.values.add(type=_INT32, int_value=_QUALITY[metric.quality])
        if metric.quality == "uncertain":
            message.properties.keys.append("uncertain")
            message.properties.values.add(type=_BOOLEAN, boolean_value=True)


def _file_of(pb2: Any) -> Any:
    """Return the declaration of the message."""
    file = pb2.FileDescriptorProto(name="spallwatch/sparkplug_b.proto", package=_PACKAGE, syntax="proto2")
    types = {name[5:].lower(): number for name, number in pb2.FieldDescriptorProto.Type.items()}
    for name, fields in _FIELDS.items():
        declared = file.message_type.add(name=name)
        for field in fields.split(", "):
            number, label, kind = field.split()
            repeated = pb2.FieldDescriptorProto.LABEL_REPEATED if kind.endswith("*") else 1
            kind = kind.rstrip("*")
            more = {"type": types[kind]} if kind in types else {"type_name": f".{_PACKAGE}.{kind}"}
            declared.field.add(name=label, number=int(number), label=repeated, **more)
    return file


class Sparkplug(Sessions):
    """Publishes a machine; a failure is a :attr:`problem`, never an exception."""

    _expected = (*Sessions._expected, SparkplugError)

    def __init__(
        self, section: SparkplugSection | None, machine: str, channels: tuple[MachineChannel, ...], state_dir: Path
    ) -> None:
        """Begin to publish; nothing without a section. ``state_dir`` holds store and status file."""
        super().__init__("publish-sparkplug", "by Sparkplug")
        if section is None:
            return
        self._section, self._machine, self._channels = section, machine, channels
        self._state_dir, self._store = state_dir, state_dir / "state.db"
        self._snapshots = Snapshots(machine, (channel.source for channel in channels), state_dir)
        self._place: int | None = None
        self.start()

    @classmethod
    def open(cls, config: Config) -> Sparkplug:
        """Return what publishes a machine as ``[publish.sparkplug]`` says."""
        return cls(config.publish.sparkplug, config.machine.name, channels_of(config), config.machine.state_dir)

    def _session(self) -> None:
        """Publish over one connection, until the end or its loss."""
        self._connected = False
        payloads = Payloads()
        with SharedConnection(self._store) as store:
            if self._place is None:
                self._place = newest_id(store)
            number = self._next_connection()
            death = payloads.encode([Metric(BD_SEQ, None, "int", number, _now())], _now())
            node = _Node(f"{_NAMESPACE}/{self._section.topic}", self._machine, self._channels, payloads, number)
            will = (node.topic("NDEATH"), death)
            link = BrokerLink(self._section, will=will, keep_will=False, wake=self.changed)
            try:
                link.connect()
                link.subscribe(node.topic("NCMD"))
                self._works()
                self._follow(link, node, store)
                # A broker that is told goodbye keeps the will to itself.
                link.wait_confirmed({link.publish(node.topic("NDEATH"), death)}, min(_CONFIRM_S, self._left()))
            finally:
                link.close()

    def _follow(self, link: BrokerLink, node: _Node, store: SharedConnection) -> None:
        assert self._place is not None
        newest = newest_id(store)
        snapshot = self._snapshots.read()
        _send(link, node.births(snapshot))
        born, asked = time.monotonic(), False
        self._send_history(link, node, store, newest)
        while True:
            with self._wake:
                self._news, ending = False, self._ending
            link.check()
            asked = any(node.asks_rebirth(content) for _, content in link.take_messages()) or asked
            if asked and time.monotonic() - born >= _MIN_REBIRTH_S:
                _send(link, node.births(snapshot))
                born, asked = time.monotonic(), False
            found = list(records_after(store, self._machine, self._place, _MAX_ROWS))
            for number, record in found:
                snapshot = replace(snapshot, records={**snapshot.records, record.source: record})
                _send(link, node.changes(snapshot))
                self._place = number
            if found:
                continue
            snapshot = self._snapshots.read()
            _send(link, node.changes(snapshot))
            if ending:
                return
            with self._wake:
                # Commands in any number wake it, each look reads the store.
                self._wake.wait_for(lambda: self._ending, _MIN_LOOK_S)
                self._wake.wait_for(lambda: self._news or self._ending, _MIN_REBIRTH_S / 10 if asked else _POLL_S)

    def _send_history(self, link: BrokerLink, node: _Node, store: SharedConnection, newest: int) -> None:
        """Send the records after the position that came before the births, at the configured rate."""
        while (place := self._place or 0) < newest:
            began = time.monotonic()
            found = [item for item in records_after(store, self._machine, place, _MAX_ROWS) if item[0] <= newest]
            for number, record in found:
                link.check()
                _send(link, node.history(record))
                self._place = number
            if not found:
                self._place = newest
            pause = len(found) / self._section.most_per_s - (time.monotonic() - began)
            with self._wake:
                if self._wake.wait_for(lambda: self._ending, max(0.0, pause)):
                    return

    def _left(self) -> float:
        return max(0.0, self._until - time.monotonic())

    def _next_connection(self) -> int:
        """Return the number of a new connection, 0 to 255; after a full disk, numbers repeat after a restart."""
        path = self._state_dir / STATE
        try:
            last = int(json.loads(path.read_text(encoding="utf-8"))["bd_seq"])
        except (OSError, ValueError, KeyError, TypeError):
            last = -1
        number = (last + 1) % 256
        try:
            with replacing(path) as temporary:
                temporary.write_text(json.dumps({"bd_seq": number}), encoding="utf-8")
        except OSError as error:
            _LOG.debug("%s cannot be written: %s", path, error)
        return number


class _Node:
    """The messages of an edge node over one connection: their numbers, aliases and what was sent."""

    def __init__(
        self, group: str, machine: str, channels: tuple[MachineChannel, ...], payloads: Payloads, connection: int
    ) -> None:
        self._group, self._machine, self._payloads = group, machine, payloads
        self._channels, self._connection = channels, connection
        self._seq = 0
        self._sent: dict[PointPath, MachinePoint] = {}
        self._alias = {path: number for number, path in enumerate(self._points(MachineSnapshot()), start=1)}

    def topic(self, kind: str, device: str | None = None) -> str:
        """Return the topic of a kind of message."""
        return "/".join((self._group, kind, self._machine, *([] if device is None else [device])))

    def asks_rebirth(self, content: bytes) -> bool:
        """Return whether a command asks for the births."""
        return self._payloads.asks_rebirth(content)

    def births(self, snapshot: MachineSnapshot) -> list[Message]:
        """Return the births of node and devices, which hold all metrics."""
        self._seq = 0
        self._sent = self._points(snapshot)
        now = _now()
        own = [
            Metric(BD_SEQ, None, "int", self._connection, now),
            Metric(REBIRTH, None, "flag", False, now),
        ]
        found = [self._message("NBIRTH", None, [*own, *self._metrics(self._of(None, self._sent), named=True)])]
        for channel in self._channels:
            metrics = self._metrics(self._of(channel, self._sent), named=True)
            found.append(self._message("DBIRTH", channel.name, metrics))
        return found

    def changes(self, snapshot: MachineSnapshot) -> list[Message]:
        """Return what differs in value or quality from what was sent; an equal value of a later block is not news."""
        points = self._points(snapshot)
        new = {
            path: point
            for path, point in points.items()
            if replace(point, time=None) != replace(self._sent[path], time=None)
        }
        self._sent = points
        found = []
        for channel in (None, *self._channels):
            metrics = self._metrics(self._of(channel, new))
            if metrics:
                kind = "NDATA" if channel is None else "DDATA"
                found.append(self._message(kind, None if channel is None else channel.name, metrics))
        return found

    def history(self, record: StoredRecord) -> list[Message]:
        """Return the values of an earlier record."""
        # With the state of a channel that runs: its values were not old then.
        status = {"running": True, "channels": {channel.name: {} for channel in self._channels}}
        points = points_of(self._channels, MachineSnapshot(status, {record.source: record}))
        found = []
        for channel in self._channels:
            if channel.source == record.source:
                # What the status file says is of the present.
                of_block = {
                    path: point
                    for path, point in self._of(channel, points).items()
                    if path[-1] not in ("state", "state_reason", "headline", "action", "device_health", "alarms")
                }
                found.append(self._message("DDATA", channel.name, self._metrics(of_block, historical=True)))
        return found

    def _points(self, snapshot: MachineSnapshot) -> dict[PointPath, MachinePoint]:
        found = points_of(self._channels, snapshot)
        return {path: point for path, point in found.items() if path[-1] not in _LEFT_OUT}

    def _of(
        self, channel: MachineChannel | None, points: Mapping[PointPath, MachinePoint]
    ) -> dict[PointPath, MachinePoint]:
        """Return the points of a channel, or those of machine and bearings."""
        if channel is None:
            return {path: point for path, point in points.items() if len(path) < 3}
        return {path: point for path, point in points.items() if path[1:-1] == (channel.name,)}

    def _metrics(
        self, points: Mapping[PointPath, MachinePoint], *, named: bool = False, historical: bool = False
    ) -> list[Metric]:
        now = _now()
        return [
            Metric(
                # A device has one channel; the node has machine and bearings.
                ("/".join(path) if len(path) < 3 else path[-1]) if named else None,
                self._alias[path],
                point.kind,
                point.value,
                now if point.time is None else round(1e3 * max(0.0, point.time)),
                typed=named,
                historical=historical,
                quality=point.quality,
            )
            for path, point in points.items()
        ]

    def _message(self, kind: str, device: str | None, metrics: Iterable[Metric]) -> Message:
        content = self._payloads.encode(metrics, _now(), self._seq)
        self._seq = (self._seq + 1) % 256
        return self.topic(kind, device), content


def _send(link: BrokerLink, messages: Iterable[Message]) -> None:
    """Send births and data, for which the specification asks QoS 0."""
    for topic, content in messages:
        link.publish(topic, content, qos=0)


def _now() -> int:
    return time.time_ns() // 1_000_000

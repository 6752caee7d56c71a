"""The payload of MQTT Sparkplug B 3.0: metrics as a message of Protocol Buffers, and commands back.

The message is declared here field by field, as in ``sparkplug_b.proto`` of the specification, so that no generated file
is tied to a version of the library. pysparkplug, the kept library for Sparkplug, needs paho-mqtt before 2.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from models.errors import SpallwatchError
from monitor.service.neighbours.points import Kind, Quality, Value

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

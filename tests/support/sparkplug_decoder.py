"""A decoder of Sparkplug B payloads for tests, from the field numbers of the specification; it shares no code.

Protocol Buffers on the wire: each field begins with a varint, number times 8 plus kind; kind 0 is a varint, 1 eight
bytes, 2 a length and as many bytes, 5 four bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

BAD, GOOD, STALE = 0, 192, 500


@dataclass
class Decoded:
    """A metric as it came."""

    name: str | None = None
    alias: int | None = None
    timestamp: int | None = None
    datatype: int | None = None
    historical: bool = False
    null: bool = False
    value: Any = None
    properties: dict[str, Any] = field(default_factory=dict)


@dataclass
class Payload:
    """A payload as it came."""

    timestamp: int | None = None
    seq: int | None = None
    metrics: list[Decoded] = field(default_factory=list)

    @property
    def by_name(self) -> dict[str | None, Decoded]:
        """The metrics by name."""
        return {metric.name: metric for metric in self.metrics}


def decode(content: bytes) -> Payload:
    """Decode a payload."""
    found = Payload()
    for number, value in _fields(content):
        match number:
            case 1:
                found.timestamp = value
            case 2:
                found.metrics.append(_metric(value))
            case 3:
                found.seq = value
            case _:
                raise AssertionError(f"field {number} of a payload")
    return found


_METRIC = {
    1: ("name", bytes.decode),
    2: ("alias", int),
    3: ("timestamp", int),
    4: ("datatype", int),
    5: ("historical", bool),
    7: ("null", bool),
    11: ("value", lambda value: value - 2**64 if value >= 2**63 else value),
    13: ("value", lambda value: struct.unpack("<d", value)[0]),
    14: ("value", bool),
    15: ("value", bytes.decode),
}
"""Fields of a metric by number; another one is an error."""


def _metric(content: bytes) -> Decoded:
    found = Decoded()
    for number, value in _fields(content):
        if number == 9:
            found.properties = _properties(value)
        else:
            name, of_wire = _METRIC[number]
            setattr(found, name, of_wire(value))
    return found


def _properties(content: bytes) -> dict[str, Any]:
    keys, values = [], []
    for number, value in _fields(content):
        if number == 1:
            keys.append(value.decode())
        else:
            parts = dict(_fields(value))
            assert parts[1] == {3: 3, 7: 11, 8: 12}[next(key for key in parts if key != 1)]
            values.append(next(part for key, part in parts.items() if key != 1))
    return dict(zip(keys, values, strict=True))


def _fields(content: bytes) -> Iterator[tuple[int, Any]]:
    place = 0
    while place < len(content):
        head, place = _varint(content, place)
        match head % 8:
            case 0:
                value, place = _varint(content, place)
            case 1:
                value, place = content[place : place + 8], place + 8
            case 2:
                length, place = _varint(content, place)
                value, place = content[place : place + length], place + length
            case kind:
                raise AssertionError(f"wire kind {kind}")
        yield head // 8, value


def _varint(content: bytes, place: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = content[place]
        value |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if byte < 0x80:
            return value, place


def rebirth_command() -> bytes:
    """A command that asks for the births: metric "Node Control/Rebirth", Boolean, true."""
    name = b"Node Control/Rebirth"
    metric = b"\x0a" + bytes([len(name)]) + name + b"\x20\x0b" + b"\x70\x01"
    return b"\x08\x01\x12" + bytes([len(metric)]) + metric

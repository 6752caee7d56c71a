"""Speed and load that a PLC gives: read live by a companion, and in a replay taken from the records of the live run."""

from __future__ import annotations

import math
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from monitor.config.opcua import OpcUaCondition
from monitor.records.database import SharedConnection
from monitor.records.packing import unpack
from monitor.service.server_process import ServerProcess
from monitor.words.numbers import count
from streams.block import Block

OPCUA = "opcua"
"""``speed_source`` and ``load_source`` of what was read."""
_ENTRY = "monitor.service.neighbours.opcua_client:child"
_MAX_READINGS = 50_000


class ConditionOf(Protocol):
    """Gives blocks the speed and load that they do not state themselves."""

    def __call__(self, block: Block) -> Block:
        """Return the block with what is known besides; the same block where nothing is."""
        ...


class Readings:
    """Readings of speed and load over time, and the one that holds at a block."""

    def __init__(self, max_age: float) -> None:
        """Keep the greatest age of a reading at the middle of a block, s."""
        self._max_age = max_age
        self._read: deque[tuple[float, float | None, float | None]] = deque(maxlen=_MAX_READINGS)

    def add(self, utc: float, speed: float | None, load: float | None) -> None:
        """Add a reading: UTC s since 1970, Hz, N; None for what could not be read. One from the past is ignored."""
        if not self._read or utc >= self._read[-1][0]:
            self._read.append((utc, speed, load))

    def __call__(self, block: Block) -> Block:
        """Return the block with the latest reading not after its middle; an older or undated one gives nothing."""
        if block.start is None:
            return block
        middle = block.start + block.duration / 2.0
        place = bisect_right(self._read, middle, key=lambda reading: reading[0])
        if not place or middle - self._read[place - 1][0] > self._max_age:
            return block
        _, speed, load = self._read[place - 1]
        return with_condition(block, speed, load)


def with_condition(block: Block, speed: float | None, load: float | None) -> Block:
    """Return the block with what was read where the block states nothing itself; a speed is positive."""
    if block.speed is None and speed is not None and math.isfinite(speed) and speed > 0.0:
        block = replace(block, speed=speed, speed_source=OPCUA)
    if block.load is None and load is not None and math.isfinite(load):
        block = replace(block, load=load, load_source=OPCUA)
    return block


class ConditionProcess(ServerProcess):
    """The companion that reads the nodes; its failure is a :attr:`problem`, and speed and load are then unknown."""

    def __init__(self, section: OpcUaCondition, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Keep the section; :meth:`tick` starts the child and takes its readings."""
        request = {"section": section.model_dump(mode="json")}
        super().__init__("speed and load by OPC UA", _ENTRY, request, monotonic)
        self.readings = Readings(section.max_age_s)

    def __call__(self, block: Block) -> Block:
        """Return the block with the speed and load that held, of what has been read by now."""
        self.tick()
        return self.readings(block)

    def _take(self, line: dict[str, Any]) -> None:
        if "reading" in line:
            utc, speed, load = line["reading"]
            self.readings.add(utc, speed, load)
        if "problem" in line:
            self._note(line["problem"])


class RecordedCondition:
    """For a replay without the PLC: what the records of the live run say that was read for the same content."""

    def __init__(self, store: Path, source: str) -> None:
        """Keep the path of the store of the live run, which may be missing."""
        self._path, self._source = store, source
        self._found: set[int] = set()
        self._missing: set[int] = set()

    def __call__(self, block: Block) -> Block:
        """Return the block with the recorded speed and load.

        Raises:
            StoreError: the store is there and cannot be read.
        """
        values: dict[str, Any] = {}
        if self._path.exists():
            with SharedConnection(self._path) as store:
                values = self._values(store, block)
        speed = values.get("speed") if values.get("speed_source") == OPCUA else None
        load = values.get("load") if values.get("load_source") == OPCUA else None
        after = with_condition(block, speed, load)
        (self._missing if after is block else self._found).add(block.sequence)
        return after

    @property
    def sentence(self) -> str:
        """What was found, for people."""
        if not self._path.exists():
            return f"speed and load by OPC UA: there is no store of a live run, {self._path}; unknown for all blocks"
        return (
            f"speed and load by OPC UA: from the records of the live run ({self._path}) for "
            f"{count(len(self._found), 'block')}, unknown for {len(self._missing)}"
        )

    def _values(self, store: SharedConnection, block: Block) -> dict[str, Any]:
        query = (
            "SELECT layouts.layout, row FROM blocks JOIN records ON records.block = blocks.id "
            "JOIN layouts ON layouts.id = records.layout WHERE source = ? AND sequence = ? AND content_hash = ?"
        )
        for layout, row in store.rows(query, self._source, block.sequence, block.content_hash):
            for values in unpack(layout, row).values():
                if OPCUA in (values.get("speed_source"), values.get("load_source")):
                    return values
        return {}

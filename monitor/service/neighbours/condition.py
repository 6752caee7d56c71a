"""Speed and load that a PLC gives: read live by a companion, and in a replay taken from the records of the live run."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import sys
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from monitor.config.machine import OpcUaCondition
from monitor.records.database import SharedConnection
from monitor.records.durable import replacing
from monitor.records.queries import committed_values
from monitor.service.broker import NotifyError, read_secret
from monitor.service.children import ServerProcess, end_with_parent, report_line
from monitor.service.neighbours.opcua_server import MISSING, OpcUaError, Report
from monitor.words.numbers import count
from streams.types.block import Block

if TYPE_CHECKING:
    from asyncua.client.client import Client
    from asyncua.crypto.uacrypto import CertProperties

OPCUA = "opcua"
"""``speed_source`` and ``load_source`` of what was read."""
_ENTRY = "monitor.service.neighbours.condition:child"
READINGS = "readings-opcua.jsonl"
"""File in the state folder: the latest readings."""
_TIMEOUT_S = 5.0
_MIN_PAUSE_S, _MAX_PAUSE_S = 1.0, 20.0
_MAX_READINGS = 50_000
_MAX_BYTES = 1_000_000


Reading = tuple[float, float | None, float | None]
"""UTC s since 1970, Hz, N."""


class Readings:
    """Readings of speed and load over time, and the one that holds at a block.

    A file keeps the latest, so that after a restart blocks of before it find theirs.
    """

    def __init__(self, max_age: float, path: Path | None = None) -> None:
        """Keep the greatest age of a reading at the middle of a block, s, and load what the file has."""
        self._max_age, self._path = max_age, path
        self._read: deque[Reading] = deque(maxlen=_MAX_READINGS)
        if path is not None and path.exists():
            self._load(path)

    def add(self, utc: float, speed: float | None, load: float | None) -> None:
        """Add a reading: UTC s since 1970, Hz, N; None for what could not be read.

        Readings of a later time are dropped: the clock was ahead, and has been set.
        """
        self._keep((utc, speed, load))
        if self._path is None:
            return
        # On a full disk, a restart knows less.
        with suppress(OSError):
            with self._path.open("a", encoding="ascii") as file:
                file.write(json.dumps(self._read[-1]) + "\n")
                size = file.tell()
            if size > _MAX_BYTES:
                lines = self._path.read_text(encoding="ascii").splitlines(keepends=True)
                with replacing(self._path) as temporary:
                    temporary.write_text("".join(lines[len(lines) // 2 :]), encoding="ascii")

    def _load(self, path: Path) -> None:
        """Take the readings of the file; a line that is cut off or not ours is left out."""
        with suppress(OSError):
            for line in path.read_bytes().splitlines():
                with suppress(ValueError, TypeError):
                    utc, speed, load = (None if part is None else float(part) for part in json.loads(line))
                    if utc is not None and math.isfinite(utc):
                        self._keep((utc, speed, load))

    def _keep(self, reading: Reading) -> None:
        while self._read and self._read[-1][0] > reading[0]:
            self._read.pop()
        self._read.append(reading)

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

    def __init__(
        self, section: OpcUaCondition, state_dir: Path, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        """Keep the section, and readings in the state folder; :meth:`tick` starts the child and takes its readings."""
        request = {"section": section.model_dump(mode="json")}
        super().__init__("speed and load by OPC UA", _ENTRY, request, monotonic)
        self.readings = Readings(section.max_age_s, state_dir / READINGS)

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
        channels = committed_values(store, self._source, block.sequence, block.content_hash)
        for values in channels.values():
            if OPCUA in (values.get("speed_source"), values.get("load_source")):
                return values
        return {}


async def follow(section: OpcUaCondition, report: Report) -> None:
    """Read the nodes at intervals until the task is cancelled; connect again after a failure.

    ``report`` is called with ``reading``, [UTC s, Hz or None, N or None], and ``problem``, a sentence or None.

    Raises:
        OpcUaError: asyncua is missing, or a configured file cannot be used.
    """
    try:
        from asyncua import ua
        from asyncua.client.client import Client
    except ModuleNotFoundError:
        raise OpcUaError(MISSING) from None
    pause = _MIN_PAUSE_S
    while True:
        client = Client(section.url, timeout=_TIMEOUT_S)
        try:
            await _secure(client, section)
            async with client:
                pause = _MIN_PAUSE_S
                await _read(client, section, report)
        except NotifyError as error:
            raise OpcUaError(str(error)) from None
        except (ua.UaError, OSError, TimeoutError, ConnectionError) as error:
            report({"problem": f"{section.url}: {type(error).__name__}: {error}".rstrip(": ")})
        await asyncio.sleep(pause)
        pause = min(2.0 * pause, _MAX_PAUSE_S)


async def _secure(client: Client, section: OpcUaCondition) -> None:
    from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
    from asyncua.crypto.uacrypto import load_certificate
    from cryptography.x509 import ExtensionNotFound, SubjectAlternativeName, UniformResourceIdentifier

    if section.username_file is not None and section.password_file is not None:
        client.set_user(read_secret(section.username_file))
        client.set_password(read_secret(section.password_file))
    if section.cert_file is None or section.key_file is None or section.server_cert_file is None:
        return
    try:
        cert, key, theirs = map(_content, (section.cert_file, section.key_file, section.server_cert_file))
        # Servers compare the name of an application with the one in its certificate.
        extensions = (await load_certificate(cert.path_or_content, cert.extension)).extensions
        names = extensions.get_extension_for_class(SubjectAlternativeName).value
        uris = names.get_values_for_type(UniformResourceIdentifier)
        if not uris:
            raise ValueError("the certificate has no URI among its names")
        client.application_uri = uris[0]
        await client.set_security(SecurityPolicyBasic256Sha256, cert, key, server_certificate=theirs)
    except ExtensionNotFound:
        raise OpcUaError(f"{section.cert_file}: the certificate has no names; expected a URI among them") from None
    except (OSError, ValueError, TypeError) as error:
        raise OpcUaError(f"[operating.opcua] cert_file, key_file, server_cert_file: cannot be used ({error})") from None


def _content(path: Path) -> CertProperties:
    """Return the content of a certificate or a key, PEM or DER whatever the name of the file."""
    from asyncua.crypto.uacrypto import CertProperties

    content = path.read_bytes()
    return CertProperties(content, "pem" if content.startswith(b"-----BEGIN") else "der")


async def _read(client: Client, section: OpcUaCondition, report: Report) -> None:
    """Read until the connection is lost."""
    wanted = ((section.speed_node, section.speed_scale), (section.load_node, section.load_scale))
    while True:
        utc, problem = time.time(), None
        found: list[float | None] = []
        for name, scale in wanted:
            value, reason = (None, None) if name is None else await _value(client, name, scale)
            found.append(value)
            problem = problem or reason
        report({"reading": [utc, *found], "problem": problem})
        await asyncio.sleep(section.interval_s)


async def _value(client: Client, name: str, scale: float) -> tuple[float | None, str | None]:
    """Return the value of a node times a scale, or None and why there is none: only a good one counts."""
    data = await client.get_node(name).read_data_value(raise_on_bad_status=False)
    value = None if data.Value is None else data.Value.Value
    if data.StatusCode is not None and not data.StatusCode.is_good():
        return None, f"{name}: its quality is {data.StatusCode.name}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None, f"{name}: expected a number, found {type(value).__name__}"
    return float(value) * scale, None


def child() -> None:
    """Read until standard input ends; report on standard output, one JSON object a line.

    The argument is a JSON object: ``section``.
    """
    section = OpcUaCondition.model_validate(json.loads(sys.argv[1])["section"])
    end_with_parent()
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)

    try:
        asyncio.run(follow(section, report_line))
    except OpcUaError as error:
        report_line({"problem": str(error)})
        sys.exit(1)

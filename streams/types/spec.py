"""Configuration of sources: channels, network limits, addresses."""

from __future__ import annotations

import ipaddress
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from urllib.parse import unquote, urlsplit
from zoneinfo import ZoneInfo

from models.words.errors import WrongInputError
from streams.turns.pulses import BlockRevolutions
from streams.types.stamps import Order, compiled

DEFAULT_BLOCK_SECONDS = 5.0
FILE_WORDS = ("{stem}", "{name}")
"""In ``pulses``: the name of a file, without and with its ending."""
UNITS = ("g", "m/s2", "V", "unknown", "mm/s")
"""The units that a channel may state; the last one is of a velocity."""

MAX_FRAME = 16 << 20
"""Bytes of the largest frame, checksum included."""
MQTT_PORT = 1883
_MAX_TOPIC_BYTES = 512


class SourceError(WrongInputError):
    """A source cannot be opened as configured: what was expected and what was found."""


@dataclass(frozen=True)
class ChannelSpec:
    """Configuration of a channel: its row in the recording, and its unit.

    Attributes:
        column: number of the column in the file, counted from 1, or the name in its header.
        key: pattern (``*``, ``?``, ``[...]``) of the variable or column name, such as ``X*_DE_time``. Without column
            and key the channel is found by its own name, or is the single row of a file.
        unit: one of ``UNITS``; None leaves it to the file or the data set.
        scale: factor from the stored numbers to ``unit``; of integers the unit of a count, of an integer WAV that of
            full scale. None where the configuration gives none: 1, and integers without a scale are refused.
        sensitivity_mv_per_g: of the sensor where ``unit`` is "V".
        any_unit: whether the row is passed on as it is stored, whatever its unit; ``unit`` is "unknown" then.
    """

    name: str
    column: int | str | None = None
    key: str | None = None
    unit: str | None = None
    scale: float | None = None
    sensitivity_mv_per_g: float | None = None
    any_unit: bool = False

    def __post_init__(self) -> None:
        """Raise SourceError for a channel that matches nothing or contradicts itself."""
        where = f"[[channel]] {self.name}"
        if self.unit is not None and self.unit not in UNITS:
            raise SourceError(f"{where}: unit must be one of {', '.join(UNITS)}, got {self.unit!r}")
        if isinstance(self.column, int) and self.column < 1:
            raise SourceError(f"{where}: columns are counted from 1, got column = {self.column}")
        if self.column is not None and self.key is not None:
            raise SourceError(f"{where}: give either column or key, not both")
        if self.scale is not None and not (math.isfinite(self.scale) and self.scale != 0.0):
            raise SourceError(f"{where}: scale must be finite and not zero, got {self.scale}")
        if self.unit == "V" and not (self.sensitivity_mv_per_g and self.sensitivity_mv_per_g > 0.0):
            raise SourceError(f"{where}: unit V needs a positive sensitivity_mv_per_g, got {self.sensitivity_mv_per_g}")


@dataclass(frozen=True)
class NetworkSpec:
    """Limits and credentials of a network source.

    Attributes:
        peers: networks (such as ``192.168.1.0/24``) from which a TCP sender may connect; empty: this machine only.
        max_connections: TCP connections at a time.
        read_timeout: seconds within which a hello must come, and a frame must be complete once it has begun.
        max_frame: bytes of the largest frame to accept.
        max_waiting: bytes of frames that may wait for their commit; at this limit reading is paused.
        ca_file: PEM certificates against which the broker's certificate is verified; it switches TLS on.
        cert_file: client certificate for the broker (PEM), with its private key in ``key_file``.
        username_file: file whose first line is the user name for the broker; ``password_file`` likewise.
        stream_key_file: file whose first line is the key of the stream; its sender must prove that it has it.
        tls_cert_file: certificate of a TCP receiver (PEM), its private key in ``tls_key_file``; it switches TLS on.
        client_id: at the broker, which keeps the session under it; None derives one from the source name.
    """

    peers: tuple[str, ...] = ()
    max_connections: int = 16
    read_timeout: float = 30.0
    max_frame: int = MAX_FRAME
    max_waiting: int = 4 * MAX_FRAME
    ca_file: Path | None = None
    cert_file: Path | None = None
    key_file: Path | None = None
    username_file: Path | None = None
    password_file: Path | None = None
    stream_key_file: Path | None = None
    tls_cert_file: Path | None = None
    tls_key_file: Path | None = None
    client_id: str | None = None

    def __post_init__(self) -> None:
        """Raise SourceError for values out of range."""
        for peer in self.peers:
            try:
                ipaddress.ip_network(peer)
            except ValueError as error:
                raise SourceError(f"peers: {error}; expected networks such as 192.168.1.0/24") from None
        if not (self.max_connections >= 1 and self.read_timeout > 0.0 and 1024 <= self.max_frame <= MAX_FRAME):
            raise SourceError(
                f"max_connections must be 1 or more, read_timeout_s positive, max_frame 1024 to {MAX_FRAME} bytes; got "
                f"{self.max_connections}, {self.read_timeout}, {self.max_frame}"
            )
        if (self.cert_file is None) != (self.key_file is None):
            raise SourceError("cert_file and key_file belong together")
        if (self.tls_cert_file is None) != (self.tls_key_file is None):
            raise SourceError("tls_cert_file and tls_key_file belong together")

    def admits(self, address: str) -> bool:
        """Return whether a sender at this numerical address may connect."""
        found = ipaddress.ip_address(address.partition("%")[0])
        found = getattr(found, "ipv4_mapped", None) or found
        return found.is_loopback or any(found in ipaddress.ip_network(peer) for peer in self.peers)


@dataclass(frozen=True)
class SourceSpec:
    """Configuration of one source.

    Attributes:
        url: ``dataset:NAME:PATH``, ``folder:PATH``, ``rig:NAME?seed=N``, ``tcp://HOST:PORT``,
            ``mqtt://HOST:PORT/TOPIC``, or a bare path whose files are recognised.
        start: seconds since 1970-01-01 UTC of the first sample, for recordings without a date; else None.
        block_s: length of a block in s, or "file" for one block a file, as data sets of snapshots always give.
        format: "auto", one of the formats of docs/reference/formats.md ("csv", "tdms", ...) or the name of a data set.
        rate: in Hz where neither the file nor the data set states it; where one does, it must agree.
        range_g: full scale in g, None where unknown; what -1 and 1 of an integer WAV without ``scale`` mean.
        channels: empty: all channels of the data set.
        timezone: IANA name of the zone of local time stamps in file names.
        settle_s: seconds for which a file of a watched folder must be unchanged before it is read, unless it was
            closed or moved in.
        max_gap_blocks: largest jump in the numbers of a stream; a frame farther ahead is refused.
        network: of a ``tcp:`` or ``mqtt:`` source, None for the defaults.
        time_from: what dates the blocks of files; None: the header, the name or a count, by the first file.
        time_name: pattern (strptime) of the date in names.
        interval: s between the starts of files, for a count; None: the length of one.
        date_order: of day, month and year in dates that do not state it; None: told over all files.
        pulses: pattern of the array, group or channel with the times of pulses of a tacho; with ``{stem}`` or
            ``{name}``, which stand for the name of a file without and with its ending, a text file beside it.
        files: pattern of the names of its files, below its folder; of several each is one of files that are recorded at
            the same time, and read as one. Empty: all of the format, which must be a single sequence.
        disregard: patterns of the keys in files that are not believed, where they contradict others.
        block_revolutions: how many turns a block has where files are cut by them; ``block_s`` is the longest then.
    """

    name: str
    url: str
    start: float | None = None
    block_s: float | Literal["file"] = DEFAULT_BLOCK_SECONDS
    format: str = "auto"
    rate: float | None = None
    range_g: float | None = None
    channels: tuple[ChannelSpec, ...] = ()
    timezone: str = "UTC"
    settle_s: float = 2.0
    max_gap_blocks: int = 100_000
    network: NetworkSpec | None = None
    time_from: Literal["header", "name", "count", "mtime"] | None = None
    time_name: str | None = None
    interval: float | None = None
    date_order: Order | None = None
    pulses: str | None = None
    files: tuple[str, ...] = ()
    block_revolutions: BlockRevolutions | None = None
    disregard: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise SourceError for values that no recording can have."""
        where = f"[[source]] {self.name}"
        if self.block_s != "file" and not (math.isfinite(self.block_s) and self.block_s > 0.0):
            raise SourceError(f'{where}: block_s must be a positive number of seconds or "file", got {self.block_s!r}')
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0.0):
            raise SourceError(f"{where}: rate_hz must be positive, got {self.rate}")
        if not (math.isfinite(self.settle_s) and self.settle_s >= 0.0):
            raise SourceError(f"{where}: settle_s must be a number of seconds from 0, got {self.settle_s}")
        problem = dating_problem(self.start, self.time_from, self.time_name, self.interval, self.date_order)
        if problem is not None:
            raise SourceError(f"{where}: {problem}")
        if self.max_gap_blocks < 1:
            raise SourceError(f"{where}: max_gap_blocks must be 1 or more, got {self.max_gap_blocks}")
        problem = pulses_problem(self.pulses) or files_problem(self.files)
        if problem is not None:
            raise SourceError(f"{where}: {problem}")
        if self.block_revolutions is not None and not self._counts_turns(self.block_revolutions):
            raise SourceError(
                f"{where}: block_revolutions needs block_s in seconds, the longest block, and what counts turns: "
                "[operating] tacho_channel, or pulses"
            )
        names = [channel.name for channel in self.channels]
        if len(set(names)) != len(names):
            raise SourceError(f"{where}: channel names must differ, got {', '.join(names)}")
        try:
            ZoneInfo(self.timezone)
        except (KeyError, ValueError, OSError) as error:
            raise SourceError(f"{where}: timezone {self.timezone!r} is not known") from error

    def _counts_turns(self, turns: BlockRevolutions) -> bool:
        """Return whether there is something that counts turns, and blocks to cut."""
        if self.block_s == "file" or turns.revolutions <= 0.0:
            return False
        names = [channel.name for channel in self.channels]
        return self.pulses is not None if turns.channel is None else turns.channel in names


def dating_problem(
    start: object, time_from: str | None, time_name: str | None, interval: float | None, date_order: str | None
) -> str | None:
    """Return what is wrong with the keys that say what dates files, or None; ``start`` is ``start_utc``."""
    if time_from == "count" and start is None:
        return 'time_from = "count" needs start_utc, the start of the first file'
    if time_name is not None and time_from not in (None, "name"):
        return f'time_name belongs to time_from = "name", got {time_from!r}'
    if interval is not None and not (math.isfinite(interval) and interval > 0.0):
        return f"interval_s must be positive, got {interval}"
    if interval is not None and (time_from not in (None, "count") or time_name is not None):
        return f'interval_s belongs to time_from = "count", got {time_from or "time_name"!r}'
    if date_order is not None and (time_from in ("count", "mtime") or time_name is not None):
        return f"date_order belongs to dates in headers and names, got {time_from or 'time_name'!r}"
    try:
        if time_name is not None:
            compiled(time_name)
    except ValueError as error:
        return f"time_name = {error}"
    return None


def pulses_problem(pattern: str | None) -> str | None:
    """Return what is wrong with the key that names the pulses, or None."""
    if pattern is None:
        return None
    if not pattern or "\0" in pattern:
        return "pulses is empty; expected the name of an array, or a pattern such as {stem}.pulses.csv"
    rest = pattern
    for word in FILE_WORDS:
        rest = rest.replace(word, "")
    if rest != pattern and ("/" in rest or not rest or "{" in rest or "*" in rest):
        return f"pulses = {pattern!r}: expected a name in the folder of the file, such as {{stem}}.pulses.csv"
    if rest == pattern and "{" in pattern:
        return f"pulses = {pattern!r}: a file beside the recording is named by {' or '.join(FILE_WORDS)}"
    return None


WILD = re.compile(r"((?<!\[)\*|\*(?!\])|\[0-9\])")
"""What stands for a part of a name in patterns of files that are read together."""


def files_problem(patterns: Sequence[str]) -> str | None:
    """Return what is wrong with the key that names the files, or None."""
    if any(not pattern or "\0" in pattern or pattern.startswith("/") for pattern in patterns):
        return "files: expected patterns of paths below the folder, such as *_ch1.csv"
    if len(patterns) < 2:
        return None
    wild = {tuple(WILD.findall(pattern)) for pattern in patterns}
    if len(set(patterns)) < len(patterns) or len(wild) > 1 or any("?" in pattern for pattern in patterns):
        wanted = "several patterns, such as *_ch1.csv and *_ch2.csv, have * in the same places"
        return f"files: {wanted}; got {', '.join(patterns)}"
    return None


@dataclass(frozen=True)
class Address:
    """Address of a stream: host, port and, for MQTT, the topic."""

    scheme: str
    host: str
    port: int
    topic: str = ""


def refuse_credentials(url: str, where: str) -> None:
    """Refuse a URL with a user name or password, which belong into files; the message does not repeat it.

    ``where`` is the key or option named in the message. Raises SourceError.
    """
    if "://" in url and "@" in re.split(r"[/?#]", url.partition("://")[2], maxsplit=1)[0]:
        raise SourceError(f"{where}: user name and password belong into username_file and password_file")


def parse_address(url: str, where: str) -> Address:
    """Return the parts of ``tcp://HOST:PORT`` or ``mqtt://HOST[:PORT]/TOPIC``.

    ``where`` is the key or option named in a message, such as ``[[source]] press: url``.

    Raises:
        SourceError: it is neither; it holds a user name or password, which belong into files; the topic has
            wildcards, which would admit any sender.
    """
    refuse_credentials(url, where)
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise SourceError(f"{where} {url!r}: {error}") from None
    extra = parts.query or parts.fragment
    if parts.scheme == "tcp" and host and port is not None and not extra and parts.path in ("", "/"):
        return Address("tcp", host, port)
    topic = unquote(parts.path[1:])
    if parts.scheme == "mqtt" and host and topic and not extra:
        if re.search(r"[+#\0]", topic) or topic.startswith("$") or len(topic.encode()) > _MAX_TOPIC_BYTES:
            raise SourceError(f"{where} {url!r}: the topic must be one topic, without + and #")
        return Address("mqtt", host, MQTT_PORT if port is None else port, topic)
    raise SourceError(f"{where} {url!r}: expected tcp://HOST:PORT or mqtt://HOST:PORT/TOPIC")

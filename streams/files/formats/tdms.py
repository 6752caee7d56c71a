"""TDMS files of LabVIEW through nptdms, with the declared lengths checked."""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streams.files.judge import Start, StatedRow, judge_start, judged, starts_of
from streams.files.keys import TIME_KEYS
from streams.files.lengths import of_one_length, with_beside
from streams.files.parse.worker import check_claim, from_disk, library, readable
from streams.files.pulse_times import matches_pulses, only_one, with_pulses
from streams.files.statements import STORED, Facts, add_fact, nearest, plain_key
from streams.files.successive import recordings_of
from streams.files.unlisted import is_stating
from streams.types import large
from streams.types.large import Data, contiguous, empty_rows, forget_pages, stream_of
from streams.types.samples import ReaderError, Samples, check_rows, stored_as

_LEAD_IN = 28
_OPEN_END = 0xFFFFFFFFFFFFFFFF
_NEW_OBJECTS, _RAW_DATA = 1 << 2, 1 << 3
"""Flags of a segment: it lists its channels; it has samples."""
_SCALE_KIND = re.compile(r"NI_Scale\[\d+\]_Scale_Type")
_LABVIEW_ZERO = -2082844800.0
"""Seconds from 1970 to 1904-01-01, the stamp of a waveform whose time was never set."""


@from_disk
def read_tdms(
    data: Data,
    name: str,
    patterns: Sequence[str] = (),
    zone: str = "UTC",
    pulses: str | None = None,
    wanted: Sequence[str] = (),
    slow: Sequence[str] = (),
    disregard: Sequence[str] = (),
) -> Samples:
    """Read the numeric channels of a TDMS file, a row for each, scaled as it says.

    Rate (``wf_increment``), time of the first sample (``wf_start_time`` and ``wf_start_offset``) and unit
    (``unit_string``) are taken from the properties of the channels; what groups and file state is compared with them,
    but for times, which are those of writing there.

    Args:
        patterns: of the channels that are wanted, as ``CHANNEL`` or ``GROUP/CHANNEL``; none: all.
        zone: IANA name of the zone of stamps that name none.
        pulses: pattern of the channel, or of the group of the one channel, of pulses; see :mod:`.pulse_times`.
        wanted, slow: see :func:`streams.files.lengths.of_one_length`.
        disregard: patterns of the properties that are not believed.

    Raises:
        ReaderError: ``empty``; ``incomplete`` where a segment is shorter than declared; ``refused`` above
            the limits; ``wrong_shape`` where no channel matches or lengths differ; ``wrong_rate`` where
            their rates do; ``unreadable``.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    tdms = _nptdms()
    data, torn, broken = _whole_part(data, name, patterns if pulses is None else None, tdms)
    left_out = {_parted(row)[0]: str(broken) for row in torn} if torn else {}
    with (
        readable(name, "a readable TDMS file"),
        stream_of(data) as stream,
        tdms.TdmsFile.open(stream) as file,
    ):
        channels = [channel for group in file.groups() if group.name not in left_out for channel in group.channels()]
        if broken is not None and not channels:
            raise broken
        check_rows(len(channels), name, "channels")
        tacho = [channel for channel in channels if matches_pulses(pulses, *_titles(channel), channel.group_name)]
        taken = _wanted([channel for channel in channels if channel not in tacho], name, patterns)
        check_claim(sum(len(channel) * 8 for channel in (*taken, *tacho)), len(data), name)
        for channel in (*taken, *tacho):
            _check_scales(channel, file, f"{name}: channel {channel.name}")
        rows = [_values(channel) for channel in taken]
        properties = _properties_of(taken, file)
        lengths = [len(channel) for channel in taken]
        titles = [(str(channel.group_name), str(channel.name)) for channel in taken]
        marks = [(_titles(channel)[1], _values(channel), _properties(channel)) for channel in tacho]
    for row, length, title in zip(rows, lengths, titles, strict=True):
        if len(row) != length:
            raise ReaderError("incomplete", f"{name}: channel {title[1]}: {length} samples promised, {len(row)} there")
    shared: list[Facts] = []
    for row, facts in zip(rows, properties, strict=True):
        told = {**facts, STORED: stored_as(row.dtype)}
        # Neighbours of which the same is stated share it, and are judged once.
        shared.append(shared[-1] if shared and shared[-1] == told else told)
    stated = [
        StatedRow(values, f"{group}/{title}", title, facts)
        for values, (group, title), facts in zip(_exact(rows), titles, shared, strict=True)
    ]

    def joined(rows: Sequence[StatedRow]) -> Samples:
        kept, beside = of_one_length(rows, wanted, slow, name, "channels")
        of_rows = judged(kept, name, "channels", zone, called=lambda row: row.short, dated=_dated, disregard=disregard)
        return with_beside(of_rows, beside)

    if pulses is None:
        several = recordings_of([*stated, *torn], name, zone, joined, parted=_parted, dated=_dated, torn=left_out)
        if several is None and broken is not None:
            raise broken
        return joined(stated) if several is None else several
    samples = joined(stated)
    title, times, facts = only_one(marks, pulses, name) or (None, None, None)
    if title is None or times is None or facts is None:
        return samples
    return with_pulses(
        samples, times, facts, zone, f"{name}: channel {title}", judge_start(_dated(facts, zone), name).value
    )


def _parted(row: StatedRow) -> tuple[str, str]:
    return row.name[: -len(row.short) - 1], row.short


def _titles(channel: Any) -> tuple[str, str]:
    """Return the names by which a channel is found: its own, and that of its group before it."""
    return str(channel.name), f"{channel.group_name}/{channel.name}"


def _dtype(channel: Any) -> np.dtype[Any] | None:
    """Return the type of the values of a channel, also of one without a scale whose samples are those of DAQmx."""
    if channel.dtype is None or np.dtype(channel.dtype).kind != "V":
        return None if channel.dtype is None else np.dtype(channel.dtype)
    counts = list((channel.scaler_data_types or {}).values())
    return np.dtype(counts[0].nptype) if len(counts) == 1 else None


def _check_scales(channel: Any, file: Any, where: str) -> None:
    """Raise ``wrong_unit`` where samples are to be scaled in a way that nptdms does not know: it leaves them out."""
    for stated in (channel.properties, file[channel.group_name].properties, file.properties):
        kinds = [str(value) for key, value in stated.items() if _SCALE_KIND.fullmatch(str(key))]
        is_unscaled = stated.get("NI_Scaling_Status", "unscaled") != "scaled"
        if kinds and is_unscaled and import_module("nptdms.scaling").get_scaling(stated, {}, {}) is None:
            reason = f"its samples are still to be scaled, and not all its scales are known: {', '.join(kinds)[:100]}"
            raise ReaderError("wrong_unit", f"{where}: {reason}")


def _part(channel: Any, begin: int, end: int) -> NDArray[Any]:
    if np.dtype(channel.dtype).kind == "V":
        (counts,) = channel.read_data(begin, end - begin, scaled=False).values()
        return np.asarray(counts)
    return np.asarray(channel[begin:end])


def _values(channel: Any) -> NDArray[Any]:
    """Return the scaled values of a channel; many of them are read piece by piece, and are on disk."""
    length = len(channel)
    if 8 * length < large.MAX_IN_MEMORY:
        if not length or np.dtype(channel.dtype).kind == "V":
            return _part(channel, 0, length)
        # A slice of the channel would be copied once more.
        chunks = [np.asarray(chunk[:]) for chunk in channel.data_chunks()]
        return chunks[0] if len(chunks) == 1 else np.concatenate(chunks)
    step = max(1, large.PIECE_BYTES // 8)
    first = _part(channel, 0, step)
    found = empty_rows((length,), first.dtype)
    for begin in range(0, length, step):
        part = first if begin == 0 else _part(channel, begin, min(begin + step, length))
        if len(part) < min(step, length - begin):
            return found[: begin + len(part)]
        found[begin : begin + step] = part
        forget_pages(found)
    return found


def _properties(item: Any) -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in item.properties.items():
        add_fact(found, plain_key(str(key)), value, str(key))
    return found


def _properties_of(channels: Sequence[Any], file: Any) -> list[dict[str, object]]:
    """Return what is stated of each channel, by itself, its group and the file.

    Times of group and file, which are those of writing, count where no channel states one.
    """
    own = [_properties(channel) for channel in channels]
    around = _properties(file)
    dated = any(_dated(facts, "UTC") for facts in own)
    passing = TIME_KEYS if dated else frozenset[str]()
    groups = {group.name: nearest(around, _properties(group), "of the file") for group in file.groups()}
    outer = {
        name: {key: value for key, value in facts.items() if is_stating(key) and key.partition("#")[0] not in passing}
        for name, facts in groups.items()
    }
    return [
        nearest(outer[channel.group_name], facts, "of its group or file")
        for channel, facts in zip(channels, own, strict=True)
    ]


def _nptdms() -> Any:
    nptdms = library("nptdms", "tdms", "TDMS files need")
    _silence()
    return nptdms


@cache
def _silence() -> None:
    """Silence the log of nptdms once: on a string that it cannot decode it logs the bytes of the file."""
    import_module("nptdms.log").log_manager.set_level(60)


def _segments(data: Data, name: str) -> tuple[list[int], ReaderError | None]:
    """Return where segments begin, and how the last one breaks off, None where it is whole.

    Declared lengths are compared with the data; nptdms silently reads what there is.

    Raises:
        ReaderError: ``unreadable``; ``incomplete`` where the first segment breaks off, or the head of the last.
    """
    position, found = 0, list[int]()
    while position < len(data):
        found.append(position)
        lead = data[position : position + _LEAD_IN]
        if not b"TDSm".startswith(lead[:4]):
            raise ReaderError("unreadable", f"{name}: not a TDMS file (no segment begins at byte {position})")
        if len(lead) < _LEAD_IN:
            raise ReaderError("incomplete", f"{name}: breaks off in the head of a segment, after {len(data)} bytes")
        order = ">" if struct.unpack_from("<I", lead, 4)[0] & (1 << 6) else "<"
        following, raw = struct.unpack_from(order + "QQ", lead, 12)
        end, told = position + _LEAD_IN + following, ""
        if following == _OPEN_END:
            told = f"the segment at byte {position} was never closed"
        elif end > len(data):
            told = f"{end} bytes are declared, {len(data)} are there"
        if told:
            return found, ReaderError("incomplete", f"{name}: {told}")
        if raw > following:
            raise ReaderError("unreadable", f"{name}: the segment at byte {position} contradicts itself")
        position = end
    return found, None


def _whole_part(
    data: Data, name: str, patterns: Sequence[str] | None, tdms: Any
) -> tuple[Data, list[StatedRow], ReaderError | None]:
    """Return the whole segments, the channels of one behind them that breaks off, and how; all where none does.

    Raises:
        ReaderError: as :func:`_segments`; ``incomplete`` where nothing is known of that segment, or wanted without
            ``patterns``.
    """
    segments, broken = _segments(data, name)
    if broken is None:
        return data, [], None
    torn: list[StatedRow] = []
    with suppress(ReaderError), readable(name, "a readable TDMS file"):
        torn = [] if patterns is None or not segments[-1] else _torn_rows(data, segments, patterns, tdms)
    if not torn:
        raise broken
    return data[: segments[-1]], torn, broken


def _torn_rows(data: Data, segments: Sequence[int], patterns: Sequence[str], tdms: Any) -> list[StatedRow]:
    """Return the channels of the last segment, which breaks off, without samples; none where its head is not whole.

    A segment may have the channels of the one before: the heads up to one that lists its own make a file without
    samples.
    """
    heads = b""
    for position in reversed(segments):
        lead = data[position : position + _LEAD_IN]
        flags = struct.unpack_from("<I", lead, 4)[0]
        order = ">" if flags & (1 << 6) else "<"
        size = struct.unpack_from(order + "Q", lead, 20)[0]
        head = data[position : position + _LEAD_IN + size] if size <= len(data) else b""
        if len(head) < _LEAD_IN + size:
            return []
        lengths = struct.pack(order + "QQ", size, size)
        heads = lead[:4] + struct.pack("<I", flags & ~_RAW_DATA) + lead[8:12] + lengths + head[_LEAD_IN:] + heads
        if flags & _NEW_OBJECTS:
            break
    else:
        return []
    with tdms.TdmsFile.open(io.BytesIO(heads)) as file:
        channels = [
            channel
            for group in file.groups()
            for channel in group.channels()
            if not patterns or any(fnmatchcase(title, p) for p in patterns for title in _titles(channel))
        ]
        properties = _properties_of(channels, file)
        titles = [(str(channel.group_name), str(channel.name)) for channel in channels]
    return [
        StatedRow(np.empty(0), f"{group}/{title}", title, facts)
        for (group, title), facts in zip(titles, properties, strict=True)
    ]


def _wanted(channels: Sequence[Any], name: str, patterns: Sequence[str]) -> list[Any]:
    kinds = {channel: getattr(_dtype(channel), "kind", "") for channel in channels}
    numeric = [channel for channel in channels if kinds[channel] in tuple("fiub") and len(channel)]
    found = [
        channel
        for channel in numeric
        if not patterns or any(fnmatchcase(title, p) for p in patterns for title in _titles(channel))
    ]
    if not found:
        held = ", ".join(f"{c.group_name}/{c.name}"[:60] for c in channels[:12]) or "no channel"
        status = "wrong_shape" if numeric else "empty"
        raise ReaderError(
            status, f"{name}: no channel with numbers matches {', '.join(patterns) or '*'}; it holds {held}"
        )
    numbers = [channel for channel in found if kinds[channel] != "b"]
    lengths = {len(channel) for channel in numbers}
    # Truth values come last, so that they do not move the numbers of the others; some are flags of something else.
    return [*numbers, *(channel for channel in found if channel not in numbers and lengths <= {len(channel)})]


def _exact(rows: list[NDArray[Any]]) -> list[NDArray[np.floating]]:
    exact = all(row.dtype.itemsize <= (4 if row.dtype.kind == "f" else 2) for row in rows)
    return [contiguous(row, np.float32 if exact else np.float64) for row in rows]


def _dated(facts: Facts, zone: str) -> list[Start]:
    offset = facts.get("wfstartoffset", 0.0)
    moved = float(offset) if isinstance(offset, int | float) and abs(offset) < 1e9 else 0.0
    found = [one for one in starts_of(facts, zone) if (one.stamp.fixed or 0.0) > _LABVIEW_ZERO + 1.0 or one.stamp.open]
    return [_of_waveform(one, moved) if one.place == "wfstarttime" else one for one in found]


def _of_waveform(start: Start, seconds: float) -> Start:
    """Return the start of a waveform, which is in UTC, moved by its offset."""
    return replace(start, stamp=replace(start.stamp.later(seconds), resolution=0.0, local=False))

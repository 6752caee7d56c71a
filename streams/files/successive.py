"""Several recordings of the same channels in one file, one after another in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from streams.files.judge import Start, StatedRow, starts_of
from streams.files.statements import Facts
from streams.types.samples import ReaderError, Samples, one_after_another
from streams.types.stamps import repeated_by, resolution_of, stamp_in_name, utc_text

MAX_RECORDINGS = 10_000
"""Recordings that one file may hold."""
_SAME_START_S = 1.0
"""Groups whose starts are not farther apart, and which overlap, may be sensors."""
_NAMED = "starttime#by the name of its group"
HOW_TO_SPLIT = "write each of its recordings to a file of its own"


def successive(parts: Sequence[tuple[str, Samples]], name: str, zone: str, torn: Sequence[str] = ()) -> Samples:
    """Return the recordings of a file, each with what is stated of it alone, in order of time.

    Args:
        parts: place of each in the file in words ("the segment in line 12"), and its samples.
        name: of the file in messages.
        zone: IANA name of the zone of stamps that name none.
        torn: of each recording that broke off and is left out, where it is, and why.

    Raises:
        ReaderError: ``wrong_shape`` where one has other channels than the first, no start, or begins before the one
            before it has ended.
    """
    (first_place, first), *others = parts
    second = others[0][0] if others else "left out"
    told = f"{name}: holds {len(parts) + len(torn)} recordings (the second is {second})"
    for place, samples in others:
        if samples.names != first.names:
            ours, theirs = (", ".join(each.names)[:100] for each in (first, samples))
            raise ReaderError("wrong_shape", f"{told}; {first_place} has {ours}, {place} {theirs}; {HOW_TO_SPLIT}")
    undated = next((place for place, samples in parts if samples.start is None), None)
    if undated is not None:
        raise ReaderError("wrong_shape", f"{told}; {undated} states no start of its own; {HOW_TO_SPLIT}")
    check_order(parts, told, zone)
    kind = np.result_type(*(samples.values.dtype for _, samples in parts))
    of_one_type = (
        samples if samples.values.dtype == kind else replace(samples, values=samples.values.astype(kind))
        for _, samples in parts
    )
    return one_after_another(list(of_one_type), torn)


def check_order(parts: Sequence[tuple[str, Samples]], told: str, zone: str) -> None:
    """Raise ``wrong_shape`` where a recording does not begin behind the end of the one before it."""
    for (before, ended), (place, begun) in pairwise(parts):
        start, end = begun.start, ended.time_of(ended.end) if ended.rate else ended.start
        if start is None or end is None or ended.start is None:
            continue
        # In the local hour that occurs twice a start is read as the first of its two times.
        start += repeated_by(start, zone) if start <= ended.start else 0.0
        if start <= ended.start or start < end - min(map(resolution_of, (start, ended.start))):
            raise ReaderError(
                "wrong_shape",
                f"{told}; {place} begins {utc_text(start)}, before {before} ends {utc_text(end)}: sensors recorded at "
                f"the same time, or a clock that was set back; {HOW_TO_SPLIT}",
            )


def recordings_of(
    rows: Sequence[StatedRow],
    name: str,
    zone: str,
    read: Callable[[Sequence[StatedRow]], Samples],
    *,
    parted: Callable[[StatedRow], tuple[str, str]],
    dated: Callable[[Facts, str], list[Start]] = starts_of,
    kind: str = "group",
    torn: Mapping[str, str] | None = None,
) -> Samples | None:
    """Return the groups of a file as recordings where all hold the same channels and their starts differ, else None.

    Args:
        rows: of the file.
        name: of the file in messages.
        zone: IANA name of the zone of stamps that name none.
        read: gives the samples of the rows of a group.
        parted: gives the group of a row, and its name in it.
        dated: gives what is stated of a row of the time of the first sample.
        kind: of the groups in messages.
        torn: why groups broke off: those are left out, if they would be recordings were they whole; else the answer is
            None.

    Raises:
        ReaderError: as ``read``, and as :func:`successive`.
    """
    groups: dict[str, list[StatedRow]] = {}
    for row in rows:
        title, short = parted(row)
        groups.setdefault(title, []).append(replace(row, name=short, short=short))
    shorts = {tuple(sorted(row.name for row in group)) for group in groups.values()}
    if len(groups) < 2 or len(shorts) > 1 or len(groups) > MAX_RECORDINGS:
        return None
    order = {row.name: place for place, row in enumerate(next(iter(groups.values())))}
    starts: dict[str, float] = {}
    for title, group in groups.items():
        group.sort(key=lambda row: order[row.name])
        stated = [start.stamp for row in group for start in dated(row.facts, zone)]
        named = stamp_in_name(title, zone) if not stated else None
        if named is not None and named.fixed is not None:
            stated = [named]
            groups[title] = [replace(row, facts={**row.facts, _NAMED: utc_text(named.fixed)}) for row in group]
        if not stated or stated[0].fixed is None:
            return None
        starts[title] = stated[0].fixed
    apart = max(starts.values()) - min(starts.values())
    if not apart:
        return None
    torn = torn or {}
    titles = sorted(starts.keys() - torn, key=lambda title: starts[title])
    if not titles or any(starts[title] == starts[other] for title in torn for other in titles):
        return None
    try:
        return successive([(f"{kind} {title}", read(groups[title])) for title in titles], name, zone, [*torn.values()])
    except ReaderError:
        if apart > _SAME_START_S:
            raise
        return None

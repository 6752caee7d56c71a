"""What a report says of the shaft: its speeds over the run, the blocks in orders, and why others are not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.report.runs import Channel, Run
from monitor.report.tables import Column, Table
from monitor.words.numbers import count, figure
from monitor.words.rotation import DOMAINS, ROTATION_REFUSALS


@dataclass(frozen=True, eq=False)
class SpeedCourse:
    """The speeds of channels whose blocks have the same ones; Hz, shape (block,).

    Attributes:
        channels: names, joined.
        low, high: NaN where only the mean is known.
        status: ``rotation_status``, "" where there is no source of an angle.
        orders: whether the spectra are over orders.
    """

    channels: str
    channel: Channel
    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    status: NDArray[np.object_]
    orders: NDArray[np.bool_]


def speed_courses(run: Run) -> list[SpeedCourse]:
    """Return the speeds of the channels of a run for whose blocks an angle was sought; equal ones once."""
    found: dict[bytes, SpeedCourse] = {}
    for channel in run.channels.values():
        status = channel.word("rotation_status")
        if not (status != "").any():
            continue
        mean, low, high = (channel.column(name) for name in ("speed", "speed_min", "speed_max"))
        key = b"".join(values.tobytes() for values in (channel.time, mean, low, high))
        orders = np.asarray(channel.word("domain") == "order", dtype=np.bool_)
        names = f"{found[key].channels}, {channel.name}" if key in found else channel.name
        found[key] = SpeedCourse(names, channel, mean, low, high, status, orders)
    return list(found.values())


def speed_words(run: Run) -> list[str]:
    """Return a sentence on the speeds and the spectra of each course."""
    return [_sentence(course) for course in speed_courses(run)]


def _sentence(course: SpeedCourse) -> str:
    sought = course.status != ""
    share = float(np.mean(course.orders[sought]))
    texts = [f"{course.channels}: {DOMAINS['order']} in {share:.0%} of {count(int(sought.sum()), 'block')}"]
    spans = (course.high - course.low)[np.isfinite(course.low)]
    if spans.size:
        middle = float(np.median(spans / course.mean[np.isfinite(course.low)]))
        least, highest = figure(float(np.nanmin(course.low))), figure(float(np.nanmax(course.high)))
        texts.append(
            f"speed from {least} to {highest} Hz; within a block by {100.0 * middle:.2g} % of its mean (median)"
        )
    return "; ".join(texts) + "."


def rotation_table(run: Run) -> Table | None:
    """Return blocks by status of the angle and domain of the spectra; None without a source of an angle."""
    rows: list[tuple[str, str, int, str, str]] = []
    for course in speed_courses(run):
        for status in dict.fromkeys(course.status.astype(str).tolist()):
            if not status:
                continue
            for orders in (True, False):
                places = np.flatnonzero((course.status == status) & (course.orders == orders))
                if places.size:
                    meaning = "the angle is known" if status == "ok" else ROTATION_REFUSALS.get(status, status)
                    domain = DOMAINS["order" if orders else "hertz"]
                    first = f"block {course.channel.sequence[places[0]]:,}"
                    rows.append((course.channels, status, int(places.size), f"{meaning}; {domain}", first))
    if not rows:
        return None
    columns = (
        Column("channels", "channels"),
        Column("status", "angle"),
        Column("blocks", "blocks", "1"),
        Column("meaning", "meaning"),
        Column("first", "first such block"),
    )
    return Table("rotation", "Angle of the shaft", columns, rows)

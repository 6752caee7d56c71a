"""Where the files of a logger are, and what their names and folders state."""

from __future__ import annotations

from datetime import datetime

from benchmarks.loggers.plan import SPEED_HZ, Plan

_STAMPS = ("%Y%m%d_%H%M%S", "%Y-%m-%d_%H-%M-%S", "%d.%m.%Y_%H-%M-%S", "%Y%m%dT%H%M%S", "%y%m%d_%H%M%S", "epoch")


def paths_of(plan: Plan, ending: str) -> list[str]:
    """Return the path of each file below the folder of data, without the mark of its channel."""
    prefix = plan.draw.one("prefix", ["Messung", "rec", "VIB", "pump3_de", "log"])
    stamp = plan.draw.one("stamp", _STAMPS, [5, 3, 2, 2, 1, 1]) if plan.dating == "name" else ""
    folders = plan.draw.one("folders", ["%Y/%m/%d/%H%M%S", "%Y-%m-%d/%H%M%S"]) if plan.dating == "folder" else ""
    if plan.dating == "folder" and plan.grouping == "hours":
        folders = plan.draw.one("folders", ["%Y%m%d/%H/%M%S", "%Y-%m-%d/%H/rec_%M%S"])
    rpm = f"_{60 * SPEED_HZ:.0f}rpm" if plan.speed_in == "name" else ""
    found: list[str] = []
    for index in range(len(plan.starts)):
        wall = plan.wall(index)
        if folders:
            stem = wall.strftime(folders) + rpm
        elif stamp:
            stem = f"{prefix}{rpm}_{_stamp(wall, stamp)}"
        else:
            stem = f"{prefix}{rpm}_{index + 1:04d}"
            if plan.grouping == "dates":
                stem = f"{wall:%Y-%m-%d}/{stem}"
        found.append(f"{stem}.{ending}")
    if stamp == "%y%m%d_%H%M%S":
        plan.draw.chosen["ambiguous_name"] = True
    return found


def _stamp(wall: datetime, stamp: str) -> str:
    return str(int(wall.timestamp())) if stamp == "epoch" else wall.strftime(stamp)


def of_channel(path: str, number: int, style: str) -> str:
    """Return the path of the file of one channel: by a suffix of the name, or in a folder of its own."""
    stem, dot, ending = path.rpartition(".")
    return f"ch{number}/{path}" if style == "folder" else f"{stem}_ch{number}{dot}{ending}"

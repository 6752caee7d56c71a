"""``spallwatch status`` of a folder: all machines in one table, the worst first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from monitor.commands.common import duration_words, emit
from monitor.config.fleet import load_fleet
from monitor.health.alarms import FAILURE, NO_DATA, machine_state
from monitor.service.status_file import read_status

_COLUMNS = ("machine", "state", "daemon", "blocks", "last block", "alarms", "remark")
_MAX_STATUS_AGE_S = 60.0
_STATES = frozenset(
    {"failure", "no_data", "bad_data", "out_of_specification", "maintenance_required", "check_function", "normal"}
)


def fleet_status(folder: Path, *, as_json: bool) -> None:
    """Print the status of all machines of a folder.

    Args:
        folder: holds a configuration a machine.
        as_json: for programs: ``machines``, the statuses that each would give alone and its ``file``, the worst first.

    Raises:
        ConfigError: the folder holds no usable set of configurations; all problems are named.
    """
    machines = [
        {
            "machine": machine.config.machine.name,
            "file": machine.path.name,
            **read_status(machine.config.machine.state_dir),
        }
        for machine in load_fleet(folder).machines
    ]
    machines.sort(key=lambda status: (_rank(status), status["machine"]))
    emit({"machines": machines}, _table([_row(status) for status in machines]), as_json=as_json)


def present_state(status: Mapping[str, Any]) -> str:
    """Return the state of a machine; without a running daemon it has no data.

    Args:
        status: as ``read_status`` gives it.
    """
    state = str(status.get("state", NO_DATA))
    if state in _STATES and (status["running"] or state == FAILURE):
        return state
    return NO_DATA


def _rank(status: Mapping[str, Any]) -> tuple[int, bool, bool]:
    """Return the sort key: the worst state first, then machines without a daemon, then those with problems."""
    state = present_state(status)
    worse = sum(machine_state(state, other) != state for other in _STATES)
    return worse, bool(status["running"]), not status.get("problems")


def _row(status: Mapping[str, Any]) -> tuple[str, ...]:
    channels = status.get("channels", {}).values()
    ages = [channel["last_block_age_s"] for channel in channels if channel.get("last_block_age_s") is not None]
    alarms = status.get("alarms", sum(len(channel.get("alarms", ())) for channel in channels))
    return (
        status["machine"],
        present_state(status).replace("_", " "),
        status["status"].replace("_", " "),
        str(status.get("blocks", "")),
        f"{duration_words(round(min(ages)))} ago" if ages and status["running"] else "",
        str(alarms) if alarms else "",
        _remark(status),
    )


def _remark(status: Mapping[str, Any]) -> str:
    """Return the best explanation of the state, in one sentence."""
    state = status.get("state")
    if not status["running"]:
        return f"no daemon since {status['updated_utc']}" if "updated_utc" in status else "no daemon has run"
    age = _age(status.get("updated_utc"))
    if age is not None and age > _MAX_STATUS_AGE_S:
        return f"the daemon has not renewed its status for {duration_words(age)}"
    problems = [f"{name}: {problem}" for name, problem in status.get("problems", {}).items()]
    if problems:
        return problems[0] + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else "")
    worst = [
        f"{name}: {channel['reason']}"
        for name, channel in status.get("channels", {}).items()
        if channel["state"] == state and state != "normal"
    ]
    return worst[0] + (f" (and {len(worst) - 1} more)" if len(worst) > 1 else "") if worst else ""


def _age(when: str | None) -> float | None:
    """Return the age of a time stamp of the status file, s."""
    if when is None:
        return None
    try:
        return (datetime.now(UTC) - datetime.fromisoformat(when)).total_seconds()
    except (TypeError, ValueError):
        return None


def _table(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(len(line[k]) for line in (_COLUMNS, *rows)) for k in range(len(_COLUMNS))]
    for line in (_COLUMNS, *rows):
        yield "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()

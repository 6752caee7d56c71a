"""``spallwatch status``: what the daemon of a machine is doing now."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from monitor.commands import option
from monitor.commands.common import duration_words, emit, read_config

_SAID = {
    "never_ran": "has never run",
    "died": "is not running: it died",
    "stopped": "is not running: it was stopped",
}


@click.command("status")
@option.config
@option.output
def command(config_path: Path | None, as_json: bool, quiet: bool) -> None:
    """Say what the daemon of this machine is doing now; exit code 0 also where none is running.

    Where FILE is a folder, all its machines are listed, the worst first.
    """
    if config_path is not None and config_path.is_dir():
        from monitor.commands.fleet_status import fleet_status

        fleet_status(config_path, as_json=as_json)
        return
    from monitor.service.status_file import read_status

    config = read_config(config_path)
    status = {"machine": config.machine.name, **read_status(config.machine.state_dir)}
    emit(status, _lines(status), as_json=as_json)


def _lines(status: Mapping[str, Any]) -> Iterator[str]:
    said = _SAID.get(status["status"], f"is {status['status']}")
    if "pid" not in status:
        yield f"{status['machine']}: the daemon {said}"
        return
    since = f"since {status['since_utc']}, " if status["running"] else ""
    yield f"{status['machine']}: the daemon {said} ({since}process {status['pid']}, spallwatch {status['version']})"
    yield f"state at {status['updated_utc']}: {_words(status['state'])}; {status['blocks']} blocks since its start"
    if status["running"] and status.get("page"):
        yield f"page: {status['page']}"
    # A file that an older version wrote lacks some keys.
    if waiting := status.get("unacknowledged", 0):
        yield f"{waiting} {'event waits' if waiting == 1 else 'events wait'} to be acknowledged"
    for name, problem in status["problems"].items():
        yield f"problem, {name}: {problem}"
    for name, source in status["sources"].items():
        age = f", the oldest for {duration_words(source['oldest_age_s'])}" if source["pending"] else ""
        yield (
            f"source {name}: {source['offered']} offered, {source['accepted']} accepted, "
            f"{source['rejected']} rejected, {source['pending']} pending{age}"
        )
    for name, channel in status["channels"].items():
        yield f"channel {name}: {', '.join(_channel(channel))}"


def _channel(channel: Mapping[str, Any]) -> Iterator[str]:
    yield f"{_words(channel['state'])} ({channel['reason']})"
    yield f"stage {_words(channel['stage'])}"
    for alarm in channel.get("alarms", ()):
        over = "" if alarm["active"] else ", over but not acknowledged"
        yield f"{alarm['severity']} of {alarm['rule']} since block {alarm['since_block']}{over}"
    if channel["fault"] is not None:
        yield f"{channel['fault'].replace('|', ' or ')} damaged"
    if channel["v_eq_mm2"] is not None:
        yield f"V_eq {channel['v_eq_mm2']:.3g} mm3/mm"
    if channel["tt_s"] is not None:
        yield f"TT {duration_words(channel['tt_s'])}"
    if channel["last_block"] is not None:
        when = channel["last_block_utc"] or "undated"
        yield f"last block {channel['last_block']} ({when}, {channel['last_block_status']})"


def _words(state: str) -> str:
    return state.replace("_", " ")

"""``spallwatch run``, ``page``, ``status``, ``release``: the daemon, the page of several machines, their state."""

from __future__ import annotations

import logging
import signal
import socket
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from models.platform.supervision import LostThreadError
from monitor.commands import option
from monitor.commands.common import read_config
from monitor.config.fleet import load_fleet
from monitor.health.alarms import FAILURE, NO_DATA
from monitor.service.progress import unhealthy
from monitor.service.system import present_status, set_up_log
from monitor.words.advice import status_line
from monitor.words.features import rule_words
from monitor.words.numbers import duration, times_first
from monitor.words.statuses import STATES, bearing_words

_COLUMNS = ("machine", "state", "daemon", "blocks", "last block", "alarms", "remark")
_MAX_IGNORED = 10
_MAX_ERRORS, _ERROR_PAUSE_S = 10, 0.1
_SAID = {
    "never_ran": "has never run",
    "died": "is not running: it died",
    "stopped": "is not running: it was stopped",
    "stalled": "is stalled",
}


@click.command("run")
@option.config
@click.option("--no-page", is_flag=True, help="Serve no page; `spallwatch page` serves one for all machines.")
@click.option("--verbose", is_flag=True, help="Log accepted blocks, too.")
@click.option("--quiet", is_flag=True, help="Log warnings and errors only.")
def command(config_path: Path | None, no_page: bool, verbose: bool, quiet: bool) -> None:
    """Follow the configured sources until SIGTERM or Ctrl-C; the log is written to standard error."""
    with _stop_on_signal() as stop:
        set_up_log(logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO)
        config = read_config(config_path)
        from monitor.service.daemon import Daemon

        Daemon(config, None if no_page else config_path or Path("config.toml")).run(stop)


@contextmanager
def _stop_on_signal() -> Iterator[threading.Event]:
    """Give an event that SIGTERM and SIGINT set.

    It is set by a thread: a handler of Python runs within the main thread, which may hold the lock of the event.
    """
    stop = threading.Event()
    lost: list[OSError] = []
    theirs, ours = socket.socketpair()
    theirs.setblocking(False)
    chosen = (signal.SIGTERM, signal.SIGINT)
    before = {number: signal.signal(number, lambda *_: None) for number in chosen}
    wakeup = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)

    def wait() -> None:
        try:
            while (received := _receive(ours)) and received[0] not in chosen:
                pass
        except OSError as error:
            lost.append(error)
        stop.set()

    thread = threading.Thread(target=wait, name="signals", daemon=True)
    thread.start()
    try:
        yield stop
    finally:
        signal.set_wakeup_fd(wakeup)
        for number, handler in before.items():
            signal.signal(number, handler)
        theirs.close()
        thread.join()
        ours.close()
    if lost:
        # The service manager starts it again; without the thread, no signal would ever end it.
        raise LostThreadError(f"the thread that waits for signals ended: {lost[0]}")


def _receive(wakes: socket.socket) -> bytes:
    """Return the next byte, through a few errors of the socket; the last of them is raised."""
    for left in reversed(range(_MAX_ERRORS)):
        try:
            return wakes.recv(1)
        except OSError:
            if not left:
                raise
            time.sleep(_ERROR_PAUSE_S)
    return b""


@click.command("page")
@option.config
@click.option("--port", type=click.IntRange(0, 65535), help="In place of the configured one; 0: any free port.")
@click.option("--quiet", is_flag=True, help="Log errors only.")
def page(config_path: Path | None, port: int | None, quiet: bool) -> None:
    """Serve one page over all machines of a folder until SIGTERM or Ctrl-C; its address is printed first.

    The page reads what the daemons write; it starts none. FILE may be a folder, whose *.toml are the machines, or one
    file. A file that is not valid is left out and logged; machines that share a name, a folder or a listening address
    are refused.
    """
    set_up_log(logging.ERROR if quiet else logging.INFO)
    from monitor.web.server import serve_until_signal

    if config_path is None or not config_path.is_dir():
        config = read_config(config_path)
        folder = (config_path or Path("config.toml")).absolute().parent
        serve_until_signal([config], config.web, config.machine.state_dir, port, folder)
        return
    fleet = load_fleet(config_path, strict=False)
    for problem in fleet.problems:
        logging.getLogger(__name__).error("left out: %s", problem)
    serve_until_signal([machine.config for machine in fleet.machines], fleet.web, fleet.page_dir, port, config_path)


@click.command("status")
@option.config
@click.option("--check", is_flag=True, help="Exit code 1 where a daemon does not run, is stalled or cannot commit.")
@option.output
def status(config_path: Path | None, check: bool) -> option.Result:
    """Say what the daemon of this machine is doing now; without --check, exit code 0 also where none is running.

    Where FILE is a folder, all its machines are listed, the worst first.
    """
    if config_path is not None and config_path.is_dir():
        machines = _fleet(config_path)
        found, lines = {"machines": machines}, _table([_row(status) for status in machines])
    else:
        config = read_config(config_path)
        found = {"machine": config.machine.name, **present_status(config)}
        machines, lines = [found], _lines(found)
    if not check:
        return found, lines
    reasons = [f"{machine['machine']}: {reason}" for machine in machines for reason in unhealthy(machine)]
    return {**found, "reasons": reasons}, (*lines, *(f"unhealthy, {reason}" for reason in reasons)), int(bool(reasons))


@click.command("release")
@click.argument("name")
@option.config
@option.output
def release(name: str, config_path: Path | None) -> option.Result:
    """Let a poisoned file be handled again: NAME as `status` lists it, or without its folder.

    A daemon that runs takes it within seconds. Exit code 1 where no poisoned file has that name.
    """
    config = read_config(config_path)
    from monitor.records import ledger

    files = ledger.release(config.machine.state_dir / "state.db", name)
    released = [{"source": source, "file": path} for source, path in files]
    return {"released": released}, (f"released: {path} (source {source})" for source, path in files)


def _lines(status: Mapping[str, Any]) -> Iterator[str]:
    said = _SAID.get(status["status"], f"is {status['status']}")
    if "pid" not in status:
        yield f"{status['machine']}: the daemon {said}"
        yield from _beside(status)
        return
    since = f"since {status['since_utc']}, " if status["running"] else ""
    yield f"{status['machine']}: the daemon {said} ({since}process {status['pid']}, spallwatch {status['version']})"
    yield f"state at {status['updated_utc']}: {_words(status['state'])}; {status['blocks']} blocks since its start"
    if status["running"] and status.get("page"):
        yield f"page: {status['page']}"
    # A file that an older version wrote lacks some keys.
    if waiting := status.get("unacknowledged", 0):
        yield f"{waiting} {'event waits' if waiting == 1 else 'events wait'} to be acknowledged"
    if recovered := status.get("recovered"):
        yield f"at the start, {recovered}"
    yield from _beside(status)
    for name, past in status.get("failures", {}).items():
        yield f"failures since the start, {name}: {past['count']}, the last at {past['last_utc']}: {past['last_cause']}"
    for name, source in status["sources"].items():
        more = f", the oldest for {duration(source['oldest_age_s'])}" if source["pending"] else ""
        # Connections and messages, which are not offered.
        more += f"; {refused} senders or messages refused" if (refused := source.get("refused", 0)) else ""
        yield (
            f"source {name}: {source['offered']} offered, {source['accepted']} accepted, "
            f"{source['rejected']} rejected, {source.get('ignored', 0)} ignored, {source['pending']} pending{more}"
        )
    yield from (f"ignored: {name}, {reason}" for name, reason in list(status.get("ignored", {}).items())[:_MAX_IGNORED])
    for name, reason in status.get("poisoned", {}).items():
        yield f"poisoned, {name}: {reason}"
    for name, found in status.get("bearings", {}).items():
        yield f"bearing {name}: {bearing_words(found)}"
    for name, channel in status["channels"].items():
        yield f"channel {name}: {_words(channel['state'])} ({channel['reason']}); {status_line(name, channel)}"
        if figures := ", ".join(_channel(channel)):
            yield f"channel {name}, in figures: {figures}"


def _beside(status: Mapping[str, Any]) -> Iterator[str]:
    """Yield the problems and the last backup, which are known without a daemon, too."""
    for name, problem in status.get("problems", {}).items():
        yield f"problem, {name}: {problem}"
    age = status["last_backup_age_s"]
    yield "no backup was made" if age is None else f"last backup {duration(age)} ago ({status['last_backup_utc']})"


def _channel(channel: Mapping[str, Any]) -> Iterator[str]:
    for alarm in channel.get("alarms", ()):
        over = "" if alarm["active"] else ", over but not acknowledged"
        yield f"{alarm['severity']} of {rule_words(alarm)} since block {alarm['since_block']}{over}"
    # A file that an older version wrote lacks the relative value.
    if channel.get("calibrated") is False and channel.get("v_eq_relative") is not None:
        yield f"V_eq {times_first(channel['v_eq_relative'])} (rig not calibrated)"
    elif channel["v_eq_mm2"] is not None:
        yield f"V_eq {channel['v_eq_mm2']:.3g} mm3/mm"
    if channel["tt_s"] is not None:
        yield f"TT {duration(channel['tt_s'])}"
    if channel["last_block"] is not None:
        when = channel["last_block_utc"] or "undated"
        yield f"last block {channel['last_block']} ({when}, {channel['last_block_status']})"


def _words(state: str) -> str:
    return state.replace("_", " ")


def _fleet(folder: Path) -> list[dict[str, Any]]:
    """Return the statuses of all machines of a folder, the worst first.

    Raises:
        ConfigError: the folder holds no usable set of configurations; all problems are named.
    """
    machines: list[dict[str, Any]] = [
        {
            "machine": machine.config.machine.name,
            "file": machine.path.name,
            **present_status(machine.config),
        }
        for machine in load_fleet(folder).machines
    ]
    machines.sort(key=lambda status: (_rank(status), status["machine"]))
    return machines


def present_state(status: Mapping[str, Any]) -> str:
    """Return the state of a machine from ``present_status``; without a running daemon it has no data."""
    state = str(status.get("state", NO_DATA))
    if state in STATES and (status["running"] is True or state == FAILURE):
        return state
    return NO_DATA


def _rank(status: Mapping[str, Any]) -> tuple[int, bool, bool]:
    """Return the sort key: the worst state first, then machines without a daemon, then those with problems."""
    return list(STATES).index(present_state(status)), status["running"] is True, not status.get("problems")


def _row(status: Mapping[str, Any]) -> tuple[str, ...]:
    channels = status.get("channels", {}).values()
    ages = [channel["last_block_age_s"] for channel in channels if channel.get("last_block_age_s") is not None]
    alarms = status.get("alarms", sum(len(channel.get("alarms", ())) for channel in channels))
    return (
        status["machine"],
        _words(present_state(status)),
        _words(status["status"]),
        str(status.get("blocks", "")),
        f"{duration(round(min(ages)))} ago" if ages and status["running"] else "",
        str(alarms) if alarms else "",
        _remark(status),
    )


def _remark(status: Mapping[str, Any]) -> str:
    """Return the best explanation of the state, in one sentence."""
    state = status.get("state")
    if not status["running"]:
        return f"no daemon since {status['updated_utc']}" if "updated_utc" in status else "no daemon has run"
    problems = [f"{name}: {problem}" for name, problem in status.get("problems", {}).items()]
    reasons = problems or [
        f"{name}: {channel['reason']}"
        for name, channel in status.get("channels", {}).items()
        if channel["state"] == state and state != "normal"
    ]
    more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
    return reasons[0] + more if reasons else ""


def _table(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(len(line[k]) for line in (_COLUMNS, *rows)) for k in range(len(_COLUMNS))]
    for line in (_COLUMNS, *rows):
        yield "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()

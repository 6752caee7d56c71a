"""``spallwatch run``: the daemon."""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from monitor.commands.common import config_option, read_config
from monitor.service.logs import set_up_log


@click.command("run")
@config_option()
@click.option("--verbose", is_flag=True, help="Log accepted blocks, too.")
@click.option("--quiet", is_flag=True, help="Log warnings and errors only.")
@click.option("--supervised", type=click.FloatRange(min=0.0), metavar="SECONDS", hidden=True)
def command(config_path: Path | None, verbose: bool, quiet: bool, supervised: float | None) -> None:
    """Follow the configured sources until SIGTERM or Ctrl-C; what it does is logged on standard error.

    Where FILE is a folder, every *.toml in it is a machine with a process of its own, and all share one page.
    """
    # --supervised: a supervisor started this. It has the page and the other end of standard input, and says how long
    # the last publication may take.
    with _asked_to_stop() as stop:
        level = logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO
        set_up_log(level)
        if config_path is not None and config_path.is_dir():
            _supervise(config_path, stop, verbose=verbose, quiet=quiet)
            return
        config = read_config(config_path)
        from monitor.service.daemon import Daemon

        if supervised is None:
            Daemon(config, config_path or Path("config.toml")).run(stop)
            return
        from monitor.service.supervision import end_with_supervisor

        end_with_supervisor(stop)
        Daemon(config, publish_within=supervised).run(stop)
        # All is closed by now. Taking down the interpreter costs a tenth of a second, and many daemons end at once.
        logging.shutdown()
        os._exit(0)


def _supervise(folder: Path, stop: threading.Event, *, verbose: bool, quiet: bool) -> None:
    """Follow all machines of a folder."""
    from monitor.service.fleet import load_fleet
    from monitor.service.supervisor import Supervisor

    fleet, page = load_fleet(folder), None
    if fleet.web.enabled:
        from monitor.service.page import PageProcess

        page = PageProcess([machine.path for machine in fleet.machines], fleet.web, fleet.page_dir)
    given = {"--verbose": verbose, "--quiet": quiet}
    Supervisor(fleet, page=page, options=[option for option, wanted in given.items() if wanted]).run(stop)


@contextmanager
def _asked_to_stop() -> Iterator[threading.Event]:
    """Give an event that SIGTERM and SIGINT set.

    It is set by a thread: a handler of Python runs within the main thread, which may hold the lock of the event.
    """
    stop = threading.Event()
    theirs, ours = socket.socketpair()
    theirs.setblocking(False)
    chosen = (signal.SIGTERM, signal.SIGINT)
    before = {number: signal.signal(number, lambda *_: None) for number in chosen}
    wakeup = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)

    def wait() -> None:
        while (heard := ours.recv(1)) and heard[0] not in chosen:
            pass
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

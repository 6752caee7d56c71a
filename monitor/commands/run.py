"""``spallwatch run``: the daemon."""

from __future__ import annotations

import logging
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from monitor.commands import option
from monitor.commands.common import read_config
from monitor.config.load import ConfigError
from monitor.service.systemd import set_up_log


@click.command("run")
@option.config
@click.option("--no-page", is_flag=True, help="Serve no page; `spallwatch page` serves one for all machines.")
@click.option("--verbose", is_flag=True, help="Log accepted blocks, too.")
@click.option("--quiet", is_flag=True, help="Log warnings and errors only.")
def command(config_path: Path | None, no_page: bool, verbose: bool, quiet: bool) -> None:
    """Follow the configured sources until SIGTERM or Ctrl-C; the log is written to standard error."""
    with _stop_on_signal() as stop:
        set_up_log(logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO)
        if config_path is not None and config_path.is_dir():
            raise ConfigError(
                f"{config_path}: is a folder; run follows one machine, so give one file of it. "
                "For all machines of a folder: one service each (spallwatch@NAME, made by make install-service) "
                f"and one page (spallwatch page --config {config_path})"
            )
        config = read_config(config_path)
        from monitor.service.daemon import Daemon

        Daemon(config, None if no_page else config_path or Path("config.toml")).run(stop)


@contextmanager
def _stop_on_signal() -> Iterator[threading.Event]:
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
        while (received := ours.recv(1)) and received[0] not in chosen:
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

"""``spallwatch page``: one page over all machines of a folder."""

from __future__ import annotations

import logging
from pathlib import Path

import click

from monitor.commands import option
from monitor.commands.common import read_config
from monitor.config.fleet import load_fleet
from monitor.service.systemd import set_up_log


@click.command("page")
@option.config
@click.option("--port", type=click.IntRange(0, 65535), help="In place of the configured one; 0: any free port.")
@click.option("--quiet", is_flag=True, help="Log errors only.")
def command(config_path: Path | None, port: int | None, quiet: bool) -> None:
    """Serve one page over all machines of a folder until SIGTERM or Ctrl-C; its address is printed first.

    The page reads what the daemons write; it starts none. FILE may be a folder, whose *.toml are the machines, or one
    file. A file that is not valid is left out and logged; machines that share a name, a folder or a listening address
    are refused.
    """
    set_up_log(logging.ERROR if quiet else logging.INFO)
    from monitor.web.server import serve_until_signal

    if config_path is None or not config_path.is_dir():
        config = read_config(config_path)
        serve_until_signal([config], config.web, config.machine.state_dir, port)
        return
    fleet = load_fleet(config_path, strict=False)
    for problem in fleet.problems:
        logging.getLogger(__name__).error("left out: %s", problem)
    serve_until_signal([machine.config for machine in fleet.machines], fleet.web, fleet.page_dir, port)

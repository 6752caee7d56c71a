"""A machine with watched folders, and its daemon as a process of its own."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.support.commands import run_command
from tests.support.forks import ForkedProgram

ROOT = Path(__file__).parents[2]
RATE = 2560
_CLI = "from monitor.cli import main; main()"


def machine_text(*folders: Path, interval_s: float = 0.3) -> str:
    """Return the configuration of a machine m without a page: sources s0, ... and channels x0, ..., one a folder."""
    parts = [
        '[machine]\nname = "m"\nmin_free_mb = 1\n',
        f"[publish]\ninterval_s = {interval_s}\n",
        "[web]\nenabled = false\n",
        '[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n',
        "[operating]\nspeed_hz = 40.0\n",
    ]
    for number, folder in enumerate(folders):
        parts.append(
            f'[[source]]\nname = "s{number}"\nurl = "folder:{folder}"\nformat = "csv"\n'
            f"rate_hz = {RATE}\nsettle_s = 0.2\nblock_s = 0.1\n"
            f'[[channel]]\nname = "x{number}"\nsource = "s{number}"\ncolumn = 1\nunit = "g"\nbearing = "b"\n'
            "band_hz = [[300, 1200]]\n"
        )
    return "".join(parts)


def make_machine(folder: Path, sources: int = 1) -> Path:
    """Make a configuration below a folder, with input folders in0, in1, ...; return its path."""
    inputs = [folder / f"in{number}" for number in range(sources)]
    for path in inputs:
        path.mkdir()
    config = folder / "m.toml"
    config.write_text(machine_text(*inputs))
    return config


def tcp_machine_text(port: int, interval_s: float = 0.3) -> str:
    """Return the configuration of a machine m with a source s that listens on a port of this machine, and channel x."""
    return (
        f'[machine]\nname = "m"\nmin_free_mb = 1\n[publish]\ninterval_s = {interval_s}\n[web]\nenabled = false\n'
        '[[bearing]]\nname = "b"\ndesignation = "1205 ETN9"\n[operating]\nspeed_hz = 40.0\n'
        f'[[source]]\nname = "s"\nurl = "tcp://127.0.0.1:{port}"\nblock_s = 0.1\nrate_hz = {RATE}\n'
        '[[channel]]\nname = "x"\nsource = "s"\nunit = "g"\nbearing = "b"\nband_hz = [[300, 1200]]\n'
    )


def free_port() -> int:
    """Return a port of this machine that nobody listens on."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def start(config: Path, *options: str, errors: Path | None = None, programs: bool = False) -> ForkedProgram:
    """Start a daemon in a fork; its standard error is appended to a file, or returned at its end.

    Its own children are forks too in quick effort, unless they shall be ``programs``.
    """
    words = ("run", "--config", str(config), *options)
    return ForkedProgram(*words, folder=ROOT, errors=errors and str(errors), programs=programs)


def start_program(config: Path, *options: str, prefix: Sequence[str] = (), **more: Any) -> subprocess.Popen[str]:
    """Start a daemon as a new program; the prefix is a program, with its options, that starts it."""
    command = [*prefix, sys.executable, "-c", _CLI, "run", "--config", str(config), *options]
    return subprocess.Popen(command, cwd=ROOT, text=True, **{"stderr": subprocess.PIPE, **more})


def call(*arguments: str, prefix: Sequence[str] = ()) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, in this process or, where there is a prefix, by the program that it names."""
    if not prefix:
        return run_command(*arguments)
    return subprocess.run(
        [*prefix, sys.executable, "-c", _CLI, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def status(config: Path) -> dict[str, Any]:
    """Return what the status file says, {} where there is none."""
    try:
        return json.loads((config.parent / "state" / "status.json").read_text())
    except FileNotFoundError:
        return {}

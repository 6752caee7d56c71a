"""The command line: dispatch to the commands, exit codes of errors, check of the installation."""

from __future__ import annotations

import importlib.util
import os
import pkgutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import click

from monitor import __version__

if TYPE_CHECKING:
    from models.words.extras import Command

DONE, FAILED, WRONG = 0, 1, 2
_WITHHELD = 0o027
"""Permissions that nothing the program makes has: files get 0640 at most, folders 0750; secrets ask for 0600."""

_COMMANDS = {
    "demo": ("demo:command", "Monitor a simulated bearing that wears out, and write a report."),
    "init": ("init.command:command", "Look at files, ask what they do not state, write a configuration."),
    "run": ("run:command", "The daemon: follows the configured sources until it is stopped."),
    "page": ("run:page", "One page over all machines of a folder."),
    "status": ("run:status", "What the daemon of a machine is doing now."),
    "release": ("run:release", "Let a file be handled again that was set aside as poisoned."),
    "replay": ("replay:command", "Run the pipeline over a recording, as fast as possible or at a pace."),
    "report": ("report:command", "One self-contained HTML report of records, or one per run."),
    "check": ("check.command:command", "Validate a configuration and list what would be monitored."),
    "redate": ("redate:command", "Choose anew what dates the later blocks of a source."),
    "bearing": ("bearing.command:command", "Fault frequencies, stiffness, natural frequencies and life."),
    "ias": ("ias:command", "Angular speed of a shaft from the pulses of an encoder."),
    "cyclic": ("orders:cyclic_command", "Spectral coherence of a recording over the orders of its shaft."),
    "simulate": ("simulate.command:command", "One scene of the bearing model."),
    "map": ("maps:command", "RMS maps: build, show, check."),
    "library": ("library:command", "Libraries of simulated lives: build."),
    "track": ("track:command", "V_eq from an RMS history and a map."),
    "orders": ("orders:command", "Spectra of a block over orders of the shaft, at its full rate."),
    "examples": ("installation:examples_command", "List the examples that come with the program, or copy them."),
    "warmup": ("installation:command", "Compile the bearing model and plan transforms in advance."),
    "forecast": ("forecast:command", "Time to threshold from a V_eq history."),
    "score": ("score:command", "Scores of the forecasts as issued, once the end is known."),
    "archive-days": ("backup:archive_days_command", "Move the oldest published days to another folder."),
    "backup": ("backup:command", "Back the state of a machine up while its daemon runs."),
    "restore": ("backup:restore_command", "Put a backup in the place of the state of a machine."),
    "user": ("user:group", "Who may sign in to the page: add, invite, list, remove."),
    "send": ("send:command", "Send a recording to a receiver over TCP or MQTT."),
    "stream": ("send:group", "Streams over TCP or MQTT: let one begin anew."),
}


@cache
def commands() -> dict[str, Command]:
    """Return all commands in the order of ``--help``; an extra names the one that it follows."""
    # Not imported above: check_installation comes before anything of models.
    from models.words.extras import Command, brought

    found = {name: Command(f"monitor.commands.{place}", words) for name, (place, words) in _COMMANDS.items()}
    extras = {name: point.load() for name, point in brought("commands").items()}
    names = list(found)
    for name, command in extras.items():
        names.insert(names.index(command.after) + 1 if command.after in names else len(names), name)
    return {name: (found | extras)[name] for name in names}


class _Commands(click.Group):
    """Import a command when it is called, so that one without a model does not wait for models to be imported."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(commands())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        named = commands().get(cmd_name)
        return None if named is None else pkgutil.resolve_name(named.place)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.words) for name, command in commands().items()])


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110, "show_default": True},
)
@click.version_option(__version__, prog_name="spallwatch")
def spallwatch() -> None:
    """Listen to rolling bearings: when damage begins, how large it is by now, how long is left.

    Exit codes: 0 done, 1 failed while running, 2 wrong usage or configuration.
    """


def check_installation() -> str | None:
    """Return what is wrong if the three packages do not come from one folder, else None.

    ``models`` is a common name: another distribution or a folder in the working directory may shadow ours.
    """
    places = {}
    for name in ("monitor", "models", "streams"):
        spec = importlib.util.find_spec(name)
        if spec is None or not spec.submodule_search_locations:
            return f"the package {name!r} of spallwatch is not installed"
        places[name] = Path(next(iter(spec.submodule_search_locations))).resolve()
    own = Path(__file__).resolve().parent.parent
    for name, place in places.items():
        if place != own / name:
            return (
                f"the package {name!r} is taken from {place}, but spallwatch is installed in {own}; "
                "install spallwatch in a virtual environment of its own, or run it from another folder"
            )
    return None


@contextmanager
def _withheld() -> Iterator[None]:
    """Make files and folders for owner and group only, also in children; a stricter umask of the caller stays."""
    before = os.umask(0o777)
    os.umask(before | _WITHHELD)
    try:
        yield
    finally:
        os.umask(before)


def main() -> None:
    """Run the command line and exit."""
    problem = check_installation()
    if problem is not None:
        click.echo(f"spallwatch: {problem}", err=True)
        sys.exit(WRONG)
    from models.platform.process_signals import interrupts_kept

    try:
        with _withheld(), interrupts_kept():
            code = spallwatch.main(prog_name="spallwatch", standalone_mode=False)
        sys.exit(code if isinstance(code, int) else DONE)
    except click.ClickException as error:
        error.show()
        sys.exit(WRONG)
    except (click.Abort, KeyboardInterrupt):
        click.echo("spallwatch: interrupted; what was committed is kept", err=True)
        sys.exit(FAILED)
    except BrokenPipeError:
        # The reader of the output has closed it; without this, python reports the same error again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)
    except Exception as error:
        _explain(error)


def _explain(error: Exception) -> None:
    """Print what went wrong and exit with the error's code; SPALLWATCH_TRACEBACK=1 shows where. No credentials."""
    # Not imported above: check_installation comes before anything of models.
    from models.words.errors import SpallwatchError
    from models.work.redact import redact, redacted_traceback

    foreseen = isinstance(error, SpallwatchError)
    code = error.exit_code if foreseen else FAILED
    if os.environ.get("SPALLWATCH_TRACEBACK") == "1":
        click.echo(redacted_traceback(error).rstrip(), err=True)
        code = FAILED
    elif not foreseen:
        text = redact(f"{type(error).__name__}: {error}")
        click.echo(f"spallwatch: failed: {text}\n(SPALLWATCH_TRACEBACK=1 shows where)", err=True)
    else:
        click.echo(f"spallwatch: {redact(str(error))}", err=True)
    sys.exit(code)

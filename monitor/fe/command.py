"""``spallwatch bearing --fe``: contacts and stiffness from finite elements, beside the analytic answer."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import click

from models.fe.bearings.rig import rig_stiffness
from models.fe.bearings.rings import SUPPORTS, Support
from models.fe.meshes.named_rules import NAMED_RULES, MeshName
from models.machine.bearing import CatalogueEntry
from monitor.commands import option
from monitor.commands.common import InputError, check_writable, input_errors, output_errors
from monitor.fe.case import FeCase, FeOptions, fe_case
from monitor.fe.config_shaft import read_shaft
from monitor.fe.rig import rig_text
from monitor.fe.shaft import shaft_values
from monitor.fe.values import Partner, fe_picture, fe_values
from monitor.fe.values import fe_lines as lines

__all__ = ["WORDS", "answer", "lines", "options"]

WORDS = "finite elements"
P = ParamSpec("P")
R = TypeVar("R")


def options(function: Callable[P, R]) -> Callable[..., R]:
    """Add the options of finite elements; the command gets them as ``fe``, None without ``--fe``."""

    @click.option("--fe", "wanted", is_flag=True, help="Contacts and rings by finite elements too (extra fe).")
    @click.option(
        "--fe-support",
        "support",
        type=click.Choice(SUPPORTS),
        default="rigid-shaft",
        help="What carries the inner ring; sinusoidal: the load on its bore, as in the thesis.",
    )
    @click.option(
        "--fe-mesh",
        "mesh",
        type=click.Choice(tuple(NAMED_RULES)),
        default="default",
        help="Size of the elements by the width of the contact.",
    )
    @click.option("--memory-gb", type=option.POSITIVE, help="Most memory of this process with --fe.")
    @click.option("--no-cache", is_flag=True, help="With --fe: compute anew, keep nothing.")
    @click.option("--shaft", type=option.FILE, help="With --fe: k_i of a stepped shaft on its bearings (TOML).")
    @click.option("--write-rig", type=option.OUT_FILE, help="With --fe: write k_c, and k_i of --shaft, as [rig].")
    @functools.wraps(function)
    def command(
        *args: Any,
        wanted: bool,
        support: Support,
        mesh: MeshName,
        memory_gb: float | None,
        no_cache: bool,
        shaft: Path | None,
        write_rig: Path | None,
        **rest: Any,
    ) -> R:
        context = click.get_current_context()
        given = [name for name in _OPTION_NAMES if _is_given(context, name)]
        if given and not wanted:
            raise InputError(f"{_OPTION_NAMES[given[0]]}: only with --fe")
        fe = FeOptions(support, mesh, memory_gb, not no_cache, shaft, write_rig) if wanted else None
        return function(*args, fe=fe, **rest)  # pyright: ignore[reportCallIssue]

    return command


_OPTION_NAMES = {
    "support": "--fe-support",
    "mesh": "--fe-mesh",
    "memory_gb": "--memory-gb",
    "no_cache": "--no-cache",
    "shaft": "--shaft",
    "write_rig": "--write-rig",
}


def _is_given(context: click.Context, name: str) -> bool:
    return context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def answer(
    entry: CatalogueEntry,
    load: float,
    clearance: float,
    analytic: Mapping[str, Any],
    partner: Partner | None,
    options: FeOptions,
) -> dict[str, Any]:
    """Return the answer of finite elements beside the analytic one; write the files that are asked for.

    Raises:
        WrongInputError: as of :func:`fe_case`; a file cannot be read or written; there is no result to write.
    """
    for words, path in (("--plot", options.plot), ("--write-rig", options.write_rig)):
        if path is not None:
            check_writable(words, path)
    shaft = None if options.shaft is None else read_shaft(options.shaft)
    case = fe_case(entry, load, clearance, options)
    values: dict[str, Any] = fe_values(case, analytic, partner)
    values["shaft"] = None if shaft is None else shaft_values(shaft, load)
    if options.write_rig is not None:
        _write_rig(case, partner, values, options.write_rig)
    if options.plot is not None:
        from monitor.fe.figure import bearing_sheet
        from monitor.report.figures.sheet import write_sheet

        with output_errors("--plot", options.plot):
            write_sheet(bearing_sheet(fe_picture(case, values, partner)), options.plot)
    return values


def _write_rig(case: FeCase, partner: Partner | None, values: Mapping[str, Any], path: Path) -> None:
    from monitor.report.tables import write_whole

    if partner is None or values["status"] != "converged":
        raise InputError(f"--write-rig {path}: there is no contact stiffness to write: {values['status']}")
    bearing = partner[0]
    k_c = rig_stiffness(
        case.bearing.assembled, bearing, case.load, clearance=case.clearance, mesh_error=case.first.mesh_error
    )
    with output_errors("--write-rig", path), input_errors(f"--write-rig {path}"):
        write_whole(path, rig_text(case.options.rig_name, bearing.element, k_c, values["shaft"]))

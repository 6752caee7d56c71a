"""``spallwatch bearing --fe``: contacts and stiffness from finite elements, beside the analytic answer."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import click

from models.fe.bearings.rig import EffectiveStiffness, rig_stiffness
from models.fe.bearings.rings import SUPPORTS, Support
from models.fe.meshes.sizing import NAMED_RULES, MeshName
from models.machine.bearing import CatalogueEntry
from monitor.commands import option
from monitor.commands.common import InputError, check_writable, input_errors, output_errors
from monitor.config.bearing import RIG_KEYS, STIFFNESS_KEYS
from monitor.fe.case import FeCase, FeOptions, fe_case
from monitor.fe.shaft import read_shaft, shaft_values
from monitor.fe.values import Partner, fe_picture, fe_values
from monitor.fe.values import fe_lines as lines


def rig_text(bearing: str, element: str, k_c: EffectiveStiffness | None, shaft: dict[str, Any] | None) -> str:
    """Return a ``[rig]`` table as TOML.

    Args:
        bearing: name of the bearing in the configuration.
        element: "ball" or "roller".
        k_c: of the bearing; None leaves the key out.
        shaft: what ``monitor.fe.shaft.shaft_values`` found; None leaves k_i out.

    Raises:
        ValueError: there is nothing to write, or the shaft did not settle.
    """
    lines = [*_contact_lines(element, k_c), *_shaft_lines(shaft)]
    if not lines:
        raise ValueError("[rig]: neither a bearing nor a shaft of finite elements to write")
    return "\n".join(
        ["# From finite elements (spallwatch bearing --fe).", "[rig]", f'bearing = "{bearing}"', *lines, ""]
    )


def _contact_lines(element: str, k_c: EffectiveStiffness | None) -> Iterator[str]:
    if k_c is None:
        return
    percent = 100.0 * k_c.spread
    mesh = "not known" if k_c.mesh_error != k_c.mesh_error else f"{100.0 * k_c.mesh_error:.2g} %"
    loads = [load for _, load, _ in k_c.matched]
    yield (
        f"# k_c of the law Q = k delta^{'1.5' if element == 'ball' else '(10/9)'} with the mean stiffness along a load "
        f"of {k_c.load:g} N;"
    )
    yield (
        f"# {k_c.low:.5g} to {k_c.high:.5g} match k_xx, k_yy or the displacement from {min(loads):g} to "
        f"{max(loads):g} N; standard deviation {percent:.2g} %, of it mesh {mesh}."
    )
    yield f"# Its spread in maps: spallwatch map build --rig-draws 16 --rig-spread-k-c {k_c.spread:.3f}"
    yield f"{STIFFNESS_KEYS[element]} = {k_c.value:.6g}"


def _shaft_lines(shaft: dict[str, Any] | None) -> Iterator[str]:
    if shaft is None:
        return
    if shaft["status"] != "converged":
        raise ValueError(f"[rig]: the shaft is {shaft['status']}; k_i is not written")
    over = shaft["against_load"]
    stiffness = [one["k_i_newton_per_m"] for one in over]
    loads = [one["load_newton"] for one in over]
    yield (
        f"# k_i of the end of the shaft under {shaft['load_newton']:g} N; {min(stiffness):.4g} to {max(stiffness):.4g} "
        f"from {loads[0]:g} to {loads[-1]:g} N, mesh error {shaft['mesh_error_percent']:.2g} %."
    )
    yield f"{RIG_KEYS['k_i']} = {shaft['k_i_newton_per_m']:.6g}"


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

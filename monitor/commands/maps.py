"""``spallwatch map``: build, show and check RMS maps."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np

from models.machine.rig import Rig, RigDraws
from models.machine.scene import PARTS, Floor, Slip
from models.maps.build import MAX_NODES, build_map, build_refined_map
from models.maps.check import check_map
from models.maps.data import RmsMap
from models.maps.file import load_map, save_map
from models.maps.plan import MapPlan
from models.solve.registry import RIGS
from models.solve.response import STATUSES, Status
from monitor.commands import option
from monitor.commands.cluster_options import Sharing, sharing
from monitor.commands.common import (
    PICTURES,
    InputError,
    check_suffix,
    check_writable,
    find_entry,
    finite,
    input_errors,
    output_errors,
    read_machine,
    say,
    write_plot,
)
from monitor.commands.model_parameters import effects_of
from monitor.config.load import Config
from monitor.words.calibration import rig_line
from monitor.words.numbers import floor_of_defect
from streams.types.block import STANDARD_GRAVITY

_COARSE = 0.02
"""Error between nodes above which a finer grid is advised."""
_MAPPED = ("second_bearing", "axial_load")
"""What a map takes of the machine beside its parameters."""
_POSTERIOR_DRAWS = 16
"""Rigs drawn of a posterior, which a map costs each."""


@click.group("map")
def command() -> None:
    """RMS over extent and depth of a defect, simulated in advance: build, show, check."""


@command.command("build")
@option.config
@option.bearing
@click.option("--load-newton", type=option.NOT_NEGATIVE, multiple=True, help="One or several loads.")
@click.option("--speed-hz", type=option.POSITIVE, multiple=True, help="One or several speeds.")
@click.option("--model", type=click.Choice(list(RIGS)), default=Rig.model, help="Other models take [shaft].")
@click.option("--fault", type=click.Choice(PARTS), default="outer", help="The damaged part.")
@click.option("--dphi-deg", type=option.Axis(), default="0:50:51", help="Extents; of a ball about its own axis.")
@click.option("--h-d-um", type=option.Axis(), default="0:32:33", help="Depths.")
@option.floor
@click.option("--floors", type=click.IntRange(min=1), default=1, help="Floors to average.")
@click.option("--seed", type=option.WHOLE, default=0, help="Seed of the first rough floor.")
@click.option("--slip-deg", type=click.FloatRange(0, 28), default=0.0, help="Largest slip angle of the balls.")
@click.option(
    "--slip-rule", type=click.Choice(["per_passage", "mean_force"]), default="per_passage", help="How slip is drawn."
)
@click.option("--slip-seed", type=option.WHOLE, default=0, help="Seed of the slip.")
@click.option(
    "--rig-draws",
    type=option.WHOLE,
    help=f"Rigs drawn for the spread over parameters. Default: {_POSTERIOR_DRAWS} of a posterior in [rig], else 0.",
)
@click.option(
    "--rig-spread", type=click.FloatRange(0, 0.5), help="Relative sd of parameters, not a posterior's. [0.035]"
)
@click.option("--rig-spread-k-r", type=click.FloatRange(0, 0.5), help="Relative sd of k_r, likewise. [0.014]")
@click.option("--rig-spread-k-c", type=click.FloatRange(0, 0.5), help="Relative sd of k_c, likewise. [--rig-spread]")
@click.option("--rig-seed", type=option.WHOLE, default=0, help="Seed of the rigs.")
@click.option(
    "--interpolation-tolerance",
    type=click.FloatRange(0, 1),
    default=0.01,
    help="Refine the axes until the error between nodes (rms, over the largest RMS) is below this; 0 leaves them.",
)
@click.option("--most-nodes", type=click.IntRange(min=1), default=MAX_NODES, help="Limit of the refinement.")
@click.option("--rms-band-hz", type=option.Range(), help="Band of the RMS, the same as of the recordings.")
@sharing("Threads or processes")
@click.option("--out", type=option.OUT_FILE, required=True, help="The map (netCDF).")
@option.output
def build(
    config_path: Path | None, name: str | None, sharing: Sharing, out: Path, quiet: bool, **options: Any
) -> option.Result:
    """Simulate a map and write it with its settings."""
    tolerance = options["interpolation_tolerance"]
    began, began_cpu = time.perf_counter(), _cpu_seconds()
    with input_errors("map build"):
        plan, left_out = _plan(config_path, name, options)
        check_writable("--out", out)
        with sharing.open(out, quiet=quiet) as shared:
            if tolerance == 0.0:
                rms_map = build_map(plan, runner=shared.runner)
            else:
                rms_map = build_refined_map(plan, tolerance, most_nodes=options["most_nodes"], runner=shared.runner)
            with output_errors("--out", out):
                save_map(rms_map, out)
    values = {
        "points": int(rms_map.rms.size),
        "seconds": time.perf_counter() - began,
        "cpu_seconds": _cpu_seconds() - began_cpu,
        "out": str(out),
        **_quality(rms_map),
        "floor": floor_of_defect(plan.floor.kind, plan.floor.sd),
        "interpolation_tolerance": tolerance,
        "model": plan.model,
        "model_version": plan.model_version,
        "sensor": rms_map.attributes["sensor"],
        "left_out": left_out,
        "fault": rms_map.part,
        "v_eq": rms_map.volume_words,
        "calibrated": plan.rig.calibrated,
        "rig": rig_line(plan.rig),
        "rig_spread_over": plan.rig_spread_words,
        "hash": rms_map.hash,
        "cluster": shared.values(),
    }
    say(f"map: {out}", quiet=quiet)
    coarse = tolerance > 0.0 and not (values["interpolation_error"] or 0.0) <= tolerance
    return values, [*_build_lines(values), *shared.lines()], coarse


def _quality(rms_map: RmsMap) -> dict[str, Any]:
    """Return errors, spreads and statuses of a map."""
    # NaN where there is no vibration.
    with np.errstate(invalid="ignore", divide="ignore"):
        relative_error = np.where(rms_map.rms > 0.0, rms_map.rms_error / rms_map.rms, np.nan)
    return {
        "error_rms": finite(np.sqrt(np.nanmean(np.square(relative_error)))),
        "error_max": finite(np.nanmax(relative_error)),
        "interpolation_error": rms_map.attributes["interpolation_error"],
        "interpolation_error_max": rms_map.attributes["interpolation_error_max"],
        "shape": list(rms_map.plan.shape),
        "condition_error": rms_map.attributes.get("condition_error"),
        "condition_error_max": rms_map.attributes.get("condition_error_max"),
        "solver": rms_map.attributes["solver"],
        "spread_floors": _relative(rms_map, rms_map.rms_std),
        "spread_rig": _relative(rms_map, rms_map.rms_rig_std),
        "standard_error": _relative(rms_map, rms_map.rms_se),
        "standard_error_max": _relative(rms_map, rms_map.rms_se, np.max),
        "not_monotone_h_d": int(np.count_nonzero(rms_map.falling("h_d"))),
        "not_monotone_dphi_d": int(np.count_nonzero(rms_map.falling("dphi_d"))),
        "nodes_inaccurate": _nodes(rms_map, "inaccurate"),
        "nodes_not_periodic": _nodes(rms_map, "not_periodic"),
        "status": {name: _nodes(rms_map, name) for name in STATUSES},
    }


def _nodes(rms_map: RmsMap, status: Status) -> int:
    """Return how many nodes have a status."""
    return int(np.count_nonzero(rms_map.status == STATUSES.index(status)))


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of the workers that have ended."""
    return sum(os.times()[:4])


def _plan(config_path: Path | None, name: str | None, options: Mapping[str, Any]) -> tuple[MapPlan, list[str]]:
    """Return the plan, and the keys of ``[shaft]`` and the axial load that the map leaves out."""
    config = read_machine(config_path)
    entry, clearance = find_entry(config, name)
    loads = options["load_newton"] or _configured(config.operating.load_newton, "--load-newton")
    speeds = options["speed_hz"] or _configured(config.operating.speed_hz, "--speed-hz")
    model = options["model"]
    machine, left_out = _machine(config, model)
    plan = MapPlan(
        load=tuple(sorted(float(v) for v in loads)),
        speed=tuple(sorted(float(v) for v in speeds)),
        h_d=tuple((np.linspace(*options["h_d_um"]) * 1e-6).tolist()),
        dphi_d=tuple(np.radians(np.linspace(*options["dphi_deg"])).tolist()),
        bearing=entry.bearing,
        rig=config.parameters_of(RIGS[model], entry),
        model=model,
        clearance=clearance,
        floor=Floor(kind=options["floor"], seed=options["seed"]),
        floors=options["floors"],
        rms_band=options["rms_band_hz"],
        slip=_slip(options),
        **_rig_draws(config.posterior_of(entry) if model == Rig.model else None, options),
        rig_seed=options["rig_seed"],
        part=options["fault"],
        **machine,
    )
    return plan, left_out


def _machine(config: Config, model: str) -> tuple[dict[str, Any], list[str]]:
    """Return what a map takes of ``config.scene_values``, and the keys of the rest."""
    able = effects_of(model)
    taken = {name: value for name, (_, value) in config.scene_values().items() if name in _MAPPED and name in able}
    return taken, [key for name, (key, _) in config.scene_values().items() if name not in taken]


def _slip(options: Mapping[str, Any]) -> Slip | None:
    if options["slip_deg"] == 0.0:
        return None
    return Slip(math.radians(options["slip_deg"]), options["slip_rule"], options["slip_seed"])


def _rig_draws(posterior: RigDraws | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the spread over rigs: of the posterior, unless another spread is asked for."""
    names = ("rig_spread", "rig_spread_k_r", "rig_spread_k_c")
    spreads = {name: options[name] for name in names if options[name] is not None}
    count = options["rig_draws"]
    if posterior is None or spreads:
        return {"rig_draws": count or 0, **spreads}
    count = _POSTERIOR_DRAWS if count is None else count
    return {"rig_draws": count, "rig_posterior": posterior.first(count) if count else None}


def _configured(value: float | None, option: str) -> tuple[float, ...]:
    if value is None:
        raise InputError(f"{option}: neither given nor in the configuration ([operating])")
    return (value,)


def _relative(
    rms_map: RmsMap, spread: np.ndarray, of: Callable[[np.ndarray], np.floating[Any]] = np.median
) -> float | None:
    """Return the median, say, of a spread over the RMS where there is damage, or None where there is no spread."""
    damaged = (rms_map.rms > 0.0) & (rms_map.h_d[:, None] > 0.0) & (rms_map.dphi_d > 0.0)
    if not np.any(damaged) or not np.any(spread):
        return None
    return float(of(spread[damaged] / rms_map.rms[damaged]))


def _build_lines(values: Mapping[str, Any]) -> Iterator[str]:
    shape = " x ".join(str(count) for count in values["shape"])
    yield f"{values['points']} points ({shape}: loads, speeds, depths, extents) in {values['seconds']:.1f} s"
    yield f"V_eq = {values['v_eq']}; model {values['model']}, version {values['model_version']}, {values['sensor']}"
    if values["left_out"]:
        yield f"configured, but not in the map: {', '.join(values['left_out'])}"
    yield values["rig"]
    if values["error_rms"] is not None:
        error, most = 100 * values["error_rms"], 100 * values["error_max"]
        yield f"estimated numerical error {error:.2g} % rms, {most:.2g} % at most"
    for name, what in (("interpolation", "nodes, over the largest RMS"), ("condition", "loads and speeds, likewise")):
        if values[f"{name}_error"] is not None:
            between, most = 100 * values[f"{name}_error"], 100 * values[f"{name}_error_max"]
            yield f"between {what}: {between:.2g} % rms, {most:.2g} % at most"
    tolerance, reached = values["interpolation_tolerance"], values["interpolation_error"] or 0.0
    if tolerance > 0.0 and not reached <= tolerance:
        yield f"the tolerance of {100 * tolerance:.2g} % is not met with the nodes allowed: raise --most-nodes"
    if tolerance == 0.0 and reached > _COARSE:
        yield "the grid is coarse for the stripes of the model: --interpolation-tolerance 0.01 refines it"
    spread = "floors" if values["fault"] == "outer" else "floors, or turns of one floor"
    for name, what in (("spread_floors", spread), ("spread_rig", "rig parameters")):
        if values[name] is not None:
            yield f"spread over {what}: {100 * values[name]:.2g} % (median over damaged nodes)"
    yield f"rigs: {values['rig_spread_over']}"
    if values["standard_error"] is not None:
        median, most = 100 * values["standard_error"], 100 * values["standard_error_max"]
        yield f"standard error {median:.2g} % (median), {most:.2g} % at most"
    yield (
        f"RMS falls with depth at {values['not_monotone_h_d']} nodes, with extent at {values['not_monotone_dphi_d']}"
    )
    yield ", ".join(f"{number} {name}" for name, number in values["status"].items() if number)
    if values["floor"] != "smooth":
        yield f"floor {values['floor']}"
    yield f"hash {values['hash'][:16]}"


@command.command("show")
@click.argument("path", metavar="FILE", type=option.FILE)
@click.option("--out", type=option.OUT_FILE, required=True, help="PNG, SVG or HTML.")
@option.output
def show(path: Path, out: Path) -> option.Result:
    """Draw a map as a picture or a page: its levels, cuts through them, and their errors."""
    check_suffix("--out", out, PICTURES)
    rms_map = load_map(path)
    from monitor.report.figures.rms_map import map_sheet, span_of

    write_plot(map_sheet(rms_map), out, "--out")
    least, most = (finite(value / STANDARD_GRAVITY) for value in span_of(rms_map.rms))
    values = {
        "points": int(rms_map.rms.size),
        "out": str(out),
        "rms_min_g": least,
        "rms_max_g": most,
        "model": rms_map.plan.model,
        "calibrated": rms_map.plan.rig.calibrated,
        "hash": rms_map.hash,
    }
    level = "no RMS" if least is None or most is None else f"RMS {least:.3g} to {most:.3g} g"
    return values, [f"{level}; {out}", rig_line(rms_map.plan.rig)]


@command.command("check")
@click.argument("path", metavar="FILE", type=option.FILE)
@click.option("--points", type=click.IntRange(min=1), default=50, help="Random nodes.")
@click.option("--seed", type=option.WHOLE, default=0, help="Seed of their choice.")
@sharing("Threads or processes")
@option.output
def check(path: Path, points: int, seed: int, sharing: Sharing, quiet: bool) -> option.Result:
    """Estimate the error of a map: nodes against finer steps, points between nodes against the model."""
    rms_map = load_map(path)
    began, began_cpu = time.perf_counter(), _cpu_seconds()
    with sharing.open(None, quiet=quiet) as shared:
        found = check_map(rms_map, points, seed=seed, runner=shared.runner)
    values = {
        "points": found.points,
        "seconds": time.perf_counter() - began,
        "cpu_seconds": _cpu_seconds() - began_cpu,
        "out": str(path),
        "error_rms": finite(found.error_rms),
        "error_max": finite(found.error_max),
        "interpolation_rms": finite(found.interpolation_rms),
        "interpolation_max": finite(found.interpolation_max),
        "condition_rms": None if found.condition_rms is None else finite(found.condition_rms),
        "condition_max": None if found.condition_max is None else finite(found.condition_max),
        "hash": rms_map.hash,
        "cluster": shared.values(),
    }
    lines = [
        f"nodes, against four times their accuracy: {100 * found.error_rms:.2g} % rms, "
        f"{100 * found.error_max:.2g} % at most",
        f"between nodes, over the largest RMS of the map: {100 * found.interpolation_rms:.2g} % rms, "
        f"{100 * found.interpolation_max:.2g} % at most",
    ]
    if found.condition_rms is not None and found.condition_max is not None:
        lines.append(
            f"between loads and speeds, likewise: {100 * found.condition_rms:.2g} % rms, "
            f"{100 * found.condition_max:.2g} % at most"
        )
    return values, [*lines, *shared.lines()]

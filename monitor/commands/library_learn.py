"""``spallwatch library learn``: learn the time to the end, and the levels there, from recorded runs to failure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from monitor.commands import option
from monitor.commands.common import (
    InputError,
    check_suffix,
    check_writable,
    finite,
    input_errors,
    output_errors,
    say,
)
from monitor.commands.feature_files import NAMES, read_features
from monitor.commands.history_files import is_records, library_settings, read_readings
from monitor.health.rest.learned.fit import MIN_BLOCKS, LearnedRun, fit_runs
from monitor.health.rest.learned.model import EndLevels, LearnedModel
from monitor.health.rest.learned.scores import PhysicalRun, library_weight, scores_out_of_run
from monitor.health.size.library.forecaster import LibraryState
from monitor.health.size.library.forecaster import step as ask_library
from monitor.records.library_file import SUFFIXES, save_learned
from monitor.words.numbers import duration


class ColumnName(click.ParamType):
    """NAME=COLUMN, a name of this program and the one in the files."""

    name = "NAME=COLUMN"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (name, column); refuse a name that is not known."""
        if isinstance(value, tuple):
            return value
        known, sign, column = str(value).partition("=")
        if not sign or not column or known not in NAMES:
            self.fail(f"{value!r} is not NAME=COLUMN with one of {', '.join(NAMES)}", param, ctx)
        return known, column


axis = click.option(
    "--axis",
    "axes",
    multiple=True,
    help="Prefix of the columns of CSV: h for h_rms_g. Of several the axis whose final stage begins first.",
)
columns = click.option(
    "--column", "columns", type=ColumnName(), multiple=True, help="Name of a column of CSV, as in rms_g=RMS."
)


@click.command("learn")
@click.argument("runs", nargs=-1, required=True, type=option.FILE)
@click.option(
    "--end-s", type=float, multiple=True, help="End of each run, s from its first block. Default: its last block."
)
@click.option(
    "--t-fs-s", type=float, multiple=True, help="Start of the final stage of each run (CSV). Default: as detected."
)
@axis
@columns
@option.channel
@click.option(
    "--library",
    "library_path",
    type=option.FILE,
    help="Library of simulated lives (.npz) to be combined: its weight is found on the RUNS, which must be records.",
)
@click.option(
    "--threshold-mm2", type=option.POSITIVE, default=0.05, help="Threshold asked of that library, mm3 per mm."
)
@click.option("--out", type=option.OUT_FILE, required=True, help="The learned library (.npz or .json).")
@option.output
def command(
    runs: tuple[Path, ...],
    end_s: tuple[float, ...],
    t_fs_s: tuple[float, ...],
    axes: tuple[str, ...],
    columns: tuple[tuple[str, str], ...],
    channel: str | None,
    library_path: Path | None,
    threshold_mm2: float,
    out: Path,
    quiet: bool,
) -> option.Result:
    """Learn from RUNS, recorded until the end that is to be forecast, of one kind of machine.

    Each is records (a netCDF file or a folder) or CSV with elapsed_s,rms_g[,h_or_g,outer_floor_g,v_eq_mm2] from
    the healthy machine on. Runs without a final stage, or with one of fewer than 8 blocks, are left out and said.
    """
    check_suffix("--out", out, SUFFIXES)
    for name, values in (("--end-s", end_s), ("--t-fs-s", t_fs_s)):
        if values and len(values) != len(runs):
            raise InputError(f"{name}: expected one for each of the {len(runs)} RUNS, got {len(values)}")
    check_writable("--out", out)
    found: list[LearnedRun] = []
    left_out: list[dict[str, str]] = []
    for place, path in enumerate(runs):
        end = end_s[place] if end_s else None
        if is_records(path):
            if t_fs_s:
                raise InputError(f"--t-fs-s: {path} is records, which state t_fs; give it for CSV only")
            run = run_of_records(path, channel, end)
        else:
            run = run_of_csv(path, axes, dict(columns), t_fs_s[place] if t_fs_s else None, end)
        if isinstance(run, str):
            left_out.append({"run": str(path), "reason": run})
        else:
            found.append(run)
    model = learn(found, left_out)
    if library_path is not None:
        model = weighed(model, found, channel, library_path, threshold_mm2 * 1e-6)
    with output_errors("--out", out):
        save_learned(model, out)
    say(f"learned library: {out}", quiet=quiet)
    return _values(model, out), _lines(model)


def learn(runs: Sequence[LearnedRun], left_out: Sequence[Mapping[str, str]]) -> LearnedModel:
    """Return the model of runs, scored out of run where there are two.

    Raises:
        InputError: none of the runs can be used.
    """
    model = fit_runs(runs)
    model = replace(model, left_out=(*left_out, *model.left_out))
    if not model.runs:
        reasons = "; ".join(f"{one['run']}: {one['reason']}" for one in model.left_out)
        raise InputError(f"library learn: no run can be learned from ({reasons})")
    used = [run for run in runs if len(run.t) >= MIN_BLOCKS]
    return replace(model, scores=scores_out_of_run(used)) if len(model.runs) > 1 else model


def weighed(
    model: LearnedModel, runs: Sequence[LearnedRun], channel: str | None, library: Path, threshold: float
) -> LearnedModel:
    """Return the model with the weight of a library beside it, found out of run.

    Raises:
        InputError: a run is no records, or the library cannot be used or has not the threshold.
    """
    settings = library_settings("library", library, "rms+harmonics", 0.8)
    physical: list[PhysicalRun] = []
    for run in runs:
        path = Path(run.name)
        if not is_records(path):
            raise InputError(f"--library: {path} is CSV; records are needed, which have load, speed and lines")
        if len(run.t) < MIN_BLOCKS:
            continue
        _, readings = read_readings(path, channel, load=None, speed=None)
        state, forecasts = LibraryState(), []
        for reading in readings[: len(run.t)]:
            with input_errors("--library"):
                state, _, (one,) = ask_library(
                    state, reading, settings["library"], settings["library_settings"], thresholds=(threshold,)
                )
            forecasts.append(one)
        physical.append(PhysicalRun(run, forecasts))
    weight = library_weight(physical)
    return model if weight is None else replace(model, weights={"learned": 1.0 - weight, "library": weight})


def run_of_csv(
    path: Path, axes: Sequence[str], columns: Mapping[str, str], t_fs: float | None, end: float | None
) -> LearnedRun | str:
    """Return the run in a CSV file, or why it is left out.

    Raises:
        InputError: the file cannot be read, or ``end`` (s on its axis) lies before its first block.
    """
    history = read_features(path, axes, columns, t_fs=t_fs, end=end)
    onset, times = history.onset, np.array(history.times)
    if onset is None:
        return "no final stage was found" if t_fs is None else f"no block follows --t-fs-s {t_fs:g}"
    rows = [i for i in range(onset.place, len(times)) if history.blocks[i].rms > 0.0]
    start = float(times[onset.place])
    volumes = [history.v_eq[i] for i in rows if math.isfinite(history.v_eq[i])]
    return LearnedRun(
        name=str(path),
        t=times[rows] - start,
        ln_rms=np.log([history.blocks[i].rms for i in rows]),
        ln_baseline=onset.ln_baseline,
        life=(float(times[-1]) if end is None else end) - start,
        t_fs=start,
        end_volume=volumes[-1] if volumes else math.nan,
        source={"axis": history.name.partition(":")[2]} if axes else None,
    )


def run_of_records(path: Path, channel: str | None, end: float | None) -> LearnedRun | str:
    """Return the run in records, or why it is left out; ``end`` in s from their first block.

    Raises:
        InputError: the records cannot be read.
    """
    from monitor.records.histories import HistoryError, NoFinalStageError, read_history

    try:
        history = read_history(path, channel)
    except NoFinalStageError:
        return "no final stage was found"
    except HistoryError as error:
        raise InputError(str(error)) from None
    since = history.time - history.first
    rows = np.flatnonzero((since <= (math.inf if end is None else end)) & (history.rms > 0.0))
    if not rows.size:
        return f"its final stage begins at {since[0]:g} s, after its end" if since.size else "no usable blocks"
    after = 0.0 if end is None else end - float(since[rows[-1]])
    volumes = history.v_eq[rows][np.isfinite(history.v_eq[rows])]
    return LearnedRun(
        name=str(path),
        t=history.running[rows] - history.running[rows[0]],
        ln_rms=np.log(history.rms[rows]),
        ln_baseline=math.log(history.baseline) if history.baseline > 0.0 else math.nan,
        life=float(history.running[rows[-1]] - history.running[rows[0]]) + after,
        t_fs=float(since[rows[0]]),
        end_volume=float(volumes[-1]) if volumes.size else math.nan,
        source={"channel": history.channel},
    )


def _values(model: LearnedModel, out: Path) -> dict[str, Any]:
    """Return the keys of the interface; scores are out of run, the mean of three moments of each life."""
    return {
        "runs": len(model.runs),
        "out": str(out),
        "hash": model.hash,
        "crps_share": model.scores.get("crps_share"),
        "coverage": model.scores.get("coverage"),
        "weights": dict(model.weights),
        "scores": dict(model.scores),
        "learned_from": [dict(run) for run in model.runs],
        "left_out": [dict(run) for run in model.left_out],
        "end_levels": _end_values(model.end_levels),
        "end_v_eq_mm2": _end_values(model.end_volumes, 1e6),
        "prior": model.prior,
    }


def _end_values(ends: EndLevels, unit: float = 1.0) -> dict[str, Any]:
    """Return the geometric mean of the levels at the end, and the factor that is one standard deviation."""
    return {
        "runs": ends.count,
        "geometric_mean": finite(unit * math.exp(ends.mean)),
        "factor_sd": finite(math.exp(ends.sd)),
    }


def _lines(model: LearnedModel) -> Iterator[str]:
    """Yield the runs, the scores and the levels at the end."""
    yield f"{'run':40}{'t_fs':>12}{'final stage':>14}{'blocks':>8}{'end level':>11}{'V_eq':>10}"
    yield f"{'':40}{'s':>12}{'':>14}{'':>8}{'x baseline':>11}{'mm3/mm':>10}"
    for run in model.runs:
        cells = [f"{run['t_fs_s']:12.6g}", f"{duration(run['life_s']):>14}", f"{run['blocks']:8}"]
        for key, width in (("end_level", 11), ("end_v_eq_mm2", 10)):
            cells.append("-".rjust(width) if run[key] is None else f"{run[key]:{width}.3g}")
        yield f"{str(run['run'])[-39:]:40}" + "".join(cells)
    yield from (f"left out: {one['run']}: {one['reason']}" for one in model.left_out)
    yield from _score_lines(model)
    for name, ends, unit in (("level over the baseline", model.end_levels, 1.0), ("V_eq", model.end_volumes, 1e6)):
        if ends.count > 1:
            middle, factor = unit * math.exp(ends.mean), math.exp(ends.sd)
            words = " mm3/mm" if unit != 1.0 else ""
            yield f"{name} at the end of {ends.count} runs: {middle:.3g}{words}, spread (SD) a factor of {factor:.3g}"
    yield f"hash {model.hash[:16]}; forecasts are {model.prior}"


def _score_lines(model: LearnedModel) -> Iterator[str]:
    scores = model.scores
    if not scores:
        yield "one run: no scores out of run"
        return
    yield "each run by the others, nominal 80 % intervals; CRPS over the final stage, of elapsed time alone in brackets"
    for share, one in scores["by_share"].items():
        if one["runs"]:
            yield (
                f"  at {share} of the final stage: CRPS {one['crps_share']:.2f} ({one['elapsed_crps_share']:.2f}), "
                f"coverage {one['coverage']:.2f}, {one['runs']} runs"
            )
    over = scores["over_life"]
    if over["crps_share"] is not None:
        yield f"  over all of it: CRPS {over['crps_share']:.2f}, coverage {over['coverage']:.2f}"

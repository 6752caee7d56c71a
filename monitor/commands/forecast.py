"""``spallwatch forecast``: time to threshold from a history, as it would have been issued at each of its points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import click

from monitor.commands import option
from monitor.commands.common import InputError, check_suffix, finite, input_errors
from monitor.commands.forecast_learned import (
    METHODS,
    Asked,
    forecast_learned,
    forecast_shipped,
    issued_by_tracker,
    learned_among,
)
from monitor.commands.history_files import (
    SUFFIXES,
    Volumes,
    is_records,
    library_settings,
    prior_of,
    read_readings,
    read_volumes,
    write_out,
)
from monitor.commands.library_learn import axis, columns
from monitor.health import tracker as damage
from monitor.health.rest import quadratic as forecast
from monitor.health.size import DamageInput, Remaining, RemainingSettings
from monitor.health.size.calibration import mark_forecast
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState
from monitor.health.size.library.forecaster import step as ask_library
from monitor.service.libraries import SHIPPED_NAME, shipped_library
from monitor.service.summary import is_calibrated
from monitor.words.numbers import duration

Issued = list[tuple[Remaining, ...]]
Forecasts = tuple[list[float], list[float], Issued]
"""Times on the axis of the input, s; damage times, s; the forecasts at each of them."""


@click.command("forecast")
@click.argument("input_path", metavar="INPUT", type=option.FILE)
@option.thresholds()
@option.method("thesis", "library", *METHODS)
@option.libraries
@option.interval
@click.option("--window-hours", type=option.POSITIVE, help="Time to the next maintenance.")
@click.option("--uncalibrated-threshold", is_flag=True, help="Also for a rig that is not calibrated.")
@option.channel
@axis
@columns
@click.option("--t-fs-s", type=float, help="Start of the final stage in CSV of features, s. Default: as detected.")
@option.rows
@option.output
def command(
    input_path: Path,
    threshold_mm2: tuple[float, ...],
    method: damage.ForecastMethod | None,
    library_path: tuple[Path, ...],
    interval: float,
    window_hours: float | None,
    uncalibrated_threshold: bool,
    channel: str | None,
    axes: tuple[str, ...],
    columns: tuple[tuple[str, str], ...],
    t_fs_s: float | None,
    out: Path | None,
) -> option.Result:
    """Forecast through INPUT: one row per point and threshold, from the points up to its time only.

    INPUT is a CSV file with time_s,v_eq_mm2 from t_fs on, or records as replay and demo publish them. From records, the
    thesis uses V_eq, a library the RMS and the BPFO lines. Without --library and --method, a library that ships, of
    growth alone, takes V_eq. V_eq is taken as it is, unless INPUT says (column status, or calibrated of the records)
    that it is uncalibrated: then TT needs --uncalibrated-threshold.

    By recorded runs (--method learned, with what library learn made, or without) INPUT is records or CSV with
    elapsed_s,rms_g from the healthy machine on, and TT is the time to the end as those runs ended.
    """
    check_suffix("--out", out, SUFFIXES)
    if method is None and learned_among(library_path):
        method = "learned"
    method = method or "library"
    thresholds = tuple(value * 1e-6 for value in threshold_mm2)
    window = None if window_hours is None else window_hours * 3600.0
    settings = RemainingSettings(interval, window)
    asked = Asked(method, library_path, settings, channel, axes, dict(columns), t_fs_s, *thresholds[:1])
    (times, running, issued), more = _forecast(input_path, asked, thresholds, uncalibrated=uncalibrated_threshold)
    # On the axis of the input, not in damage time.
    issued = [
        tuple(replace(one, t_threshold=one.t_threshold + time - t) for one in results)
        for results, time, t in zip(issued, times, running, strict=True)
    ]
    # The end of recorded runs is no threshold.
    named = (None,) if method == "learned" else threshold_mm2
    rows = [
        _row(time, mm2, result)
        for time, results in zip(times, issued, strict=True)
        for mm2, result in zip(named, results, strict=True)
    ]
    values = {
        "method": method,
        "interval": None if method == "thesis" else interval,
        "prior": None,
        "library": None,
        "rows": rows,
        "by_threshold": _by_threshold(named, issued),
        **more,
    }
    if out is not None:
        write_out(out, values, {"time": times, "columns": _columns(issued), "thresholds": thresholds})
    return values, _lines(values)


def _forecast(
    path: Path, asked: Asked, thresholds: tuple[float, ...], *, uncalibrated: bool
) -> tuple[Forecasts, dict[str, Any]]:
    """Return the forecasts by a method, and what the answer says beside them: prior, library.

    Args:
        path: the input.
        asked: the method and what it takes.
        thresholds: m2.
        uncalibrated: whether TT is issued for a rig that is not calibrated.
    """
    method, libraries, interval, window = asked.method, asked.libraries, asked.settings.interval, asked.settings.window
    if method in METHODS:
        if len(thresholds) > 1:
            raise InputError(f"--threshold-mm2: --method {method} forecasts one end, got {len(thresholds)} thresholds")
        answer = forecast_learned(path, asked)
        return (answer.times, answer.running, answer.issued), answer.values
    if asked.axes or asked.columns or asked.t_fs is not None:
        raise InputError(f"--axis, --column and --t-fs-s belong to --method learned, not to {method}")
    if len(libraries) > 1:
        raise InputError("--library: may be given twice with --method combined only")
    library = next(iter(libraries), None)
    if method != "library":
        library_settings(method, library, "v_eq", interval)
        return _thesis(path, asked.channel, thresholds, asked=uncalibrated), {}
    if library is None:
        history = read_volumes(path, asked.channel)
        with input_errors(str(path)):
            settings = LibrarySettings(features="v_eq", interval=interval, window=window)
            issued = forecast_shipped(history, thresholds, settings)
        issued = _marked(issued, history, asked=uncalibrated)
        more = {"prior": prior_of(shipped_library()), "library": SHIPPED_NAME}
        return (history.times, history.running, issued), more
    features = "rms+harmonics" if is_records(path) else "v_eq"
    given = library_settings(method, library, features, interval, window)
    given["uncalibrated_threshold"] = uncalibrated
    issue = _library_on_records if is_records(path) else _library_on_volumes
    found = issue(path, asked.channel, thresholds, given)
    return found, {"prior": prior_of(given["library"]), "library": str(library)}


def _thesis(path: Path, channel: str | None, thresholds: Sequence[float], *, asked: bool) -> Forecasts:
    """Forecast by the quadratic through the first V_eq; ``asked``: also where V_eq is uncalibrated."""
    history = read_volumes(path, channel)
    state, issued = forecast.ForecastState(), []
    for row, (t, v_eq) in enumerate(zip(history.running, history.v_eq, strict=True), 1):
        with input_errors(f"{path}: row {row}"):
            state, results = forecast.step(state, t, v_eq, thresholds=thresholds)
        issued.append(results)
    return history.times, history.running, _marked(issued, history, asked=asked)


def _marked(issued: Issued, history: Volumes, *, asked: bool) -> Issued:
    """Return the forecasts from a history of V_eq, marked where it is uncalibrated."""
    if history.calibrated:
        return issued
    return [tuple(mark_forecast(one, issued=asked) for one in results) for results in issued]


def _library_on_volumes(
    path: Path, channel: str | None, thresholds: Sequence[float], asked: Mapping[str, Any]
) -> Forecasts:
    """Forecast from a V_eq history alone, by the remaining time of simulated lives with a similar history."""
    history = read_volumes(path, channel)
    state, issued = LibraryState(), []
    for row, (t, v_eq) in enumerate(zip(history.running, history.v_eq, strict=True), 1):
        if v_eq < 0:
            raise InputError(f"{path}: row {row}: v_eq must be a volume, got {v_eq * 1e6:g} mm3/mm")
        block = DamageInput(t, v_eq=v_eq)
        with input_errors("--library"):
            state, _, forecasts = ask_library(
                state, block, asked["library"], asked["library_settings"], thresholds=thresholds
            )
        issued.append(forecasts)
    return history.times, history.running, _marked(issued, history, asked=asked["uncalibrated_threshold"])


def _library_on_records(
    path: Path, channel: str | None, thresholds: Sequence[float], asked: Mapping[str, Any]
) -> Forecasts:
    """Forecast from the RMS and the BPFO lines of records."""
    times, readings = read_readings(path, channel, load=None, speed=None)
    settings = damage.DamageSettings(
        track_method="library",
        forecast_method="library",
        thresholds=tuple(thresholds),
        calibrated=is_calibrated(asked["library"]),
        **asked,
    )
    issued = issued_by_tracker(readings, settings, damage.DamageGate())
    return times, [reading.time for reading in readings], issued


def _row(time: float, threshold_mm2: float | None, result: Remaining) -> dict[str, Any]:
    return {
        "t_issue_s": time,
        "threshold_mm2": threshold_mm2,
        "tt_s": finite(result.tt),
        "tt_lower_s": finite(result.tt_lower),
        "tt_upper_s": finite(result.tt_upper),
        "t_threshold_s": finite(result.t_threshold),
        "p_threshold": finite(result.p_threshold),
        "p_crossed": finite(result.p_crossed),
        "p_no_growth": finite(result.p_no_growth),
        "r_squared": finite(result.r_squared),
        "status": result.status,
    }


def _by_threshold(threshold_mm2: Sequence[float | None], issued: Issued) -> list[dict[str, Any]]:
    """Return for each threshold the number of forecasts, the last TT, and the ratio of TT to that of the first.

    The ratio is the median over the moments at which both have a TT above zero.
    """
    found = []
    for place, mm2 in enumerate(threshold_mm2):
        answers = [results for results in issued if _answers(results[place])]
        ratios = [r[place].tt / r[0].tt for r in answers if _answers(r[0]) and r[0].tt > 0.0]
        last = issued[-1][place]
        found.append(
            {
                "threshold_mm2": mm2,
                "answers": len(answers),
                "tt_s": finite(last.tt),
                "t_threshold_s": finite(last.t_threshold),
                "tt_over_first": median(ratios) if ratios else None,
                "status": last.status,
            }
        )
    return found


def _answers(result: Remaining) -> bool:
    return result.status in ("ok", "uncalibrated") and math.isfinite(result.tt)


def _threshold(row: Mapping[str, Any]) -> str:
    """Return the cell of the threshold; the end of recorded runs has none."""
    return "end".rjust(10) if row["threshold_mm2"] is None else f"{row['threshold_mm2']:10.3g}"


def _columns(issued: Issued) -> dict[str, Any]:
    """Return the columns of the netCDF file, SI, over time and threshold."""
    names = ("tt", "tt_lower", "tt_upper", "p_threshold", "p_no_growth", "p_crossed", "r_squared")
    columns: dict[str, Any] = {name: [[getattr(one, name) for one in row] for row in issued] for name in names}
    return {**columns, "tt_status": [[one.status for one in row] for row in issued]}


def _lines(values: Mapping[str, Any]) -> Iterator[str]:
    columns = [("tt_s", "TT", "s"), ("tt_lower_s", "lower", "s"), ("tt_upper_s", "upper", "s")]
    columns += [("t_threshold_s", "reached at", "s"), ("p_threshold", "p", "1")]
    columns += [("p_no_growth", "p no growth", "1"), ("p_crossed", "p crossed", "1"), ("r_squared", "R2", "1")]
    rows = values["rows"]
    shown = [column for column in columns if any(row[column[0]] is not None for row in rows)]
    yield f"{'issued':>12}  {'threshold':>10}  {'  '.join(f'{name:>10}' for _, name, _ in shown)}  status"
    yield f"{'s':>12}  {'mm3/mm':>10}  {'  '.join(f'{unit:>10}' for _, _, unit in shown)}"
    for row in rows:
        cells = ["-".rjust(10) if row[key] is None else f"{row[key]:10.5g}" for key, _, _ in shown]
        yield f"{row['t_issue_s']:12.6g}  {_threshold(row)}  {'  '.join(cells)}  {row['status']}"
    if values["prior"]:
        yield f"prior: {values['prior']}"
    if len(values["by_threshold"]) > 1:
        yield "dependence of TT on the threshold:"
        for one in values["by_threshold"]:
            tt = one["status"] if one["tt_s"] is None else duration(one["tt_s"])
            ratio = "" if one["tt_over_first"] is None else f", {one['tt_over_first']:.3g} times that of the first"
            yield f"  {one['threshold_mm2']:g} mm3/mm: last TT {tt}{ratio}, {one['answers']} answers"

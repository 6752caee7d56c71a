"""``spallwatch forecast``: time to threshold from a history, as it would have been issued at each of its points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import click

from monitor.commands.common import InputError, duration_words, emit, output_options
from monitor.commands.histories import check_out, is_records, number, read_readings, read_volumes, write_out
from monitor.commands.track import attributes_of, library_settings, prior_of
from monitor.health.damage import tracker as damage
from monitor.health.damage.library.forecaster import LibraryInput, LibraryState
from monitor.health.damage.library.forecaster import step as ask_library
from monitor.health.damage.thesis import forecast

Issued = list[tuple[damage.Remaining, ...]]


@click.command("forecast")
@click.argument("input_path", metavar="INPUT", type=click.Path(path_type=Path))
@click.option(
    "--threshold-mm2",
    type=click.FloatRange(min=0, min_open=True),
    multiple=True,
    default=(0.05,),
    show_default=True,
    help="Threshold of V_eq, mm3 per mm of width; may be given several times.",
)
@click.option(
    "--method",
    type=click.Choice(["thesis", "library"]),
    help="By default library where --library names one, else thesis.",
)
@click.option("--library", "library_path", type=click.Path(path_type=Path), help="Library of simulated lives (.npz).")
@click.option(
    "--interval", type=click.FloatRange(0.5, 0.98), default=0.8, show_default=True, help="Level of intervals."
)
@click.option("--window-hours", type=click.FloatRange(min=0, min_open=True), help="Time to the next maintenance.")
@click.option("--channel", help="Channel of the records, where several have a final stage.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Write the rows too: .csv, .json or .nc.")
@output_options
def command(
    input_path: Path,
    threshold_mm2: tuple[float, ...],
    method: str | None,
    library_path: Path | None,
    interval: float,
    window_hours: float | None,
    channel: str | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Forecast through INPUT: one row a point and threshold, from the points up to its own time only.

    INPUT is a CSV file with time_s,v_eq_mm2 from t_fs on, or records as replay and demo publish them. Of records, the
    thesis takes the V_eq that they hold, the library the RMS and the BPFO lines.
    """
    check_out(out)
    method = method or ("thesis" if library_path is None else "library")
    thresholds = tuple(value * 1e-6 for value in threshold_mm2)
    window = None if window_hours is None else window_hours * 3600.0
    if method == "library":
        features = "rms+harmonics" if is_records(input_path) else "v_eq"
        asked = library_settings(method, library_path, features, interval, window)
        issue = _library_on_records if is_records(input_path) else _library_on_volumes
        times, issued = issue(input_path, channel, thresholds, asked)
        prior = prior_of(asked["library"])
    else:
        library_settings(method, library_path, "v_eq", interval)
        times, issued = _thesis(input_path, channel, thresholds)
        prior = None
    rows = [
        _row(time, mm2, result)
        for time, results in zip(times, issued, strict=True)
        for mm2, result in zip(threshold_mm2, results, strict=True)
    ]
    told = {
        "method": method,
        "interval": interval if method == "library" else None,
        "prior": prior,
        "rows": rows,
        "by_threshold": _by_threshold(threshold_mm2, issued),
    }
    if out is not None:
        write_out(
            out,
            told,
            {
                "time": times,
                "columns": _columns(issued),
                "thresholds": thresholds,
                "attributes": attributes_of(told),
            },
        )
    emit(told, _lines(told), as_json=as_json)


def _thesis(path: Path, channel: str | None, thresholds: Sequence[float]) -> tuple[list[float], Issued]:
    """Forecast by the quadratic through the first V_eq."""
    times, running, volumes = read_volumes(path, channel)
    state, issued = forecast.ForecastState(), []
    for row, (t, v_eq) in enumerate(zip(running, volumes, strict=True), 1):
        try:
            state, results = forecast.step(state, t, v_eq, thresholds=thresholds)
        except ValueError as error:
            raise InputError(f"{path}: row {row}: {error}") from None
        issued.append(tuple(damage.Remaining.of_thesis(result) for result in results))
    return times, _on_axis(issued, times, running)


def _library_on_volumes(
    path: Path, channel: str | None, thresholds: Sequence[float], asked: Mapping[str, Any]
) -> tuple[list[float], Issued]:
    """Forecast from a V_eq history alone, by what simulated lives with such a history had before them."""
    times, running, volumes = read_volumes(path, channel)
    state, issued = LibraryState(), []
    for row, (t, v_eq) in enumerate(zip(running, volumes, strict=True), 1):
        if v_eq < 0:
            raise InputError(f"{path}: row {row}: v_eq must be a volume, got {v_eq * 1e6:g} mm3/mm")
        block = LibraryInput(t=t, v_eq=v_eq)
        try:
            state, found = ask_library(state, block, asked["library"], asked["asking"], thresholds=thresholds)
        except ValueError as error:
            raise InputError(f"--library: {error}") from None
        issued.append(tuple(damage.Remaining.of_library(result) for result in found.forecasts))
    return times, _on_axis(issued, times, running)


def _library_on_records(
    path: Path, channel: str | None, thresholds: Sequence[float], asked: Mapping[str, Any]
) -> tuple[list[float], Issued]:
    """Forecast from the RMS and the BPFO lines of records."""
    times, readings = read_readings(path, channel, load=None, speed=None)
    settings = damage.DamageSettings(
        track_method="library", forecast_method="library", thresholds=tuple(thresholds), **asked
    )
    state, issued = damage.DamageState(), []
    for reading in readings:
        try:
            state, _, forecasts = damage.step(state, reading, damage.Stage(), settings)
        except ValueError as error:
            raise InputError(f"--library: {error}") from None
        issued.append(forecasts)
    return times, _on_axis(issued, times, [reading.time for reading in readings])


def _on_axis(issued: Issued, times: Sequence[float], running: Sequence[float]) -> Issued:
    """Return the forecasts with the moment of the threshold on the axis of the input instead of in damage time."""
    return [
        tuple(replace(one, t_threshold=one.t_threshold + time - t) for one in results)
        for results, time, t in zip(issued, times, running, strict=True)
    ]


def _row(time: float, threshold_mm2: float, result: damage.Remaining) -> dict[str, Any]:
    return {
        "t_issue_s": time,
        "threshold_mm2": threshold_mm2,
        "tt_s": number(result.tt),
        "tt_lower_s": number(result.tt_lower),
        "tt_upper_s": number(result.tt_upper),
        "t_threshold_s": number(result.t_threshold),
        "p_threshold": number(result.p_threshold),
        "r_squared": number(result.r_squared),
        "status": result.status,
    }


def _by_threshold(threshold_mm2: Sequence[float], issued: Issued) -> list[dict[str, Any]]:
    """Say of each threshold how often there was an answer, the last TT, and TT over that of the first threshold given.

    The ratio is the median over the moments at which both have a TT above zero: how much of TT is the threshold's.
    """
    told = []
    for place, mm2 in enumerate(threshold_mm2):
        answers = [results for results in issued if results[place].status == "ok"]
        ratios = [r[place].tt / r[0].tt for r in answers if r[0].status == "ok" and r[0].tt > 0.0]
        last = issued[-1][place]
        told.append(
            {
                "threshold_mm2": mm2,
                "answers": len(answers),
                "tt_s": number(last.tt),
                "t_threshold_s": number(last.t_threshold),
                "tt_over_first": median(ratios) if ratios else None,
                "status": last.status,
            }
        )
    return told


def _columns(issued: Issued) -> dict[str, Any]:
    """Return the columns of the netCDF file, SI, over time and threshold."""
    names = ("tt", "tt_lower", "tt_upper", "p_threshold", "r_squared")
    columns: dict[str, Any] = {name: [[getattr(one, name) for one in row] for row in issued] for name in names}
    return {**columns, "tt_status": [[one.status for one in row] for row in issued]}


def _lines(told: Mapping[str, Any]) -> Iterator[str]:
    columns = [("tt_s", "TT", "s"), ("tt_lower_s", "lower", "s"), ("tt_upper_s", "upper", "s")]
    columns += [("t_threshold_s", "reached at", "s"), ("p_threshold", "p", "1"), ("r_squared", "R2", "1")]
    rows = told["rows"]
    shown = [column for column in columns if any(row[column[0]] is not None for row in rows)]
    yield f"{'issued':>12}  {'threshold':>10}  {'  '.join(f'{name:>10}' for _, name, _ in shown)}  status"
    yield f"{'s':>12}  {'mm3/mm':>10}  {'  '.join(f'{unit:>10}' for _, _, unit in shown)}"
    for row in rows:
        cells = ["-".rjust(10) if row[key] is None else f"{row[key]:10.5g}" for key, _, _ in shown]
        yield f"{row['t_issue_s']:12.6g}  {row['threshold_mm2']:10.3g}  {'  '.join(cells)}  {row['status']}"
    if told["prior"]:
        yield f"leans on: {told['prior']}"
    if len(told["by_threshold"]) > 1:
        yield "how much TT depends on the threshold:"
        for one in told["by_threshold"]:
            tt = one["status"] if one["tt_s"] is None else duration_words(one["tt_s"])
            ratio = "" if one["tt_over_first"] is None else f", {one['tt_over_first']:.3g} times that of the first"
            yield f"  {one['threshold_mm2']:g} mm3/mm: last TT {tt}{ratio}, {one['answers']} answers"

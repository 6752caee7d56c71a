"""Reports: one page of one or several runs, and the index of a batch."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from monitor import __version__
from monitor.health.schema import VARIABLES
from monitor.records.durable import free_name, replacing
from monitor.report.comparison import compare, laws, milestones, scores
from monitor.report.data_quality import without_folders
from monitor.report.figures.spectrum import SpectrumView
from monitor.report.options import Options
from monitor.report.page import is_pdf, require_pdf, write_page
from monitor.report.run_section import RunPart, part_of_run
from monitor.report.runs import Channel, Records, ReportError, Run, read_runs
from monitor.report.summary import RunSummary, summarise
from monitor.report.tables import Table, write_tables, write_whole
from monitor.words.features import FEATURES, Feature

_WORDS = (
    *("stage", "fault", "fault_basis", "edv_status", "tt_status", "tta_status"),
    *("domain", "rotation_status", "level_status"),
)
_COUNTS = ("pulses_missing", "pulses_extra")
_FOREIGN = re.compile(r"[^\w.-]+")


def write_trends(runs: Sequence[Run], folder: Path, attributes: Mapping[str, str] | None = None) -> list[Path]:
    """Write ``trends-CHANNEL.csv`` and ``.nc`` of each channel, behind ``runN-`` where there are several runs.

    CSV has units at the ends of names, netCDF SI with ``units``; one row for each block of the channel's source, in
    order of time. Features that no block has are left out. Returns the files.

    Raises:
        ReportError: a file cannot be written.
    """
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, run, channel in _named(runs):
            table = _dataset(run, channel)
            for ending, write in ((".csv", _write_csv), (".nc", _write_netcdf)):
                path = folder / f"{name}{ending}"
                with replacing(path) as temporary:
                    write(table.assign_attrs(attributes or {}), temporary)
                written.append(path)
    except (OSError, RuntimeError) as error:
        raise ReportError(f"{folder}: trends cannot be written: {error}") from error
    return written


def _named(runs: Sequence[Run]) -> Iterator[tuple[str, Run, Channel]]:
    """Yield the name of the file of each channel: with what a file may be called, and once."""
    taken: set[str] = set()
    for place, run in enumerate(runs, start=1):
        prefix = f"run{place}-" if len(runs) > 1 else ""
        for channel in run.channels.values():
            plain = f"{prefix}trends-{_FOREIGN.sub('_', channel.name)}"
            name = free_name(plain, lambda found: found.casefold() in taken)
            taken.add(name.casefold())
            yield name, run, channel


def _dataset(run: Run, channel: Channel) -> xr.Dataset:
    """Return the rows of a channel, SI."""
    time_attributes = {"units": "seconds since 1970-01-01T00:00:00Z" if run.dated else "s"}
    variables: dict[str, xr.Variable] = {
        "block": xr.Variable("time", channel.sequence, {"long_name": "number of the block in its source"}),
        "status": xr.Variable("time", channel.status.astype(object), {"long_name": "status of the block"}),
    }
    for feature in FEATURES.values():
        for name, values in _columns(feature, channel):
            attributes = {"long_name": feature.long_name, "units": feature.units}
            if feature.acceleration and not channel.has_level:
                attributes["units"] = "unknown"
            variables[name] = xr.Variable("time", values, attributes)
    for name in _COUNTS:
        if np.isfinite(values := channel.column(name)).any():
            variables[name] = xr.Variable("time", values, {"long_name": VARIABLES[name].long_name, "units": "1"})
    for name in _WORDS:
        if (words := channel.words.get(name)) is not None and (words[:, 0] != "").any():
            variables[name] = xr.Variable("time", words[:, 0], {"long_name": VARIABLES[name].long_name})
    found = xr.Dataset(variables, {"time": ("time", channel.time, time_attributes)})
    return found.assign_attrs(title=f"Trends of channel {channel.name}", machine=run.machine, channel=channel.name)


def _columns(feature: Feature, channel: Channel) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the columns of a feature that have values: one, or one for each band or threshold."""
    values = channel.numbers.get(feature.name)
    if values is None:
        return
    for place in range(values.shape[1]):
        if np.isfinite(values[:, place]).any():
            yield feature.name if place == 0 else f"{feature.name}_{place + 1}", values[:, place]


def _write_csv(table: xr.Dataset, path: Path) -> None:
    dated = str(table["time"].attrs["units"]).startswith("seconds since")
    columns: dict[str, object] = {"time_s": table["time"].values}
    if dated:
        moments = pd.to_datetime(table["time"].values, unit="s", utc=True)
        columns["time_utc"] = moments.strftime("%Y-%m-%dT%H:%M:%S.%f").str[:-3] + "Z"
    for name, array in table.data_vars.items():
        key, values = str(name), array.values
        feature = FEATURES.get(re.sub(r"_\d+$", "", key)) if key not in FEATURES else FEATURES[key]
        if feature is not None and array.attrs.get("units") != "unknown":
            key, values = f"{key}{feature.unit.ending}", values / feature.unit.si
        columns[key] = values
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.9g", lineterminator="\n")


def _write_netcdf(table: xr.Dataset, path: Path) -> None:
    table.assign_attrs(Conventions="CF-1.11").to_netcdf(path, engine="netcdf4")


_FILE_ATTRIBUTES = {"product_version": f"spallwatch {__version__}"}


def build_report(
    records: Records | Sequence[Records],
    out: Path,
    *,
    title: str | None = None,
    spectra: Mapping[str, tuple[Any, ...]] | None = None,
    pending: int = 0,
    notes: Sequence[str] = (),
    options: Options | None = None,
    tables: Path | None = None,
    pdf: bool = False,
) -> Path:
    """Write a report of one or several runs and return its path.

    Args:
        records: see :func:`monitor.report.runs.read_runs`.
        out: the file, HTML or, where its name ends in .pdf, PDF; replaced atomically.
        title: None for that of the options.
        spectra: by channel, an envelope spectrum that is not in the store, as the fields of :class:`SpectrumView`.
        pending: blocks offered but not yet accepted or rejected, where there is one run.
        notes: sentences at the top, after those of the options.
        options: None for all sections, in UTC.
        tables: folder for every table of the page and the trends of each channel, as CSV and netCDF; None for none.
        pdf: write a PDF beside ``out`` too.

    Raises:
        ReportError: the records cannot be read, a file cannot be written, or a requirement of PDF is missing.
    """
    if pdf or is_pdf(Path(out)):
        require_pdf()
    options = options or Options()
    options = replace(options, title=title or options.title, notes=(*options.notes, *notes))
    views = {name: SpectrumView(*view) for name, view in (spectra or {}).items()}
    page, _ = report_runs(
        read_runs(records), out, options=options, views=views, pending=pending, tables=tables, pdf=pdf
    )
    return page


def report_runs(
    runs: Sequence[Run],
    out: Path,
    *,
    options: Options,
    views: Mapping[str, SpectrumView] | None = None,
    pending: int = 0,
    tables: Path | None = None,
    pdf: bool = False,
) -> tuple[Path, list[RunSummary]]:
    """Write a report of runs in memory, see :func:`build_report`; return its path and a summary of each run."""
    numbers = itertools.count(1)
    parts = [
        part_of_run(run, options, views or {}, pending if len(runs) == 1 else 0, numbers, anchor=f"r{place}")
        for place, run in enumerate(runs, start=1)
    ]
    summaries = [
        summarise(run, part, f"#run{place}", scored=options.holds("score"))
        for place, (run, part) in enumerate(zip(runs, parts, strict=True), start=1)
    ]
    compared = compare(summaries, options, numbers) if len(runs) > 1 and options.holds("comparison") else None
    alone = _tables_over_runs(summaries, options) if compared is None else []
    write_page(
        Path(out),
        "report.html.j2",
        pdf=pdf,
        zoomed=any(picture.zoom for part in parts for channel in part.channels for picture in channel.pictures),
        title=options.title or f"Bearing health: {', '.join(dict.fromkeys(run.machine for run in runs))}",
        notes=[without_folders(note) for note in options.notes],
        runs=parts,
        compared=compared,
        scores=[table for table in alone if table.name == "scores"],
        options=options,
    )
    if tables is not None:
        write_tables(
            [*(alone if compared is None else compared.tables), *_tables_of_runs(parts)], tables, _FILE_ATTRIBUTES
        )
        write_trends(runs, tables, _FILE_ATTRIBUTES)
    return Path(out), summaries


def _tables_over_runs(summaries: Sequence[RunSummary], options: Options) -> list[Table]:
    """Return the tables over runs that apply to a single run too."""
    found = [milestones(summaries, options.zone), laws(summaries), scores(summaries)]
    return [table for table in found if table is not None]


def _tables_of_runs(parts: Sequence[RunPart]) -> list[Table]:
    """Return the tables of each run, under unique names."""
    prefixes = [f"run{place}-" if len(parts) > 1 else "" for place in range(1, len(parts) + 1)]
    return [
        replace(table, name=f"{prefix}{table.name}")
        for prefix, part in zip(prefixes, parts, strict=True)
        for table in part.tables.values()
    ]


def write_index(
    runs: Sequence[RunSummary],
    failed: Sequence[tuple[str, str]],
    out: Path,
    options: Options,
    *,
    tables: bool,
    pdf: bool = False,
) -> Path:
    """Write ``index.html`` and ``failures.json`` of a batch into the folder ``out``; return the index.

    ``failed`` has name and error of each run without a report. ``tables``: write the tables over runs to ``tables/``
    too; ``pdf``: write ``index.pdf`` too.

    Raises:
        ReportError: a file cannot be written.
    """
    compared = compare(runs, options, itertools.count(1))
    path = out / "index.html"
    write_page(
        path,
        "index.html.j2",
        pdf=pdf,
        title=options.title or "Bearing health: all runs",
        notes=options.notes,
        compared=compared,
        failed=[(name, without_folders(error)) for name, error in failed],
        options=options,
    )
    listed = out / "failures.json"
    try:
        write_whole(listed, json.dumps([{"run": name, "error": error} for name, error in failed], indent=1))
    except OSError as error:
        raise ReportError(f"{listed}: cannot be written: {error.strerror or error}") from error
    if tables:
        write_tables(compared.tables, out / "tables", _FILE_ATTRIBUTES)
    return path

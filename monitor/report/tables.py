"""Tables of reports: on the page, and beside it as CSV and netCDF of the same values."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from monitor.records.durable import replacing
from monitor.report.runs import ReportError
from monitor.words.numbers import Clock, figure

Cell = float | int | str | bool | None


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        name: of the quantity, without a unit.
        heading: for people, with the unit.
        units: UDUNITS string of the SI unit, None for text.
        edge: unit at the end of the name in CSV, "" for none.
        scale: factor from SI to the unit in CSV and on the page.
        words: formats a value (SI); by default three figures.
        on_page: False for files alone.
    """

    name: str
    heading: str
    units: str | None = None
    edge: str = ""
    scale: float = 1.0
    words: Callable[[Any], str] | None = None
    on_page: bool = True

    @property
    def is_number(self) -> bool:
        """Whether its values are numbers."""
        return self.units is not None

    @property
    def key(self) -> str:
        """Its name in CSV."""
        return f"{self.name}_{self.edge}" if self.edge else self.name

    def shown(self, value: Cell) -> str:
        """Format a value for the page: "–" for None, "" and NaN."""
        if value is None or value == "" or (isinstance(value, float) and not math.isfinite(value)):
            return "–"
        if self.words is not None:
            return self.words(value)
        if self.is_number:
            return f"{value:,}" if isinstance(value, int) else figure(self.scale * float(value))
        return str(value)

    def written(self, value: Cell) -> Cell:
        """Return a value for CSV: None for None and NaN."""
        if value is None or (isinstance(value, float) and not math.isfinite(value)):
            return None
        if self.is_number and self.scale != 1.0:
            return float(f"{self.scale * float(value):.12g}")
        return value


def time_column(name: str, heading: str, clock: Clock) -> Column:
    """Return a column of moments, s on the axis of a run."""
    where = clock.label if clock.dated else "from the first block"
    return Column(name, f"{heading} ({where})", "s", "s", words=clock.short)


@dataclass(frozen=True)
class Table:
    """A table: ``name`` of its files, ``rows`` of SI values in the order of the columns, ``note`` below it."""

    name: str
    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    note: str = ""

    @property
    def page_columns(self) -> list[Column]:
        """The columns on the page."""
        return [column for column in self.columns if column.on_page]

    @property
    def cells(self) -> list[list[str]]:
        """The rows for the page."""
        return [
            [column.shown(cell) for column, cell in zip(self.columns, row, strict=True) if column.on_page]
            for row in self.rows
        ]

    def to_csv(self) -> str:
        """Return CSV with units at the ends of names; text that a spreadsheet takes for a formula is quoted."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([column.key for column in self.columns])
        for row in self.rows:
            cells = (column.written(cell) for column, cell in zip(self.columns, row, strict=True))
            writer.writerow(["" if cell is None else _harmless(cell) for cell in cells])
        return out.getvalue()

    def to_dataset(self) -> xr.Dataset:
        """Return a dataset over ``row``, SI, NaN for missing numbers."""
        variables: dict[str, Any] = {}
        for place, column in enumerate(self.columns):
            cells = [row[place] for row in self.rows]
            attributes = {"long_name": column.heading}
            if column.is_number:
                values = np.array([np.nan if cell is None else float(cell) for cell in cells], dtype=np.float64)
                attributes["units"] = column.units or "1"
            else:
                values = np.array(["" if cell is None else str(cell) for cell in cells], dtype=object)
            variables[column.name] = ("row", values, attributes)
        return xr.Dataset(variables, attrs={"title": self.title, "comment": self.note, "Conventions": "CF-1.11"})


_FORMULA = "=+-@\t\r\n\uff1d\uff0b\uff0d\uff20"
"""With what a formula begins in a spreadsheet, also in full width."""


def _harmless(cell: Cell) -> Cell:
    if not isinstance(cell, str):
        return cell
    # The writer puts no quotes around a carriage return, which would begin a row, and a cell.
    return ("'" if cell.startswith(tuple(_FORMULA)) else "") + cell.replace("\r\n", "\n").replace("\r", "\n")


def write_tables(tables: Iterable[Table], folder: Path, attributes: Mapping[str, str] | None = None) -> list[Path]:
    """Write each table as ``NAME.csv`` and ``NAME.nc`` with ``attributes``, each atomically; return the files.

    Raises:
        ReportError: a file cannot be written.
    """
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for table in tables:
            texts, binary = (folder / f"{table.name}.{ending}" for ending in ("csv", "nc"))
            write_whole(texts, table.to_csv())
            dataset = table.to_dataset().assign_attrs(attributes or {})
            with replacing(binary) as temporary:
                dataset.to_netcdf(temporary, engine="netcdf4")
            written += [texts, binary]
    except (OSError, RuntimeError) as error:
        raise ReportError(f"{folder}: tables cannot be written: {error}") from error
    return written


def write_whole(path: Path, content: str | bytes, *, make_folder: bool = True) -> None:
    """Write a file atomically, text as UTF-8.

    Raises:
        OSError: it cannot be written.
    """
    if make_folder:
        path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)

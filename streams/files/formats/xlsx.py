"""Excel workbooks (.xlsx, .xlsm): a sheet becomes the text that Excel would export, and is read as such."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial

from streams.files.formats.text import read_layout
from streams.files.formats.workbook import Worksheet, sheets_of
from streams.files.parse.worker import check_claim, from_disk, readable
from streams.files.successive import successive
from streams.types.large import Data, stream_of
from streams.types.samples import ReaderError, Samples

_MIN_TABLE_ROWS = 8
_MIN_SHARE = 0.1
"""A sheet with fewer lines of numbers, or with so small a share of those of the longest, is no recording beside it."""


@from_disk
def read_xlsx(
    data: Data, name: str, keys: Sequence[str] = (), zone: str = "UTC", disregard: Sequence[str] = ()
) -> Samples:
    """Read the sheet of a workbook that holds a table of numbers, one column a channel.

    Rows above the numbers are a head, as :func:`streams.files.formats.text.read_layout` reads it, and so are sheets
    without a table. Cells of dates are dates and times of day.

    Args:
        keys: patterns of the channels; one such as ``SHEET/COLUMN`` says which sheet is read.
        zone: IANA name of the zone of dates.
        disregard: patterns of the keys that are not believed.

    Raises:
        ReaderError: as :func:`streams.files.formats.text.read_layout`, with sheet and row; ``wrong_shape`` where
            several sheets hold tables that are not recordings one after another, and no key names one; ``incomplete``
            where the file breaks off; ``refused`` beyond the limits.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    if data[:4] == b"PK\x03\x04":
        with stream_of(data) as stream:
            if not zipfile.is_zipfile(stream):
                raise ReaderError("incomplete", f"{name}: {len(data)} bytes, without the list that ends a workbook")
    with (
        readable(name, "a readable Excel workbook", _said),
        stream_of(data) as stream,
        zipfile.ZipFile(stream) as packed,
    ):
        parts = {info.filename: info for info in packed.infolist()}
        check_claim(sum(info.file_size for info in parts.values()), len(data), name)
        sheets = list(sheets_of(packed, name))
    notes = [line for other in sheets if not other.tables for _, line in other.lines if line]
    chosen, is_asked = _chosen(sheets, keys, name)
    read = partial(_read_sheet, notes=notes, name=name, zone=zone, disregard=disregard)
    samples = read(chosen[0]) if len(chosen) == 1 else _one_after_another(chosen, read, name, zone)
    if not is_asked:
        return samples
    return samples.of_each(lambda one: replace(one, names=tuple(f"{chosen[0].title}/{title}" for title in one.names)))


def _one_after_another(
    sheets: Sequence[Worksheet], read: Callable[[Worksheet], Samples], name: str, zone: str
) -> Samples:
    """Return the sheets as recordings; ``wrong_shape`` where they do not hold the same channels at other times."""
    listed = ", ".join(repr(sheet.title) for sheet in sheets)[:400]
    error = ReaderError(
        "wrong_shape",
        f"{name}: {len(sheets)} sheets hold tables of numbers: {listed}; name one in [[channel]] key, as "
        f'"{sheets[0].title}/COLUMN"; recordings one after another have the same columns, and each states its start',
    )
    found: list[tuple[float, str, Samples]] = []
    torn: dict[str, str] = {}
    for sheet in sheets:
        place = f"sheet {sheet.title!r}"
        try:
            try:
                samples = read(sheet)
            except ReaderError as cause:
                # Without its last row a sheet that breaks off shows whether it is a recording of its own.
                samples, torn[place] = read(replace(sheet, lines=sheet.lines[:-1])), str(cause)
        except ReaderError as cause:
            raise error from cause
        if samples.start is None or (found and samples.names != found[0][2].names):
            raise error
        found.append((samples.start, place, samples))
    found.sort(key=lambda one: one[0])
    whole = [(place, samples) for _, place, samples in found if place not in torn]
    if len({start for start, *_ in found}) < (len(found) if torn else 2) or not whole:
        raise error
    return successive(whole, name, zone, [*torn.values()])


def _read_sheet(sheet: Worksheet, *, notes: Sequence[str], name: str, zone: str, disregard: Sequence[str]) -> Samples:
    begin = min((sheet.lines[row][0] for row in sheet.tables[:1]), default=0)
    lines = ["\t" * max(0, first - begin) + line for first, line in sheet.lines]
    text = "\n".join([*notes, *lines, ""]).encode()
    try:
        return read_layout(text, name, zone, disregard)
    except ReaderError as error:
        raise ReaderError(error.status, _placed(str(error), name, sheet.title, len(notes))) from error


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {str(error)[:80]}"


def _placed(message: str, name: str, title: str, before: int) -> str:
    """Return a message about lines of the text with the rows of the sheet, which ``before`` lines precede."""

    def place(match: re.Match[str]) -> str:
        row = int(match[1]) - before
        return f"{name}: sheet {title!r}" + (f", row {row}" if row > 0 else "")

    return re.sub(rf"^{re.escape(name)}: line (\d+)", place, message)


def _chosen(sheets: Sequence[Worksheet], keys: Sequence[str], name: str) -> tuple[list[Worksheet], bool]:
    """Return the sheets that are read, and whether a key names them."""
    patterns = [key.rpartition("/")[0] for key in keys if "/" in key]
    asked = [sheet for sheet in sheets if any(fnmatchcase(sheet.title, pattern) for pattern in patterns)]
    longest = max((len(sheet.tables) for sheet in sheets), default=0)
    least = max(_MIN_TABLE_ROWS, _MIN_SHARE * longest)
    found = asked or [sheet for sheet in sheets if len(sheet.tables) >= min(least, max(longest, 1))]
    if not found:
        listed = ", ".join(repr(sheet.title) for sheet in sheets)[:400]
        raise ReaderError("empty", f"{name}: no line of numbers in the sheets {listed}")
    return found, bool(asked)

"""Workbooks and tables as other programs write them; the parts of a workbook by hand, after ECMA-376."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyarrow as pa

Cell = str | float | int | bool | datetime | None
Row = Sequence[Cell]
STYLES = ("General", "yyyy\\-mm\\-dd\\ hh:mm:ss.000", "hh:mm:ss.000", '0.00" days"', "yyyy-mm-dd")
"""Formats of cells by the number of their style; dates have the second."""
_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006/relationships"


def column_name(place: int) -> str:
    name = ""
    while place >= 0:
        name = chr(ord("A") + place % 26) + name
        place = place // 26 - 1
    return name


def days(moment: datetime, since: int = 1900) -> float:
    epoch = datetime(1899, 12, 30) if since == 1900 else datetime(1904, 1, 1)
    return (moment - epoch).total_seconds() / 86400.0


def workbook(
    sheets: Mapping[str, Sequence[Row]],
    *,
    shared: bool = True,
    since: int = 1900,
    prefix: str = "",
    styles: Mapping[int, int] | None = None,
    places: bool = True,
    more: Mapping[str, str] | None = None,
) -> bytes:
    """A workbook of sheets by name.

    Args:
        shared: whether texts stand in the table of shared ones, or in their cells.
        since: the year of day 0, 1900 or 1904.
        prefix: of the names of elements, such as "x:".
        styles: styles of the columns by place from 0, for cells of numbers.
        places: whether cells state where they are.
        more: parts of the package that replace those of the same name.
    """
    texts: list[str] = []

    def cell(value: Cell, row: int, column: int) -> str:
        place = f' r="{column_name(column)}{row}"' if places else ""
        tag = f"{prefix}c"
        if value is None:
            return "" if places else f"<{tag}/>"
        if isinstance(value, datetime):
            return f'<{tag}{place} s="1"><{prefix}v>{days(value, since)!r}</{prefix}v></{tag}>'
        if isinstance(value, bool):
            return f'<{tag}{place} t="b"><{prefix}v>{int(value)}</{prefix}v></{tag}>'
        if isinstance(value, str) and value.startswith("="):
            return f"<{tag}{place}><{prefix}f>{escape(value[1:])}</{prefix}f></{tag}>"
        if isinstance(value, str) and shared:
            texts.append(value)
            return f'<{tag}{place} t="s"><{prefix}v>{len(texts) - 1}</{prefix}v></{tag}>'
        if isinstance(value, str):
            words = f"<{prefix}is><{prefix}t>{escape(value)}</{prefix}t></{prefix}is>"
            return f'<{tag}{place} t="inlineStr">{words}</{tag}>'
        style = f' s="{styles[column]}"' if styles and column in styles else ""
        return f"<{tag}{place}{style}><{prefix}v>{value!r}</{prefix}v></{tag}>"

    space = f'xmlns:{prefix[:-1]}="{_MAIN}"' if prefix else f'xmlns="{_MAIN}"'
    parts: dict[str, str] = {}
    for number, rows in enumerate(sheets.values(), start=1):
        lines = [
            f'<{prefix}row r="{row}">'
            + "".join(cell(value, row, i) for i, value in enumerate(values))
            + f"</{prefix}row>"
            for row, values in enumerate(rows, start=1)
            if any(value is not None for value in values)
        ]
        body = f"<{prefix}sheetData>{''.join(lines)}</{prefix}sheetData>"
        parts[f"xl/worksheets/sheet{number}.xml"] = f"<{prefix}worksheet {space}>{body}</{prefix}worksheet>"
    listed = "".join(
        f'<sheet name={quoteattr(name)} sheetId="{i}" r:id="rId{i}"/>' for i, name in enumerate(sheets, start=1)
    )
    head = f'<workbookPr date1904="{int(since == 1904)}"/>'
    parts["xl/workbook.xml"] = (
        f'<workbook xmlns="{_MAIN}" xmlns:r="{_OFFICE}">{head}<sheets>{listed}</sheets></workbook>'
    )
    links = [("worksheet", f"worksheets/sheet{i}.xml") for i in range(1, len(sheets) + 1)]
    links += [("styles", "/xl/styles.xml"), ("sharedStrings", "sharedStrings.xml")]
    parts["xl/_rels/workbook.xml.rels"] = _links(links)
    parts["_rels/.rels"] = _links([("officeDocument", "xl/workbook.xml")])
    forms = "".join(
        f'<numFmt numFmtId="{163 + i}" formatCode={quoteattr(code)}/>' for i, code in enumerate(STYLES) if i
    )
    used = "".join(f'<xf numFmtId="{163 + i if i else 0}"/>' for i in range(len(STYLES)))
    parts["xl/styles.xml"] = (
        f'<styleSheet xmlns="{_MAIN}"><numFmts>{forms}</numFmts><cellStyleXfs><xf numFmtId="14"/></cellStyleXfs>'
        f"<cellXfs>{used}</cellXfs></styleSheet>"
    )
    words = "".join(f"<si><r><t>{escape(text[:1])}</t></r><r><t>{escape(text[1:])}</t></r></si>" for text in texts)
    parts["xl/sharedStrings.xml"] = f'<sst xmlns="{_MAIN}">{words}</sst>'
    parts["[Content_Types].xml"] = "<Types/>"
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, text in {**dict(sorted(parts.items())), **(more or {})}.items():
            packed.writestr(name, text if text.startswith("<?xml") else f'<?xml version="1.0"?>{text}')
    return stream.getvalue()


def _links(targets: Sequence[tuple[str, str]]) -> str:
    listed = "".join(
        f'<Relationship Id="rId{i}" Type="{_OFFICE}/{kind}" Target="{target}"/>'
        for i, (kind, target) in enumerate(targets, start=1)
    )
    return f'<Relationships xmlns="{_PACKAGE}">{listed}</Relationships>'


def parquet_bytes(
    columns: Mapping[str, NDArray[np.generic] | pa.Array],
    metadata: Mapping[str, str] | None = None,
    of_columns: Mapping[str, Mapping[str, str]] | None = None,
    rows_a_group: int | None = None,
) -> bytes:
    """A Parquet table with metadata of the file and of its columns."""
    # Most tests that import the makers need no table.
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({name: pa.array(column) for name, column in columns.items()})
    fields = [field.with_metadata((of_columns or {}).get(field.name)) for field in table.schema]
    table = table.cast(pa.schema(fields, metadata=metadata))
    stream = io.BytesIO()
    pq.write_table(table, stream, row_group_size=rows_a_group)
    return stream.getvalue()

"""Pages: a template as self-contained HTML, and the same page on A4 as a tagged PDF."""

from __future__ import annotations

import functools
import io
import logging
import re
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, FunctionLoader
from markupsafe import Markup

from monitor import __version__
from monitor.report.figures.zoom import policy_hash, zoom_json, zoom_script, zoom_style
from monitor.report.runs import ReportError
from monitor.report.tables import write_whole
from monitor.report.verdict import GRADE_NAMES
from monitor.words.numbers import Clock

if TYPE_CHECKING:
    from weasyprint.document import Document

SYMBOLS = {"good": "●", "watch": "▲", "bad": "■", "open": "○"}
_PDF_VARIANT = "pdf/ua-1"
"""Tagged, with title, language and alternative texts."""
_VARIABLE = re.compile(r"var\(--\w+,(#[0-9a-f]{6})\)")
_LABELLED = re.compile(r'(<svg[^>]* aria-label="([^"]*)"[^>]*>)')
_LOGGERS = ("weasyprint", "weasyprint.progress", "fontTools")


def is_pdf(path: Path) -> bool:
    """Tell whether a file name ends in .pdf."""
    return path.suffix.lower() == ".pdf"


def write_page(out: Path, template: str, *, pdf: bool = False, **values: Any) -> None:
    """Write a template as HTML, or as PDF if the name ends in .pdf; replace the file atomically.

    ``pdf``: write a PDF beside the HTML too. ``values`` are those of the template, ``options`` among them.

    Raises:
        ReportError: a file cannot be written, or a requirement of PDF is missing.
    """
    paper = out if is_pdf(out) else out.with_suffix(".pdf") if pdf else None
    path = out
    try:
        if paper is not None:
            path = paper
            write_whole(paper, to_pdf(render(template, bare=True, **values)))
        if not is_pdf(out):
            path = out
            write_whole(out, render(template, **values))
    except OSError as error:
        raise ReportError(f"{path}: cannot be written: {error.strerror or error}") from error


def render(template: str, *, bare: bool = False, zoomed: bool = False, style_sheet: str = "", **values: Any) -> str:
    """Return a template as HTML, with every value escaped.

    ``bare``: without scripts and data of figures, for PDF. ``zoomed``: with the scripts for charts
    that can be zoomed and figures that can be saved.
    """
    script = zoom_script() + _file("save.js") if zoomed and not bare else ""
    sheets = ["report.css", *(["pdf.css"] if bare else []), *([style_sheet] if style_sheet else [])]
    return (
        _environment()
        .get_template(template)
        .render(
            written=Clock(True, values["options"].zone).moment(float(int(datetime.now(UTC).timestamp()))),
            # Not from outside: escaping would break the quotes and brackets of a style sheet.
            style=Markup("".join(map(_file, sheets)) + (zoom_style() if script else "")),
            script=Markup(script),
            policy=Markup(policy_hash(script)),
            zoom_json=lambda data: Markup(zoom_json(data)),
            svg=Markup,
            version=__version__,
            symbols=SYMBOLS,
            grades=GRADE_NAMES,
            bare=bare,
            **values,
        )
    )


@functools.cache
def _environment() -> Environment:
    """Return the templates of this package, each compiled once."""
    return Environment(autoescape=True, loader=FunctionLoader(_file), trim_blocks=True, lstrip_blocks=True)


def _file(name: str) -> str:
    return resources.files("monitor.report").joinpath(f"templates/{name}").read_text(encoding="utf-8")


def to_pdf(page: str) -> bytes:
    """Return a page as PDF (PDF/UA-1) on A4; see :func:`lay_out`."""
    buffer = io.BytesIO()
    lay_out(page).write_pdf(buffer, pdf_variant=_PDF_VARIANT)
    return buffer.getvalue()


def lay_out(page: str) -> Document:
    """Lay a ``bare`` page of :func:`render` out on A4; external resources are not fetched."""
    html, fetcher = require_pdf()
    refusing = fetcher(allowed_protocols=("data",), allow_redirects=False)
    return html(string=for_paper(page), url_fetcher=refusing).render(pdf_variant=_PDF_VARIANT)


def for_paper(page: str) -> str:
    """Return a page with style variables of figures replaced by their colours, and labels of figures by titles."""
    return _LABELLED.sub(r"\1<title>\2</title>", _VARIABLE.sub(r"\1", page))


def require_pdf() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the HTML class and the URL fetcher of WeasyPrint.

    Raises:
        ReportError: the extra ``pdf`` or the system library Pango is missing.
    """
    try:
        # It prints where Pango is missing, and warns where HarfBuzz-Subset is, without which it can do.
        with redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from weasyprint import HTML
            from weasyprint.urls import URLFetcher
    except ImportError as error:
        raise ReportError(
            f'a PDF needs the extra pdf: pip install "spallwatch[pdf]" ({error.name or error} is missing)'
        ) from error
    except OSError as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ReportError(
            "a PDF needs the system library Pango, on Debian: apt install libpango-1.0-0 libpangoft2-1.0-0 "
            f"libharfbuzz-subset0 ({reason})"
        ) from error
    # It warns of rules of the style sheet that are meant for browsers.
    for name in _LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return HTML, URLFetcher

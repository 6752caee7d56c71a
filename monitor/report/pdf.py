"""The report on paper: the same page laid out on A4 as a tagged PDF, without network and without files of others."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

from monitor.report.runs import ReportError

if TYPE_CHECKING:
    from weasyprint.document import Document

VARIANT = "pdf/ua-1"
"""Tagged, with a title, a language and texts for what is a picture: readable by those who do not see it."""
_VARIABLE = re.compile(r"var\(--\w+,(#[0-9a-f]{6})\)")
_LABELLED = re.compile(r'(<svg[^>]* aria-label="([^"]*)"[^>]*>)')
_LIBRARIES = ("weasyprint", "weasyprint.progress", "fontTools")


def require_pdf() -> None:
    """Say early, before a report is made, where it could not be written as PDF.

    Raises:
        ReportError: the extra ``pdf`` is missing, or the system library Pango.
    """
    _library()


def to_pdf(page: str) -> bytes:
    """Return a page as PDF (PDF/UA-1) on A4; see :func:`lay_out`."""
    buffer = io.BytesIO()
    lay_out(page).write_pdf(buffer, pdf_variant=VARIANT)
    return buffer.getvalue()


def lay_out(page: str) -> Document:
    """Return a page laid out on A4.

    Nothing is fetched: what the page names beside itself, on a network or in a file, is left out.

    Args:
        page: HTML as :func:`monitor.report.report.render` makes it, ``bare``.

    Raises:
        ReportError: the extra ``pdf`` is missing, or the system library Pango.
    """
    html, fetcher = _library()
    refusing = fetcher(allowed_protocols=("data",), allow_redirects=False)
    return html(string=for_paper(page), url_fetcher=refusing).render(pdf_variant=VARIANT)


def for_paper(page: str) -> str:
    """Return a page with what only a browser understands said otherwise.

    Colours of figures are themselves rather than variables of the style sheet, and what a figure shows is its title.
    """
    return _LABELLED.sub(r"\1<title>\2</title>", _VARIABLE.sub(r"\1", page))


def _library() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Load the library that lays pages out: its page and its fetcher."""
    try:
        # It prints where it finds no Pango; what is printed here belongs to programs.
        with redirect_stdout(io.StringIO()):
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
    # What it says of the style sheet's parts for browsers is no news to anybody who reports a bearing.
    for name in _LIBRARIES:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    return HTML, URLFetcher

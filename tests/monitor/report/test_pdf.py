from __future__ import annotations

import importlib
import json
import re
import shutil
import sys
import threading
import zlib
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from monitor import __version__
from monitor.commands.report import command
from monitor.health.record import Record
from monitor.records.store import Store
from monitor.report.options import Options
from monitor.report.page import for_paper, lay_out, to_pdf
from monitor.report.report import build_report, report_runs
from monitor.report.runs import ReportError, read_runs
from tests.conftest import missing_for_pdf
from tests.oracles.lives import life

MM = 96 / 25.4
A4 = (210 * MM, 297 * MM)
START = 1_700_000_000.0
WORDS = frozenset({"quality", "events", "provenance"})
"""Sections of a page that is about words, not pictures."""


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stored_life(tmp_path_factory.mktemp("life"), life(start=START))


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stored_life(tmp_path_factory.mktemp("short"), life(60, start=START, onset=40, learn=20))


def stored_life(folder: Path, made: list[Record], machine: str = "press <4>") -> Path:
    with Store.open(folder / "state.db", machine=machine) as store:
        store.describe({"config_hash": "c1"})
        store.commit_many([(record, {}) for record in made])
    return folder


def inflated(pdf: bytes) -> bytes:
    """A PDF with its streams as they were before they were compressed."""
    found = [pdf]
    for body in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL):
        try:
            found.append(zlib.decompressobj().decompress(body))
        except zlib.error:
            continue
    return b"\n".join(found)


def words(page: Any) -> str:
    """The text of a page that was laid out, header and footer included."""
    return " ".join(box.text for box in page._page_box.descendants() if type(box).__name__ == "TextBox")


def only_events(folder: Path) -> Path:
    """Return a file of options that leaves out pictures."""
    path = folder / "include.toml"
    path.write_text('[report]\ninclude = ["events"]\n')
    return path


def bare_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, source: Path, **options: Any) -> str:
    """The HTML of which a PDF is made."""
    taken: list[str] = []
    with monkeypatch.context() as patch:
        patch.setattr("monitor.report.page.to_pdf", lambda page: taken.append(page) or b"")
        report_runs(read_runs(source), tmp_path / "x.pdf", options=Options(**options))
    return taken[0]


@pytest.mark.pdf
def test_a_pdf_is_tagged_and_says_whose_it_is_and_nothing_is_printed(
    short: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = build_report(short, tmp_path / "deep" / "press.PDF", title='Press "4" & <b>')
    # Nor what the layout says of styles.
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "")
    pdf = out.read_bytes()
    assert pdf.startswith(b"%PDF-1.7")
    assert not list(out.parent.glob("*.html"))
    told = inflated(pdf)
    for name in (b"/StructTreeRoot", b"/MarkInfo", b"/Lang", b"/S /Figure", b"/Alt", b"/S /TH", b"pdfuaid:part"):
        assert name in told, name
    xmp = re.sub(rb"\s+", b" ", told)
    assert b"Press &quot;4&quot; &amp; &lt;b&gt;" in xmp or b'Press "4" &amp; &lt;b&gt;' in xmp
    assert f"spallwatch {__version__}".encode() in xmp
    assert not re.search(rb"/(JavaScript|JS|Launch|EmbeddedFile|URI)\b", told)


@pytest.mark.pdf
@pytest.mark.usefixtures("blank_pictures")
def test_pages_are_a4_with_header_footer_and_whole_figures(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = bare_page(monkeypatch, tmp_path, stored, title="Hall A")
    assert "data-values" not in page
    assert "<script" not in page
    document = lay_out(page)
    pages = list(document.pages)
    assert len(pages) > 2
    bottom = (297 - 19) * MM
    figures = 0
    for number, one in enumerate(pages, start=1):
        assert (one.width, one.height) == pytest.approx(A4)
        text = words(one)
        assert f"page {number} of {len(pages)}" in text
        assert f"by spallwatch {__version__}" in text
        assert number == 1 or ("Hall A" in text and "press <4>" in text)
        for box in one._page_box.descendants():
            if box.element_tag == "figure" and type(box).__name__ == "BlockBox":
                figures += 1
                assert box.position_y >= 0.0
                assert box.position_y + box.margin_height() <= bottom + 1.0
    # Each stands on one page: none was cut into two boxes.
    assert figures == page.count("<figure")
    whole = " ".join(map(words, pages))
    for sentence in ("In the final stage of its life: damage of the outer race", "Data quality", "accepted", "Events"):
        assert sentence in whole


@pytest.mark.pdf
def test_a_long_table_repeats_its_head() -> None:
    rows = "".join(f"<tr><td>{number}</td></tr>" for number in range(200))
    head = "<!DOCTYPE html><html lang='en'><title>t</title><style>thead {display: table-header-group}</style>"
    pages = list(lay_out(f"{head}<table><thead><tr><th>count</th></tr></thead><tbody>{rows}</tbody></table>").pages)
    assert len(pages) > 2
    assert all("count" in words(page) for page in pages)


@pytest.mark.pdf
def test_names_with_html_are_words_on_paper_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    evil = "<img src=x onerror=alert(1)><script>"
    stored_life(tmp_path, life(60, start=START, onset=40, learn=20), evil)
    page = bare_page(monkeypatch, tmp_path, tmp_path, title=evil, sections=WORDS)
    document = lay_out(page)
    whole = " ".join(map(words, document.pages)).replace("\n", "")
    assert evil.replace(" ", "") in whole.replace(" ", "")
    assert document.metadata.title == evil


@pytest.fixture
def listener() -> Iterator[tuple[str, list[str]]]:
    """A web server on loopback that writes down what it is asked for."""
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(200)
            self.end_headers()

        def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}", asked
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.mark.pdf
def test_nothing_is_fetched_from_a_network_or_a_file(listener: tuple[str, list[str]], tmp_path: Path) -> None:
    address, asked = listener
    secret = tmp_path / "secret.txt"
    secret.write_text("the key is 4711")
    page = f"""<!DOCTYPE html><html lang="en"><head><title>t</title>
        <link rel="stylesheet" href="{address}/style.css"><link rel="attachment" href="{secret.as_uri()}">
        <link rel="attachment" href="{address}/attached">
        <style>@import url({address}/more.css); @font-face {{ font-family: f; src: url({address}/font) }}
        body {{ font-family: f; background: url({address}/paper.png) }}</style></head>
        <body><img src="{address}/a.png" alt="a"><img src="{secret.as_uri()}" alt="b"><img src="//127.0.0.1/c" alt="c">
        <svg viewBox="0 0 9 9"><image href="{address}/d.png"/><use href="{secret.as_uri()}#x"/></svg></body></html>"""
    told = inflated(to_pdf(page))
    assert asked == []
    assert b"4711" not in told


@pytest.mark.pdf
def test_the_command_writes_a_page_and_its_pdf(short: Path, tmp_path: Path) -> None:
    out = tmp_path / "press.html"
    order = [str(short), "--out", str(out), "--include", str(only_events(tmp_path)), "--pdf", "--json", "--quiet"]
    outcome = CliRunner().invoke(command, order)
    assert outcome.exit_code == 0, outcome.output
    assert json.loads(outcome.output)["pdf"] == str(tmp_path / "press.pdf")
    assert (tmp_path / "press.pdf").read_bytes().startswith(b"%PDF")
    assert out.read_text().startswith("<!DOCTYPE html>")


@pytest.mark.pdf
def test_a_batch_writes_pdfs_too_and_makes_again_one_that_is_missing(short: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(short, tmp_path / "hall" / "press")
    order = ["--batch", str(tmp_path / "hall"), "--out", str(out), "--workers", "1", "--json", "--quiet"]
    order += ["--include", str(only_events(tmp_path)), "--no-tables", "--pdf"]
    outcome = CliRunner().invoke(command, order)
    assert outcome.exit_code == 0, outcome.output
    (page,) = out.glob("*/report.pdf")
    assert (out / "index.pdf").read_bytes().startswith(b"%PDF")
    page.unlink()
    assert json.loads(CliRunner().invoke(command, order).output)["reused"] == 0
    assert page.read_bytes().startswith(b"%PDF")
    assert json.loads(CliRunner().invoke(command, order).output)["reused"] == 1


def without(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "weasyprint"]:
        monkeypatch.delitem(sys.modules, name)


def test_a_missing_extra_is_named_before_anything_is_made(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch)
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    with pytest.raises(ReportError, match=r'pip install "spallwatch\[pdf\]"'):
        build_report(stored, tmp_path / "a.pdf")
    with pytest.raises(ReportError, match=r"spallwatch\[pdf\]"):
        build_report(tmp_path / "nowhere", tmp_path / "a.html", pdf=True)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_pango_is_named_and_nothing_is_printed(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without(monkeypatch)
    library = tmp_path / "library"
    library.mkdir()
    (library / "weasyprint.py").write_text("print('read the manual'); raise OSError('cannot load pango-1.0-0')")
    monkeypatch.syspath_prepend(str(library))
    with pytest.raises(ReportError, match=r"Pango.*libpango-1\.0-0.*cannot load pango"):
        build_report(stored, tmp_path / "a.pdf")
    assert capsys.readouterr().out == ""


def test_what_is_missing_is_named_and_no_warning_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = tmp_path / "weasyprint"
    library.mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    (library / "urls.py").write_text("class URLFetcher: ...")
    without(monkeypatch)
    for text, missing in {
        "import warnings; warnings.warn('HarfBuzz-Subset', DeprecationWarning)\nclass HTML: ...": "",
        "raise OSError('cannot load library pangoft2-1.0-0')": "Pango.*cannot load library pangoft2-1.0-0",
        "import weasyprint_needs_this": r"spallwatch\[pdf\].*weasyprint_needs_this is missing",
    }.items():
        (library / "__init__.py").write_text(text)
        importlib.invalidate_caches()
        found = missing_for_pdf.__wrapped__()
        for name in ("weasyprint", "weasyprint.urls"):
            sys.modules.pop(name, None)
        assert re.search(missing, found) if missing else found == ""


def test_paper_has_plain_colours_and_pictures_with_titles() -> None:
    page = '<svg role="img" aria-label="a &lt;b&gt;" viewBox="0 0 1 1"><path style="fill: var(--blue,#0072b2)"/></svg>'
    assert for_paper(page) == (
        '<svg role="img" aria-label="a &lt;b&gt;" viewBox="0 0 1 1"><title>a &lt;b&gt;</title>'
        '<path style="fill: #0072b2"/></svg>'
    )

"""The gallery of the other models: page, data and pictures belong together, and what is drawn now is what was kept."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.gallery import DATA
from benchmarks.gallery_ceruti_faults import COMMON, FAULTS, lines
from benchmarks.gallery_models import PAGE, SOURCES, page
from benchmarks.gallery_page import Entry, Source, counted, make, section, table
from benchmarks.gallery_plate import MOST_BYTES, Plate, plain, words
from benchmarks.gallery_spectra import Lines, envelope_spectrum, is_multiple, kept_lines, spectrum
from models.published.ceruti import SPEED
from monitor.commands.simulate.command import command
from tests.support.effort import effort_count
from tests.support.gallery_data import check_links, same

CHEAP = (
    ("ceruti", "2.7"),
    ("ceruti", "6.15"),
    ("thibault", "7"),
    ("beat", "12"),
    ("ceruti", "6.31"),
    ("ceruti", "6.4"),
    ("beat", "5"),
    ("ceruti", "6.14"),
    ("thibault", "5"),
    ("thibault", "16"),
    ("thibault", "10"),
)


@pytest.mark.parametrize("name", list(SOURCES))
def test_every_figure_has_a_counterpart_or_a_reason(name: str) -> None:
    source = SOURCES[name]
    numbers = [entry.number for entry in source.entries]
    assert len(set(numbers)) == len(numbers)
    assert set(source.figures) <= set(numbers)
    assert set(source.kept) <= set(source.figures)
    for entry in source.entries:
        assert (entry.number in source.figures) != bool(entry.why), entry.number
        assert all(like in source.figures for like in entry.like)


def test_the_page_is_made_of_the_data() -> None:
    """Renew it with ``python -m benchmarks.gallery --source ceruti``."""
    assert PAGE.read_text(encoding="utf-8") == page(DATA)


def test_links_of_the_page_lead_somewhere() -> None:
    check_links(page(DATA), PAGE.parent)


def test_pictures_beside_the_page_are_few_and_small() -> None:
    kept = sorted(name for source in SOURCES.values() for name in source.kept.values())
    pictures = sorted((PAGE.parent / "gallery-models").iterdir())
    assert [path.name for path in pictures] == kept
    assert max(path.stat().st_size for path in pictures) < MOST_BYTES


@pytest.mark.parametrize("name", list(SOURCES))
def test_data_are_those_of_the_figures(name: str) -> None:
    found = sorted(path.name for path in (DATA / name).iterdir())
    assert found == sorted(f"fig{number}.json" for number in SOURCES[name].figures)


@pytest.mark.parametrize(("name", "figure"), CHEAP[: effort_count(quick=4, full=len(CHEAP))])
def test_what_is_drawn_now_is_what_was_kept(name: str, figure: str) -> None:
    plate = SOURCES[name].figures[figure]()
    kept = json.loads((DATA / name / f"fig{figure}.json").read_text(encoding="utf-8"))
    same(plain(plate.data), kept["data"])
    assert [claim.verdict for claim in plate.claims] == [claim["verdict"] for claim in kept["claims"]]
    assert plate.caption == kept["caption"]


def test_the_command_of_a_fault_of_the_shaft_makes_its_spectrum(tmp_path: Path) -> None:
    """The line of an unbalance at the disc, from the waveform that the printed command writes."""
    waveform = tmp_path / "disc.csv"
    words_ = shlex.split(f"{COMMON} {FAULTS['unbalance'][0]} --sensor c --accuracy 0.02 --waveform {waveform}")
    result = CliRunner().invoke(command, words_[2:])
    assert result.exit_code == 0, result.output
    time, signal = np.loadtxt(waveform, delimiter=",", skiprows=1, unpack=True)
    found = spectrum(9.80665 * signal, 1.0 / (time[1] - time[0]))
    assert found.at(SPEED) == pytest.approx(lines("unbalance", "c").at(SPEED), rel=0.01)


def test_lines_of_a_spectrum() -> None:
    """A tone of amplitude 2 at 40 Hz, and one at 3000 Hz of amplitude 1 whose envelope swings at 40 Hz by 0.5."""
    rate = 10_000.0
    t = np.arange(4 * int(rate)) / rate
    swing = (1.0 + 0.5 * np.cos(2.0 * np.pi * 40.0 * t)) * np.cos(2.0 * np.pi * 3000.0 * t)
    tone = spectrum(2.0 * np.sin(2.0 * np.pi * 40.0 * t) + 5.0, rate)
    assert tone.at(40.0) == pytest.approx(2.0, rel=1e-6)
    assert tone.highest() == pytest.approx(40.0)
    assert envelope_spectrum(swing, rate, (1000.0, 4000.0)).at(40.0) == pytest.approx(0.5, rel=1e-3)
    kept = kept_lines({"A": tone}, 100.0)
    assert kept["highest_a_m_s2"][40] == pytest.approx(2.0, rel=1e-6)
    assert len(kept["highest_a_m_s2"]) == 101
    flat = Lines(np.arange(10.0), np.array([0.0, 1.0, 1.0, 6.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]))
    assert flat.stands_out(3.0, 10.0)
    assert not flat.stands_out(6.0, 10.0)
    assert is_multiple(86.4, 43.2, 0.1)
    assert not is_multiple(60.0, 43.2, 0.1)


def test_a_source_is_written_with_its_own_words(tmp_path: Path) -> None:
    def plate() -> Plate:
        return Plate("What is seen.", "l", 1.0, lambda made: None, {}, [words("it rises", [True])], "chosen films")

    entries = (Entry("6.28", "Orbits"), Entry("6.5", "Angles", "a drawing", ("6.28",)))
    source = Source("who", entries, {"6.28": plate}, {"6.28": "who-6.28.svg"}, "pictures", "with chosen films")
    make(source, tmp_path, tmp_path, [])
    stored = source.stored(tmp_path)
    assert table(source, stored)[3:] == [
        "| 6.28 | Orbits | [with chosen films](#who-6-28) | 1 agrees |",
        "| 6.5 | Angles | none: a drawing; see [Fig. 6.28](#who-6-28) |  |",
    ]
    text = "\n".join(section(source, entries[0], stored["6.28"]))
    assert '<a id="who-6-28"></a>' in text
    assert "![l](pictures/who-6.28.svg)" in text
    assert "What is seen. Another machine: chosen films." in text
    assert counted(stored).startswith("Of 1 statements of the print: 1 agrees, 0 are close")
    with pytest.raises(ValueError, match=r"--only 6\.5: expected numbers among 6\.28"):
        make(source, tmp_path, tmp_path, ["6.5"])

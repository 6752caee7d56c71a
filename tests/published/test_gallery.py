"""The gallery: page, data and pictures belong together and to the program; verdicts are what their rule says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import FigureBase

from benchmarks.gallery import DATA, ENTRIES, FIGURES, KEPT, PAGE, SOURCE, page
from benchmarks.gallery_lives import LENGTHS, MINUTE, TESTS, V_END, V_TH, printed_law, sizes, true_volume
from benchmarks.gallery_page import make
from benchmarks.gallery_plate import MOST_BYTES, Plate, number, plain, save_plate, words
from benchmarks.gallery_seeded import likeness
from models.machine.bearing import from_catalogue
from models.path.defect import race_radius
from tests.support.effort import effort_count
from tests.support.gallery_data import check_links, same

CHEAP = ("36", "38", "40", "43", "53", "45", "46", "47", "48", "51")


def stored(figure: str) -> dict[str, Any]:
    return json.loads((DATA / f"fig{figure}.json").read_text(encoding="utf-8"))


def test_every_figure_of_both_chapters_stands_once() -> None:
    assert [entry.number for entry in ENTRIES] == [str(n) for n in range(29, 68)]
    for entry in ENTRIES:
        assert (entry.number in FIGURES) != bool(entry.why), entry.number
        assert all(like in FIGURES for like in entry.like)


def test_the_page_is_made_of_the_data() -> None:
    """Renew it with ``python -m benchmarks.gallery``."""
    assert PAGE.read_text(encoding="utf-8") == page(DATA)


def test_links_of_the_page_lead_somewhere() -> None:
    check_links(page(DATA), PAGE.parent)


def test_pictures_beside_the_page_are_few_and_small() -> None:
    pictures = sorted(PAGE.with_suffix("").iterdir())
    assert [path.name for path in pictures] == sorted(KEPT.values())
    assert all(stored(figure)["picture"] == name for figure, name in KEPT.items())
    assert max(path.stat().st_size for path in pictures) < MOST_BYTES
    assert sorted(path.stem for path in DATA.glob("*.json")) == sorted(f"fig{figure}" for figure in FIGURES)


@pytest.mark.parametrize("figure", CHEAP[: effort_count(quick=5, full=len(CHEAP))])
def test_what_is_drawn_now_is_what_was_kept(figure: str) -> None:
    plate, kept = FIGURES[figure](), stored(figure)
    same(plain(plate.data), kept["data"])
    assert [claim.verdict for claim in plate.claims] == [claim["verdict"] for claim in kept["claims"]]
    assert plate.caption == kept["caption"]


def test_what_rests_on_simulated_lives_says_so() -> None:
    lives = {figure for figure in FIGURES if stored(figure)["machine"]}
    assert lives == {"55", "57", "58", "59", "60", "62", "63", "64", "65", "66", "67"}
    for figure in lives:
        for claim in stored(figure)["claims"]:
            # No number of another machine may pass for a reproduced one.
            assert claim["verdict"] == "not comparable" or " of " in claim["obtained"] or "falls" in claim["obtained"]


@pytest.mark.parametrize(
    ("printed", "obtained", "half", "verdict"),
    [
        (7.5, 7.549, 0.05, "agrees"),
        (7.5, 7.56, 0.05, "close"),
        (7.5, 7.8, 0.05, "differs"),
        (7.5, 7.2, 0.05, "differs"),
        (100.0, 97.1, 0.5, "close"),
    ],
)
def test_verdicts_on_numbers(printed: float, obtained: float, half: float, verdict: str) -> None:
    assert number("x", printed, obtained, "Hz", half).verdict == verdict


@pytest.mark.parametrize(
    ("cases", "verdict"), [([True, True], "agrees"), ([True, False], "in part"), ([False, False], "differs")]
)
def test_verdicts_on_words(cases: list[bool], verdict: str) -> None:
    claim = words("x", cases)
    assert (claim.verdict, claim.obtained) == (verdict, f"{sum(cases)} of 2")


def test_a_large_drawing_becomes_dots_and_one_that_stays_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.gallery_plate.MOST_BYTES", 30_000)
    monkeypatch.setattr("benchmarks.gallery_plate._DPI", (60, 40))

    def many(made: FigureBase) -> None:
        made.subplots(1, 1).plot(*np.random.default_rng(0).normal(size=(2, 700)), ".", ms=1)

    def noise(made: FigureBase) -> None:
        made.subplots(1, 1).imshow(np.random.default_rng(0).random((150, 450)), aspect="auto")

    path = save_plate(Plate("c", "l", 1.5, many, {"a_g": np.array([1.0, np.nan])}), "1", tmp_path, tmp_path)
    assert path.suffix == ".png"
    assert path.stat().st_size < 30_000
    assert json.loads((tmp_path / "fig1.json").read_text())["data"] == {"a_g": [1.0, None]}
    with pytest.raises(ValueError, match="figure 2"):
        save_plate(Plate("c", "l", 3.0, noise, {}), "2", tmp_path, tmp_path)
    assert not list(tmp_path.glob("fig2*"))


def test_unknown_figures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--only 31: expected numbers among 36"):
        make(SOURCE, tmp_path, tmp_path, ["31"])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("test", TESTS)
def test_a_twin_follows_the_printed_law_and_goes_on_without_a_jump(test: str) -> None:
    law, end = printed_law(test), LENGTHS[test] * MINUTE
    crossing = law.first_crossing(V_TH)
    assert crossing is not None
    assert crossing < end
    assert true_volume(test, 0.5 * crossing) == law.value_at(0.5 * crossing)
    assert true_volume(test, crossing) == pytest.approx(V_TH)
    step = 1e-3
    before, after = (true_volume(test, crossing + k * step) for k in (-1, 1))
    assert after - V_TH == pytest.approx(V_TH - before, rel=1e-3)
    assert true_volume(test, end) == pytest.approx(V_END)
    volumes = np.array([true_volume(test, float(t)) for t in np.linspace(0.0, end, 200)])
    assert np.all(np.diff(volumes) > 0.0)


@pytest.mark.parametrize("volume", [1e-9, 5e-8, 5e-7])
def test_sizes_have_the_volume(volume: float) -> None:
    extent, depth = sizes(volume)
    assert race_radius(from_catalogue("1205 ETN9")) * extent * depth == pytest.approx(volume)


def test_likeness_of_periods() -> None:
    t = np.arange(4000)
    tone = np.sin(2.0 * np.pi * t / 80.5)
    assert likeness(tone, 80.5) == pytest.approx(1.0, abs=2e-3)
    assert abs(likeness(np.random.default_rng(0).normal(size=4000), 80.5)) < 0.2

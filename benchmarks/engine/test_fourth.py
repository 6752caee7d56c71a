"""What the fourth set's references are, which of them are still to be made, and what the tables say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.engine.fourth import Answered, beside, is_open, load, reference, save, tables
from reference.periodic.fourth import SETS, fourth_scene
from reference.periodic.judge import answer, compared

KEPT = load()


def test_the_references_belong_to_the_scenes_that_are_drawn() -> None:
    assert len({(entry["set"], entry["number"]) for entry in KEPT}) == len(KEPT) > 0
    for entry in KEPT:
        seed, count = SETS[entry["set"]]
        assert entry["number"] < count
        assert fourth_scene(seed, entry["number"]).key() == entry["key"]


@pytest.mark.parametrize("entry", sorted(KEPT, key=lambda entry: entry["seconds"])[:2], ids=lambda entry: entry["key"])
def test_a_reference_is_made_again(entry: dict[str, Any]) -> None:
    again = reference(entry["set"], entry["number"], 60.0)
    assert again["status"] == entry["status"]
    assert again["rms"] == pytest.approx(entry["rms"], rel=1e-6)
    assert again["lines"] == pytest.approx(entry["lines"], rel=1e-5, abs=1e-5 * max(entry["lines"]))


def test_a_scene_at_the_limit_is_open_for_a_longer_one(tmp_path: Path) -> None:
    cut = reference("development", KEPT[0]["number"], 1e-3)
    assert cut["status"] == "limit"
    assert (is_open(cut, 1e-3), is_open(cut, 1.0), is_open(None, 1.0)) == (False, True, True)
    assert not is_open({"status": "settled", "error": 1e-9, "limit": 1e-3}, 1.0)
    assert is_open({"status": "settled", "error": None, "limit": 1e-3}, 1.0)
    entries = [cut | {"number": 3}, cut | {"set": "held_out", "number": 0}, cut | {"number": 1}]
    save(entries, tmp_path / "kept.json")
    kept = load(tmp_path / "kept.json")
    placed = [(entry["set"], entry["number"]) for entry in kept]
    assert placed == [("development", 1), ("development", 3), ("held_out", 0)]


# Scenes that had a wrong peak (26, 47, 50, 55), and one with a stable motion that repeats beside that from rest (22).
@pytest.mark.parametrize("number", [22, 26, 47, 50, 55])
def test_a_development_scene_that_was_wrong(number: int) -> None:
    truth = next(one for one in KEPT if (one["set"], one["number"]) == ("development", number))
    got = answer(fourth_scene(SETS["development"][0], number), 1e-3)
    assert got["status"] == ("converged" if truth["repeats"] else "not_periodic")
    found = compared(truth, got)
    assert len(found) == (8 if truth["repeats"] else 1)
    assert [each.quantity for each in found if each.wrong] == []


TRUTH: dict[str, Any] = {"key": "k", "status": "settled", "repeats": True, "rms": 2.0, "peak": 6.0, "lines": [1.0] * 6}
TRUTH |= {"error": 1e-9, "peak_error": 1e-9, "line_errors": [1e-9] * 6, "standard_error": 0.0, "spread": 0.0}


def answered(rms: float, status: str = "converged", ms: float = 1.0) -> Answered:
    got: dict[str, Any] = {"status": status, "rms": rms, "peak": 6.0, "lines": [1.0] * 6, "ms": ms}
    got |= {"estimate": 1e-3, "peak_estimate": 1e-3, "line_estimates": [1e-3] * 6}
    return Answered(1e-3, 0, fourth_scene(SETS["development"][0], 0), TRUTH, got)


def test_the_tables_count_what_is_bounded_and_what_is_wrong() -> None:
    answers = [answered(2.0), answered(2.004, ms=3.0), answered(2.01), answered(2.01, "inaccurate")]
    found = tables([*answers, Answered(1e-3, 1, answers[0].scene, TRUTH, {"status": "refused", "reason": "why"})])
    assert {row["status"]: (row["scenes"], row["share"]) for row in found["statuses"]} == {
        "converged": (3, 0.6),
        "inaccurate": (1, 0.2),
        "refused": (1, 0.2),
    }
    (rms,) = (row for row in found["errors"] if (row["status"], row["quantity"]) == ("converged", "rms"))
    assert (rms["compared"], rms["off by more than 3 times"]) == (3, 1)
    assert rms["bounded"] == pytest.approx(1.0 / 3.0)
    assert rms["stated over true"] == pytest.approx(2.004e-3 / 4e-3)
    assert [row["quantity"] for row in found["wrong"]] == ["rms"]
    (work,) = found["work"]
    assert (work["converged"], work["ms, median"]) == (3, 1.0)
    assert work["error, most"] == pytest.approx(5e-3)


def test_earlier_figures_stand_beside_the_new_ones() -> None:
    before, after = (tables([answered(rms)]) for rms in (2.004, 2.0))
    found = beside(after, before)
    (rms,) = (row for row in found["errors"] if row["quantity"] == "rms")
    assert (rms["bounded"], rms["bounded before"]) == (1.0, 0.0)
    new = beside(tables([answered(2.0, "inaccurate")]), before)
    assert new["statuses"][0]["share before"] is None

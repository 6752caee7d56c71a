"""The page of the models shows the stored figures of benchmarks.models, and these meet what was aimed at."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.models.__main__ import ASKED, asked_rows, stored_tables, with_tables

ROOT = Path(__file__).resolve().parents[3]


def test_the_page_shows_the_stored_figures() -> None:
    """Renew it with ``python -m benchmarks.models --stored benchmarks/results/models.json --document FILE``."""
    text = (ROOT / "docs" / "evidence" / "models.md").read_text(encoding="utf-8")
    assert with_tables(text, stored_tables(ROOT / "benchmarks" / "results" / "models.json")) == text


def test_the_stored_figures_meet_what_was_aimed_at() -> None:
    tables = stored_tables(ROOT / "benchmarks" / "results" / "models.json")
    assert [row["met"] for row in asked_rows(tables["against"], tables["linear"])] == ["yes"] * len(ASKED)
    assert {str(row["model"]).split(",")[0] for row in tables["against"]} >= {
        "six_dof", "rotor", "ball_inertia", "ring_impact", "angular"
    }  # fmt: skip


def test_the_worst_of_each_ratio_is_judged() -> None:
    good = {"model": "m", "scene": "s", "times scipy": 9.0, "times plain": 99.0, "share of prototype": 0.05}
    poor = good | {"scene": "t", "times scipy": 4.0, "share of prototype": 0.2, "times plain": None}
    methods = [{"method": "lsim", "grid": "1", "times the kernel": 2.0}]
    rows = asked_rows([good, poor], methods)
    assert [row["met"] for row in rows] == ["no", "yes", "yes", "no"]
    assert [row["worst"] for row in rows] == pytest.approx([4.0, 99.0, 2.0, 0.2])
    assert rows[0]["where"] == "m, t"

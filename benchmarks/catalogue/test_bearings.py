"""The catalogue of series against published ratings, bearings known from elsewhere, and its own rules."""

from __future__ import annotations

import pytest

from benchmarks.catalogue.bearings import internal, known_bearings, published_ratings
from benchmarks.catalogue.ratings import fitted_rules
from models.machine.catalogue.ratings import dynamic_rating, static_rating
from models.machine.catalogue.series import RULES, families, geometry


def test_the_derived_geometry_gives_the_published_ratings() -> None:
    derived = [base for base in sorted(families()) if "derived" in geometry(base).source]
    assert len(derived) > 300
    for base in derived:
        inside = internal(geometry(base), families()[base])
        dynamic, static = published_ratings(base)
        assert static_rating(inside) == pytest.approx(static, rel=0.021), base
        assert dynamic_rating(inside) == pytest.approx(dynamic, rel=0.026), base


def test_bearings_known_from_elsewhere_agree_within_the_stated_uncertainty() -> None:
    rows = known_bearings()
    assert all(row["probability"] > 0.0 for row in rows), "the right number of elements is listed"
    assert sum(row["n_elements"][0] == row["n_elements"][1] for row in rows) >= 0.8 * len(rows)
    for row in rows:
        assert abs(row["bpfo_error_counted"]) <= 2.0 * row["bpfo_stated"], row["designation"]
        assert abs(row["bsf_error_counted"]) <= 2.0 * row["bsf_stated"], row["designation"]


def test_the_rules_are_those_that_the_even_bore_codes_give() -> None:
    for series, rule in fitted_rules().items():
        assert RULES[series] == rule, series

"""The judge itself: what it calls equal and what it calls a difference."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.regression.compare import compare
from benchmarks.regression.observe import Observation, of_json, of_rows

BEFORE: Observation = {
    "out/store/blocks/sequence": np.array([1.0, 2.0]),
    "out/store/blocks/x.rms": np.array([[0.5], [np.nan]]),
    "out/store/blocks/status": np.array(["ok", "nan"]),
    "out/store/blocks/reason": np.array(["", "not a number"]),
}


def changed(name: str, values: list[object]) -> Observation:
    return BEFORE | {f"out/store/blocks/{name}": np.array(values)}


def test_the_same_values_are_equal_and_so_are_two_nans() -> None:
    found = compare(BEFORE, dict(BEFORE))
    assert (found.differences, found.records, found.values) == ([], 2, 6)


@pytest.mark.parametrize(
    ("name", "values", "where"),
    [
        ("x.rms", [[0.5 * (1.0 + 1e-9)], [np.nan]], "block 1[0]; 1 of 2 differ"),
        ("x.rms", [[0.5], [0.0]], "block 2[0]; 1 of 2 differ"),
        ("status", ["ok", "short"], "block 2; 1 of 2 differ"),
        ("sequence", [1.0], "shape"),
        ("new", [1.0, 2.0], "only in present"),
    ],
)
def test_a_change_is_named_with_its_block(name: str, values: list[object], where: str) -> None:
    found = compare(BEFORE, changed(name, values))
    assert [(item.name, item.where) for item in found.differences] == [(f"out/store/blocks/{name}", where)]


def test_a_relative_change_may_be_allowed_and_is_reported() -> None:
    after = changed("x.rms", [[0.5 * (1.0 + 1e-9)], [np.nan]])
    found = compare(BEFORE, after, relative=1e-6)
    assert found.differences == []
    assert found.greatest == pytest.approx(1e-9, rel=1e-6)


def test_sentences_are_compared_on_demand() -> None:
    after = changed("reason", ["", "holds NaN"])
    assert compare(BEFORE, after).differences == []
    assert len(compare(BEFORE, after, texts=True).differences) == 1


def test_rows_become_columns_without_what_differs_between_runs() -> None:
    rows = [{"tt": [1, None], "config_hash": "a"}, {"tt": [3.0, 4.0], "kind": "final_stage"}]
    found = of_rows("t", rows)
    assert list(found) == ["t/tt/0", "t/tt/1", "t/kind"]
    np.testing.assert_array_equal(found["t/tt/1"], [np.nan, 4.0])
    assert found["t/kind"].tolist() == ["", "final_stage"]
    assert list(of_json("j", {"seconds": 1.0, "rows": [{"a": 1}], "b": 2})) == ["j/b", "j/rows/a"]

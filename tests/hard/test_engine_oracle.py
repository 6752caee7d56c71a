"""The engine against stored results of the independent oracle (tests/oracles/periodic) on random scenes."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from reference.periodic.judge import DEFAULT_ACCURACY, answer, verdict
from reference.periodic.rig import from_dict
from tests.support.effort import effort_count

STORED = {
    entry["key"]: entry for entry in json.loads((Path(__file__).parents[1] / "data" / "engine_oracle.json").read_text())
}
# They take 36 of the 38 s of all, seconds each: slow shafts and a long mean. The others hold balls and rollers, rough
# floors, light loads and motions that do not repeat as well.
SLOW = {"baea56bffd41d5d0", "bec6ec402262718d", "58d499834c919c2f", "c801b0be71b558a8", "dfb2abc8eceef652"}
KEYS = [key for key in STORED if effort_count(quick=0, full=1) or key not in SLOW]


@cache
def row_of(key: str) -> dict[str, Any]:
    scene = from_dict(STORED[key]["scene"])
    return verdict(scene, STORED[key]["result"], answer(scene, None), DEFAULT_ACCURACY)


@pytest.mark.parametrize("key", KEYS)
def test_the_engine_is_right_or_says_that_it_is_not(key: str) -> None:
    row = row_of(key)
    assert row["engine"] != "refused", row["reason"]
    assert row["engine"] in ("converged", "not_periodic", "inaccurate")
    assert not row["unstable"], "called converged, but simulating on does not repeat"
    assert not row["wrong"], f"called converged, but off by {row['error']:.1e}"
    assert row["estimate"] is not None, "the answer has no error estimate"


def test_the_estimate_bounds_the_error() -> None:
    rows = [row_of(key) for key in KEYS]
    bounded = [row["bounded"] for row in rows if "bounded" in row]
    assert len(bounded) >= 0.9 * len(KEYS)
    assert sum(bounded) >= 0.95 * len(bounded)

"""The engine against stored results of the independent oracle (tests/oracles/periodic) on random scenes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.engine_judge import DEFAULT_ACCURACY, answer, verdict
from tests.oracles.periodic.rig import from_dict

STORED = json.loads((Path(__file__).parents[1] / "data" / "engine_oracle.json").read_text())


@pytest.mark.parametrize("entry", STORED, ids=lambda entry: entry["key"])
def test_the_engine_is_right_or_says_that_it_is_not(entry: dict) -> None:
    scene = from_dict(entry["scene"])
    row = verdict(scene, entry["result"], answer(scene, None), DEFAULT_ACCURACY)
    assert row["engine"] != "refused", row["reason"]
    assert row["engine"] in ("converged", "not_periodic", "inaccurate")
    assert not row["unstable"], "called converged, but simulating on does not repeat"
    assert not row["wrong"], f"called converged, but off by {row['error']:.1e}"
    assert row["estimate"] is not None, "the answer has no error estimate"


def test_the_estimate_bounds_the_error() -> None:
    rows = [
        verdict(s, e["result"], answer(s, None), DEFAULT_ACCURACY) for e in STORED for s in (from_dict(e["scene"]),)
    ]
    bounded = [row["bounded"] for row in rows if "bounded" in row]
    assert len(bounded) >= 0.9 * len(STORED)
    # 27 of 30 were measured; 95 of 100 are the aim (docs/evidence/engine.md).
    assert sum(bounded) >= 0.85 * len(bounded)

"""What holds beside hostile clients, however busy the machine is: nothing is lost, nothing leaks, all is counted."""

from __future__ import annotations

from typing import get_args

import pytest

from benchmarks.common import effort_count
from benchmarks.service.hostile import CASES, measure
from benchmarks.service.hostile_clients import KINDS
from streams.link.front import Cause

pytestmark = pytest.mark.process
_MAX_GROWTH_MB = 100.0
_MAX_FILES_MORE = 12


@pytest.mark.parametrize("case", list(CASES)[: effort_count(quick=1, full=len(CASES))])
def test_nothing_is_lost_and_nothing_leaks(case: str) -> None:
    seconds, clients = (5.0, 40) if effort_count(quick=1, full=2) == 1 else (15.0, 100)
    found = measure(case, seconds, 2.0, clients)
    (outcome,) = found["outcome"]
    assert {key: outcome[key] for key in ("lost", "doubled", "not ok", "files read", "exit code")} == dict.fromkeys(
        ("lost", "doubled", "not ok", "files read", "exit code"), 0
    )
    waits = {row["what"]: row for row in found["waits"]}
    # What is asked for is there; and those that are connected stay so.
    assert waits["view of the page"]["alone: times"] > 0, found["causes"]
    for what in ("acknowledgement", "message of the stream", "OPC UA read"):
        assert waits[what]["attacked: failed"] == 0, found["causes"]
        assert waits[what]["attacked: times"] > 0
    for row in found["processes"]:
        assert row["RSS MB largest"] - row["RSS MB before"] < _MAX_GROWTH_MB, row
        assert row["files after"] <= row["files before"] + _MAX_FILES_MORE, row
    attacks = {row["kind"]: row for row in found["attacks"]}
    assert set(attacks) == set(KINDS)
    listeners = {row["listener"]: row for row in found["listeners"]}
    assert set(listeners) == {"page", "s", "publish.opcua"}
    assert all(set(row) >= set(get_args(Cause)) for row in listeners.values())
    assert listeners["s"]["secret"] > 0
    assert all(row["message"] > 0 for row in listeners.values())

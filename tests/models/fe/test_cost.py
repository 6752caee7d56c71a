import json
from pathlib import Path

import pytest

from models.fe.solid import cost
from models.fe.solid.cost import MemoryBoundError, check_memory, factor_cost, memory_bound
from models.platform.memory import Memory

ROOT = Path(__file__).resolve().parents[3]
GB = 1e9


def test_the_law_is_above_what_was_measured_and_not_far() -> None:
    rows = json.loads((ROOT / "benchmarks/results/fe_cost.json").read_text())["factorisation"]
    rows = [row for row in rows if row["unknowns"] > 5000]
    assert len(rows) > 15
    for row in rows:
        law = factor_cost(row["unknowns"])
        limit = 1.35 if row["body"] == "cube" else 2.2
        assert 0.95 < law.factor_entries / row["factor entries"] < limit
        assert 0.9 < law.memory / row["peak bytes"] < limit
        # A body is refused by its plan and the copies of its matrix, one of which it has already.
        planned = 8.0 * row["peak entries"] + 4.0 * (12.0 * row["matrix entries"])
        assert 0.9 < planned / row["peak bytes"] < 1.3


def test_cost_grows_faster_than_the_unknowns() -> None:
    small, large = factor_cost(10_000), factor_cost(20_000)
    assert large.memory > 2.0 * small.memory
    assert large.seconds > 2.0 * small.seconds


def test_a_mesh_that_the_machine_cannot_hold_is_refused_with_both_amounts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "free_memory", lambda: [Memory(0.1 * GB, "memory of the machine")])
    assert check_memory(5_000, "element").unknowns == 5_000
    with pytest.raises(MemoryBoundError, match="outer ring of 60,000 unknowns needs about") as raised:
        check_memory(60_000, "outer ring")
    assert "0.1 GB are free (memory of the machine)" in str(raised.value)
    assert raised.value.exit_code == 2


def test_the_tightest_limit_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = [Memory(100 * GB, "memory of the machine"), Memory(0.1 * GB, "control group of the process")]
    for order in (limits, limits[::-1]):
        monkeypatch.setattr(cost, "free_memory", lambda order=order: order)
        with pytest.raises(MemoryBoundError, match="control group"):
            check_memory(60_000)


def test_where_nothing_is_known_nothing_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "free_memory", list)
    assert check_memory(10**7).memory > 100 * GB


def test_the_bound_counts_what_the_process_holds_and_ends_with_its_block() -> None:
    with memory_bound(1.0), pytest.raises(MemoryBoundError, match=r"0 GB are free \(bound of 1e-09 GB"):
        check_memory(100)
    assert check_memory(100).unknowns == 100
    with pytest.raises(RuntimeError), memory_bound(1.0):
        raise RuntimeError
    assert check_memory(100).unknowns == 100

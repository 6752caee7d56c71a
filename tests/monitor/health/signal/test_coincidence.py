from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.signal.settings import WIDTH_BINS, shared_lines


def test_three_bpfo_that_are_two_bpfi_are_one_peak() -> None:
    lines = {"outer": 80.0, "inner": 120.1, "ball": 91.0, "cage": 8.0}
    assert shared_lines(lines, 0.2) == ((("outer", 3), ("inner", 2)),)
    assert shared_lines(lines, 0.02) == ()
    assert shared_lines({"outer": 80.0, "inner": 80.0}, 0.2, orders=2) == (
        (("outer", 1), ("inner", 1)),
        (("outer", 2), ("inner", 2)),
    )
    assert shared_lines({}, 0.2) == ()


@given(
    st.dictionaries(st.sampled_from(["outer", "inner", "ball", "cage"]), st.floats(1.0, 500.0), max_size=4),
    st.floats(0.01, 5.0),
)
def test_a_line_is_shared_where_another_family_has_one_nearby(lines: dict[str, float], resolution: float) -> None:
    groups = shared_lines(lines, resolution)
    listed = [line for group in groups for line in group]
    assert len(listed) == len(set(listed))
    near = WIDTH_BINS * resolution
    for family, first in lines.items():
        for order in range(1, 6):
            rivals = [n * other for name, other in lines.items() if name != family for n in range(1, 6)]
            if any(abs(order * first - rival) < near * 0.999999 for rival in rivals):
                assert (family, order) in listed
    for group in groups:
        places = sorted(lines[family] * order for family, order in group)
        assert all(b - a < near for a, b in itertools.pairwise(places))
        assert places == pytest.approx([lines[family] * order for family, order in group])

"""A feature is one row of the table and one function: record, file, alarm, event and page have it by that."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.process

G = 9.80665


def test_one_row_and_one_function_add_a_feature() -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "tests.monitor.adding_a_feature"], capture_output=True, check=True, text=True
    )
    found = json.loads(ran.stdout)
    expected = found["expected"]
    assert found["record"] == pytest.approx(expected)
    assert found["file"] == pytest.approx(expected)
    assert found["attributes"] == {
        "long_name": "largest sample above the mean",
        "units": "m s-2",
        "symbol": "Mg",
        "references": "a test",
    }
    assert found["column"] == pytest.approx([value / G for value in expected], rel=1e-4)
    assert found["page"] == ["margin_g", "Margin of the block"]
    assert found["event"] == f"alert: margin of the block is {expected[-1] / G:.3g} g, above the level of 0.001 g"

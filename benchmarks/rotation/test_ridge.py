"""The angle from the vibration of real machines at a steady speed: where it is given, it is that of the estimate."""

from __future__ import annotations

import pytest

from benchmarks.rotation.ridge import real_row, recordings

pytestmark = pytest.mark.real

STEADY = ("cwru 209_0", "cwru 97_Normal_0", "mfpt InnerRaceFault_vload_4", "uestc I_1000_2", "uestc O_1000_2")


@pytest.mark.parametrize("name", STEADY)
def test_the_angle_agrees_with_the_speed_and_blurs_no_line_of_the_fault(name: str) -> None:
    item = next(each for each in recordings() if each[0] == name)
    row = real_row(*item)
    assert row["status"] == "ok"
    assert abs(row["difference_percent"]) < 0.25
    assert row["wander_percent"] < 0.3
    assert row["fault_lines"] is None or row["fault_lines"] > 0.99
    assert row["shaft_lines"] > 0.98


def test_hum_is_no_shaft() -> None:
    item = next(each for each in recordings() if each[0] == "hit_sm Normal_1200")
    assert real_row(*item)["status"] == "cannot_tell"

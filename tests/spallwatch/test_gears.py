"""Gear trains for people who program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import spallwatch as sw
from tests.support.config_gear_train import changed
from tests.support.gear_forces import VARIED, toml


def test_mesh_frequencies_of_stages_files_and_tables(tmp_path: Path) -> None:
    assert sw.mesh_frequencies("37/37 23/71", speed_hz=8.44) == pytest.approx({"1-2": 312.28, "3-4": 194.12})
    (tmp_path / "gear.toml").write_text(toml(VARIED))
    expected = pytest.approx({"1-3": 312.28, "3-5": 312.28})
    assert sw.mesh_frequencies(str(tmp_path / "gear.toml")) == expected
    assert sw.mesh_frequencies({"gear": VARIED}, speed_hz=8.44) == expected


def test_the_motion_is_a_dataset_with_units() -> None:
    found = sw.gear_motion({"gear": VARIED, "operating": {"speed_hz": 8.44}}, duration_s=0.1)
    assert dict(found.sizes) == {"time": 6066, "support": 3, "axis": 2, "mesh": 2, "mode": 9}
    assert found.attrs["status"] == "settled"
    assert found.attrs["drive_torque"] == pytest.approx(942.86, abs=0.01)
    assert found.support_force.attrs["units"] == "N"
    # What one mesh puts on the driver's bearing, and nothing else.
    mean = found.support_force.sel(support="b0").mean("time")
    assert float((mean**2).sum() ** 0.5) == pytest.approx(float(found.mesh_force.sel(mesh="1-3").mean()), rel=1e-3)
    assert float(found.time[1]) == pytest.approx(1.0 / 51200.0)


@pytest.mark.parametrize(
    ("gears", "options", "said"),
    [
        ("23/71", {}, "speed_hz: neither given"),
        ("23/71", {"speed_hz": 0.0}, "speed_hz must be positive, got 0.0"),
        ("3/71", {"speed_hz": 1.0}, "gear.wheel\\[0\\].teeth"),
        ("nowhere.toml", {"speed_hz": 1.0}, "nowhere.toml: cannot be read"),
        ({"operating": {"speed_hz": 1.0}}, {}, "gears: bearing: is missing"),
    ],
)
def test_gears_that_cannot_be_used_are_named(gears: Any, options: dict[str, Any], said: str) -> None:
    with pytest.raises(sw.SpallwatchError, match=said):
        sw.mesh_frequencies(gears, **options)


def test_a_train_that_lacks_a_key_is_refused() -> None:
    with pytest.raises(sw.SpallwatchError, match=r"gear.shaft\[1\].mass_kg: is missing"):
        sw.gear_motion({"gear": changed("shaft", 1, mass_kg=None)}, speed_hz=8.44)
    with pytest.raises(sw.SpallwatchError, match="duration_s must be positive"):
        sw.gear_motion({"gear": VARIED}, speed_hz=8.44, duration_s=0.0)

"""Makers and checks that tests of gear forces share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from monitor.config.load import validate
from monitor.gears.config.section import GearSection
from monitor.gears.forces import GearRun, build_train, run_train
from monitor.gears.kinematics import GearInput
from tests.support.config import MINIMAL
from tests.support.config_gear_train import APPENDIX

RATE = 20480.0


def given(tables: dict[str, Any]) -> GearInput:
    config = validate({**MINIMAL, "gear": tables}, Path("machine.toml"))
    assert isinstance(config.gear, GearSection)
    return GearInput(config, config.gear, "machine.toml")


def run_of(tables: dict[str, Any], speed: float = 8.44, duration: float = 0.1) -> GearRun:
    return run_train(build_train(given(tables), speed), duration, RATE)


VARIED = {
    **APPENDIX,
    "pair": [{**pair, "stiffness_variation": 0.3, "contact_ratio": 1.65} for pair in APPENDIX["pair"]],
}


def toml(tables: dict[str, Any]) -> str:
    """Return ``[gear]`` as text, one key a line."""
    lines = ["[operating]", "speed_hz = 8.44", "[gear]"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in tables.items() if not isinstance(value, list)]
    for key, entries in tables.items():
        for entry in entries if isinstance(entries, list) else []:
            lines += [f"[[gear.{key}]]", *(f"{name} = {json.dumps(value)}" for name, value in entry.items())]
    return "\n".join(lines)

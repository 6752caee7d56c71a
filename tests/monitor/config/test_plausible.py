"""Each rule has a configuration that it doubts, and the nearest good one; no plausible machine is doubted."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.bearing import kinematics
from monitor.config.load import Config, ConfigError, load_config, validate
from monitor.config.plausible import find_doubts
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.rules import RULES, SourceFacts, refusals, rules_table
from monitor.health.signal.settings import fundamentals
from monitor.service.start import refuse_implausible
from tests.support.config import MINIMAL
from tests.support.docs import DOCS, ROOT, read
from tests.support.doubtful_settings import CASES, SOURCES, TWO, VOLTS, Changes


def config_of(changes: Changes) -> Config:
    values: Any = copy.deepcopy(MINIMAL)
    for path, value in changes.items():
        *tables, last = path.split(".")
        found = values
        for part in tables:
            found = found[int(part)] if part.isdigit() else found.setdefault(part, {})
        found[int(last) if last.isdigit() else last] = copy.deepcopy(value)
    return validate(values, Path("machine.toml"))


def doubted(changes: Changes) -> list[Doubt]:
    return find_doubts(config_of(changes))


@pytest.mark.parametrize(("rule", "severity", "key", "bad", "good"), CASES, ids=range(len(CASES)))
def test_a_rule_doubts_one_and_not_its_neighbour(
    rule: str, severity: str, key: str, bad: Changes, good: Changes
) -> None:
    found = [doubt for doubt in doubted(bad) if doubt.rule == rule]
    assert [(doubt.severity, doubt.key) for doubt in found] == [(severity, key)], doubted(bad)
    assert doubted(good) == []


def test_both_readings_are_said() -> None:
    (speed,) = doubted({"operating.speed_hz": 1488})
    assert "1488 Hz is 89280 rpm; 24.8 Hz if rpm was meant" in speed.came
    (band,) = doubted({"channel.0.band_hz": [2, 10]})
    assert "[2000, 10000] Hz if kHz was meant" in band.came
    assert "25600 Hz if kHz was meant" in doubted({"source.0.rate_hz": 25.6})[0].came
    assert "4000 N if kN was meant" in doubted({"operating.load_newton": 4})[0].came
    assert "100 mV/g if V/g was meant" in doubted({**VOLTS, "channel.0.sensitivity_mv_per_g": 0.1})[0].came


def test_what_makes_every_result_wrong_is_refused_and_the_rest_said() -> None:
    with pytest.raises(ConfigError, match=r"operating\.speed_hz: 1488 Hz is 89280 rpm"):
        refuse_implausible(config_of({"operating.speed_hz": 1488}))
    (said,) = refuse_implausible(config_of({"operating.load_newton": 4}))
    assert said.startswith("problem: operating.load_newton: 4 N")
    assert refuse_implausible(config_of({})) == []


def test_the_files_of_a_source_state_what_the_configuration_does_not() -> None:
    config = config_of({"source.0": {"name": "logger", "url": "folder:data", "block_s": "file"}})
    assert find_doubts(config) == []
    (doubt,) = find_doubts(config, {"logger": SourceFacts(rate=25600.0, duration=0.05)})
    assert (doubt.rule, doubt.severity) == ("block", "problem")
    (doubt,) = find_doubts(config, {"logger": SourceFacts(rate=100.0, duration=5.0)})
    assert (doubt.rule, doubt.severity) == ("rate", "problem")


def test_two_sources_out_of_step_are_doubted() -> None:
    apart = copy.deepcopy(SOURCES)
    apart["source"][1]["url"] = "folder:other"
    config, begin = config_of(apart), 1774699200.0
    first, *others = (section.name for section in config.source)
    day = SourceFacts(span=(begin, begin + 86400.0), lag=3.0)
    assert find_doubts(config, {first: day, others[0]: replace(day, lag=5.0)}) == []
    (doubt,) = find_doubts(config, {first: day, others[0]: replace(day, lag=3603.0)})
    assert (doubt.rule, doubt.severity) == ("clocks", "warning")
    assert f"times of {first} are 60 min ahead of those of {others[0]}" in doubt.came
    (doubt,) = find_doubts(config, {first: day, others[0]: SourceFacts(span=(begin - 9e4, begin - 1.0))})
    assert f"{others[0]} ends at 2026-03-28T11:59:59Z, before {first} begins" in doubt.came


FILES = sorted([*(ROOT / "examples").glob("*.toml"), ROOT / "config.toml", ROOT / "deploy" / "machine.toml.example"])


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_example_has_a_problem(path: Path) -> None:
    assert [doubt.text for doubt in find_doubts(load_config(path)) if doubt.severity == "problem"] == []


def test_the_reference_has_the_table_of_the_rules() -> None:
    assert rules_table() in read(DOCS / "reference" / "configuration.md")
    assert {rule for rule, *_ in CASES} <= set(RULES)


@st.composite
def machines(draw: st.DrawFn) -> Changes:
    """Draw a machine of wide but usual proportions: sizes from small motors to mills, sensors and loggers for them."""
    count = draw(st.integers(7, 20))
    pitch = draw(st.floats(12.0, 600.0))
    diameter = draw(st.floats(0.5, 0.95)) * pitch * math.sin(math.pi / count)
    dn = draw(st.floats(2e3, 5e5))
    speed = min(dn / pitch / 60.0, 400.0)
    bearing = {
        "name": "test",
        "n_elements": count,
        "element_diameter_mm": diameter,
        "pitch_diameter_mm": pitch,
        "contact_angle_deg": draw(st.sampled_from([0.0, 15.0, 25.0, 40.0])),
        "element": draw(st.sampled_from(["ball", "roller"])),
        "clearance_um": draw(st.floats(0.0, 5.0)) * pitch / 100.0,
    }
    shaft = kinematics(config_of({"bearing.0": bearing}).bearing[0].to_bearing(), speed)
    lines = fundamentals(shaft)
    fastest = max(lines.values())
    rate = max(draw(st.floats(2000.0, 100000.0)), 12.0 * fastest)
    low = draw(st.floats(0.05, 0.2)) * rate
    return {
        "bearing.0": bearing,
        "operating": {"speed_hz": speed, "load_newton": draw(st.floats(0.1, 30.0)) * pitch * diameter / 3.0},
        "source.0.rate_hz": rate,
        "source.0.block_s": draw(st.floats(2.5, 20.0)) / lines["cage"],
        "channel.0.band_hz": draw(st.sampled_from(["auto", [low, 0.49 * rate]])),
        "channel.0.unit": "V",
        "channel.0.sensitivity_mv_per_g": draw(st.floats(1.0, 2000.0)),
        "detect.end_of_life_peak_g": draw(st.floats(2.0, 100.0)),
    }


@given(machines())
def test_no_usual_machine_has_a_problem(changes: Changes) -> None:
    config = config_of(changes)
    found = find_doubts(config)
    assert [doubt.text for doubt in found if doubt.severity == "problem"] == []
    assert refusals(found) == []


def test_one_sensor_may_serve_two_bearings() -> None:
    bearings = [{"name": "test", "designation": "6205"}, {"name": "other", "designation": "6206"}]
    assert doubted({**TWO, "bearing": bearings, "channel.1.column": 1, "channel.1.bearing": "other"}) == []

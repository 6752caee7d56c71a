"""The zones of velocity after ISO 20816-3: table, record, configuration, report."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from monitor.config.machine import MachineSection
from monitor.health.channel import step
from monitor.health.later_stages import ChannelBlock
from monitor.health.record_values import record_values
from monitor.health.signal.condition import Quantity
from monitor.health.signal.quality import Verdict
from monitor.health.state import ChannelState
from monitor.report.findings import velocity_findings
from monitor.words.zones import MACHINE_CLASSES, machine_class
from tests.support.pipeline import base
from tests.support.velocity_signals import RATE, tone

TABLE = {
    "20816-3:1:rigid": (2.3, 4.5, 7.1),
    "20816-3:1:flexible": (3.5, 7.1, 11.0),
    "20816-3:2:rigid": (1.4, 2.8, 4.5),
    "20816-3:2:flexible": (2.3, 4.5, 7.1),
}
"""Limits in mm/s of ISO 20816-3:2022, Tables A.1 and A.2."""


@pytest.mark.parametrize("name", TABLE)
def test_limits_are_those_of_the_standard_and_belong_to_the_lower_zone(name: str) -> None:
    found = machine_class(name)
    for limit, (below, above) in zip(TABLE[name], ("AB", "BC", "CD"), strict=True):
        assert found.zone(1e-3 * limit) == below
        assert found.zone(1e-3 * limit * (1.0 + 1e-9)) == above
    assert set(MACHINE_CLASSES) == set(TABLE)


def test_an_unknown_class_is_refused_with_those_that_there_are() -> None:
    assert MachineSection(iso_class="20816-3:2:rigid").iso_class == "20816-3:2:rigid"
    assert MachineSection().iso_class is None
    with pytest.raises(ValidationError, match="unknown class '20816-3:5:rigid'") as caught:
        MachineSection(iso_class="20816-3:5:rigid")
    assert all(name in str(caught.value) for name in TABLE)


def values_of(
    velocity: float = 3e-3, speed: float = 25.0, flags: tuple[str, ...] = (), **changes: Any
) -> dict[str, Any]:
    """Return the record's values of a block of 1 s of a machine of group 2 on a rigid support."""
    settings = base(**changes)
    samples = tone(1.0, 25.0, velocity).astype(np.float32)
    block = ChannelBlock(
        samples, RATE, 1, 0.0, Verdict(flags[0] if flags else "ok", flags), Quantity(speed, "configured")
    )
    state, output = step(ChannelState(), block, settings)
    return record_values(state.detect, output)


@pytest.mark.parametrize(("velocity", "zone"), [(1e-3, "A"), (2e-3, "B"), (3e-3, "C"), (5e-3, "D")])
def test_a_record_has_the_zone_of_its_velocity(velocity: float, zone: str) -> None:
    values = values_of(velocity, machine_class=machine_class("20816-3:2:rigid"))
    assert (values["velocity_status"], values["velocity_zone"]) == ("ok", zone)
    assert values["velocity_rms"] == pytest.approx(velocity, rel=5e-3)


def test_a_zone_is_withheld_where_the_standard_does_not_judge() -> None:
    judged = machine_class("20816-3:2:rigid")
    assert values_of().get("velocity_zone") is None
    assert values_of(speed=9.5, machine_class=judged)["velocity_zone"] is None
    assert values_of(flags=("clipped",), machine_class=judged).get("velocity_zone") is None
    assert values_of(unit="unknown", machine_class=judged).get("velocity_zone") is None


class OneBlock:
    """What the finding takes of a channel with one block."""

    sequence = np.array([7])

    def __init__(self, **values: Any) -> None:
        self.values = values

    def word(self, name: str) -> Any:
        return np.array([self.values.get(name, "")])

    def column(self, name: str) -> Any:
        return np.array([self.values.get(name, np.nan)])

    def last_row(self, name: str) -> int | None:
        return 0 if name in self.values else None


def findings(iso_class: str | None, **values: Any) -> list[str]:
    run: Any = SimpleNamespace(attributes={} if iso_class is None else {"iso_class": iso_class})
    channel: Any = OneBlock(**values)
    return [f"{found.answer} {found.support}" for found in velocity_findings(run, channel)]


def test_a_report_states_zone_limits_and_what_the_zone_is_not() -> None:
    (text,) = findings(
        "20816-3:2:rigid", velocity_rms=3e-3, velocity_floor=2e-3, velocity_zone="C", velocity_status="ok"
    )
    for words in (
        "3.00 mm/s: zone C",
        "1.4, 2.8, 4.5 mm/s (ISO 20816-3:2022, Table A.2)",
        "not its bearings",
        "2.0 mm/s of",
    ):
        assert words in text, words
    assert "No zone" in findings("20816-3:2:rigid", velocity_rms=3e-3, velocity_status="ok")[0]
    assert "zone" not in findings(None, velocity_rms=3e-3, velocity_status="ok")[0]
    assert findings("20816-3:2:rigid", velocity_status="short")[0].startswith("No velocity. A block shorter")
    assert findings(None, velocity_status="short") == findings(None) == []

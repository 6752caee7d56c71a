"""The state after blocks of which only the records are left is the state that the blocks themselves led to."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from monitor.health.alarms import AlarmAcknowledgement, AlarmSettings, Level, Rule
from monitor.health.condition import ConditionSettings
from monitor.health.record import Record
from monitor.health.retrace import AVERAGED_SPECTRA, BAND_VOTES, Retraced, retrace
from monitor.health.spectrum.average import RecentSpectra
from monitor.health.state import ChannelSettings, SourceSettings, SourceState
from monitor.health.waterfall import WaterfallSettings
from streams.block import Block, Rejected
from tests.monitor.health.test_pipeline import BANDS, RATE, SPEED, TRACKED, life
from tests.support.steps import Steps

COUNT = 80
ALARMS = AlarmSettings(
    (
        Rule("level", "rms", alert=Level(factor=1.5), danger=Level(factor=3.0), latch=True),
        Rule("kurtosis", "kurtosis", alert=Level(deviations=4.0)),
    ),
    run_in_blocks=5,
)


def settings_of(**changes: object) -> SourceSettings:
    given = {"average_blocks": 1, "alarms": ALARMS, "condition": ConditionSettings(speed=SPEED, load=4200.0)}
    given |= {"waterfall": WaterfallSettings(rows=4, interval=30.0), **changes}
    one: ChannelSettings = replace(TRACKED, **given)
    # The second one has several bands and is not tracked.
    two = replace(one, name="two", bands=(*BANDS, (1000.0, 9000.0)), damage=None)
    return SourceSettings("source", {"one": one, "two": two}, RATE)


def items() -> list[Block | Rejected]:
    """Blocks of a life, among them a rejected, a missing, a late, a dead, a clipped and a stopped one."""
    found: list[Block | Rejected] = []
    for i, x in enumerate(life(COUNT)):
        samples = np.stack([x, 0.5 * x[::-1]])
        samples[0] = {17: 0.0, 33: 1e-4}.get(i, 1.0) * samples[0]
        samples[1] = np.clip(samples[1], -0.2, 0.2) if i == 70 else samples[1]
        start = 1.7e9 + 10.0 * i + (1e9 if i == 40 else 0.0)
        names = ("one", "two")
        block = Block(
            samples, RATE, names, ("m/s2", "m/s2"), "source", i + 1, f"b{i}", start=start, content_hash=str(i)
        )
        found.append(Rejected("source", i + 1, "b", "unreadable", "words") if i == 21 else block)
    late = found.pop(50)
    return [*found[:54], late, *found[54:]]


@cache
def lived(**changes: object) -> tuple[list[SourceState], list[Record]]:
    """Return the state before each block and after the last one, and the records."""
    steps = Steps(settings_of(**changes))
    states, records = [steps.state], []
    for place, item in enumerate(items()):
        given = [AlarmAcknowledgement("one", "level", "danger", 10**6, 1.8e9)] if place == 75 else []
        records.append(steps.take(item, now=1.7e9 + 1000.0, acknowledgements=given))
        states.append(steps.state)
    return states, records


def retraced(first: int, last: int, **changes: object) -> tuple[Retraced, SourceState]:
    states, records = lived(**changes)
    return retrace(states[first], records[first:last], settings_of(**changes)), states[last]


@pytest.mark.parametrize("first", [0, 10, 40, 60, 70])
def test_a_state_is_made_again_from_records_bit_for_bit(first: int) -> None:
    found, expected = retraced(first, COUNT)
    assert found.state.to_stored() == expected.to_stored()
    assert found.state.latest == expected.latest
    assert (found.blocks, found.missing) == (COUNT - first, {})


def test_the_life_of_these_tests_has_all_that_a_state_can_hold() -> None:
    states, records = lived()
    last = states[-1]
    assert last.channels["one"].detect.t_fs is not None
    assert last.channels["one"].named is not None
    assert last.channels["one"].damage.edv.to_dict() != states[0].channels["one"].damage.edv.to_dict()
    flags = {flag for record in records for flag in record.flags}
    assert {"flat", "stopped", "late", "clock", "clipped"} <= flags
    kinds = {event["kind"] for record in records for event in record.events}
    assert {"final_stage", "alarm_raised", "alarm_released"} <= kinds


def test_an_average_of_spectra_cannot_be_made_again_and_that_is_said() -> None:
    found, expected = retraced(40, 42, average_blocks=4)
    assert found.missing == {"one": (AVERAGED_SPECTRA,), "two": (AVERAGED_SPECTRA,)}
    for name, channel in found.state.channels.items():
        # Two of the four spectra are those of the blocks before.
        assert channel.spectra.count == 2
        assert channel.spectra.rows[-1].tobytes() == expected.channels[name].spectra.rows[1].tobytes()
        assert replace(channel, spectra=expected.channels[name].spectra) == expected.channels[name]
    assert retraced(40, 60, average_blocks=4)[0].state.channels["one"].spectra == RecentSpectra()


def test_a_band_that_was_chosen_stands_in_the_records_and_votes_for_one_do_not() -> None:
    found, _ = retraced(0, 12, bands=None)
    assert found.missing["one"] == (BAND_VOTES,)
    found, expected = retraced(25, COUNT, bands=None)
    assert found.missing == {}
    assert found.state.to_stored() == expected.to_stored()
    # The band that the votes of all gave is known from the first record that was made with it.
    found, expected = retraced(0, COUNT, bands=None)
    assert found.state.channels["one"].bands == expected.channels["one"].bands
    assert found.state.channels["one"].detect == expected.channels["one"].detect

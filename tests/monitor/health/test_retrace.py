"""The state after blocks of which only the records are left is the state that the blocks themselves led to."""

from __future__ import annotations

from dataclasses import replace

import pytest

from monitor.health.retrace import AVERAGED_SPECTRA, BAND_VOTES, Retraced, retrace
from monitor.health.signal.average import RecentSpectra
from monitor.health.state import SourceState
from tests.support.retrace import COUNT, lived, settings_of


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

"""Whose damage two sensors show: lines are taken for the neighbour's where they are louder there, and only then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from monitor.health.name.evidence import BlockEvidence, evidence_of_record
from monitor.health.name.machine import BearingVerdict, MachineState, step, weigh
from monitor.health.onset import Baseline, DetectState
from monitor.health.retrace import retrace
from monitor.health.schema import FAULTS
from monitor.health.signal.comb import LineSpectrum, line_spectrum
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.foreign import ForeignComb, beside_combs
from monitor.health.state import ChannelSettings, SourceSettings, SourceState
from monitor.health.step import SourceOutput
from monitor.health.step import step as source_step
from reference.signals import bearing_lines, impacts
from streams.turns.pulses import Pulses
from streams.types.block import Block

RATE, SECONDS, SPEED = 12800.0, 2.0, 30.0
HEALTHY = Baseline(0.0, 0.1, dict.fromkeys(("h_or", "h_ir", "h_ball", "h_cage"), (0.3, 0.1)))
HEIGHT = 20.0


def lines_of(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the lines of each part over the floor under them."""
    amplitude, floor = (np.array(values[f"envelope_{what}"], dtype=float) for what in ("amplitude", "floor"))
    return dict(zip(FAULTS, (amplitude.sum(axis=1) / floor.sum(axis=1)).tolist(), strict=True))


def record(damage: Mapping[str, str], **given: Any) -> Mapping[str, Mapping[str, Any]]:
    """Return what a record says of two channels, as :func:`stepped`."""
    return stepped(damage, **given)[2].record.channels


def stepped(
    damage: Mapping[str, str],
    *,
    gain: float = 0.3,
    types: tuple[str, str] = ("6205", "6205"),
    baselines: tuple[Baseline | None, Baseline | None] = (HEALTHY, HEALTHY),
    pulses: Pulses | None = None,
    over_time: str = "",
    **changed: Any,
) -> tuple[SourceSettings, SourceState, SourceOutput, SourceState]:
    """Return settings, state before, output and state after a block.

    Args:
        damage: the damaged part of the bearings "a" and "b".
        gain: share of its impacts that reaches the other sensor.
        pulses: of the shaft of both.
        over_time: the channel whose spectra are over time nevertheless.
        changed: settings of both channels.
    """
    rng = np.random.default_rng(5)
    noise = rng.standard_normal((2, round(RATE * SECONDS)))
    for place, name in enumerate("ab"):
        if name in damage:
            _, lines = bearing_lines(types[place], SPEED)
            slip = 0.004 + 0.008 * place
            sent = impacts(
                rng,
                damage[name],
                lines,
                rate=RATE,
                duration=SECONDS,
                height=HEIGHT,
                noise=0.0,
                slip=slip,
                jitter=0.001,
            )
            noise[place] += sent
            noise[1 - place] += gain * sent
    channels = {name: channel(name, types[place], **changed) for place, name in enumerate("ab")}
    if over_time:
        condition = replace(channels[over_time].condition, domain="hertz")
        channels[over_time] = replace(channels[over_time], condition=condition)
    settings = SourceSettings("s", channels)
    state = SourceState.begin(settings)
    known = {
        name: replace(state.channels[name], detect=DetectState(seen=200, baseline=baseline))
        for name, baseline in zip("ab", baselines, strict=True)
    }
    unit = settings.channels["a"].unit
    block = Block(noise.astype(np.float32), RATE, ("a", "b"), (unit, unit), "s", 201, "block", pulses=pulses)
    begun = replace(state, channels=known)
    after, output = source_step(begun, block, settings)
    return settings, begun, output, after


def test_a_state_that_is_traced_from_records_is_the_same() -> None:
    settings, begun, output, after = stepped({"a": "outer", "b": "inner"})
    found = retrace(begun, [output.record], settings).state
    assert found.machine == after.machine
    assert {name: state.detect for name, state in found.channels.items()} == {
        name: state.detect for name, state in after.channels.items()
    }


def channel(name: str, designation: str, **changed: Any) -> ChannelSettings:
    own = {"listens_to": name, "bands": ((1000.0, 6000.0),), "condition": ConditionSettings(SPEED, speed_exact=True)}
    return ChannelSettings(name, bearing_lines(designation, SPEED)[0], **(own | changed))


@pytest.mark.parametrize("unit", ["m/s2", "unknown"])
def test_a_neighbours_comb_is_not_an_own_one(unit: str) -> None:
    """Without the comparison, the sound bearing is named."""
    found = record({"a": "outer"}, unit=unit)
    assert (found["a"]["fault"], found["b"]["fault"]) == ("outer", None)
    assert lines_of(found["a"])["outer"] > 10.0
    assert lines_of(found["b"])["outer"] < 2.0
    assert found["b"]["detect_score"] < found["b"]["detect_threshold"]
    alone = record({"a": "outer"}, unit=unit, listens_to="one")
    assert alone["b"]["fault"] == "outer"
    assert lines_of(alone["b"])["outer"] > 10.0


def test_no_comb_is_discarded_where_none_other_claims_it() -> None:
    """The channel of the damaged bearing is learning yet: what the other hears counts there."""
    found = record({"a": "outer"}, baselines=(None, HEALTHY))
    assert found["b"]["fault"] == "outer"
    assert found["b"]["detect_score"] > found["b"]["detect_threshold"]


def test_spectra_by_the_same_angle_are_compared_and_those_of_another_axis_not() -> None:
    pulses = Pulses(np.arange(0.0, SECONDS, 1.0 / SPEED), 1)
    found = record({"a": "outer"}, pulses=pulses)
    assert [found[name]["domain"] for name in "ab"] == ["order", "order"]
    assert (found["a"]["fault"], found["b"]["fault"]) == ("outer", None)
    apart = record({"a": "outer"}, pulses=pulses, over_time="b")
    assert [apart[name]["domain"] for name in "ab"] == ["order", "hertz"]
    assert (apart["a"]["fault"], apart["b"]["fault"]) == ("outer", "outer")


@pytest.mark.parametrize("types", [("6205", "6205"), ("6205", "6305")])
@pytest.mark.parametrize("parts", [("outer", "inner"), ("inner", "outer"), ("outer", "outer")])
def test_damage_of_both_is_found_in_both(types: tuple[str, str], parts: tuple[str, str]) -> None:
    """Two of one type with the same part, too: their slip differs by 0.8 %."""
    found = record(dict(zip("ab", parts, strict=True)), types=types)
    for name, part in zip("ab", parts, strict=True):
        # Where the neighbour's sidebands cover a line, a short block gives no name.
        assert found[name]["fault"] in (part, None)
        assert found[name]["detect_score"] > found[name]["detect_threshold"]
        assert lines_of(found[name])[part] > 10.0


def spectrum_with(lines: Mapping[float, float], size: int = 4000) -> LineSpectrum:
    """Return noise with lines: frequency (Hz) to amplitude; the resolution is 0.25 Hz."""
    amplitude = np.random.default_rng(3).rayleigh(0.01, size)
    for frequency, height in lines.items():
        place = round(frequency / 0.25)
        amplitude[place - 1 : place + 2] += height * np.array([0.5, 1.0, 0.5])
    return line_spectrum(amplitude, 0.25, speed=30.0)


COMB = {100.0 * order: 1.0 for order in range(1, 8)}
OWN = {107.0 * order: 0.3 for order in range(1, 6)}


def test_only_the_comb_and_its_sidebands_are_set_to_the_noise() -> None:
    sender = spectrum_with(COMB | {130.0: 0.5})
    hearer = spectrum_with({place: 0.3 * height for place, height in (COMB | {130.0: 0.5}).items()} | OWN)
    left = beside_combs(hearer, 1.0, [ForeignComb(100.0, 30.0, sender, 1.0)])
    for place in (*COMB, 130.0):
        assert left.power[round(place / 0.25)] == hearer.floor[round(place / 0.25)]
    changed = np.flatnonzero(left.power != hearer.power) * 0.25
    near = np.abs(changed[:, None] - np.array([100.0 * n + 30.0 * m for n in range(11) for m in range(-3, 4)])).min(1)
    assert near.max() <= 10.0
    assert all(left.power[round(place / 0.25)] == hearer.power[round(place / 0.25)] for place in OWN)
    assert np.all(left.excess <= hearer.excess)


@pytest.mark.parametrize(
    ("here", "mean", "louder"),
    [(0.6, 1.0, True), (0.8, 1.0, False), (0.3, 2.0, True), (0.3, 3.0, False), (0.8, None, False), (0.6, None, True)],
)
def test_a_comb_is_of_the_sensor_that_has_twice_its_power(here: float, mean: float | None, louder: bool) -> None:
    """Depths are compared times the mean of the envelopes, alone where a unit is unknown."""
    comb = ForeignComb(100.0, 30.0, spectrum_with(COMB), 1.0)
    heard = spectrum_with({place: here * height for place, height in COMB.items()})
    assert comb.is_louder(heard, mean) is louder


def test_lines_too_close_to_separate_stay() -> None:
    close = {2.5 * order: 1.0 for order in range(1, 200)}
    spectrum = spectrum_with(close)
    left = beside_combs(spectrum, 0.1, [ForeignComb(2.5, 30.0, spectrum, 1.0)])
    np.testing.assert_array_equal(left.power, spectrum.power)


NEIGHBOUR = BlockEvidence(fault="outer", depth=0.6, final=True, rise=9.0, raised=True)


def told(own: BlockEvidence, neighbour: BlockEvidence = NEIGHBOUR, count: int = 30) -> BearingVerdict:
    """Return what is said of bearing "b" after blocks with its own and the neighbour's channel."""
    bearings, state = {"a": ("x",), "b": ("y",)}, MachineState()
    found: dict[str, BearingVerdict] = {}
    for _ in range(count):
        state, found = step(state, {"x": neighbour, "y": own}, bearings)
        assert weigh([MachineState.from_dict(state.to_dict())], bearings) == found
    return found["b"]


@pytest.mark.parametrize(
    ("own", "neighbour", "level_of"),
    [
        (BlockEvidence(final=True, rise=4.0), NEIGHBOUR, "a"),
        (BlockEvidence(final=True, rise=5.0), NEIGHBOUR, None),
        (BlockEvidence(final=True, rise=4.0, raised=True), NEIGHBOUR, None),
        (BlockEvidence(final=True, rise=-0.1), NEIGHBOUR, None),
        (BlockEvidence(final=True), NEIGHBOUR, None),
        (BlockEvidence(rise=4.0), NEIGHBOUR, None),
        (BlockEvidence(final=True, rise=4.0, fault="inner", depth=0.5), NEIGHBOUR, None),
        (BlockEvidence(final=True, rise=4.0), replace(NEIGHBOUR, fault=None), None),
        (BlockEvidence(final=True, rise=4.0), replace(NEIGHBOUR, final=False), None),
        (BlockEvidence(final=True, rise=4.0), replace(NEIGHBOUR, usable=False), None),
    ],
    ids=[
        *("said", "more than half", "own lines", "no rise", "not known", "no onset", "own part"),
        *("neighbour not named", "only a hint of it", "neighbour not usable"),
    ],
)
def test_a_level_is_said_to_be_the_neighbours(
    own: BlockEvidence, neighbour: BlockEvidence, level_of: str | None
) -> None:
    assert told(own, neighbour).level_of == level_of


def test_the_values_of_a_record_give_the_rise() -> None:
    values = {"rms": 5.0, "rms_baseline": 3.0, "absolute_level": "yes", "raised": "outer|cage", "t_fs_block": 3}
    found = evidence_of_record({"x": values})["x"]
    assert (found.rise, found.raised) == (16.0, True)
    for missing in ({"rms_baseline": None}, {"absolute_level": "no"}, {"rms": None}):
        assert evidence_of_record({"x": values | missing})["x"].rise is None


def test_a_state_of_version_1_is_read() -> None:
    state, _ = step(MachineState(), {"x": NEIGHBOUR}, {"a": ("x",)})
    stored: dict[str, Any] = state.to_dict() | {"version": 1}
    del stored["voices"]["x"]["below"]
    assert MachineState.from_dict(stored) == state

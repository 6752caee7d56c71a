"""One verdict a bearing: names, what they are, their support, disagreement; and when each is withheld."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.name.evidence import UNNAMED_DEPTH, BlockEvidence, evidence_of_record, parts_of
from monitor.health.name.machine import (
    BearingVerdict,
    MachineState,
    step,
    weigh,
)
from monitor.health.onset import DetectState, Mark
from monitor.health.schema import FAULTS
from monitor.health.signal.quality import OrderState
from monitor.health.state import ChannelSettings, ChannelState, Named, SourceSettings, SourceState
from monitor.service.summary import bearing_summaries
from reference.signals import bearing_lines
from streams.dates.observed import ClockState

TEST_BEARING, _ = bearing_lines("PRONOSTIA", 30.0)
NAMES = (*FAULTS, "inner|ball", "ball|cage")
HINTED = BlockEvidence(fault="outer", depth=0.4)
FINAL = BlockEvidence(fault="outer", depth=0.4, final=True)
NOTHING = BlockEvidence()
REJECTED = BlockEvidence(usable=False)
STOPPED = BlockEvidence(usable=False, paused=True)


def said(blocks: Iterable[Mapping[str, BlockEvidence]], *channels: str) -> list[BearingVerdict]:
    """Return what is said of the one bearing after each block."""
    state, found = MachineState(), []
    for heard in blocks:
        state, verdicts = step(state, heard, {"bearing": channels})
        found.append(verdicts["bearing"])
    return found


def alone(*blocks: BlockEvidence) -> BearingVerdict:
    return said([{"x": heard} for heard in blocks], "x")[-1]


def both(x: Sequence[BlockEvidence], y: Sequence[BlockEvidence]) -> BearingVerdict:
    return said([{"x": one, "y": other} for one, other in zip(x, y, strict=True)], "x", "y")[-1]


def names(fault: str, depth: float = 0.4, *, final: bool = False, count: int = 60) -> list[BlockEvidence]:
    return [BlockEvidence(fault=fault, depth=depth, final=final)] * count


def test_a_single_recording_gets_a_hint_whose_support_is_not_full() -> None:
    found = alone(HINTED)
    assert (found.fault, found.basis, found.disagreement) == ("outer", "hint", {})
    assert found.support == pytest.approx(0.4 / (0.4 + UNNAMED_DEPTH))


def test_support_is_the_share_of_recent_blocks_weighted_by_depth() -> None:
    found = alone(*[NOTHING, HINTED] * 200)
    assert found.support == pytest.approx(0.4 / (0.4 + UNNAMED_DEPTH), abs=0.02)
    assert alone(*names("outer", count=400)).support == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    "blocks",
    [
        [],
        [NOTHING] * 60,
        [*names("outer", count=3), *[NOTHING] * 60],
        [REJECTED, STOPPED, replace(HINTED, usable=False)],
        [*[NOTHING] * 60, HINTED],
    ],
    ids=["no block", "silent", "named long ago", "nothing usable", "once in many"],
)
def test_no_name(blocks: list[BlockEvidence]) -> None:
    state, found = MachineState(), weigh([], {"bearing": ("x",)})
    for heard in blocks:
        state, found = step(state, {"x": heard}, {"bearing": ("x",)})
    assert found["bearing"] == BearingVerdict(channels=("x",))


def test_a_name_is_a_verdict_only_in_a_final_stage_of_a_channel_that_names_it() -> None:
    assert alone(*names("outer")).basis == "hint"
    assert alone(*names("outer", final=True)).basis == "verdict"
    onset_elsewhere = both(names("outer"), [BlockEvidence(final=True)] * 60)
    assert (onset_elsewhere.fault, onset_elsewhere.basis) == ("outer", "hint")
    # One stray name since the onset is none yet.
    assert alone(*[NOTHING] * 60, FINAL).fault is None


def test_a_verdict_outweighs_hints_and_disagreement_is_said() -> None:
    blocks = {"x": names("inner", 0.3, final=True), "y": names("outer", 0.6), "z": names("outer", 0.6)}
    found = said([dict(zip(blocks, row, strict=True)) for row in zip(*blocks.values(), strict=True)], *blocks)[-1]
    assert (found.fault, found.basis) == ("inner", "verdict")
    assert found.disagreement == {"y": "outer", "z": "outer"}
    assert found.support == pytest.approx(0.3 / 1.5, abs=0.01)


def test_when_the_final_stage_closes_the_verdict_is_a_hint_again_and_goes_with_its_lines() -> None:
    episode = [*[NOTHING] * 30, *names("outer", final=True, count=20)]
    assert alone(*episode).basis == "verdict"
    assert (alone(*episode, NOTHING).fault, alone(*episode, NOTHING).basis) == ("outer", "hint")
    assert alone(*episode, *[NOTHING] * 150).fault is None


def test_lines_that_drown_in_their_own_noise_keep_the_verdict_and_lose_support() -> None:
    found = alone(*names("outer", final=True), *[BlockEvidence(final=True)] * 1000)
    assert (found.fault, found.basis) == ("outer", "verdict")
    assert found.support == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("x", "y", "fault", "disagreement"),
    [
        ("inner|ball", "inner", "inner", {}),
        ("inner|ball", "ball|cage", "ball", {}),
        ("inner|ball", "inner|ball", "inner|ball", {}),
        ("ball|cage", "ball|cage", "ball|cage", {}),
        ("outer", "outer", "outer", {}),
    ],
)
@pytest.mark.parametrize("final", [False, True])
def test_names_that_share_a_part_support_each_other(
    x: str, y: str, fault: str, disagreement: dict[str, str], *, final: bool
) -> None:
    found = both(names(x, final=final), names(y, final=final))
    assert (found.fault, found.disagreement) == (fault, disagreement)
    assert found.support == pytest.approx(1.0, abs=0.01)


def test_the_two_axes_of_bearing_1_5() -> None:
    """One ends ``inner|ball``, the other ``outer``: the deeper one is the name, the other the disagreement."""
    found = both(names("inner|ball", 0.5, final=True), names("outer", 0.3, final=True))
    assert (found.fault, found.disagreement) == ("inner|ball", {"y": "outer"})
    assert found.support == pytest.approx(0.5 / 0.8, abs=0.01)
    found = both(names("inner|ball", 0.3, final=True), names("outer", 0.5, final=True))
    assert (found.fault, found.disagreement) == ("outer", {"x": "inner|ball"})


def test_a_healthy_bearing_that_is_often_named_is_a_hint_and_no_more() -> None:
    """As 2_5 before any damage: 965 of 2,300 blocks."""
    assert {(found.fault, found.basis) for found in often_named()[100:]} <= {("outer", "hint"), (None, None)}


def often_named() -> list[BearingVerdict]:
    return said([{"x": HINTED if (i * 965) % 2300 < 965 else NOTHING} for i in range(2300)], "x")


def test_a_name_does_not_flicker() -> None:
    """Names of two parts that come in turn, silence between: a change needs half as much evidence again."""
    changes = [a.fault != b.fault for a, b in itertools.pairwise(often_named())]
    assert sum(changes[50:]) == 0
    blocks = [BlockEvidence(fault="outer" if i % 13 < 7 else "inner", depth=0.3, final=True) for i in range(600)]
    found = [verdict.fault for verdict in said([{"x": heard} for heard in blocks], "x")]
    assert set(found[10:]) == {"outer"}
    assert said([{"x": heard} for heard in (*blocks, *names("inner", final=True, count=800))], "x")[-1].fault == "inner"


def test_a_channel_without_usable_blocks_loses_its_voice_beside_others_only() -> None:
    x = names("inner", 0.9, count=110)
    dead = [*names("outer", 0.3, count=60), *[REJECTED] * 49]
    assert both(x, [*dead, NOTHING]).disagreement == {"y": "outer"}
    assert both(x, [*dead, REJECTED]).disagreement == {}
    assert alone(*dead, REJECTED).fault == "outer"
    # Blocks of a stopped machine do not end the weight of a channel.
    stopped = [*names("outer", 0.3, count=10), *[STOPPED] * 100]
    assert both(x, stopped).disagreement == {"y": "outer"}
    # A block that holds nothing of the channel is one that it missed.
    one = said([*[{"x": HINTED, "y": names("inner")[0]}] * 60, *[{"x": HINTED}] * 50], "x", "y")[-1]
    assert one.disagreement == {}


def source_of(channel: str, blocks: Iterable[BlockEvidence]) -> MachineState:
    state = MachineState()
    for heard in blocks:
        state, _ = step(state, {channel: heard}, {"bearing": (channel,)})
    return state


def test_sources_of_different_rates_are_weighed_alike() -> None:
    """Ten times the blocks do not make ten times the evidence."""
    often, seldom = source_of("x", names("outer", 0.3, count=600)), source_of("y", names("inner", 0.5))
    found = weigh([often, seldom], {"bearing": ("x", "y")})["bearing"]
    assert (found.fault, found.disagreement) == ("inner", {"x": "outer"})


def test_a_source_that_is_silent_for_longer_than_the_patience_has_no_voice() -> None:
    old = source_of("x", (replace(HINTED, time=1e9 + i) for i in range(60)))
    new = source_of("y", (replace(names("inner", 0.3)[0], time=2e9 + i) for i in range(60)))
    bearings = {"bearing": ("x", "y")}
    assert weigh([old, new], bearings)["bearing"].fault == "outer"
    assert weigh([old, new], bearings, patience=1.1e9)["bearing"].fault == "outer"
    found = weigh([old, new], bearings, patience=1e8)["bearing"]
    assert (found.fault, found.disagreement) == ("inner", {})


def test_bearings_are_weighed_apart() -> None:
    blocks = {"x": names("outer"), "y": names("inner"), "z": [NOTHING] * 60}
    state, found = MachineState(), {}
    for row in zip(*blocks.values(), strict=True):
        state, found = step(state, dict(zip(blocks, row, strict=True)), {"drive": ("x", "z"), "free": ("y",)})
    assert {name: verdict.fault for name, verdict in found.items()} == {"drive": "outer", "free": "inner"}
    assert found["drive"].channels == ("x", "z")
    assert found["drive"].support == pytest.approx(1.0, abs=0.01)


def test_the_values_of_a_record_say_whether_a_channel_was_heard() -> None:
    values = {"fault": "outer", "fault_depth": 0.5, "t_fs_block": 7, "quality_status": "gap", "quality_flags": "gap"}
    found = evidence_of_record({"x": values}, 1.0)["x"]
    assert found == BlockEvidence(fault="outer", depth=0.5, final=True, time=1.0)
    for status, flags, paused in (("nan", None, False), ("flat", "flat", False), ("stopped", "stopped|gap", True)):
        heard = evidence_of_record({"x": {"quality_status": status, "quality_flags": flags}})["x"]
        assert (heard.usable, heard.paused, heard.final) == (False, paused, False)


def test_a_name_that_is_no_part_counts_as_silence() -> None:
    assert parts_of("undecided") == parts_of(None) == frozenset()
    assert alone(*names("undecided")).fault is None
    found = both(names("undecided", 0.9), names("outer", 0.3))
    assert (found.fault, found.disagreement) == ("outer", {})


def test_a_store_that_is_older_begins_with_the_names_of_its_channels() -> None:
    named = Named("outer", 5.0, 0.4, 2.0, 7)
    onset = DetectState(t_fs=Mark(5, None), t_fs_known=Mark(7, None))
    channels = {"x": ChannelState(named=named, detect=onset), "y": ChannelState(), "z": ChannelState(named=named)}
    settings = SourceSettings("s", {name: ChannelSettings(name, TEST_BEARING) for name in channels})
    stored = {f"channel:s:{name}": state.to_dict() for name, state in channels.items()}
    found = weigh([SourceState.begin(settings, stored).machine], settings.bearings)["bearing"]
    assert (found.fault, found.basis, found.channels) == ("outer", "verdict", ("x", "y", "z"))
    with pytest.raises(ValueError, match="machine state: version 3 expected, got 9"):
        SourceState.begin(settings, stored | {"machine:s": {"version": 9}})


def test_the_sources_of_a_machine_are_weighed_together() -> None:
    """One source names a part since its onset; the other, daily one names another, and is silent for a month."""
    settings = {
        name: SourceSettings(name, {name: ChannelSettings(name, TEST_BEARING, listens_to="drive")}) for name in "xy"
    }
    pairs = []
    for name, fault, until in (("x", "outer", 1e8), ("y", "inner", 1e8 + 60 * 86400.0)):
        heard = [replace(names(fault, final=fault == "inner")[0], time=until - 60.0 * i) for i in range(60, 0, -1)]
        begun = SourceState.begin(settings[name])
        pairs.append((replace(begun, machine=source_of(name, heard)), settings[name]))
    (found,) = bearing_summaries(pairs).values()
    assert found.pop("support") == pytest.approx(1.0, abs=0.01)
    assert found == {
        "fault": "inner", "fault_basis": "verdict", "disagreement": {}, "channels": ["x", "y"], "level_of": None
    }  # fmt: skip
    slow = replace(pairs[0][0], order=OrderState(clock=ClockState(interval=5 * 86400.0))), pairs[0][1]
    assert bearing_summaries([slow, pairs[1]])["drive"]["disagreement"] == {"x": "outer"}


channel_of = st.lists(
    st.builds(
        BlockEvidence,
        usable=st.sampled_from((True, True, True, False)),
        fault=st.sampled_from((None, *NAMES)),
        depth=st.floats(0.2, 2.0),
        final=st.booleans(),
    ),
    max_size=30,
)
machines = st.dictionaries(st.sampled_from("abcde"), channel_of, min_size=1, max_size=4)


def states_of(machine: Mapping[str, Sequence[BlockEvidence]]) -> list[MachineState]:
    """Each channel a source of its own, without a memory of what was named."""
    return [replace(source_of(name, blocks), named={}) for name, blocks in machine.items()]


@given(machines, st.randoms(use_true_random=False))
def test_the_order_of_channels_does_not_matter(machine: dict[str, list[BlockEvidence]], random: object) -> None:
    states, channels = states_of(machine), list(machine)
    found = weigh(states, {"bearing": channels})
    random.shuffle(states)  # pyright: ignore[reportAttributeAccessIssue]
    random.shuffle(channels)  # pyright: ignore[reportAttributeAccessIssue]
    assert weigh(states, {"bearing": channels}) == found


@given(machines)
def test_what_is_said_is_in_its_ranges_and_consistent(machine: dict[str, list[BlockEvidence]]) -> None:
    found = weigh(states_of(machine), {"bearing": tuple(machine)})["bearing"]
    assert (found.fault is None) == (found.basis is None) == (found.support is None)
    if found.support is None:
        assert found.disagreement == {}
        return
    assert 0.0 <= found.support <= 1.0
    final = any(blocks and any(heard.final for heard in blocks) for blocks in machine.values())
    assert found.basis == "hint" or final
    for channel, other in found.disagreement.items():
        assert channel in machine
        assert not parts_of(other) & parts_of(found.fault)


@given(machines, st.floats(0.2, 2.0), st.integers(1, 60), st.booleans())
def test_a_channel_that_agrees_never_lowers_the_support(
    machine: dict[str, list[BlockEvidence]], depth: float, count: int, final: bool
) -> None:
    before = weigh(states_of(machine), {"bearing": tuple(machine)})["bearing"]
    if before.fault is None or before.support is None:
        return
    agreeing = {"z": names(before.fault, depth, final=final and before.basis == "verdict", count=count)}
    after = weigh(states_of(machine | agreeing), {"bearing": (*machine, "z")})["bearing"]
    assert parts_of(after.fault) & parts_of(before.fault)
    if parts_of(before.fault) <= parts_of(after.fault):
        assert after.support is not None
        assert after.support >= before.support - 1e-12


@given(machines, st.integers(1, 60))
def test_a_silent_channel_changes_nothing_but_a_list(machine: dict[str, list[BlockEvidence]], count: int) -> None:
    before = weigh(states_of(machine), {"bearing": tuple(machine)})["bearing"]
    after = weigh(states_of(machine | {"z": [NOTHING] * count}), {"bearing": (*machine, "z")})["bearing"]
    assert replace(after, channels=before.channels) == before

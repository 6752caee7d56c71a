"""The watcher: blocks of one source through the pipeline into the store, each committed once and whole."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.config.load import ConfigError
from monitor.health.condition import Quantity, load_of, speed_of
from monitor.health.quality import (
    FLAGS,
    OrderState,
    Verdict,
    check_order,
    check_rate,
    rejected,
    with_flags,
)
from monitor.health.record import Record
from monitor.health.state import ChannelState
from monitor.health.step import BlockInfo, ChannelOutput, judge, step
from monitor.health.waterfall import SpectrumChange
from monitor.service.alarming import Alarming
from monitor.service.recording import block_record, rejected_record
from monitor.service.setup import ChannelSetup
from monitor.service.waterfall import Waterfalls
from streams.block import Block, Rejected, to_si

States = dict[str, dict[str, Any]]
Memory = list[tuple[object, dict[str, Any]]]
"""What a watcher and its parts were at a moment."""


class UnfitError(ConfigError):
    """A block does not have what the configuration says.

    Attributes:
        status: of the rejection that can stand in its place.
    """

    def __init__(self, status: str, reason: str) -> None:
        """Keep the status beside the sentence for people."""
        super().__init__(reason)
        self.status = status


class Watcher:
    """Carries the states of the channels of one source from block to block.

    It holds no clock and no store: :meth:`process` gives the record, and :meth:`states` what must be committed with it.
    """

    def __init__(self, source: str, channels: Mapping[str, ChannelSetup], rate: float | None = None) -> None:
        """Begin with fresh states.

        Args:
            source: name of the source.
            channels: the channels to watch, by name.
            rate: configured sampling rate, Hz, or None where the recording states it.
        """
        self.source = source
        self.channels = dict(channels)
        self._rate = rate
        self._order = OrderState()
        self._states = {name: ChannelState() for name in channels}
        self.alarming = Alarming(source, {name: setup.alarms for name, setup in channels.items()})
        """The alarms of the channels."""
        self._waterfalls = Waterfalls(
            source,
            {name: setup.waterfall for name, setup in channels.items()},
            {name: setup.settings.bearing for name, setup in channels.items()},
        )
        self.spectra: tuple[SpectrumChange, ...] = ()
        """What the latest block changes in the kept spectra, to be committed with its record."""
        tracked = ((name, setup.settings.damage) for name, setup in channels.items())
        self._methods = {name: damage.forecast_method for name, damage in tracked if damage is not None}
        self._checked_rates: set[float] = set()
        self._conditions: dict[str, dict[str, Any]] = {}
        self.outputs: dict[str, ChannelOutput] = {}
        """What the latest block said of each channel, for whoever draws it."""
        self.latest: dict[str, Mapping[str, Any]] = {}
        """Values of each channel in the latest record that has it."""
        self.sequence = 0
        """Number of the latest block."""
        self.dated = False
        """Whether the times of the blocks are UTC."""

    def restore(self, states: Mapping[str, Mapping[str, Any]], latest: Record | None = None) -> None:
        """Take up the states that a store gives back; channels that it does not know begin afresh.

        Args:
            states: by name, as :meth:`states` gave them.
            latest: the record that was committed with them.
        """
        if latest is not None:
            self._remember(latest)
        self.alarming.restore(states)
        self._waterfalls.restore(states)
        if self._order_key in states:
            self._order = OrderState.from_dict(states[self._order_key])
        for name in self._states:
            key = self._channel_key(name)
            if key in states:
                self._states[name] = ChannelState.from_dict(states[key])

    def states(self) -> States:
        """Return all states by name, to be committed with the record of the block that led to them."""
        states = {self._channel_key(name): state.to_dict() for name, state in self._states.items()}
        return {self._order_key: self._order.to_dict(), **states, **self.alarming.states(), **self._waterfalls.states()}

    @property
    def thresholds(self) -> tuple[float, ...]:
        """Thresholds of V_eq that the tracked channels are forecast to, m2; () where none is tracked."""
        tracked = (setup.settings.damage for setup in self.channels.values())
        return next((damage.thresholds for damage in tracked if damage is not None), ())

    @property
    def interval(self) -> float | None:
        """Usual seconds from block to block, or None before two were seen."""
        return self._order.interval

    def channel(self, name: str) -> ChannelState:
        """Return the state of one channel."""
        return self._states[name]

    def settle_band(self, name: str, band: tuple[float, float]) -> None:
        """Freeze the band of a channel that was chosen from a recording as a whole."""
        self._states[name] = replace(self._states[name], bands=(band,), band_source="recording")

    def remembered(self) -> Memory:
        """Return all that is remembered, for :meth:`go_back`; states are frozen, so that nothing large is copied."""
        return [(part, _copied(vars(part))) for part in (self, self.alarming, self._waterfalls)]

    def go_back(self, memory: Memory) -> None:
        """Be as it was then: for a block that failed half way, or whose states cannot be stored."""
        for part, values in memory:
            vars(part).update(_copied(values))
        # What the block before changed in the kept spectra is committed.
        self.spectra = ()

    def process(
        self, item: Block | Rejected, now: float | None = None, truth: Mapping[str, Any] | None = None
    ) -> Record:
        """Take one block through all stages and return its record.

        Args:
            item: the block, or the rejection that stands in its place.
            now: present UTC where the stream is live, None in a replay.
            truth: what a simulated rig knows of the block.

        Raises:
            UnfitError: the block does not have what the configuration says; of a recording, no later block will.
        """
        self.spectra = ()
        if isinstance(item, Rejected):
            self._order, _ = check_order(self._order, item.sequence, None, dated=False)
            return self.alarming.after(rejected_record(item), self._states, None)
        time = item.start if item.start is not None else item.elapsed
        self._order, flags = check_order(self._order, item.sequence, time, dated=item.start is not None, now=now)
        verdict = check_rate(item.rate, self._rate)
        if not verdict.accepted:
            record = block_record(item, verdict.status, (), verdict.reason, {}, None)
            return self.alarming.after(record, self._states, None)
        self._check_fit(item)
        self._conditions = {}
        outputs = {name: self._channel_step(name, item, time, flags) for name in self.channels}
        status, flags, reason = _block_verdict({name: output.verdict for name, output in outputs.items()}, flags)
        self.outputs = outputs
        channels = {name: (self._states[name], output) for name, output in outputs.items()}
        record = block_record(item, status, flags, reason, channels, truth, self._methods, conditions=self._conditions)
        self._remember(record)
        self.spectra = self._waterfalls.after(item, self._states, outputs)
        return self.alarming.after(record, self._states, outputs)

    def _remember(self, record: Record) -> None:
        self.sequence = record.sequence
        self.dated = record.time is not None
        self.latest.update(record.channels)

    def _channel_step(self, name: str, block: Block, time: float | None, flags: tuple[str, ...]) -> ChannelOutput:
        setup, state = self.channels[name], self._states[name]
        row = block.channels.index(name)
        unit = block.units[row]
        section = setup.section
        samples, si_unit = to_si(block.samples[row], unit, section.scale, section.sensitivity_mv_per_g)
        if (si_unit == "m/s2") != setup.settings.absolute:
            verdict = rejected("wrong_unit", f"unit {unit!r}, configured is {setup.section.unit!r}")
        else:
            verdict = judge(samples, state, setup.settings)
        speed, load = self._condition(setup, block, samples if verdict.accepted else None)
        if verdict.accepted and speed.value is None:
            verdict = rejected("incomplete", "the shaft speed is not known: neither stated nor found in the signal")
        info = BlockInfo(
            sequence=block.sequence,
            time=time,
            rate=block.rate,
            duration=block.duration,
            speed=speed.value,
            load=load.value,
        )
        state, output = step(state, samples, info, with_flags(verdict, flags), setup.settings)
        self._states[name] = state
        if output.features is not None:
            self._conditions[name] = {
                "speed_source": speed.source,
                "speed_sd": speed.sd,
                "load_source": load.source,
                "load_sd": load.sd,
            }
        return output

    @staticmethod
    def _condition(
        setup: ChannelSetup, block: Block, samples: NDArray[np.floating] | None
    ) -> tuple[Quantity, Quantity]:
        """Return speed and load of a block for a channel, which is given where its samples are usable."""
        settings = setup.condition
        rows = {name: block.samples[block.channels.index(name)] for name in settings.channels if name in block.channels}
        speed = speed_of(block.speed, rows, samples, block.rate, setup.settings.bearing, settings)
        return speed, load_of(block.load, rows, settings)

    def _check_fit(self, block: Block) -> None:
        """Refuse what no later block would mend: a missing channel, an unknown speed, a band above Nyquist."""
        missing = sorted(set(self.channels) - set(block.channels))
        if missing:
            raise UnfitError(
                "wrong_shape",
                f"source {self.source!r}, {block.name}: channel {missing[0]!r} is not in it; it has "
                f"{', '.join(block.channels)}",
            )
        for setup in self.channels.values():
            if block.speed is None and setup.condition.speed is None and not setup.condition.varies:
                raise UnfitError(
                    "incomplete",
                    f"operating.speed_hz is missing, and {block.name} does not state the shaft speed: the fault "
                    "frequencies cannot be computed",
                )
            if block.rate not in self._checked_rates:
                try:
                    setup.section.check_rate(block.rate)
                except ValueError as error:
                    raise UnfitError("wrong_rate", str(error)) from None
        self._checked_rates.add(block.rate)

    @property
    def _order_key(self) -> str:
        return f"source:{self.source}"

    def _channel_key(self, name: str) -> str:
        return f"channel:{self.source}:{name}"


def _copied(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: copy(value) if isinstance(value, dict | set) else value for name, value in values.items()}


def _block_verdict(verdicts: Mapping[str, Verdict], order_flags: tuple[str, ...]) -> tuple[str, tuple[str, ...], str]:
    """Return status, flags and reason of a block: rejected only where all its channels are."""
    reason = "; ".join(f"{name}: {verdict.reason}" for name, verdict in verdicts.items() if verdict.reason)
    accepted = [verdict for verdict in verdicts.values() if verdict.accepted]
    if not accepted:
        return next(iter(verdicts.values())).status, (), reason
    raised = {*order_flags, *(flag for verdict in accepted for flag in verdict.flags)}
    flags = tuple(flag for flag in FLAGS if flag in raised)
    return (flags[0] if flags else "ok"), flags, reason

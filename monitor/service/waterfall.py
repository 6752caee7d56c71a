"""The spectra of a watcher that are to be stored: what a block said in, changes of the table ``spectra`` out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from models.bearing import Bearing, kinematics
from monitor.health.spectrum.features import BlockFeatures, fundamentals
from monitor.health.state import ChannelState
from monitor.health.step import ChannelOutput
from monitor.health.waterfall import SpectrumChange, SpectrumRow, WaterfallSettings, WaterfallState, step
from streams.block import Block

_HARMONICS = 6.5
"""How many lines of the highest family a kept spectrum reaches."""


class Waterfalls:
    """Carries the waterfall states of the channels of one source from block to block."""

    def __init__(self, source: str, settings: Mapping[str, WaterfallSettings], bearings: Mapping[str, Bearing]) -> None:
        """Begin with fresh states for the channels named in ``settings``."""
        self._source, self._settings, self._bearings = source, dict(settings), dict(bearings)
        self._states = {name: WaterfallState() for name in settings}

    def restore(self, states: Mapping[str, Mapping[str, Any]]) -> None:
        """Take up the states that a store gives back."""
        for name in self._states:
            if self._key(name) in states:
                self._states[name] = WaterfallState.from_dict(states[self._key(name)])

    def states(self) -> dict[str, dict[str, Any]]:
        """Return the states by name, to be committed with the record."""
        return {
            self._key(name): state.to_dict() for name, state in self._states.items() if self._settings[name].rows > 0
        }

    def after(
        self, block: Block, states: Mapping[str, ChannelState], outputs: Mapping[str, ChannelOutput]
    ) -> tuple[SpectrumChange, ...]:
        """Return what a block changes in the kept spectra.

        A block has a spectrum where its channel is neither rejected nor flat, of a standing machine, late or out of
        order. The time of a block whose clock is not believed is stated, but decides nothing.

        Args:
            block: it.
            states: of the channels after it.
            outputs: what it said of them.
        """
        changes: list[SpectrumChange] = []
        for name, output in outputs.items():
            if self._settings[name].rows < 1 or not output.verdict.for_baseline:
                continue
            if output.features is None or output.speed is None:
                continue
            time = block.start if block.start is not None else block.elapsed
            row = self._row(block, name, time, output, output.features, output.speed)
            if not (np.all(np.isfinite(row.amplitude)) and math.isfinite(row.mean)):
                continue
            found = output.detection
            onset = found is not None and found.alarm
            self._states[name], keeping = step(
                self._states[name],
                time,
                self._settings[name],
                believed="clock" not in output.verdict.flags,
                onset=onset,
                end=found is not None and found.end,
            )
            began = states[name].detect.t_fs if onset else None
            changes.append(SpectrumChange(row, keeping.kind, keeping.thin, None if began is None else began.sequence))
        return tuple(changes)

    def _row(
        self, block: Block, name: str, time: float | None, output: ChannelOutput, features: BlockFeatures, speed: float
    ) -> SpectrumRow:
        envelope, lines = features.envelopes[output.leading], features.lines[output.leading]
        nominal = fundamentals(kinematics(self._bearings[name], speed))
        keep = min(envelope.amplitude.size, int(_HARMONICS * max(nominal.values()) / envelope.resolution))
        return SpectrumRow(
            source=self._source,
            channel=name,
            sequence=block.sequence,
            time=time,
            resolution=float(envelope.resolution),
            band=(float(envelope.band[0]), float(envelope.band[1])),
            speed=float(speed),
            mean=float(envelope.mean),
            absolute=output.absolute,
            amplitude=envelope.amplitude[:keep],
            lines={
                fault: float(line * (lines[fault].speed_factor if lines[fault].detected else 1.0))
                for fault, line in nominal.items()
            },
        )

    def _key(self, channel: str) -> str:
        return f"waterfall:{self._source}:{channel}"

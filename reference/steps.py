"""A source taken through the stages block by block, without a store."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from monitor.health.name.machine import BearingVerdict
from monitor.health.output import ChannelOutput
from monitor.health.record import Record
from monitor.health.signal.waterfall import SpectrumChange
from monitor.health.state import SourceSettings, SourceState, Stored
from monitor.health.step import SourceOutput, step
from streams.types.block import Block, Rejected


class Steps:
    """Holds the state of one source and the output of its latest block."""

    def __init__(self, settings: SourceSettings, stored: Stored | None = None, latest: Record | None = None) -> None:
        """Begin where a stored state and the latest record end, or without a history."""
        self.settings = settings
        self.state = SourceState.begin(settings, stored, latest)
        self.output: SourceOutput | None = None

    def take(self, item: Block | Rejected, **given: Any) -> Record:
        """Take a block, with what :func:`monitor.health.step.step` takes besides it, and return its record."""
        self.state, self.output = step(self.state, item, self.settings, **given)
        return self.output.record

    def stored(self) -> Stored:
        """Return the state as it is kept."""
        return self.state.to_stored()

    @property
    def outputs(self) -> Mapping[str, ChannelOutput]:
        """By channel, of the latest block."""
        return {} if self.output is None else self.output.channels

    @property
    def bearings(self) -> Mapping[str, BearingVerdict]:
        """By bearing, of the latest block."""
        return {} if self.output is None else self.output.bearings

    @property
    def spectra(self) -> tuple[SpectrumChange, ...]:
        """What the latest block changes in the kept spectra."""
        return () if self.output is None else self.output.spectra

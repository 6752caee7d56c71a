"""Which envelope spectra are kept, so that a life of any length has about as many of them.

At most one per interval of record time is kept; when there are twice as many as wanted, every other one is dropped and
the interval doubles. The newest is always kept. Those around the start of the final stage are pinned: the last one
before it, the one with which it became known and two after it, a first interval apart, and that of the end of life.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from monitor.health.codec import StoredState
from monitor.health.signal.kurtogram import Kurtogram
from monitor.health.signal.spectra import BlockView

Kind = Literal["newest", "kept", "pinned"]
"""How long a spectrum is kept: until the next one comes, until it is thinned out, always."""

_PINNED_AFTER = 3
_SLACK = 1e-3
"""Share of the interval by which a block may come early: clocks are not exact."""


@dataclass(frozen=True, eq=False)
class SpectrumRow:
    """The envelope spectrum of one block of one channel, not averaged.

    Attributes:
        sequence: number of the block in its source.
        time: of its first sample, UTC seconds since 1970, or seconds from the first block where undated; None unknown.
        resolution: spacing of the bins, Hz; bin k is at k times it.
        band: (lo, hi) that was demodulated, Hz.
        speed: of the shaft, Hz.
        mean: of the envelope, m/s2, or in the channel's unknown unit.
        absolute: whether amplitudes are in m/s2.
        amplitude: (n,) single-sided, in the unit of ``mean``; a line on a bin reads its amplitude.
        lines: frequency of the first line of each family, Hz: outer, inner, ball (it meets both races), cage. As found
            in this spectrum where the family is detected, else the kinematic frequency.
        kurtogram: of the block, or None where it was not computed: only with spectra that are kept for good.
        view: raw spectrum and waveform; None in rows that were read without.
        domain: "order" where the block was warped to its mean speed: a bin is then an order of the shaft, its
            frequency over ``speed``.
        speed_range: least and highest speed in the block, Hz, None where only its mean is known.
        speed_course: speed at equal steps from the beginning to the end of the block, Hz, or None likewise.
    """

    source: str
    channel: str
    sequence: int
    time: float | None
    resolution: float
    band: tuple[float, float]
    speed: float
    mean: float
    absolute: bool
    amplitude: NDArray[np.floating]
    lines: Mapping[str, float]
    kurtogram: Kurtogram | None = None
    view: BlockView | None = None
    domain: str = "hertz"
    speed_range: tuple[float, float] | None = None
    speed_course: tuple[float, ...] | None = None

    @property
    def frequency(self) -> NDArray[np.float64]:
        """(n,) frequency of each bin, Hz."""
        return np.arange(self.amplitude.size, dtype=np.float64) * self.resolution

    @property
    def order(self) -> NDArray[np.float64]:
        """(n,) order of the shaft of each bin."""
        return self.frequency / self.speed


@dataclass(frozen=True, eq=False)
class SpectrumChange:
    """Changes by one block in the spectra of one channel.

    Attributes:
        thin: drop every other one of the kept ones first.
        pin_before: pin the last kept one before the block of this number, or None.
    """

    row: SpectrumRow
    kind: Kind
    thin: bool = False
    pin_before: int | None = None


@dataclass(frozen=True)
class WaterfallSettings:
    """How many spectra are kept.

    Attributes:
        rows: target number of a long life, at most twice as many; 0 keeps none.
        interval: shortest record time between two of them, s.
    """

    rows: int = 200
    interval: float = 60.0


@dataclass(frozen=True)
class WaterfallState(StoredState):
    """The waterfall of a channel between two blocks; version 1.

    Attributes:
        interval: present one, s, or None before the first spectrum.
        count: kept spectra that may be thinned out.
        last: time of the latest kept one, s, or None.
        to_pin: how many of the next ones are pinned.
    """

    VERSIONS = (1,)

    version: int = VERSIONS[-1]
    interval: float | None = None
    count: int = 0
    last: float | None = None
    to_pin: int = 0


def step(
    state: WaterfallState,
    time: float | None,
    settings: WaterfallSettings,
    *,
    clock_valid: bool = True,
    onset: bool = False,
    end: bool = False,
) -> tuple[WaterfallState, Kind, bool]:
    """Return the state after a block with a spectrum, how long to keep it, and whether to drop every other kept one.

    Args:
        time: of the block, s, or None where blocks have none: then each counts as an interval after the one before.
        clock_valid: whether the time is used; if not, the spectrum is at most the newest.
        onset, end: whether the final stage, the end of life became known with the block.
    """
    interval = settings.interval if state.interval is None else state.interval
    to_pin = max(state.to_pin, _PINNED_AFTER) if onset else state.to_pin
    # The final stage may be short beside the life: its start does not wait for the longer interval.
    wait = (settings.interval if to_pin else interval) * (1.0 - _SLACK)
    due = clock_valid and (time is None or state.last is None or time < state.last or time - state.last >= wait)
    if onset or end or (due and to_pin):
        last = time if clock_valid else state.last
        return replace(state, interval=interval, last=last, to_pin=max(0, to_pin - 1)), "pinned", False
    if not due:
        return replace(state, interval=interval), "newest", False
    thin = state.count >= 2 * settings.rows
    count = (state.count + 1) // 2 if thin else state.count
    interval = 2.0 * interval if thin else interval
    return replace(state, interval=interval, count=count + 1, last=time), "kept", thin

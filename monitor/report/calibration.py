"""What a report may say of V_eq and TT of a channel whose rig is not calibrated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.records.archive import of_channel
from monitor.report.runs import Channel, Run
from monitor.words.numbers import times_first, volume

_MM2 = 1e6


@dataclass(frozen=True, eq=False)
class VolumeScale:
    """The scale on which V_eq of a channel is shown.

    Attributes:
        factor: from m2 to the scale.
        unit: behind its values.
        absolute: False where V_eq is shown as a multiple of its first value.
    """

    factor: float
    unit: str
    absolute: bool

    @classmethod
    def of(cls, run: Run, channel: Channel) -> VolumeScale:
        """Return mm2 for a calibrated rig, else multiples of the first tracked value, if there is any."""
        v_eq, relative = channel.column("v_eq"), channel.column("v_eq_relative")
        known = np.flatnonzero(v_eq > 0.0)
        if is_calibrated(run, channel) or not known.size:
            return cls(_MM2, "mm³/mm", absolute=True)
        last, first = int(known[-1]), float(v_eq[known[0]])
        # Records of an earlier version have no relative values.
        if relative[last] > 0.0:
            first = float(v_eq[last] / relative[last])
        return cls(1.0 / first, "times the first tracked value", absolute=False)

    def write(self, value: float) -> str:
        """Return a V_eq (m2) with its unit."""
        return volume(value) if self.absolute else times_first(value * self.factor)

    def write_briefly(self, value: float) -> str:
        """Return a V_eq (m2) for a table."""
        return volume(value) if self.absolute else f"× {value * self.factor:.3g}"

    def scaled(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values (m2) on the scale."""
        return self.factor * values


def is_calibrated(run: Run, channel: Channel) -> bool:
    """Return whether V_eq of a channel is that of its machine; "declared" counts."""
    return of_channel(run.attributes.get("calibrated"), channel.name) in ("yes", "declared")


def unscaled(run: Run, channel: Channel) -> str:
    """Return the caveat on V_eq and TT of a model that was not calibrated, "" for a calibrated one."""
    return "" if is_calibrated(run, channel) else " On the scale of a model that is not calibrated."

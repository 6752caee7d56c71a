"""Kernel: how far balls are relieved by the defects that they pass, in intervals known before the run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from models.platform.jit import inlined

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from models.platform.jit import Index


class HasPassages(Protocol):
    """A plan with records of passages in the intervals of ``models.solve.engine.passages``."""

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Times of the edges, s, (I + 1,)."""
        ...

    @property
    def first(self) -> NDArray[np.int64]:
        """The records of interval i are first[i] to first[i + 1], (I + 1,)."""
        ...

    @property
    def ball(self) -> NDArray[np.int64]:
        """The ball of each record."""
        ...

    @property
    def depth(self) -> NDArray[np.float64]:
        """It is deeper by depth * sin(rate * t + offset), m."""
        ...

    @property
    def rate(self) -> NDArray[np.float64]:
        """See ``depth``, rad/s."""
        ...

    @property
    def offset(self) -> NDArray[np.float64]:
        """See ``depth``, rad."""
        ...


@inlined
def fill_depth(t: float, h: float, interval: Index, plan: HasPassages, depth: NDArray[np.float64]) -> None:
    """Write the depths at the nodes of a step of length h that begins at t and lies in one interval."""
    for node in range(3):
        for j in range(depth.shape[1]):
            depth[node, j] = 0.0
        for r in range(plan.first[interval], plan.first[interval + 1]):
            angle = plan.rate[r] * (t + 0.5 * h * node) + plan.offset[r]
            depth[node, plan.ball[r]] += plan.depth[r] * math.sin(angle)

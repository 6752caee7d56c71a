"""Where the points of a shaft move, of which an orbit is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.words.request import Request, Sensor

MOST_TURNS = 20
"""Turns of the shaft that are kept at most: more hide each other in a picture."""
# Samples that are kept of a turn; steps are much shorter.
_SAMPLES_A_TURN = 2000


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Displacements of points of a shaft, after the beginning from rest was dropped.

    Attributes:
        step: time between samples, s.
        place: from the centre of the outer rings, m, shape (points, 2, samples): along the load and across it.
        points: of the rows of ``place``, named as the sensors there.
        clearance: free way of each point until its ring meets the balls, m; NaN where it is in no bearing.
        error: largest change of a travel (largest less smallest place) when steps are halved, over the largest travel.
    """

    step: float
    place: NDArray[np.float64]
    points: tuple[Sensor, ...]
    clearance: tuple[float, ...]
    error: float

    def travel(self) -> NDArray[np.float64]:
        """Return how far each point moves along the load and across it, m, (points, 2)."""
        return np.ptp(self.place, axis=2)


Walk = Callable[[float, float], "NDArray[np.float64] | None"]
"""Return the places (points, 2, steps) from rest for a duration and a step, s, or None if the motion diverged."""


def settled(
    walk: Walk,
    scene: Scene,
    request: Request,
    *,
    step: float,
    settle: float,
    points: tuple[Sensor, ...],
    clearance: tuple[float, ...],
) -> Trajectories | None:
    """Return the trajectories of the last turns of a motion from rest, None if it diverged.

    ``step`` and half of it are tried; the finer one is kept. ``settle``: time to drop at the beginning, s.
    """
    duration = min(request.duration, MOST_TURNS / scene.speed)
    kept: list[NDArray[np.float64]] = []
    for each in (step, 0.5 * step):
        place = walk(settle + duration, each)
        if place is None:
            return None
        kept.append(place[:, :, round(settle / each) :])
    travels = [np.ptp(place, axis=2) for place in kept]
    largest = float(np.max(travels[1]))
    error = float(np.max(np.abs(travels[1] - travels[0]))) / largest if largest > 0.0 else 0.0
    every = max(1, int(1.0 / (scene.speed * _SAMPLES_A_TURN * 0.5 * step)))
    return Trajectories(0.5 * step * every, kept[1][:, :, ::every], points, clearance, error)

"""The best path of speed and its growth through a plane of scores, by dynamic programming."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.rotation.plane import Plane

_BENDS = np.arange(-3, 4)
"""Steps of growth from one window to the next."""
_BEND_COST = 0.3
"""Cost of the square of such a step, in ln of power."""
_SLACK = (-1, 0, 1)
_SLACK_COST = 0.5
"""Steps of speed beside what the growth asks for, and the cost of one."""


def best_path(plane: Plane) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return ln of the speed and its growth over the times of the plane, and the mean score along them.

    Returns:
        ln of the speed, shape (time,); growth, 1/s, shape (time,); mean of the score over time.
    """
    n_time, n_growth, n_speed = plane.score.shape
    hop = float(plane.time[1] - plane.time[0])
    sources, costs = _moves(plane, hop)
    value = plane.score[0].astype(np.float32)
    choices = np.empty((n_time, n_growth * n_speed), dtype=np.int8)
    flat = np.full(n_growth * n_speed + 1, -np.inf, dtype=np.float32)
    cell = np.arange(n_growth * n_speed, dtype=np.intp)
    for at in range(1, n_time):
        flat[:-1] = value.ravel()
        reached = flat.take(sources) - costs[:, None]
        chosen = reached.argmax(axis=0)
        choices[at] = chosen
        value = reached[chosen, cell].reshape(n_growth, n_speed) + plane.score[at]
    place = int(value.argmax())
    total = float(value.ravel()[place]) / n_time
    places = np.empty(n_time, dtype=np.intp)
    places[-1] = place
    for at in range(n_time - 1, 0, -1):
        place = int(sources[choices[at, place], place])
        places[at - 1] = place
    return plane.log_speed[places % n_speed], plane.growth[places // n_speed], total


def _moves(plane: Plane, hop: float) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return where each cell can be reached from.

    Returns:
        Flat index of the cell before, the index beyond the last where there is none, shape (move, cell); and the cost
        of each move, shape (move,).
    """
    n_growth, n_speed = plane.growth.size, plane.log_speed.size
    step = float(plane.log_speed[1] - plane.log_speed[0])
    growth_at, speed_at = np.divmod(np.arange(n_growth * n_speed), n_speed)
    sources: list[NDArray[np.intp]] = []
    costs: list[float] = []
    for bend in _BENDS:
        before = growth_at - bend
        inside = (before >= 0) & (before < n_growth)
        mean = 0.5 * (plane.growth[growth_at] + plane.growth[np.clip(before, 0, n_growth - 1)])
        for slack in _SLACK:
            speed = speed_at - np.rint(mean * hop / step).astype(np.intp) - slack
            reachable = inside & (speed >= 0) & (speed < n_speed)
            sources.append(np.where(reachable, before * n_speed + speed, n_growth * n_speed))
            costs.append(_BEND_COST * float(bend) ** 2 + _SLACK_COST * abs(slack))
    return np.array(sources), np.array(costs, dtype=np.float32)

"""Kernels of quadrature weights over a ball period: fourth order between the places where contacts change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray


@kernel
def add_quadrature(weight: NDArray[np.float64], scale: float) -> None:
    """Write weights of fourth order for equal steps of length ``scale`` between the values, shape (steps + 1,).

    The trapezoid rule with Gregory's end corrections; closed Newton-Cotes rules where there are too few steps for them.
    """
    steps = weight.shape[0] - 1
    weight[:] = scale
    if steps == 1:
        weight[0] = weight[1] = scale / 2.0
    elif steps == 2:
        weight[0] = weight[2] = scale / 3.0
        weight[1] = scale * 4.0 / 3.0
    elif steps == 3:
        weight[0] = weight[3] = scale * 3.0 / 8.0
        weight[1] = weight[2] = scale * 9.0 / 8.0
    elif steps == 4:
        weight[0] = weight[4] = scale * 14.0 / 45.0
        weight[1] = weight[3] = scale * 64.0 / 45.0
        weight[2] = scale * 24.0 / 45.0
    else:
        for end in (0, steps):
            inwards = 1 if end == 0 else -1
            weight[end] -= scale * 5.0 / 8.0
            weight[end + inwards] += scale / 6.0
            weight[end + 2 * inwards] -= scale / 24.0


@kernel
def fill_weights(
    flow: NDArray[np.float64],
    first: NDArray[np.int64],
    smooth: NDArray[np.float64],
    changed: NDArray[np.bool_],
    any_changed: bool,
    weight: NDArray[np.float64],
) -> None:
    """Write the weights of a period's values, in which the steps ``changed`` have no part.

    Args:
        flow, first: see models.solve.six_dof.kernels.period.Period.
        smooth: the weights where no step is changed.
        any_changed: whether one is.
        weight: written, (steps + segments,).
    """
    if not any_changed:
        weight[:] = smooth
        return
    duration = 0.0
    for k in range(first.shape[0] - 1):
        duration += flow[k, 0] * (first[k + 1] - first[k])
    weight[:] = 0.0
    for k in range(first.shape[0] - 1):
        begin = first[k]
        for n in range(first[k], first[k + 1] + 1):
            if n < first[k + 1] and not changed[n]:
                continue
            if n > begin:
                add_quadrature(weight[begin + k : n + k + 1], flow[k, 0] / duration)
            begin = n + 1

"""Which comb the lines of another one are sidebands of.

Damage that turns through the load zone makes lines at every multiple of its own frequency and at turns of its carrier
to either side: the shaft for a race, the cage for a ball. The k-th multiple with k turns less on every side is a comb
as well: two turns below an inner race of eight balls it stands where the outer race would. The damage itself makes the
deeper comb, wherever it turns through the load zone in one piece.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Kinematics
from monitor.health.signal.comb import FaultLines, LineSpectrum, comb_grid, combs_depth
from monitor.health.signal.lines import SEARCH
from monitor.words.parts import PARTS

TURNS = (-3, -2, -1, 1, 2, 3)
"""Turns of the carrier between a comb and the one of which it is sidebands, for each multiple."""
_SAME_BINS = 1.5
"""Bins within which a line is one of the comb found."""


def own_lines(lines: NDArray[np.float64], other: float, n_harmonics: int, distance: float) -> NDArray[np.bool_]:
    """Return which lines of combs are that far from any multiple of another frequency, shape (harmonic, comb).

    Args:
        lines: fundamentals of the combs, Hz.
        other: frequency, Hz.
        n_harmonics: lines of each comb.
        distance: Hz.
    """
    places = np.multiply.outer(np.arange(1.0, n_harmonics + 1.0), lines) / other
    return np.abs(places - np.rint(places)) * other > distance


def parent_depth(
    spectrum: LineSpectrum, kinematics: Kinematics, found: FaultLines, speed_error: float, score: float, least: float
) -> float:
    """Return the depth of the deepest comb of which the one found may be sidebands, 0 where none is deep enough.

    Comb and sidebands give the turns of the carrier between them: only combs are looked at whose ratio to these turns
    is that of a part, with its slip, at a speed that the shaft may have.

    Args:
        spectrum: of the envelope.
        kinematics: kinematic frequencies at the stated or measured shaft speed.
        found: the comb that may be sidebands.
        speed_error: how far off the shaft speed may be, relative.
        score: comb score that the other must have.
        least: depth that the other must have.
    """
    resolution, ranges = (
        spectrum.resolution,
        _ranges(kinematics, found.fundamental, speed_error, 4.0 * spectrum.resolution),
    )
    margin = 0.5 * resolution
    grids = [comb_grid(low - margin, high + margin, resolution) for low, high in ranges]
    if not grids:
        return 0.0
    lines, bins = np.concatenate([grid.lines for grid in grids]), np.concatenate([grid.bins for grid in grids], axis=1)
    excess = np.append(spectrum.excess, 0.0)
    scores = excess.take(np.minimum(bins, spectrum.excess.size)).sum(axis=0)
    own = own_lines(lines, found.fundamental, bins.shape[0], _SAME_BINS * resolution)
    depths = combs_depth(spectrum, bins, own)
    deep = (scores >= score) & (depths >= least)
    return float(depths.max(where=deep, initial=0.0))


def _ranges(
    kinematics: Kinematics, fundamental: float, speed_error: float, resolved: float
) -> list[tuple[float, float]]:
    """Return where combs may stand of which the one with this fundamental is sidebands, Hz.

    Carriers below ``resolved`` (Hz) are left out: their sidebands are not apart.
    """
    found: list[tuple[float, float]] = []
    for part in PARTS:
        carrier = part.sidebands(kinematics)
        if carrier is None or carrier < resolved:
            continue
        low, high = (part.frequency(kinematics) / carrier * (1.0 + slip) for slip in part.slip)
        slowest, fastest = carrier * (1.0 - speed_error), carrier * (1.0 + speed_error)
        for turns in TURNS:
            if low + turns <= 0.0:
                continue
            # The comb stands at r turns of the carrier, its sidebands at r + turns.
            turn = max(slowest, fundamental / (high + turns)), min(fastest, fundamental / (low + turns))
            near = abs(turns) * turn[0] <= SEARCH * fundamental
            if turn[0] <= turn[1] and not near:
                places = sorted(fundamental - turns * each for each in turn)
                found.append((places[0], places[1]))
    return found

"""What the physical tracker believes beforehand: how damage grows, and how far a map may be from the bearing.

A defect of extent dphi_d and depth h_d is heard as

    ln x = 1/2 ln(X(dphi_d, h_d)^2 + n^2) + w (c + b + s z) + e,    w = X^2 / (X^2 + n^2),

for each feature x (the RMS and the first lines of BPFO): X is the map's value, n what the sensor picks up besides, c
the gain of bench against model that all features share, b that of one feature, both constant over a life; s is the
standard deviation of ln X over floors and rig parameters, z (mean 0, variance 1) the error of the map where the defect
is, and e what scatters from block to block. z keeps its value over a distance on the map: a floor does not change as
the defect grows over it, so that a second block at nearly the same defect tells nearly nothing new.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.maps.data import MapSlice

    Floats = NDArray[np.float64]

_GRAVITY = 9.80665
_DEPTHS = np.array([2e-6, 9e-6, 18e-6, 28e-6])
# Standard deviation of ln X over floors and rig parameters at these depths, where a map does not say (RMS, line 1, and
# lines beyond): the median over extents of a map of rough floors with drawn rigs (benchmarks/filter.py, "spread").
_SPREAD = np.array([[0.29, 0.14, 0.06, 0.03], [0.18, 0.05, 0.02, 0.02], [0.44, 0.15, 0.07, 0.02]])
_LEAST_SPREAD, _MOST_SPREAD = 0.1, 0.6


@dataclass(frozen=True)
class GrowthPrior:
    """How damage is taken to grow before anything is heard: dV/dt = R (V / V_th)^m, hasting and resting, with jumps.

    Attributes:
        threshold: V_th, to which the others refer, m2.
        v_start: V_eq at the first block: median, m2.
        v_start_sd: standard deviation of its logarithm.
        durations: range of the time to the threshold, s, uniform in the logarithm.
        exponents: range of m, uniform: 0 is a straight line, 1 an exponential, more is faster still.
        haste_sd: standard deviation of the haste, the logarithm of a factor on the growth that comes and goes.
        memory: time after which the haste is forgotten, s.
        h_threshold: range of the depth at the threshold, m, uniform in the logarithm.
        depth_share: range of the share of ln V_eq that ln h_d takes, uniform.
        path_sd: standard deviation by which ln h_d leaves that path while ln V_eq grows by one.
        roughness: standard deviation of the factor on the growth within ``interval``.
        kicks: probability within ``interval`` that the haste changes by a standard deviation of ``kick_sd`` at once.
        kick_sd: see ``kicks``.
        jumps: probability within ``interval`` that V_eq jumps, by ``jump`` times ``threshold`` on average.
        jump: see ``jumps``; the size is exponentially distributed.
        interval: time to which the rates refer, s.
    """

    threshold: float = 0.05e-6
    v_start: float = 0.0022e-6
    v_start_sd: float = 0.65
    durations: tuple[float, float] = (11000.0, 55000.0)
    exponents: tuple[float, float] = (0.3, 1.3)
    haste_sd: float = 0.2
    memory: float = 6000.0
    h_threshold: tuple[float, float] = (4e-6, 20e-6)
    depth_share: tuple[float, float] = (0.2, 0.7)
    path_sd: float = 0.03
    roughness: float = 0.5
    kicks: float = 0.005
    kick_sd: float = 1.2
    jumps: float = 0.005
    jump: float = 0.3
    interval: float = 300.0


@dataclass(frozen=True)
class ErrorModel:
    """How far what is heard may be from the map.

    Attributes:
        gain_sd: standard deviation of c, the logarithm of the gain that all features share.
        rms_gain_sd: standard deviation of b for the RMS.
        harmonic_gain_sd: standard deviation of b for a line of BPFO.
        scatter: standard deviation of e that a measured figure has by itself.
        rms_doubt: standard deviation by which the RMS of one block is doubted besides.
        harmonic_doubt: the same for a line of BPFO. Both are several times what a block's error is seen to be: errors
            of a map are correlated in more ways than z has, and blocks are no independent witnesses.
        spread_factor: factor on the spread that a map states.
        rms_length: (extent, rad; depth, m) over which the error of the RMS of a map keeps its value.
        harmonic_length: the same for a line of BPFO.
        load_length: the same for the logarithm of the load.
        speed_length: the same for the logarithm of the speed.
        freedom: degrees of freedom of the Student distribution by which an unlikely figure is doubted.
        background_rms: RMS of what the sensor picks up besides the bearing, m/s2.
        background_harmonic: the same at each line of BPFO, as an amplitude, m/s2.
    """

    gain_sd: float = 0.12
    rms_gain_sd: float = 0.12
    harmonic_gain_sd: float = 0.19
    scatter: float = 0.02
    rms_doubt: float = 0.4
    harmonic_doubt: float = 0.5
    spread_factor: float = 1.0
    rms_length: tuple[float, float] = (math.radians(1.2), 0.6e-6)
    harmonic_length: tuple[float, float] = (math.radians(6.0), 10e-6)
    load_length: float = 0.5
    speed_length: float = 0.1
    freedom: float = 20.0
    background_rms: float = 0.05 * _GRAVITY
    background_harmonic: float = 0.006 * _GRAVITY


@dataclass(frozen=True, eq=False)
class HeardMap:
    """A map as the tracker reads it: F features (the RMS, then lines of BPFO) at each node.

    Attributes:
        dphi_d: extents, rad, shape (D,).
        h_d: depths, m, shape (H,).
        table: at each node the features' values, m/s2, and standard deviations of their logarithm, shape (H * D, 2 F).
        background: what the sensor picks up besides, m/s2, shape (F,).
        load: N.
        speed: Hz.
    """

    dphi_d: Floats
    h_d: Floats
    table: Floats
    background: Floats
    load: float
    speed: float

    @property
    def features(self) -> int:
        """F, the number of features."""
        return self.background.size

    def at(self, dphi_d: Floats, h_d: Floats) -> tuple[Floats, Floats, Floats]:
        """Return what the map says of some defects; those beyond it count as on its edge.

        Args:
            dphi_d: rad, shape (N,).
            h_d: m, shape (N,).

        Returns:
            ln x without errors, w and s of the module's equation, shape (N, F) each.
        """
        i, u = _cells(self.dphi_d, dphi_d)
        j, v = _cells(self.h_d, h_d)
        width = self.dphi_d.size
        node = j * width + i
        low = self.table[node] * (1.0 - u) + self.table[node + 1] * u
        high = self.table[node + width] * (1.0 - u) + self.table[node + width + 1] * u
        value = low + v * (high - low)
        return self.heard(value)

    def heard(self, value: Floats) -> tuple[Floats, Floats, Floats]:
        """Return ln x without errors, w and s of rows of the table, shape (N, F) each."""
        n = self.features
        power = value[:, :n] ** 2
        total = power + self.background**2
        return 0.5 * np.log(total), power / total, value[:, n:]


def _cells(axis: Floats, x: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the node below each value and the fraction of the way to the next, the latter as a column."""
    x = np.clip(x, axis[0], axis[-1])
    index = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, axis.size - 2)
    return index, ((x - axis[index]) / (axis[index + 1] - axis[index]))[:, None]


def heard_map(map_slice: MapSlice, errors: ErrorModel, lines: int) -> HeardMap | None:
    """Return a map slice as the tracker reads it, or None where it is too small or has no values.

    A node without values takes those of the mean of its neighbours.

    Args:
        map_slice: the map at one load and speed.
        errors: background and spread.
        lines: how many lines of BPFO to read, at most 6.
    """
    shape = (map_slice.h_d.size, map_slice.dphi_d.size)
    if min(shape) < 2:
        return None
    value = np.concatenate((map_slice.rms[..., None], map_slice.harmonic_amplitude[..., :lines]), axis=2)
    floors = np.concatenate((map_slice.rms_std[..., None], map_slice.harmonic_std[..., :lines]), axis=2)
    rigs = np.concatenate((map_slice.rms_rig_std[..., None], map_slice.harmonic_rig_std[..., :lines]), axis=2)
    if not np.any(np.all(np.isfinite(value), axis=2)):
        return None
    if np.any(np.isnan(value)):
        value, floors, rigs = (_filled(a) for a in (value, floors, rigs))
    spread = _spread(value, np.hypot(floors, rigs), map_slice.h_d, errors.spread_factor)
    # The mean over floors lies above the median, about which the logarithm is symmetric.
    table = np.concatenate((value * np.exp(-0.5 * spread**2), spread), axis=2).reshape(shape[0] * shape[1], -1)
    background = np.array([errors.background_rms] + [errors.background_harmonic] * lines)
    return HeardMap(map_slice.dphi_d, map_slice.h_d, table, background, map_slice.load, map_slice.speed)


def _spread(value: Floats, std: Floats, h_d: Floats, factor: float) -> Floats:
    """Return the standard deviation of ln X at each node, shape (H, D, F)."""
    if np.any(std > 0.0):
        relative = std / np.maximum(value, 1e-12)
        spread = np.sqrt(np.log1p(np.minimum(relative, 1.0) ** 2))
    else:
        rows = [_SPREAD[min(k, 2)] for k in range(value.shape[2])]
        spread = np.stack([np.interp(h_d, _DEPTHS, row) for row in rows], axis=1)[:, None, :] * np.ones(value.shape)
    return np.clip(factor * spread, _LEAST_SPREAD, _MOST_SPREAD)


def _filled(values: Floats) -> Floats:
    """Return an array (H, D, F) with its holes filled from around, ring by ring."""
    filled = values.copy()
    while np.any(np.isnan(filled)):
        padded = np.pad(filled, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        near = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
        known = ~np.isnan(near)
        count = np.sum(known, axis=0)
        mean = np.sum(np.where(known, near, 0.0), axis=0) / np.maximum(count, 1)
        take = np.isnan(filled) & (count > 0)
        if not np.any(take):
            return np.nan_to_num(filled)
        filled[take] = mean[take]
    return filled

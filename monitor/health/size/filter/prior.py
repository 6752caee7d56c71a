"""Priors of the physical tracker: growth of damage, and errors of a map.

A defect of extent dphi_d and depth h_d gives for each feature x (the RMS and the first lines of BPFO)

    ln x = 1/2 ln(X(dphi_d, h_d)^2 + n^2) + w (c + b + s z) + e,    w = X^2 / (X^2 + n^2),

X is the map's value, n the background of the sensor, c the gain of bench against model that all features share, b that
of one feature, both constant over a life; s is the standard deviation of ln X over floors and rig parameters, z (mean
0, variance 1) the error of the map at the defect, and e the scatter from block to block. z is correlated over a
distance on the map: a floor does not change as the defect grows over it, so a second block at nearly the same defect
adds little information.
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
# lines beyond): the median over extents of a map of rough floors with drawn rigs.
_SPREAD = np.array([[0.29, 0.14, 0.06, 0.03], [0.18, 0.05, 0.02, 0.02], [0.44, 0.15, 0.07, 0.02]])
# The same over floors alone.
_FLOOR_SPREAD = np.array([[0.25, 0.08, 0.045, 0.01], [0.17, 0.05, 0.02, 0.006], [0.41, 0.15, 0.06, 0.015]])
_MIN_SPREAD, _MAX_SPREAD = 0.1, 0.6


@dataclass(frozen=True)
class GrowthPrior:
    """Prior of the growth: dV/dt = R (V / V_th)^m, with random speed-ups, jumps and standstill.

    Attributes:
        threshold: V_th to which the other values refer, m2.
        v_start: V_eq at the first block: median, m2.
        v_start_sd: standard deviation of its logarithm.
        durations: time to the threshold, s, uniform in the logarithm.
        exponents: range of m, uniform: 0 is a straight line, 1 an exponential.
        growth_noise_sd: standard deviation of the growth-rate noise, the logarithm of a random factor on the growth.
        memory: correlation time of the growth-rate noise, s.
        h_threshold: depth at the threshold, m, uniform in the logarithm.
        depth_share: d ln h_d / d ln V_eq, uniform.
        path_sd: standard deviation of ln h_d about that path while ln V_eq grows by one.
        roughness: standard deviation of the growth factor within ``interval``.
        kicks: probability within ``interval`` of a step of the growth-rate noise.
        kick_sd: standard deviation of that step.
        jumps: probability within ``interval`` of a jump of V_eq.
        jump: its mean over ``threshold``; exponentially distributed.
        still: probability that the damage stands still at the first block.
        stops: rate at which growing damage comes to a standstill, per ``interval``.
        starts: largest rate at which it grows again; that falls the longer it has stood still.
        interval: time to which the rates refer, s.
    """

    threshold: float = 0.05e-6
    v_start: float = 0.0022e-6
    v_start_sd: float = 0.65
    durations: tuple[float, float] = (11000.0, 55000.0)
    exponents: tuple[float, float] = (0.3, 1.3)
    growth_noise_sd: float = 0.2
    memory: float = 6000.0
    h_threshold: tuple[float, float] = (4e-6, 20e-6)
    depth_share: tuple[float, float] = (0.2, 0.7)
    path_sd: float = 0.03
    roughness: float = 0.5
    kicks: float = 0.005
    kick_sd: float = 1.2
    jumps: float = 0.005
    jump: float = 0.3
    still: float = 0.1
    stops: float = 0.002
    starts: float = 0.01
    interval: float = 300.0

    @property
    def prior(self) -> str:
        """Growth and depth, as text."""
        hours = " to ".join(f"{value / 3600.0:.3g}" for value in self.durations)
        depth = " to ".join(f"{value * 1e6:g}" for value in self.h_threshold)
        reached = f"{hours} h to {self.threshold * 1e6:g} mm2, where it is {depth} um deep"
        return f"a growth that takes {reached}, and may stall or jump"


@dataclass(frozen=True)
class ErrorModel:
    """Errors of observations against the map.

    Attributes:
        gain_sd: standard deviation of c, a logarithm.
        rms_gain_sd: standard deviation of b for the RMS.
        harmonic_gain_sd: standard deviation of b for a line of BPFO.
        scatter: standard deviation of the measured value alone.
        rms_model_sd: additional model error of the RMS (SD per block).
        harmonic_model_sd: the same for a line of BPFO. Both are several times the observed scatter: errors of a map and
            of neighbouring blocks are correlated beyond what z describes.
        spread_factor: factor on the spread of the map.
        rms_length: correlation length (extent, rad; depth, m) of the map's error of the RMS.
        harmonic_length: the same for a line of BPFO.
        load_length: the same in the logarithm of the load.
        speed_length: the same in the logarithm of the speed.
        freedom: degrees of freedom of the Student distribution of the errors.
        background_rms: RMS of the background of the sensor, m/s2.
        background_harmonic: the same at each line of BPFO, an amplitude, m/s2.
    """

    gain_sd: float = 0.12
    rms_gain_sd: float = 0.12
    harmonic_gain_sd: float = 0.19
    scatter: float = 0.02
    rms_model_sd: float = 0.4
    harmonic_model_sd: float = 0.5
    spread_factor: float = 1.0
    rms_length: tuple[float, float] = (math.radians(1.2), 0.6e-6)
    harmonic_length: tuple[float, float] = (math.radians(6.0), 10e-6)
    load_length: float = 0.5
    speed_length: float = 0.1
    freedom: float = 20.0
    background_rms: float = 0.05 * _GRAVITY
    background_harmonic: float = 0.006 * _GRAVITY


@dataclass(frozen=True, eq=False)
class MapLookup:
    """A map as the tracker reads it: F features (the RMS, then lines of BPFO) at each node.

    Attributes:
        dphi_d: extents, rad, shape (D,).
        h_d: depths, m, shape (H,).
        table: at each node the features' values, m/s2, and standard deviations of their logarithm, shape (H * D, 2 F).
        background: of the sensor, m/s2, shape (F,).
        gains: standard deviation of b, the error of the map that all nodes share included, shape (F,).
        load: N.
        speed: Hz.
    """

    dphi_d: Floats
    h_d: Floats
    table: Floats
    background: Floats
    gains: Floats
    load: float
    speed: float

    @property
    def features(self) -> int:
        """F, the number of features."""
        return self.background.size

    def at(self, dphi_d: Floats, h_d: Floats) -> tuple[Floats, Floats, Floats]:
        """Return ln x without errors, w and s at some defects, shape (N, F) each; clamped to the map."""
        i, u = _cells(self.dphi_d, dphi_d)
        j, v = _cells(self.h_d, h_d)
        width = self.dphi_d.size
        node = j * width + i
        low = self.table[node] * (1.0 - u) + self.table[node + 1] * u
        high = self.table[node + width] * (1.0 - u) + self.table[node + width + 1] * u
        value = low + v * (high - low)
        return self.log_features(value)

    def log_features(self, value: Floats) -> tuple[Floats, Floats, Floats]:
        """Return ln x without errors, w and s of rows of the table, shape (N, F) each."""
        n = self.features
        power = value[:, :n] ** 2
        total = power + self.background**2
        return 0.5 * np.log(total), power / total, value[:, n:]


def _cells(axis: Floats, x: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the node below each value, and the fraction of the way to the next as a column."""
    x = np.clip(x, axis[0], axis[-1])
    index = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, axis.size - 2)
    return index, ((x - axis[index]) / (axis[index + 1] - axis[index]))[:, None]


def build_lookup(map_slice: MapSlice, errors: ErrorModel, lines: int) -> MapLookup | None:
    """Return a map slice as the tracker reads it, or None where it is too small or has no values.

    A node without values takes the mean of its neighbours.

    Args:
        lines: number of BPFO lines, at most 6.
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
    if np.any(rigs > 0.0) and not np.median(floors[..., 0]) > 0.0:
        # Rigs were drawn over one floor, which says nothing about others.
        floors = np.hypot(floors, value * np.sqrt(np.expm1(_tabled(_FLOOR_SPREAD, map_slice.h_d, value) ** 2)))
    # What all nodes share does not change as the defect grows: it belongs to the gain, the rest to z.
    common = map_slice.rig_common[: 1 + lines]
    rigs = np.sqrt(np.maximum(rigs**2 - (value * common) ** 2, 0.0))
    spread = _spread(value, np.hypot(floors, rigs), map_slice.h_d, errors.spread_factor)
    # The mean over floors lies above the median, about which the logarithm is symmetric.
    table = np.concatenate((value * np.exp(-0.5 * spread**2), spread), axis=2).reshape(shape[0] * shape[1], -1)
    background = np.array([errors.background_rms] + [errors.background_harmonic] * lines)
    gains = np.hypot([errors.rms_gain_sd] + [errors.harmonic_gain_sd] * lines, common)
    return MapLookup(map_slice.dphi_d, map_slice.h_d, table, background, gains, map_slice.load, map_slice.speed)


def _spread(value: Floats, std: Floats, h_d: Floats, factor: float) -> Floats:
    """Return the standard deviation of ln X at each node, shape (H, D, F)."""
    if np.any(std > 0.0):
        relative = std / np.maximum(value, 1e-12)
        spread = np.sqrt(np.log1p(np.minimum(relative, 1.0) ** 2))
    else:
        spread = _tabled(_SPREAD, h_d, value)
    return np.clip(factor * spread, _MIN_SPREAD, _MAX_SPREAD)


def _tabled(table: Floats, h_d: Floats, value: Floats) -> Floats:
    """Return a table over ``_DEPTHS`` at each node, shape (H, D, F) as ``value``."""
    rows: list[Floats] = [np.interp(h_d, _DEPTHS, table[min(k, 2)]) for k in range(value.shape[2])]
    return np.stack(rows, axis=1)[:, None, :] * np.ones(value.shape)


def _filled(values: Floats) -> Floats:
    """Return an array (H, D, F) with its holes filled from their neighbours, ring by ring."""
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

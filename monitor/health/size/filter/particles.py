"""Particles of the physical tracker: candidate defects, their growth, and how well each explains the observations.

A particle is a defect with its growth and the gain; b and z of ``monitor.health.size.filter.prior`` are Gaussian
given the particle's path and are carried exactly, as mean and covariance of a Kalman filter for each feature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from monitor.health.codec import FLOAT32, Float32Array, StoredState
from monitor.health.size.filter.prior import ErrorModel, GrowthPrior, MapLookup

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LN_V, LN_H, LN_R, POWER, SHARE, GAIN, GROWTH_NOISE, STILL = range(8)
"""Columns of ``Particles.core``."""

_DRAWS_PER_PARTICLE = 6
# Blur of the copies of a particle, in standard deviations of all particles.
_BLUR = 0.08
_MAX_LN_U = 5.0
_MIN_SLOWNESS = 1e-3
# Least intervals of a standstill; starts of growth while a standstill becomes e times as long.
_BEGUN, _LASTING = 1e-3, 0.3
# Bins of ln V_eq; highest valley between two peaks, as a share of the lower; least weight of each.
_PEAK_BINS = 40
_MAX_VALLEY = 0.5
_MIN_PEAK_WEIGHT = 0.15


@dataclass(frozen=True, eq=False)
class Particles(StoredState):
    """N particles of F features, in the single precision in which they are stored.

    Attributes:
        core: shape (N, 8): ln V_eq, ln h_d, ln R of ``GrowthPrior``, its m, d ln h_d / d ln V_eq, c, the
            growth-rate noise, and for how many intervals the damage has stood still, 0 where it grows; SI.
        weight: shape (N,), of sum 1.
        mean: of b and z, shape (N, F, 2).
        cov: variance of b, covariance, variance of z, shape (N, F, 3).
    """

    core: Float32Array
    weight: Float32Array
    mean: Float32Array
    cov: Float32Array

    @property
    def effective(self) -> float:
        """Effective number of particles, 1 / sum of squared weights."""
        return float(1.0 / np.sum(self.weight**2))

    def sizes(self, part_radius: float) -> tuple[Floats, Floats]:
        """Return the extents, rad, and the depths, m, shape (N,) each (Eq. 90)."""
        h_d = np.exp(self.core[:, LN_H])
        return np.exp(self.core[:, LN_V]) / (part_radius * h_d), h_d

    def rounded(self) -> Particles:
        """Round to the stored precision."""
        arrays = (self.core, self.weight, self.mean, self.cov)
        return Particles(*(array.astype(np.float32).astype(np.float64) for array in arrays))

    @classmethod
    def upgraded(cls, stored: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return particles of an earlier version with a column of those that stand still."""
        core = FLOAT32.decode(stored["core"])
        if core.shape[1] != STILL:
            return stored
        return {**stored, "core": FLOAT32.encode(np.concatenate((core, np.zeros((len(core), 1))), axis=1))}


def draw(rng: np.random.Generator, count: int, gains: Floats, growth: GrowthPrior, errors: ErrorModel) -> Particles:
    """Draw several times ``count`` particles from the prior; ``gains`` are standard deviations of b, shape (F,)."""
    n = _DRAWS_PER_PARTICLE * count

    def uniform(limits: tuple[float, float]) -> Floats:
        return rng.uniform(limits[0], limits[1], n)

    share, power = uniform(growth.depth_share), uniform(growth.exponents)
    ln_start = math.log(growth.v_start / growth.threshold)
    # What stands still may have grown before anybody listened: any size below the threshold.
    still = rng.uniform(size=n) < growth.still
    ln_u = np.where(still, uniform((ln_start, 0.0)), ln_start + growth.v_start_sd * rng.standard_normal(n))
    ln_u = np.minimum(ln_u, -0.05)
    ln_t, ln_h = (uniform((np.log(lo), np.log(hi))) for lo, hi in (growth.durations, growth.h_threshold))
    slow = _slowness(power)
    ln_r = np.log(growth.threshold * -np.expm1(slow * ln_u) / slow) - ln_t
    core = np.column_stack(
        (
            ln_u + np.log(growth.threshold),
            ln_h + share * ln_u,
            ln_r,
            power,
            share,
            errors.gain_sd * rng.standard_normal(n),
            growth.growth_noise_sd * rng.standard_normal(n),
            np.where(still, _BEGUN, 0.0),
        )
    )
    features = gains.size
    cov = np.zeros((n, features, 3))
    cov[:, :, 0], cov[:, :, 2] = gains**2, 1.0
    return Particles(core, np.full(n, 1.0 / n), np.zeros((n, features, 2)), cov)


def grow(particles: Particles, rng: np.random.Generator, dt: float | Floats, growth: GrowthPrior) -> Particles:
    """Advance the particles: dV/dt = R (V / V_th)^m, with noise, steps, jumps and standstill.

    Args:
        dt: s; not positive leaves them as they are. An array gives each particle its own time, shape (N,).
    """
    if np.all(dt <= 0.0):
        return particles
    core = particles.core.copy()
    n, blocks = len(core), dt / growth.interval
    still = core[:, STILL] > 0.0
    core[:, STILL], factor = _stood(rng, core[:, STILL], blocks, growth)
    kept = np.exp(-dt / growth.memory)
    core[:, GROWTH_NOISE] = kept * core[:, GROWTH_NOISE] + growth.growth_noise_sd * np.sqrt(
        1.0 - kept**2
    ) * rng.standard_normal(n)
    kicked = rng.uniform(size=n) < -np.expm1(-growth.kicks * blocks)
    core[:, GROWTH_NOISE] += np.where(kicked, growth.kick_sd * rng.standard_normal(n), 0.0)
    shape = blocks / growth.roughness**2
    rough = rng.gamma(shape, 1.0 / shape, n)
    slow = _slowness(core[:, POWER])
    ln_u = core[:, LN_V] - np.log(growth.threshold)
    # u^slow grows by slow times this share of itself; where that leaves nothing, u has gone to infinity.
    share = slow * rough * dt * np.exp(core[:, LN_R] + core[:, GROWTH_NOISE] - np.log(growth.threshold) - slow * ln_u)
    ln_grown = ln_u + np.log1p(np.maximum(share, -1.0 + 1e-9)) / slow
    jumped = rng.uniform(size=n) < -np.expm1(-growth.jumps * blocks)
    jump = np.where(jumped, growth.jump * rng.exponential(size=n), 0.0)
    # Beyond any map; a long gap must not overflow.
    ln_grown = np.minimum(np.log(np.exp(np.minimum(ln_grown, _MAX_LN_U)) + jump), _MAX_LN_U)
    step = np.where(still, 0.0, np.maximum(ln_grown - ln_u, 0.0))
    core[:, LN_V] += step
    core[:, LN_H] += core[:, SHARE] * step + growth.path_sd * np.sqrt(step) * rng.standard_normal(n)
    weight = particles.weight * factor
    return Particles(core, weight / np.sum(weight), particles.mean, particles.cov)


def _stood(
    rng: np.random.Generator, stood: Floats, blocks: float | Floats, growth: GrowthPrior
) -> tuple[Floats, Floats]:
    """Return for how many intervals the damage has stood still after some more (0: it grows), and factors of weights.

    The longer it has stood still, the longer it will: at a constant rate, the growth that is begun again and again and
    found wrong would add up over weeks. Particles begin to grow at the constant rate all the same, with less weight, so
    that some are there when it does.
    """
    still = stood > 0.0
    changed = rng.uniform(size=stood.size) < -np.expm1(-np.where(still, growth.starts, growth.stops) * blocks)
    ln_stay = -growth.starts * blocks
    lasting = -np.minimum(growth.starts, _LASTING / np.maximum(stood, _BEGUN)) * blocks
    factor = np.where(changed, np.expm1(lasting) / np.expm1(np.minimum(ln_stay, -1e-300)), np.exp(lasting - ln_stay))
    return np.where(still != changed, np.maximum(stood + blocks, _BEGUN), 0.0), np.where(still, factor, 1.0)


def _slowness(power: Floats) -> Floats:
    """Return 1 - m, kept off zero."""
    slow = 1.0 - power
    return np.where(np.abs(slow) < _MIN_SLOWNESS, _MIN_SLOWNESS, slow)


def decorrelate(particles: Particles, distance: Floats) -> Particles:
    """Decorrelate z over a distance (in correlation lengths, shape (N, F))."""
    rho = np.exp(-distance)
    mean, cov = particles.mean.copy(), particles.cov.copy()
    mean[:, :, 1] *= rho
    cov[:, :, 1] *= rho
    cov[:, :, 2] = rho**2 * cov[:, :, 2] + (1.0 - rho**2)
    return Particles(particles.core, particles.weight, mean, cov)


def assimilate(
    particles: Particles,
    lookup: MapLookup,
    part_radius: float,
    ln_x: Floats,
    variance: Floats,
    errors: ErrorModel,
    seen: tuple[Floats, Floats, Floats] | None = None,
) -> Particles:
    """Update the weights, b and z of the particles by one block.

    Args:
        ln_x: logarithms of the features, NaN where missing, shape (F,).
        variance: of e, shape (F,).
        seen: what ``lookup.at`` returns for the particles, where it is known already.
    """
    known = np.isfinite(ln_x)
    expected, w, s = seen or lookup.at(*particles.sizes(part_radius))
    b, z = particles.mean[:, :, 0], particles.mean[:, :, 1]
    p_bb, p_bz, p_zz = (particles.cov[:, :, k] for k in range(3))
    gap = np.where(known, ln_x, 0.0) - expected - w * (particles.core[:, GAIN, None] + b + s * z)
    # Covariance of b and of z with the feature, and the feature's variance.
    c_b, c_z = w * (p_bb + s * p_bz), w * (p_bz + s * p_zz)
    total = w * (c_b + s * c_z) + variance
    square = gap**2 / total
    # The factor 1 / sqrt(total) is left out: the assumed errors exceed the real scatter, so with it the particles of
    # least variance, which hardly move, would win over a run whatever is observed.
    ln_like = -0.5 * (errors.freedom + 1.0) * np.log1p(square / errors.freedom)
    ln_weight = np.log(np.maximum(particles.weight, 1e-300)) + np.sum(np.where(known, ln_like, 0.0), axis=1)
    weight = np.exp(ln_weight - np.max(ln_weight))
    inflation = np.maximum(1.0, (errors.freedom + square) / (errors.freedom + 1.0))
    per_gap = np.where(known, 1.0 / (total * inflation), 0.0)
    mean = np.stack((b + c_b * per_gap * gap, z + c_z * per_gap * gap), axis=2)
    cov = np.stack((p_bb - c_b * c_b * per_gap, p_bz - c_b * c_z * per_gap, p_zz - c_z * c_z * per_gap), axis=2)
    return Particles(particles.core, weight / np.sum(weight), mean, cov)


def resample(particles: Particles, rng: np.random.Generator, count: int) -> Particles:
    """Resample systematically to ``count`` particles of equal weight, blurring copies."""
    total = np.cumsum(particles.weight)
    places = (rng.uniform() + np.arange(count)) / count * float(total[-1])
    index = np.minimum(total.searchsorted(places), total.size - 1)
    core = particles.core[index]
    spread = np.cov(core.T) + 1e-12 * np.eye(core.shape[1])
    core = core + _BLUR * rng.standard_normal(core.shape) @ np.linalg.cholesky(spread).T
    core[:, STILL] = particles.core[index, STILL]
    core[:, POWER] = np.clip(core[:, POWER], 0.0, 2.0)
    core[:, SHARE] = np.clip(core[:, SHARE], 0.05, 0.95)
    return Particles(core, np.full(count, 1.0 / count), particles.mean[index], particles.cov[index])


def quantiles(values: Floats, weight: Floats, levels: Sequence[float]) -> list[float]:
    """Return weighted quantiles, linear between the middles of the particles' weights."""
    order = np.argsort(values)
    sorted_weight = weight[order]
    places = np.cumsum(sorted_weight) - 0.5 * sorted_weight
    return [float(np.interp(level, places, values[order])) for level in levels]


def two_peaks(ln_v: Floats, weight: Floats) -> bool:
    """Return whether ln V_eq has two peaks with a deep valley and much weight on both sides."""
    counts, _ = np.histogram(ln_v, bins=_PEAK_BINS, weights=weight)
    smooth = np.convolve(counts, np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0, mode="same")
    left, right = np.maximum.accumulate(smooth), np.maximum.accumulate(smooth[::-1])[::-1]
    valley = smooth < _MAX_VALLEY * np.minimum(left, right)
    share = np.cumsum(counts)
    return bool(np.any(valley & (share > _MIN_PEAK_WEIGHT) & (share < 1.0 - _MIN_PEAK_WEIGHT)))

"""Signals of simulated machines for tests and benchmarks: damaged bearings, healthy ones, and what is neither.

Nothing here knows anything of the detector. Levels are in m/s2, the broadband noise of a healthy machine is 1 m/s2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing, Kinematics, from_catalogue, kinematics
from models.solve.response import Response, SignalRecord
from monitor.health.signal.features import fundamentals

Samples = NDArray[np.float64]
RESONANCE, DECAY = 3400.0, 900.0
"""Hz and 1/s of the resonance that impacts excite."""


def bearing_lines(designation: str, speed: float) -> tuple[Bearing, Kinematics]:
    """Return a bearing of the catalogue and its kinematic frequencies at a shaft speed in Hz."""
    bearing = from_catalogue(designation)
    return bearing, kinematics(bearing, speed)


def impacts(
    rng: np.random.Generator,
    fault: str,
    lines: Kinematics,
    *,
    rate: float = 25600.0,
    duration: float = 2.0,
    height: float = 8.0,
    noise: float = 1.0,
    slip: float = 0.005,
    jitter: float = 0.005,
    modulation: float = 1.0,
) -> Samples:
    """Return what a damaged bearing sounds like, shape (sample,): rings of a resonance in noise.

    Args:
        rng: random numbers.
        fault: outer, inner, ball or cage.
        lines: nominal kinematic frequencies.
        rate: sampling rate, Hz.
        duration: s.
        height: first swing of a ring of full strength.
        noise: standard deviation of the white noise.
        slip: share by which the impacts come later than the kinematics say.
        jitter: standard deviation of one interval over its mean; the errors add up, as those of slipping balls do.
        modulation: how much the strength of the impacts swings: with the shaft (inner race in the load zone), the cage
            (ball), or a fifth of it with the shaft (outer race: unbalance).
    """
    n = round(rate * duration)
    line = fundamentals(lines)[fault] * (1.0 - slip)
    count = int(duration * line * 1.2) + 10
    times = np.cumsum((1.0 + jitter * rng.standard_normal(count)) / line) - rng.uniform(0.0, 1.0 / line)
    times = times[(times > 0.0) & (times < duration)]
    carrier = {"inner": lines.speed, "ball": lines.ftf, "outer": lines.speed, "cage": lines.speed}[fault]
    depth = modulation * (0.2 if fault in ("outer", "cage") else 1.0)
    swing = 1.0 + depth * np.cos(2.0 * np.pi * (carrier * times + rng.uniform()))
    strength = height * swing / (1.0 + depth)
    train = np.zeros(n)
    np.add.at(train, (times * rate).astype(np.intp), strength)
    return _ringing(train, rate) + noise * rng.standard_normal(n)


def pulses(n: int, rate: float, times: NDArray[np.float64], height: float) -> Samples:
    """Return rings of equal height that begin at ``times`` (s), shape (n,), without noise."""
    train = np.zeros(n)
    places = (times * rate).astype(np.intp)
    np.add.at(train, places[(places >= 0) & (places < n)], height)
    return _ringing(train, rate)


def _ringing(train: Samples, rate: float) -> Samples:
    n_ring = min(train.size, round(8.0 / DECAY * rate))
    t = np.arange(n_ring) / rate
    ring = np.exp(-DECAY * t) * np.sin(2.0 * np.pi * RESONANCE * t)
    n = train.size + n_ring
    length = 1 << (n - 1).bit_length()
    return np.fft.irfft(np.fft.rfft(train, length) * np.fft.rfft(ring, length), length)[: train.size]


def _tone(n: int, frequency: float, turn: float) -> Samples:
    """Return the cosine of ``n`` samples: cycles per sample, and turns at the first sample."""
    along, across = _quadratures(n, frequency)
    return math.cos(2.0 * math.pi * turn) * along - math.sin(2.0 * math.pi * turn) * across


@lru_cache(maxsize=16)
def _quadratures(n: int, frequency: float) -> tuple[Samples, Samples]:
    """Return cosine and sine of a frequency, which all blocks of a machine have in common."""
    angle = 2.0 * np.pi * frequency * np.arange(n)
    return np.cos(angle), np.sin(angle)


@dataclass(frozen=True)
class HealthyMachine:
    """One healthy machine: its own levels, drawn once, and how they wander from block to block.

    Attributes:
        speed: shaft speed, Hz.
        bpfo: ball pass frequency, Hz.
        harmonics: amplitude of each harmonic of the shaft, m/s2, shape (harmonic,).
        compliance: depth of the modulation by passing balls (varying compliance), shape (2,) for BPFO and twice it.
        drift: standard deviation of ln level.
        memory: blocks over which the level forgets (its correlation falls to 1/e).
        scatter: standard deviation of ln level that is new in every block.
        burst_rate: share of blocks that hold a single burst.
        run_in: what ln level starts above its mean.
    """

    speed: float
    bpfo: float
    harmonics: NDArray[np.float64]
    compliance: NDArray[np.float64]
    drift: float = 0.05
    memory: float = 50.0
    scatter: float = 0.025
    burst_rate: float = 0.005
    run_in: float = 0.2

    @classmethod
    def draw(cls, rng: np.random.Generator, speed: float, bpfo: float) -> HealthyMachine:
        """Draw a machine: six shaft harmonics up to half the noise, a compliance of 2 to 6 %."""
        return cls(
            speed=speed,
            bpfo=bpfo,
            harmonics=0.5 * rng.uniform(0.0, 1.0, 6) / np.arange(1, 7),
            compliance=rng.uniform(0.02, 0.06) * np.array([1.0, 0.4]),
            scatter=rng.uniform(0.02, 0.03),
        )

    def levels(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Return the level of each of ``count`` consecutive blocks, shape (block,)."""
        keep = math.exp(-1.0 / self.memory)
        news = rng.standard_normal(count) * self.drift * math.sqrt(1.0 - keep * keep)
        news[0] = rng.standard_normal() * self.drift
        ln_level = np.empty(count)
        value = 0.0
        for i in range(count):
            value = keep * value + news[i]
            ln_level[i] = value
        settling = self.run_in * np.exp(-np.arange(count) / 20.0)
        return np.exp(ln_level + settling + self.scatter * rng.standard_normal(count))

    def block(self, rng: np.random.Generator, level: float, rate: float, n: int) -> Samples:
        """Return the samples of one block, shape (n,)."""
        noise = rng.standard_normal(n)
        passing = 1.0 + sum(
            depth * _tone(n, order * self.bpfo / rate, rng.uniform())
            for order, depth in zip((1, 2), self.compliance, strict=True)
        )
        x = noise * passing
        for order, amplitude in enumerate(self.harmonics, start=1):
            x += amplitude * _tone(n, order * self.speed / rate, rng.uniform())
        x *= level
        if rng.uniform() < self.burst_rate:
            x += pulses(n, rate, rng.uniform(0.0, n / rate, 1), rng.uniform(10.0, 100.0) * level)
        return x


def record_of(response: Response) -> SignalRecord:
    """Return the record of a motion that was simulated over time."""
    assert response.record is not None
    return response.record


def recorded(response: Response) -> NDArray[np.float64]:
    """Return the signals of both sensors of a motion that was simulated over time, m/s2."""
    return record_of(response).signal

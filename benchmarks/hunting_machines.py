"""A surrogate of healthy machines whose speed hunts and whose load steps: what the detector takes of each block.

RMS^2 of a block is the mean over nine moments of

    sum over lines of (a_o s^p f^q |H(o s)|)^2 + (b s^r f^q)^2
    |H|^2 = sum over modes of g_m^2 |x^2 / (1 - x^2 + 2 i z x)|^2

with ``s`` the speed over its mean, ``f`` the load over the full one, ``x`` the frequency over that of a mode. Lines are
three of the shaft and twenty of BPFO with a cage that slips anew in each block; six modes between 100 Hz and 6 kHz have
1 to 5 % of critical damping, and lines cross them as the speed changes. Around that level drift, scatter, run-in and
knocks are those of ``tests.support.signals.HealthyMachine``. The lines of a part over the floor scatter, and follow the
resonances that the lines of BPFO cross by a share.

All constants are stated here; ``benchmarks.healthy_hunting`` compares them with blocks of the model six_dof.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.onset import LINES, DetectInput
from tests.support.signals import HealthyMachine

Array = NDArray[np.float64]
MOMENTS = 9
SPEED, LOAD, BPFO = 25.0, 4000.0, 5.6
LOADS = (1.0, 0.8, 0.6)


@dataclass(frozen=True)
class Duty:
    """How speed and load of a machine vary.

    Attributes:
        width: largest deviation of the speed from its mean, as a share of that.
        steps: whether the load steps between ``LOADS``.
    """

    width: float = 0.0
    steps: bool = False


@dataclass(frozen=True, eq=False)
class HuntingMachine:
    """One machine, drawn once.

    Attributes:
        orders: of the lines, shape (line,); those from the fourth on belong to the cage's slip.
        force: of each, shape (line,).
        modes: frequency in Hz, damping and gain, shape (3, mode).
        speed_power: of the force of lines and of the broadband part.
        load_power: of both.
        broadband: RMS of it over that of the lines at full load and mean speed.
        period: of the hunting, blocks.
        dwell: mean number of blocks at one load.
    """

    orders: Array
    force: Array
    modes: Array
    speed_power: tuple[float, float]
    load_power: float
    broadband: float
    period: float
    dwell: float
    levels: HealthyMachine

    @classmethod
    def draw(cls, rng: np.random.Generator) -> HuntingMachine:
        """Draw a machine."""
        orders = np.concatenate((np.arange(1.0, 4.0), BPFO * np.arange(1.0, 21.0)))
        damping = np.exp(rng.uniform(math.log(0.01), math.log(0.05), 6))
        frequency = np.exp(rng.uniform(math.log(100.0), math.log(6000.0), 6))
        return cls(
            orders=orders,
            force=rng.uniform(0.3, 1.0, orders.size) / np.concatenate((np.ones(3), np.arange(1.0, 21.0))),
            modes=np.stack((frequency, damping, rng.uniform(0.3, 1.0, 6))),
            speed_power=(float(rng.uniform(0.0, 2.0)), float(rng.uniform(0.5, 2.5))),
            load_power=float(rng.uniform(0.0, 1.0)),
            broadband=float(np.exp(rng.uniform(math.log(0.5), math.log(2.0)))),
            period=float(np.exp(rng.uniform(math.log(2.0), math.log(400.0)))),
            dwell=float(np.exp(rng.uniform(math.log(10.0), math.log(150.0)))),
            levels=HealthyMachine.draw(rng, SPEED, BPFO * SPEED),
        )

    def course(self, rng: np.random.Generator, duty: Duty, count: int) -> tuple[Array, Array]:
        """Return the speeds at the moments of ``count`` blocks, Hz, shape (block, moment), and their loads, N."""
        turns = np.cumsum((1.0 + 0.3 * rng.standard_normal(count * (MOMENTS - 1) + 1)) / self.period / (MOMENTS - 1))
        speed = SPEED * (1.0 + duty.width * np.sin(2.0 * np.pi * (turns + rng.uniform())))
        places = np.arange(count)[:, None] * (MOMENTS - 1) + np.arange(MOMENTS)
        changes = np.concatenate(([True], rng.uniform(size=count - 1) < 1.0 / self.dwell))
        drawn = rng.choice(LOADS, count) if duty.steps else np.ones(count)
        return speed[places], LOAD * drawn[np.maximum.accumulate(np.where(changes, np.arange(count), 0))]

    def transfer(self, frequency: Array) -> Array:
        """Return |H|^2 at frequencies in Hz."""
        mode, damping, gain = self.modes
        x = frequency[..., None] / mode
        return np.sum(gain**2 * x**4 / ((1.0 - x**2) ** 2 + (2.0 * damping * x) ** 2), axis=-1)

    def law(self, speed: Array, load: Array, slip: Array) -> tuple[Array, Array]:
        """Return ln RMS of blocks, shape (block,), and half ln of the mean of |H|^2 at five lines of BPFO."""
        s, f = speed / SPEED, (load / LOAD)[:, None]
        orders = np.broadcast_to(self.orders, (len(load), self.orders.size)).copy()
        orders[:, 3:] *= 1.0 - slip[:, None]
        gains = self.transfer(orders[:, None, :] * speed[:, :, None])
        lines = np.sum(self.force**2 * gains, axis=-1)
        whole = float(np.sum(self.force**2 * self.transfer(self.orders * SPEED)))
        power = lines / whole * s ** (2.0 * self.speed_power[0]) + self.broadband**2 * s ** (2.0 * self.speed_power[1])
        rms = 0.5 * np.log(np.mean(power * f ** (2.0 * self.load_power), axis=1))
        return rms, 0.5 * np.log(np.mean(gains[:, :, 3:8], axis=(1, 2)))

    def blocks(
        self, rng: np.random.Generator, duty: Duty, count: int, growth: Array | None = None, of_lines: float = 2.0
    ) -> list[DetectInput]:
        """Return what the detector takes of ``count`` blocks.

        Args:
            growth: of ln RMS, shape (block,).
            of_lines: growth of the lines of the outer race over the floor, over that.
        """
        speed, load = self.course(rng, duty, count)
        rms, resonance = self.law(speed, load, 0.005 + 0.003 * rng.standard_normal(count))
        level = np.exp(rms) * self.levels.levels(rng, count)
        level[rng.uniform(size=count) < self.levels.burst_rate] *= rng.uniform(1.5, 20.0)
        follows = rng.uniform(0.0, 0.4, len(LINES))
        lines = 0.12 * rng.standard_normal((count, len(LINES))) + follows * (resonance - resonance.mean())[:, None]
        if growth is not None:
            level = level * np.exp(growth)
            lines[:, 0] += of_lines * growth
        stated = load * (1.0 + 0.01 * rng.standard_normal(count))
        return [
            DetectInput(
                sequence=i + 1,
                time=10.0 * i,
                rms=float(level[i]),
                prominence=dict(zip(LINES, np.exp(lines[i]).tolist(), strict=True)),
                peak=None,
                speed=float(speed[i].mean()),
                speed_range=(float(speed[i].min()), float(speed[i].max())),
                load=float(stated[i]),
            )
            for i in range(count)
        ]

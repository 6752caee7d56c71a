"""A pair of gears whose speed wanders, with what repeats with each wheel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel

RATE = 12800.0


def pair(driver: int = 23, driven: int = 71) -> GearSettings:
    """Return a pair whose driver turns with the bearing's shaft."""
    wheels = (GearWheel("pinion", driver, 1.0), GearWheel("wheel", driven, driver / driven))
    return GearSettings(wheels, (GearPairing("pinion", "wheel"),))


@dataclass(frozen=True)
class Meshing:
    """What a pair gives.

    Attributes:
        noise: standard deviation; a mesh line of order h reads 1/h.
        impact: (wheel, height) of a burst once a turn of it.
        eccentric: (wheel, share) by which the mesh is modulated once a turn of it.
        wander: relative, slow.
    """

    noise: float = 0.3
    impact: tuple[str, float] | None = None
    eccentric: tuple[str, float] | None = None
    wander: float = 3e-4
    speed: float = 29.7
    duration: float = 4.0

    def of(self, gears: GearSettings, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return samples and turns of the bearing's shaft, each (sample,)."""
        rng = np.random.default_rng(seed)
        time = np.arange(round(self.duration * RATE)) / RATE
        phase = rng.uniform(0.0, 6.28, 8)
        speed = self.speed * (1.0 + self.wander * np.sin(2 * np.pi * 0.3 * time + phase[0]))
        turns = np.concatenate(([0.0], np.cumsum(speed)[:-1])) / RATE
        order = gears.mesh_orders()[0]
        x = sum(np.cos(2 * np.pi * order * h * turns + phase[h]) / h for h in (1, 2, 3))
        depth = np.zeros(time.size)
        for wheel in gears.wheels:
            own = 0.02 + (self.eccentric[1] if self.eccentric and self.eccentric[0] == wheel.name else 0.0)
            depth += own * np.cos(2 * np.pi * wheel.turns * turns + phase[4])
        x = x * (1.0 + depth)
        if self.impact is not None:
            wheel = gears.by_name[self.impact[0]]
            at = ((turns * wheel.turns) % 1.0 - 0.4) * wheel.teeth
            x += self.impact[1] * np.exp(-0.5 * (at / 0.3) ** 2) * np.sin(2 * np.pi * 2.4 * at)
        return x + rng.normal(0.0, self.noise, time.size), turns

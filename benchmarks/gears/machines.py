"""Machines with a pair of gears for ``benchmarks/gears/naming.py``: blocks by the model of a train.

A pair is drawn by its seed: teeth, module, masses, stiffness of the mesh and the supports, the errors of a good healthy
pair (eccentricity, pitch errors of single teeth). The train is integrated at one speed over a whole hunting cycle, in
which every tooth meets every other. A block is the acceleration of the driver's body along x by angle, at a speed that
differs from block to block and wanders within, at a level that differs, with white noise: what changes with speed and
load is left out. In the train an eccentric wheel only turns its body by the way that its centre is off; by that way the
mesh is ahead and behind once a turn, which is done to the angle by which a block is read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from models.gears.teeth.mesh import MeshStiffness
from models.gears.train.linear import mesh_mass
from models.gears.train.motion import simulate_train
from models.gears.train.parts import Body, GearTrain, Mesh, Support, Wheel, alike, line_of_action
from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel

TRAINING = range(500)
"""Seeds on which constants may be fitted."""
HEALTHY = range(43_000, 43_040)
"""Machines without damage, set aside before thresholds were chosen; judged once."""
DAMAGED = range(44_000, 44_006)
"""Machines that are damaged in every way and size, likewise."""

Kind = Literal["crack", "spall", "pitch", "eccentric"]
SIZES: dict[Kind, tuple[float, ...]] = {
    "crack": (0.05, 0.1, 0.2, 0.4),
    "spall": (0.05, 0.1, 0.2, 0.4),
    "pitch": (2e-6, 5e-6, 10e-6, 20e-6),
    "eccentric": (10e-6, 20e-6, 40e-6, 80e-6),
}
"""Of a crack: share of the mean mesh stiffness that is lost while the tooth is in contact. Of a spall: share of a pitch
over which 60 % of it are lost. Of a pitch error: displacement of one tooth, m. Of an eccentric wheel: of its centre, m,
beside that of a healthy one."""
RATE, BLOCK_S = 12800.0, 2.5
_PASSAGES = 3.58
"""Balls that pass the damage in one turn of the driver."""
_SAMPLES = 64
_FINER = 4
_ANGLE = math.radians(20.0)


@dataclass(frozen=True)
class Fault:
    """Damage of one wheel; a size of ``SIZES``."""

    wheel: Literal["driver", "driven"]
    kind: Kind
    size: float


@dataclass(frozen=True)
class GearMachine:
    """One machine.

    Attributes:
        seed: draws everything else.
        fault: None for none.
    """

    seed: int
    fault: Fault | None = None

    @cached_property
    def teeth(self) -> tuple[int, int]:
        """Teeth of driver and driven wheel."""
        rng = np.random.default_rng([41, self.seed])
        driver = int(rng.integers(17, 32))
        return driver, max(driver + 1, round(driver * float(rng.uniform(1.2, 3.0))))

    @cached_property
    def settings(self) -> GearSettings:
        """What a configuration knows of the pair."""
        driver, driven = self.teeth
        wheels = (GearWheel("driver", driver, 1.0), GearWheel("driven", driven, driver / driven))
        return GearSettings(wheels, (GearPairing("driver", "driven"),))

    @cached_property
    def speed(self) -> float:
        """Mean speed of the driver, Hz."""
        return float(np.random.default_rng([43, self.seed]).uniform(18.0, 35.0))

    @cached_property
    def noise(self) -> float:
        """Noise over the vibration of the healthy pair."""
        return 10.0 ** (-float(np.random.default_rng([47, self.seed]).uniform(0.0, 15.0)) / 20.0)

    @cached_property
    def train(self) -> GearTrain:
        """The pair with its errors and its fault."""
        rng = np.random.default_rng([53, self.seed])
        module, mean = rng.uniform(2e-3, 5e-3), rng.uniform(3e8, 8e8)
        radii = [0.5 * module * teeth * math.cos(_ANGLE) for teeth in self.teeth]
        masses = [float(np.clip(7800.0 * math.pi * r * r * 10.0 * module, 0.3, 60.0)) for r in radii]
        k = rng.uniform(1e8, 5e8)
        support = (Support("support", alike(k), alike(2.0 * 0.05 * math.sqrt(k * masses[0]))),)
        stiffness = MeshStiffness.rectangular(self.teeth, mean, rng.uniform(0.2, 0.5), rng.uniform(1.3, 1.9), _SAMPLES)
        stiffness = replace(stiffness, **_errors(rng, self.teeth), **_loss(self.fault, stiffness))
        stiffness = _with_fault_error(stiffness, self.fault)
        load = mean * rng.uniform(5e-6, 15e-6) * radii[1]
        bodies = (
            Body("driver", masses[0], 0.5 * masses[0] * radii[0] ** 2, support),
            Body("driven", masses[1], 0.5 * masses[1] * radii[1] ** 2, (replace(support[0], name="b"),), torque=-load),
        )
        wheels = tuple(
            Wheel(name, name, teeth, radius)
            for name, teeth, radius in zip(("driver", "driven"), self.teeth, radii, strict=True)
        )
        line = line_of_action(0.7, _ANGLE, counterclockwise=True)
        back = line_of_action(0.7, _ANGLE, counterclockwise=True, back=True)
        mesh = Mesh("driver", "driven", stiffness, line, back, backlash=1e-4)
        train = GearTrain(bodies, wheels, (mesh,), drive="driver", speed=self.speed)
        damping = 2.0 * rng.uniform(0.03, 0.1) * math.sqrt(mean * mesh_mass(train, mesh))
        return replace(train, meshes=(replace(mesh, damping=damping),))

    @cached_property
    def cycle(self) -> NDArray[np.float64]:
        """Acceleration over a hunting cycle at equal steps of angle, m/s2, shape (sample,)."""
        duration = self.cycle_turns / self.speed
        count = round(2.0 * RATE * duration)
        motion = simulate_train(self.train, duration=duration, rate=count / duration)
        course = motion.of("driver.x", "acceleration")[:count]
        bins = np.fft.rfft(course)
        bins[int(0.45 * RATE * duration) :] = 0.0
        finer = np.zeros(_FINER * count // 2 + 1, dtype=np.complex128)
        finer[: bins.size] = bins
        return np.fft.irfft(finer, _FINER * count, norm="forward") / count

    @property
    def cycle_turns(self) -> int:
        """Turns of the driver after which all repeats."""
        return self.teeth[1] // math.gcd(*self.teeth)

    def _ahead(self, turns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return by how many turns of the driver the mesh is ahead of wheels whose centres are where they should be."""
        rng = np.random.default_rng([61, self.seed])
        pitch = 2.0 * np.pi * self.train.wheels[0].base_radius
        ahead = np.zeros(turns.size)
        for name, teeth in zip(("driver", "driven"), self.teeth, strict=True):
            centre = rng.uniform(2e-6, 10e-6)
            if self.fault is not None and self.fault.kind == "eccentric" and self.fault.wheel == name:
                centre += self.fault.size
            ahead += centre / pitch * np.sin(2.0 * np.pi * (turns * self.teeth[0] / teeth + rng.uniform()))
        return ahead

    def turns(self, number: int) -> NDArray[np.float64]:
        """Return the turns of the driver at the samples of a block, shape (sample,)."""
        return self._turns(np.random.default_rng([59, self.seed, number]))

    def _turns(self, rng: np.random.Generator) -> NDArray[np.float64]:
        time = np.arange(round(RATE * BLOCK_S)) / RATE
        speed = self.speed * (1.0 + 0.005 * rng.normal())
        course = speed * (1.0 + 3e-4 * np.sin(2.0 * np.pi * (rng.uniform(0.1, 0.5) * time + rng.uniform())))
        return rng.uniform(0.0, self.cycle_turns) + np.cumsum(course) / RATE

    def block(self, number: int, healthy: GearMachine | None = None, bearing: float = 0.0) -> NDArray[np.float32]:
        """Return the samples of one block, m/s2.

        Args:
            number: of the block; together with the seed it draws speed, level and noise.
            healthy: the machine before the fault, whose vibration the noise is relative to.
            bearing: RMS of the impacts of a damaged outer race, over that vibration.
        """
        rng = np.random.default_rng([59, self.seed, number])
        turns = self._turns(rng)
        turns += self._ahead(turns)
        place = turns / self.cycle_turns % 1.0 * self.cycle.size
        low = place.astype(np.intp)
        share = place - low
        x = (1.0 - share) * self.cycle[low % self.cycle.size] + share * self.cycle[(low + 1) % self.cycle.size]
        level = float(np.std((healthy or self).cycle))
        x = math.exp(0.05 * rng.normal()) * x + self.noise * level * rng.normal(size=x.size)
        if bearing:
            hits = _impacts(rng, turns)
            x += bearing * level / float(np.std(hits)) * hits
        return x.astype(np.float32)


def _impacts(rng: np.random.Generator, turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return bursts at the passages of balls, whose times scatter by a hundredth of their distance."""
    passages = np.arange(math.ceil(turns[0] * _PASSAGES), turns[-1] * _PASSAGES)
    at = np.interp((passages + 0.01 * rng.normal(size=passages.size)) / _PASSAGES, turns, np.arange(turns.size))
    hits = np.zeros(turns.size)
    np.add.at(hits, at.astype(np.intp), 1.0 + 0.1 * rng.normal(size=passages.size))
    time = np.arange(256) / RATE
    return np.convolve(hits, np.exp(-900.0 * time) * np.sin(2.0 * np.pi * 3100.0 * time))[: turns.size]


def _errors(rng: np.random.Generator, teeth: tuple[int, int]) -> dict[str, NDArray[np.float64]]:
    """Return the errors of single teeth of a healthy pair over a turn of each wheel, m."""
    names = ("driver_error", "driven_error")
    return {name: _by_tooth(rng.normal(0.0, 1e-6, count)) for name, count in zip(names, teeth, strict=True)}


def _by_tooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values of teeth over a turn, each from the middle of a pitch to that of the next, with eased steps."""
    place = np.arange(values.size * _SAMPLES) / _SAMPLES
    low = place.astype(np.intp)
    eased = 0.5 - 0.5 * np.cos(np.pi * np.clip((place - low - 0.4) / 0.2, 0.0, 1.0))
    return (1.0 - eased) * values[low] + eased * values[(low + 1) % values.size]


def _loss(fault: Fault | None, stiffness: MeshStiffness) -> dict[str, NDArray[np.float64]]:
    if fault is None or fault.kind not in ("crack", "spall"):
        return {}
    count = stiffness.driver_teeth if fault.wheel == "driver" else stiffness.driven_teeth
    lost = np.zeros(count * _SAMPLES)
    if fault.kind == "crack":
        reach = round(1.5 * _SAMPLES)
        lost[:reach] = fault.size * stiffness.mean * np.sin(np.pi * (np.arange(reach) + 0.5) / reach)
    else:
        lost[: max(1, round(fault.size * _SAMPLES))] = 0.6 * stiffness.mean
    return {f"{fault.wheel}_loss": lost}


def _with_fault_error(stiffness: MeshStiffness, fault: Fault | None) -> MeshStiffness:
    if fault is None or fault.kind != "pitch":
        return stiffness
    name = f"{fault.wheel}_error"
    error = getattr(stiffness, name)
    teeth = np.zeros(error.size // _SAMPLES)
    teeth[3] = fault.size
    return replace(stiffness, **{name: error + _by_tooth(teeth)})

"""Bounds of the error of a model that stands for another, looked up from dimensionless groups of the scene.

Each is a product of powers of the groups, fitted to the true errors of random scenes, of which it covers 98 %
(``benchmarks/scenes_fit.py``). Outside of the groups' ranges none is known. The root mean square may agree by chance
where waveforms differ, so that its bounds are the widest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from models.machine.bearing import kinematics
from models.solve.mappings.ring import approach_of, bearing_stiffness, ring_of, with_balls
from models.solve.rotor.rig import RotorRig

if TYPE_CHECKING:
    from models.machine.scene import Scene
    from models.words.request import Quantity

Groups = dict[str, float]
# Added to a clearance over the approach, so that none has a logarithm.
_NO_CLEARANCE = 0.03
# A range of groups is believed beyond its ends by this factor.
_BEYOND = 1.05


@dataclass(frozen=True)
class Bound:
    """A bound constant * prod group ** power.

    Attributes:
        constant: with the margin for the scenes that it was fitted to.
        powers: of the groups, in their order.
    """

    constant: float
    powers: tuple[float, ...]

    def of(self, groups: Groups) -> float:
        """Return the bound of a scene."""
        logs = (power * math.log(group) for power, group in zip(self.powers, groups.values(), strict=True))
        return self.constant * math.exp(sum(logs))


@dataclass(frozen=True)
class Bounds:
    """Bounds of each quantity, from scenes whose groups are within ranges.

    Attributes:
        rms, waveform, lines: of these.
        ranges: of the groups, in their order.
        vanishing: number of first groups with which the error vanishes: below their ranges that of the ends holds.
    """

    rms: Bound
    waveform: Bound
    lines: Bound
    ranges: tuple[tuple[float, float], ...]
    vanishing: int = 1

    def look_up(self, groups: Groups, quantity: Quantity) -> float:
        """Return the bound of a quantity; raise a ValueError that names a group outside of its range."""
        known = dict(groups)
        for k, ((name, value), (low, high)) in enumerate(zip(groups.items(), self.ranges, strict=True)):
            if k < self.vanishing and value < low:
                known[name] = low
            elif not low / _BEYOND <= value <= high * _BEYOND:
                raise ValueError(f"{name} is {value:.3g}, its error is known from {low:.3g} to {high:.3g}")
        return {"waveform": self.waveform, "lines": self.lines}.get(quantity, self.rms).of(known)


def groups_of_balls(scene: Scene) -> Groups:
    """Return what decides on the error of massless balls."""
    ring = ring_of(scene)
    pressed, heavier = with_balls(scene, ring)
    approach, stiffness = approach_of(scene, ring), bearing_stiffness(scene, ring.k_c, abs(ring.force))
    natural = math.sqrt(stiffness / ring.mass)
    loaded = 2.0 * math.acos(scene.clearance / (scene.clearance + approach)) * scene.bearing.n_elements / math.tau
    return {
        "gap of unloaded balls over the approach": (pressed.clearance - scene.clearance) / approach,
        "mass of the balls over that of the ring": heavier.mass / ring.mass - 1.0,
        "clearance over the approach": scene.clearance / approach + _NO_CLEARANCE,
        "damping ratio": loaded * ring.damping / (4.0 * natural * ring.mass),
        "loaded balls": loaded,
        "ball-pass over natural frequency": math.tau * kinematics(scene.bearing, scene.speed).bpfo / natural,
    }


def groups_of_shaft(scene: Scene) -> Groups:
    """Return what decides on the error of a rigid shaft."""
    rig = scene.rig_as(RotorRig)
    stiffness = bearing_stiffness(scene, rig.k_c, 0.5 * scene.load)
    natural = math.sqrt(2.0 * stiffness / (rig.m + 2.0 * rig.end_mass))
    return {
        "stiffness of bearings over that of the shaft": max(stiffness / spring for spring in rig.shaft_stiffness),
        "ball-pass over natural frequency": math.tau * kinematics(scene.bearing, scene.speed).bpfo / natural,
        "mass of an end over that of the disc": rig.end_mass / rig.m,
        "damping ratio": scene.bearing.n_elements * rig.c_b / (4.0 * natural * rig.m),
        "clearance over the deflection": scene.clearance * stiffness / max(scene.load, 1e-9) + _NO_CLEARANCE,
    }

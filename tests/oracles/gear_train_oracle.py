"""A train of gears by scipy's DOP853, wheel by wheel, with the flanks' contacts as events: slow and obvious.

Nothing but the description of the train is shared with ``models/gears/train/kernel.py``: forces and torques are added
up body by body, without matrices; each interval between samples of the tables is integrated by itself, and within it
each interval between changes of contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from models.gears.train.parts import GearTrain, Mesh


@dataclass
class _Flanks:
    """One pair of flanks of a mesh: ``sense`` 1 of those that drive, -1 of the others."""

    mesh: Mesh
    sense: int
    touching: bool = False


class Oracle:
    """One run; the state is (x, y, angle, their rates) of each body, whether it may move or not."""

    def __init__(self, train: GearTrain) -> None:
        """Take a train whose speed is constant."""
        assert train.acceleration == 0.0
        self.train, self.ratios, self.torques = train, train.ratios(), train.torques()
        self.index = {body.name: k for k, body in enumerate(train.bodies)}
        self.flanks = [_Flanks(mesh, sense) for mesh in train.meshes for sense in (1, -1)]
        self.evaluations = 0

    def turns(self, mesh: Mesh, t: float) -> tuple[float, float]:
        """Turns of both wheels."""
        driver, driven = self.train.wheel(mesh.driver), self.train.wheel(mesh.driven)
        return (
            mesh.driver_start + self.ratios[driver.body] * self.train.speed * t,
            mesh.driven_start + self.ratios[driven.body] * self.train.speed * t,
        )

    def course(self, mesh: Mesh, t: float) -> tuple[float, float]:
        """Stiffness and error at a time."""
        k, e = mesh.stiffness.at(*self.turns(mesh, t))
        return float(k), float(e)

    def interval(self, mesh: Mesh, begin: float, end: float) -> tuple[float, float, float, float]:
        """Stiffness and error at ``begin``, and their rates, from two instants within an interval of the tables."""
        one, two = (begin + share * (end - begin) for share in (0.25, 0.75))
        (k1, e1), (k2, e2) = self.course(mesh, one), self.course(mesh, two)
        k_rate, e_rate = (k2 - k1) / (two - one), (e2 - e1) / (two - one)
        return k1 - k_rate * (one - begin), k_rate, e1 - e_rate * (one - begin), e_rate

    def approach(self, flanks: _Flanks, z: np.ndarray) -> tuple[float, float, np.ndarray]:
        """Approach of the wheels at a pair of flanks without errors, its rate, and the direction."""
        mesh = flanks.mesh
        if flanks.sense > 0:
            angle = mesh.line_of_action
        else:
            angle = mesh.line_of_action + math.pi if mesh.back_line is None else mesh.back_line
        direction = np.array([math.cos(angle), math.sin(angle)])
        found = []
        for part in (0, 3):
            value = 0.0
            for name, sign in ((mesh.driver, 1.0), (mesh.driven, -1.0)):
                wheel = self.train.wheel(name)
                body = z[6 * self.index[wheel.body] + part :][:3]
                value += sign * (direction @ body[:2]) + sign * flanks.sense * wheel.base_radius * body[2]
            found.append(value)
        return found[0], found[1], direction

    def gap(self, flanks: _Flanks, z: np.ndarray, error: float) -> float:
        """How far a pair of flanks overlaps."""
        back = flanks.mesh.backlash if flanks.sense < 0 else 0.0
        return self.approach(flanks, z)[0] - flanks.sense * error - back

    def rates(self, t: float, z: np.ndarray, begin: float, courses: dict[str, Any]) -> np.ndarray:
        """Time derivative of the state, with the contacts as they are."""
        self.evaluations += 1
        force = np.zeros((len(self.train.bodies), 3))
        for body in self.train.bodies:
            k = self.index[body.name]
            x, v = z[6 * k : 6 * k + 3], z[6 * k + 3 : 6 * k + 6]
            for support in body.supports:
                force[k, :2] -= np.array(support.stiffness) @ x[:2] + np.array(support.damping) @ v[:2]
            force[k, 2] += self.torques[body.name] - body.speed_damping * v[2]
        for spring in self.train.torsions:
            a, b = self.index[spring.first], self.index[spring.second]
            torque = spring.stiffness * (z[6 * a + 2] - z[6 * b + 2]) + spring.damping * (z[6 * a + 5] - z[6 * b + 5])
            force[a, 2] -= torque
            force[b, 2] += torque
        for flanks in self.flanks:
            mesh = flanks.mesh
            others = [f.touching for f in self.flanks if f.mesh is mesh]
            film = mesh.damps_without_contact and not any(others) and flanks.sense > 0
            if not (flanks.touching or film):
                continue
            k0, k_rate, e0, e_rate = courses[mesh.name]
            way, rate, direction = self.approach(flanks, z)
            error = e0 + e_rate * (t - begin)
            back = mesh.backlash if flanks.sense < 0 else 0.0
            push = mesh.damping * (rate - flanks.sense * e_rate)
            if flanks.touching:
                push += (k0 + k_rate * (t - begin)) * (way - flanks.sense * error - back)
            for name, sign in ((mesh.driver, -1.0), (mesh.driven, 1.0)):
                wheel = self.train.wheel(name)
                force[self.index[wheel.body], :2] += sign * push * direction
                force[self.index[wheel.body], 2] += sign * push * flanks.sense * wheel.base_radius
        out = np.zeros_like(z)
        for body in self.train.bodies:
            k = self.index[body.name]
            out[6 * k : 6 * k + 3] = z[6 * k + 3 : 6 * k + 6]
            if body.translates:
                out[6 * k + 3 : 6 * k + 5] = force[k, :2] / body.mass
            if body.rotates:
                out[6 * k + 5] = force[k, 2] / body.inertia
        return out

    def instants(self, duration: float) -> list[float]:
        """Instants at which a mesh passes a sample of its tables."""
        found = {0.0, duration}
        for mesh in self.train.meshes:
            wheel = self.train.wheel(mesh.driver)
            rate = self.ratios[wheel.body] * self.train.speed * wheel.teeth * mesh.stiffness.samples
            first = mesh.driver_start * wheel.teeth * mesh.stiffness.samples
            found |= {(n - first) / rate for n in range(math.ceil(first), math.ceil(first + rate * duration) + 1)}
        ordered = sorted(t for t in found if 0.0 <= t <= duration)
        return [t for t, after in zip(ordered, [*ordered[1:], math.inf], strict=True) if after - t > 1e-12 * duration]

    def event(self, flanks: _Flanks, begin: float, course: tuple[float, float, float, float]) -> Any:
        """Return the event of a change of contact from what it is."""
        _, _, e0, e_rate = course

        def wrong(time: float, z: np.ndarray) -> float:
            gap = self.gap(flanks, z, e0 + e_rate * (time - begin))
            return -gap if flanks.touching else gap

        event: Any = wrong
        event.terminal, event.direction = True, 1.0
        return event

    def run(self, state: np.ndarray, duration: float, rtol: float, max_step: float) -> np.ndarray:
        """Return the state after a time; contacts touch at first where flanks overlap.

        Two changes within a step of ``max_step`` are not seen.
        """
        z = np.array(state, dtype=float)
        for flanks in self.flanks:
            gap = self.gap(flanks, z, self.course(flanks.mesh, 0.0)[1])
            flanks.touching = gap > 0.0 or (flanks.mesh.backlash == 0.0 and flanks.sense > 0)
        watched = [
            f for f in self.flanks if f.mesh.backlash > 0.0 and not (f.sense < 0 and math.isinf(f.mesh.backlash))
        ]
        instants = self.instants(duration)
        for begin, end in pairwise(instants):
            courses = {mesh.name: self.interval(mesh, begin, end) for mesh in self.train.meshes}

            t = begin
            while t < end:
                found = solve_ivp(
                    lambda s, y, b=begin, c=courses: self.rates(s, y, b, c),
                    (t, end),
                    z,
                    method="DOP853",
                    events=[self.event(flanks, begin, courses[flanks.mesh.name]) for flanks in watched],
                    max_step=max_step,
                    rtol=rtol,
                    atol=rtol * 1e-6,
                )
                assert found.success, found.message
                t, z = float(found.t[-1]), found.y[:, -1]
                for flanks, times in zip(watched, found.t_events or [], strict=True):
                    if len(times):
                        flanks.touching = not flanks.touching
        return z

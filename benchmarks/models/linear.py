"""Impacts on rings, a linear model: cost and error beside scipy's methods for linear systems.

All compute the acceleration of the outer ring under the same pulses, from rest. Ours is compared with DOP853 in plain
Python, cut at both ends of each pulse (relative tolerance 1e-11), over the first 0.05 s; the others, which place pulses
at their samples, with ours over a second. Errors are RMS of the difference over RMS.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from itertools import pairwise
from typing import Any, cast

import numba
import numpy as np
from scipy import signal
from scipy.integrate import solve_ivp

from benchmarks.common import Row, interleaved_ms
from benchmarks.models.problem import Floats, Setting
from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Part, Scene
from models.solve.ring_impact.hits import hits_on
from models.solve.ring_impact.kernel import RECTANGLE, Pulses, Turn, add_response
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.ring_impact.solver import films, matrices, modes_of
from tests.oracles import ring_impact_oracle as oracle

MODEL = "ring_impact"
RATE = 48000.0
PARTS: tuple[Part, ...] = ("outer", "ball", "inner")
SETTINGS = (Setting("DOP853", 1e-9), Setting("DOP853", 1e-10), Setting("DOP853", 1e-11), Setting("LSODA", 1e-11))
_COMPARED = 0.05
_STILL = Turn(0.0, 0.0)


def scene_of(part: Part) -> Scene:
    """Return 6205 at 1750 rpm with a defect that is not hit at a sample."""
    return Scene(
        1750.0 / 60.0,
        1000.0,
        bearing=from_catalogue("6205"),
        rig=RingImpactRig(),
        defect=Defect(0.03, 1e-3, position=0.1, part=part),
    )


class Impacts:
    """One defect with its pulses over a second."""

    def __init__(self, part: Part) -> None:
        """Find hits and modes."""
        self.part, self.scene = part, scene_of(part)
        hits = hits_on(self.scene, 0, 0.0, 1.0)
        width = self.scene.rig_as(RingImpactRig).pulse_width
        self.pulses, self.modes = Pulses(hits.start, hits.force, width, RECTANGLE), modes_of(self.scene, part)
        mass, damping, stiffness = matrices(self.scene)
        inverse = np.linalg.inv(mass)
        self.a = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ stiffness, -inverse @ damping]])
        self.b = np.zeros((6, 1))
        self.b[3:, 0] = inverse[:, PARTS.index(part)]

    def ours(self, oversampling: int, seconds: float) -> Callable[[], Floats]:
        """Return the work of the kernel."""
        n, modes = round(seconds * RATE * oversampling), self.modes
        scratch = np.empty((3, len(modes.rate)), np.complex128)

        def work() -> Floats:
            wave = np.zeros(n)
            add_response(wave, 1.0 / (RATE * oversampling), modes, self.pulses, _STILL, scratch)
            return wave

        return work

    def system(self) -> signal.StateSpace:
        """Return the system from the force on the part to the acceleration of the outer ring."""
        return signal.StateSpace(self.a, self.b, self.a[3:4], self.b[3:4])

    def sampled(self, oversampling: int) -> tuple[Floats, Floats]:
        """Return times and force at the samples of a second."""
        t = np.arange(round(RATE * oversampling)) / (RATE * oversampling)
        force = np.zeros(len(t))
        for start, height in zip(self.pulses.start, self.pulses.force, strict=True):
            first, last = np.searchsorted(t, (start, start + self.pulses.width))
            force[first:last] += height
        return t, force

    def lsim(self, oversampling: int, *, interpolated: bool) -> Callable[[], Floats]:
        """Return the work of scipy.signal.lsim."""
        system, (t, force), run = self.system(), self.sampled(oversampling), cast("Any", signal.lsim)
        return lambda: run(system, force, t, interp=interpolated)[1]

    def filtered(self, oversampling: int) -> Callable[[], Floats]:
        """Return the work of a zero-order hold and scipy.signal.sosfilt, the fastest that scipy has on a grid."""
        held = cast("Any", self.system()).to_discrete(1.0 / (RATE * oversampling), "zoh")
        with warnings.catch_warnings():
            # The numerator begins with nearly nothing where the force reaches the sensor through other masses.
            warnings.simplefilter("ignore", signal.BadCoefficients)
            zeros, poles, gain = signal.ss2zpk(held.A, held.B, held.C, held.D)
        sections, (_, force) = signal.zpk2sos(zeros, poles, gain), self.sampled(oversampling)
        run = cast("Any", signal.sosfilt)
        return lambda: run(sections, force)

    def driven(self) -> list[tuple[float, float]]:
        """Return the pulses of the compared time."""
        pulses = zip(self.pulses.start, self.pulses.force, strict=True)
        return [(float(t), float(f)) for t, f in pulses if t < _COMPARED]

    def plain(self) -> Floats:
        """Return the acceleration by DOP853 in plain Python, cut at the pulses."""
        rig, (outer, inner) = self.scene.rig_as(RingImpactRig), films(self.scene)
        machine = oracle.Machine(
            rig.m_o,
            rig.element_mass(self.scene.bearing),
            rig.m_i,
            rig.k_o,
            outer.stiffness,
            inner.stiffness,
            rig.k_i,
            outer.damping,
            inner.damping,
            rig.pulse,
            rig.pulse_width,
        )
        return oracle.motion(machine, PARTS.index(self.part), self.driven(), times())[2]

    def compiled(self, setting: Setting) -> Floats:
        """Return the acceleration by a method of ``solve_ivp`` on compiled equations, cut at the pulses."""
        at, width, driven = times(), self.pulses.width, self.driven()
        edges = sorted({0.0, float(at[-1]) + 1e-9, *(t for t, _ in driven), *(t + width for t, _ in driven)})
        state, out = np.zeros(6), np.empty(len(at))
        for low, high in pairwise(edges):
            middle = 0.5 * (low + high)
            push = self.b[:, 0] * sum(f for t, f in driven if t < middle < t + width)
            here = np.flatnonzero((at >= low) & (at < high))
            found = solve_ivp(
                lambda t, y, push=push: _linear_rate(self.a, push, y),
                (low, high),
                state,
                cast("Any", setting.method),
                t_eval=[*at[here], high],
                rtol=setting.tolerance,
                atol=1e-7 * setting.tolerance,
            )
            out[here] = self.a[3] @ found.y[:, :-1] + push[3]
            state = found.y[:, -1]
        return out


@cast("Any", numba.njit)(cache=False)
def _linear_rate(a: Floats, push: Floats, y: Floats) -> Floats:
    """Return a y + push."""
    out = push.copy()
    for i in range(6):
        for j in range(6):
            out[i] += a[i, j] * y[j]
    return out


def times() -> Floats:
    """Return the samples of the compared time, s."""
    return np.arange(round(_COMPARED * RATE), dtype=np.float64) / RATE


def difference(wave: Floats, reference: Floats) -> float:
    """Return the RMS of a difference over that of the reference."""
    return math.sqrt(float(np.mean((wave - reference) ** 2) / np.mean(reference**2)))


def against(part: Part, *, quick: bool) -> tuple[Row, list[Row]]:
    """Return the kernel beside scipy's integrators and plain Python, and beside its methods for linear systems."""
    impacts, rounds = Impacts(part), 3 if quick else 9
    truth, exact = impacts.plain(), impacts.ours(1, 1.0)()
    error = difference(impacts.ours(1, _COMPARED)(), truth)
    ours = {factor: _timed(impacts.ours(factor, 1.0), rounds) for factor in (1, 8)}
    best: tuple[Setting, float, float] | None = None
    _linear_rate(impacts.a, impacts.b[:, 0], np.zeros(6))
    for setting in SETTINGS[2:3] if quick else SETTINGS:
        # Against ours, which is exact: the reference's own tolerance is no better.
        missed = difference(impacts.compiled(setting), exact[: len(truth)])
        took = _timed(lambda s=setting: impacts.compiled(s), 1) / _COMPARED
        if missed <= max(error, 1e-9) and (best is None or took < best[2]):
            best = setting, missed, took
    plain = _timed(impacts.plain, 1) / _COMPARED
    name = f"defect of the {part} race" if part != "ball" else "defect of an element"
    row: Row = {
        "model": MODEL,
        "scene": name,
        "step us": 1e6 / RATE,
        "error": error,
        "peak error": None,
        "ms per s": ours[1],
        "scipy": None if best is None else f"{best[0]}, cut at the pulses",
        "scipy error": None if best is None else best[1],
        "error there": error,
        "scipy ms per s": None if best is None else best[2],
        "times scipy": None if best is None else best[2] / ours[1],
        "plain ms per s": plain,
        "times plain": plain / ours[1],
        "prototype ms per s": None,
        "share of prototype": None,
    }
    return row, _linear_methods(impacts, ours, exact, error, rounds, quick=quick)


def _linear_methods(
    impacts: Impacts, ours: dict[int, float], exact: Floats, error: float, rounds: int, *, quick: bool
) -> list[Row]:
    rows: list[Row] = []

    def add(method: str, factor: int, missed: float, took: float) -> None:
        rows.append(
            {
                "defect": impacts.part,
                "method": method,
                "grid": f"{factor} x 48 kHz",
                "error": missed,
                "ms per s": took,
                "times the kernel": took / ours[factor],
            }
        )

    for factor in (1, 8):
        add("kernel", factor, error, ours[factor])
        work = impacts.filtered(factor)
        add("zero-order hold, sosfilt", factor, difference(work()[::factor], exact), _timed(work, rounds))
        if quick and factor > 1:
            continue
        for interpolated in (False, True):
            work = impacts.lsim(factor, interpolated=interpolated)
            name = "lsim, linear" if interpolated else "lsim, zero-order hold"
            add(name, factor, difference(work()[::factor], exact), _timed(work, 1))
    return rows


def _timed(work: Callable[[], object], rounds: int) -> float:
    return interleaved_ms({"work": work}, rounds)["work"]

"""Jumps of a pair of gears that loses contact: the solver in time against an independent harmonic balance.

python -m benchmarks.gear_jump [--quick] [--json FILE] [--picture FILE]

The mesh frequency of a pair is swept up and down in small steps, each from where the last one ended. The balance
(tests/oracles/gear_harmonic_balance.py) follows all periodic motions by arc length: a sweep must jump at its folds, and
between them lie on its stable motions. The oracle shares no code with the solver.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from models.gears.teeth.geometry import GearPair, ToothedWheel
from models.gears.teeth.mesh import MeshStiffness
from models.gears.teeth.stiffness import mesh_stiffness
from models.gears.train.motion import TrainState, simulate_train
from models.gears.train.parts import Body, GearTrain, Mesh, Wheel
from tests.oracles.gear_harmonic_balance import Balance, Motion, Pair, root_mean_square

Array = NDArray[np.float64]

TEETH = 50
MODULE, WIDTH, TORQUE = 3e-3, 20e-3, 150.0
BASE_RADIUS = 0.5 * TEETH * MODULE * math.cos(math.radians(20.0))
INERTIA = 0.5 * 7850.0 * math.pi * (0.5 * TEETH * MODULE) ** 4 * WIDTH
MEAN_STIFFNESS = 5e8
HALF_BACKLASH = 50e-6
"""Two wheels of 50 teeth, 20 mm wide, as in the tests of Kahraman & Blankenship (1997), N m and m: but for the
stiffness of the teeth, results without dimensions do not hang on them."""
MASS = INERTIA / (2.0 * BASE_RADIUS**2)
NATURAL = math.sqrt(MEAN_STIFFNESS / MASS)
SAMPLES = 128
PER_PERIOD = 5 * SAMPLES
"""Between the samples of the tables too: at them the error is exact, and between them its first harmonic is less."""
KEPT = 4
"""Spread of the periods from which a motion counts as one of twice the period."""
"""Spread of the periods below which a motion repeats with the mesh."""
"""Change of the RMS from one step to the next, over the RMS, that counts as a jump beside its trend."""


@dataclass(frozen=True)
class Case:
    """A pair without dimensions, as in the oracle, and the sweep.

    Attributes:
        name: of the case.
        error: amplitude E of the first harmonic of the error.
        stiffness: harmonics of the stiffness over its mean; None for that of the teeth under ``TORQUE``.
        sweep: least and highest frequency.
        step: of the frequency.
        settle: periods of the mesh after each step.
        most: longest arc length of the branch.
    """

    name: str
    zeta: float
    force: float
    error: float
    stiffness: tuple[float, ...] | None
    sweep: tuple[float, float]
    step: float = 0.002
    settle: int = 150
    most: float = 0.02


@cache
def of_teeth() -> tuple[MeshStiffness, float]:
    """Return stiffness of the teeth under ``TORQUE``, N/m, and their static deflection over half the backlash."""
    wheel = ToothedWheel(TEETH, face_width=WIDTH, hub_radius=0.02)
    force = TORQUE / BASE_RADIUS
    found = mesh_stiffness(GearPair(wheel, wheel, MODULE), force, samples=SAMPLES)
    return found.scaled_to(MEAN_STIFFNESS), force / (found.mean * HALF_BACKLASH)


CASES = (
    Case("error", 0.05, 0.1, 0.05, (), (0.6, 1.0)),
    Case("stiffness", 0.05, 0.1, 0.0, (0.35, 0.1), (0.6, 1.0)),
    Case("error and stiffness", 0.05, 0.1, -0.03, (0.2,), (0.6, 1.0)),
    Case("stiffness of the teeth", 0.04, of_teeth()[1], 0.0, None, (0.65, 1.05)),
    Case("both flanks", 0.1, 0.5, 0.8, (), (0.58, 1.1)),
)
"""The first is F_m = 0.1, F_ah = 0.05, zeta = 0.05, commonly attributed to Kahraman & Singh (1990); not at hand."""


def table(case: Case) -> MeshStiffness:
    """Return stiffness and error of a case as tables, N/m and m."""
    if case.stiffness is None:
        return of_teeth()[0]
    found = MeshStiffness.harmonic(
        (TEETH, TEETH), MEAN_STIFFNESS, [share * MEAN_STIFFNESS for share in case.stiffness], samples=SAMPLES
    )
    wave = np.cos(2.0 * math.pi * np.arange(SAMPLES) / SAMPLES) * case.error * HALF_BACKLASH
    return found if case.error == 0.0 else replace(found, driver_error=np.tile(wave, TEETH))


def oracle(case: Case) -> Pair:
    """Return the same without dimensions, with the first harmonic that straight lines between samples leave."""
    places = np.arange(SAMPLES + 1) / SAMPLES
    if case.stiffness is None:
        base = of_teeth()[0].base / MEAN_STIFFNESS
        values = np.append(base, base[0])
    else:
        waves = [share * np.cos(2.0 * math.pi * j * places) for j, share in enumerate(case.stiffness, 1)]
        values = np.sum([np.ones_like(places), *waves], axis=0)

    def stiffness(phase: Array) -> Array:
        return np.interp(phase, places, values)

    return Pair(case.zeta, case.force, ((case.error * np.sinc(1.0 / SAMPLES) ** 2, 0.0),), stiffness)


def train(case: Case, frequency: float) -> GearTrain:
    """Return the train of a case at a mesh frequency over the natural frequency."""
    load = case.force * MEAN_STIFFNESS * HALF_BACKLASH * BASE_RADIUS
    return GearTrain(
        bodies=(
            Body("first", inertia=INERTIA, translates=False),
            Body("second", inertia=INERTIA, translates=False, torque=-load),
        ),
        wheels=(Wheel("a", "first", TEETH, BASE_RADIUS), Wheel("b", "second", TEETH, BASE_RADIUS)),
        meshes=(
            Mesh(
                "a",
                "b",
                table(case),
                0.0,
                damping=2.0 * case.zeta * math.sqrt(MEAN_STIFFNESS * MASS),
                backlash=2.0 * HALF_BACKLASH,
                damps_without_contact=True,
            ),
        ),
        drive="first",
        speed=frequency * NATURAL / (2.0 * math.pi * TEETH),
    )


@dataclass(frozen=True)
class Point:
    """A step of a sweep in time.

    Attributes:
        rms: of the deflection about its mean.
        apart: share of the time without contact.
        spread: largest difference between periods of the mesh, over the range of the deflection.
    """

    frequency: float
    rms: float
    apart: float
    spread: float


def sweep(case: Case, frequencies: Array, start: TrainState | None = None) -> tuple[list[Point], TrainState | None]:
    """Return the steps of a sweep in time, each from where the last one ended, and the last state."""
    found: list[Point] = []
    for frequency in frequencies:
        here = train(case, float(frequency))
        mesh = here.mesh_frequencies()["a-b"]
        settled = simulate_train(here, duration=1.0 / mesh, rate=mesh, settle=case.settle / mesh, start=start)
        rate = PER_PERIOD * mesh
        kept = simulate_train(here, duration=KEPT / mesh + 1.0 / rate, rate=rate, settle=0.0, start=settled.end)
        start = kept.end
        periods = (kept.mesh_displacement[:-1, 0] / HALF_BACKLASH).reshape(KEPT, PER_PERIOD)
        spread = float(np.abs(periods - periods[0]).max() / np.ptp(periods))
        found.append(Point(float(frequency), float(periods.std()), float(kept.out_of_contact[0]), spread))
    return found, start


def nearest_stable(balance: Balance, branch: list[Motion], points: list[Point]) -> list[Motion | None]:
    """Return the stable motion of a branch that is nearest to each step of a sweep, None where there is none."""
    found: list[Motion | None] = []
    for point in points:
        candidates: list[Motion] = []
        for before, after in itertools.pairwise(branch):
            low, high = sorted((before.frequency, after.frequency))
            if not low <= point.frequency <= high:
                continue
            share = (point.frequency - before.frequency) / (after.frequency - before.frequency)
            guess = before.coefficients + share * (after.coefficients - before.coefficients)
            # Next to a fold the guess may lead nowhere.
            with contextlib.suppress(RuntimeError):
                candidates.append(balance.motion(point.frequency, guess))
        stable = [motion for motion in candidates if motion.stable]
        found.append(min(stable, key=lambda motion: abs(root_mean_square(motion) - point.rms), default=None))
    return found

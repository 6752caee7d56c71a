"""Simulated lives of bearings: growth of damage, and the features of each block.

A life is one bearing from the onset of its damage to beyond the largest V_eq of interest. Each block is simulated at
its own extent and depth of the defect, without a map. Features are those of ``monitor.health.signal.features``.

A life depends on the population and its number alone, so lives can be simulated in any order by any number of workers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.lives.laws import GrowthPath, draw_law, grow
from models.lives.population import Population, Range
from models.machine.bearing import kinematics
from models.machine.rig import Rig, RigParameters
from models.machine.scene import Defect, Floor, Scene, Slip
from models.path.defect import race_radius
from models.solve.response import HARMONICS
from models.work.runner import SERIAL
from models.work.task import Work

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.maps.nodes import Progress
    from models.work.runner import Runner

# Length of a life over the time to reach the largest V_eq of interest.
_BEYOND = 1.35
# Groups of blocks of a life with slip, each at a speed of its own: so many, fewer where they would have fewer blocks
# than the next number, more where they would have more than are simulated side by side
# (models.solve.six_dof.kernels.lanes.LANES).
_GROUPS, _FEWEST = 4, 8
_LANES = 32
# Bytes of a life beside the program, at most.
_MEMORY = 64_000_000
# Seconds of a block, and of one by another model; roughly.
_BLOCK_SECONDS, _MODEL_SECONDS = 2e-3, 0.1


@dataclass(frozen=True, eq=False)
class LifePlan:
    """The draws of a life, SI units.

    Attributes:
        clearance: radial clearance, m.
        slip: largest slip angle, rad.
        h_threshold: depth where V_eq is the population's threshold, m.
        depth_share: share of ln V_eq that ln h_d takes.
        harmonic_gain: further factor on each harmonic, shape (6,).
        background_rms, background_harmonic: RMS of background vibration, and its amplitude at each harmonic, m/s2.
    """

    number: int
    law: str
    path: GrowthPath
    rig: RigParameters
    clearance: float
    floor: Floor
    load: float
    speed: float
    slip: float
    h_threshold: float
    depth_share: float
    gain: float
    harmonic_gain: NDArray[np.float64]
    background_rms: float
    background_harmonic: float

    def defects(self, t: NDArray[np.float64], threshold: float, race: float) -> list[Defect]:
        """Return the defect at times since the onset, s; it has depth ``h_threshold`` where V_eq is ``threshold``."""
        v_eq = self.path.at(t)
        h_d = self.h_threshold * (v_eq / threshold) ** self.depth_share
        return [Defect(float(v / (race * h)), float(h), self.floor) for v, h in zip(v_eq, h_d, strict=True)]


@dataclass(frozen=True, eq=False)
class LifeHistory:
    """Measured features of one life, and the truth. SI units; n blocks, missing ones are absent.

    Attributes:
        t: time of each block since the onset, s, shape (n,).
        load, speed: radial load, N, and shaft speed, Hz, known to the monitor, shape (n,).
        rms: measured RMS in the population's band, m/s2, shape (n,).
        harmonics: measured amplitudes of BPFO harmonics 1..6, m/s2, shape (n, 6); 0 where one is outside the band.
        v_eq, dphi_d, h_d: true volume per width, m2, extent, rad, and depth, m, shape (n,).
        path: true V_eq between the blocks and beyond the last.
    """

    number: int
    law: str
    t: NDArray[np.float64]
    load: NDArray[np.float64]
    speed: NDArray[np.float64]
    rms: NDArray[np.float64]
    harmonics: NDArray[np.float64]
    v_eq: NDArray[np.float64]
    dphi_d: NDArray[np.float64]
    h_d: NDArray[np.float64]
    path: GrowthPath

    def crossing(self, threshold: float) -> float:
        """Return when V_eq first reaches a threshold (m2), s since the onset, between blocks too; infinity if never."""
        return self.path.crossing(threshold)


def _uniform_ln(rng: np.random.Generator, limits: Range) -> float:
    return math.exp(rng.uniform(math.log(limits[0]), math.log(limits[1])))


def draw_life(population: Population, number: int) -> LifePlan:
    """Return the draws of a life without simulating it; ``number`` is not negative."""
    rng = np.random.default_rng([population.seed, number, 0])
    weights = np.array([weight for _, weight in population.laws])
    law = population.laws[int(rng.choice(weights.size, p=weights / weights.sum()))][0]
    duration = _uniform_ln(rng, population.durations)
    v_0 = _uniform_ln(rng, population.v_0)
    path = grow(
        draw_law(law, rng, population.threshold / v_0),
        rng,
        duration=duration,
        v_0=v_0,
        threshold=population.threshold,
        until=population.until,
        roughness=population.roughness,
    )
    factors = {name: math.exp(sd * rng.standard_normal()) for name, sd in population.rig_spread}
    rig = replace(population.rig, **{name: getattr(population.rig, name) * f for name, f in factors.items()})
    clearance, posterior = population.clearance, population.rig_posterior
    if posterior is not None and isinstance(population.rig, Rig):
        # The draws are in random order: lives take them in turn.
        row = number % len(posterior.rows)
        rig, clearance = posterior.rig(population.rig, row), posterior.clearance(clearance, row)
    # Drawn in any case, so that a model does not move the draws that follow.
    rough = Floor("rough", sd=float(rng.uniform(*population.floor_sd)), seed=int(rng.integers(1, 2**31)))
    return LifePlan(
        number=number,
        law=law,
        path=path,
        rig=rig,
        clearance=clearance,
        floor=rough if isinstance(rig, Rig) else Floor(),
        load=float(rng.uniform(*population.load)),
        speed=float(rng.uniform(*population.speed)),
        slip=float(rng.uniform(*population.slip)),
        h_threshold=_uniform_ln(rng, population.h_threshold),
        depth_share=float(rng.uniform(*population.depth_share)),
        gain=math.exp(population.gain_sd * rng.standard_normal()),
        harmonic_gain=np.exp(population.harmonic_gain_sd * rng.standard_normal(HARMONICS)),
        background_rms=_uniform_ln(rng, population.background_rms),
        background_harmonic=_uniform_ln(rng, population.background_harmonic),
    )


def simulate_life(population: Population, number: int) -> LifeHistory:
    """Return one life of a population.

    Raises:
        ValueError: if a scene is outside what the model describes; the message names the field.
    """
    plan = draw_life(population, number)
    rng = np.random.default_rng([population.seed, number, 1])
    end = min(_BEYOND * plan.path.crossing(population.until), float(plan.path.t[-1]))
    count = int(end // population.interval) + 1
    # All draws are made before any block is left out, so that one setting does not move another's draws.
    known = 1.0 + np.array([population.load_variation, population.speed_variation]) * rng.uniform(-1.0, 1.0, (count, 2))
    jitter = 1.0 + np.array([population.load_jitter, population.speed_jitter]) * rng.standard_normal((count, 2))
    noise = rng.standard_normal((count, 1 + HARMONICS))
    there = np.flatnonzero(rng.uniform(size=count) >= population.missing)
    loads, drift = _slow_changes(population, plan, count)
    unknown = _unknown(population, number)
    jitter *= unknown.errors
    scatter = np.exp(unknown.scatter * noise)
    slip = Slip(plan.slip, seed=plan.floor.seed) if plan.slip > 0.0 else None
    if slip is not None:
        jitter[there, 1] = _grouped(jitter[there, 1])
    conditions = np.stack((loads, np.full(count, plan.speed)), axis=1)[there] * known[there]
    t = np.asarray(population.interval * there, dtype=np.float64)
    healthy = Scene(plan.speed, plan.load, population.bearing, plan.rig, clearance=plan.clearance, slip=slip)
    defects = plan.defects(t, population.threshold, race_radius(population.bearing))
    scenes = [
        replace(healthy, load=load, speed=speed, defect=defect)
        for (load, speed), defect in zip((conditions * jitter[there]).tolist(), defects, strict=True)
    ]
    rms, harmonics = _levels(scenes, population)
    gain = plan.gain * drift[there]
    rms = np.hypot(gain * rms, plan.background_rms) * scatter[there, 0]
    harmonics = gain[:, None] * plan.harmonic_gain * harmonics
    harmonics = np.hypot(harmonics, plan.background_harmonic) * scatter[there, 1:]
    # A block whose motion diverges is treated as missing.
    finite = np.isfinite(rms)
    return LifeHistory(
        number=number,
        law=plan.law,
        t=t[finite],
        load=conditions[finite, 0],
        speed=conditions[finite, 1],
        rms=rms[finite],
        harmonics=np.where(_shown(population, conditions[finite, 1]), harmonics[finite], 0.0),
        v_eq=plan.path.at(t[finite]),
        dphi_d=np.array([d.dphi_d for d in defects])[finite],
        h_d=np.array([d.h_d for d in defects])[finite],
        path=plan.path,
    )


def _slow_changes(
    population: Population, plan: LifePlan, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the load of each block before its variation, N, and the factor of its gain's drift, each (count,)."""
    # A stream of its own: lives without these changes are those of before.
    rng = np.random.default_rng([population.seed, plan.number, 2])
    walk = np.cumsum(rng.standard_normal(count)) / math.sqrt(count)
    load = np.full(count, plan.load)
    for at in np.sort(rng.uniform(size=rng.poisson(population.load_steps))):
        load[int(at * count) :] = rng.uniform(*population.load)
    return load, np.exp(population.gain_drift * walk)


@dataclass(frozen=True, eq=False)
class _Unknown:
    """What the monitor of a life does not know and what stays for the whole life.

    Attributes:
        errors: factors on load and speed, shape (2,).
        scatter: standard deviation of each figure of a block, RMS first, shape (7,).
    """

    errors: NDArray[np.float64]
    scatter: NDArray[np.float64]


def _unknown(population: Population, number: int) -> _Unknown:
    # A stream of its own, as in ``_slow_changes``.
    rng = np.random.default_rng([population.seed, number, 4])
    errors = 1.0 + np.array([population.load_error, population.speed_error]) * rng.standard_normal(2)
    rms, lines = (_spread(rng, limits) for limits in (population.scatter, population.line_scatter))
    return _Unknown(errors, np.array([rms] + [lines] * HARMONICS))


def _spread(rng: np.random.Generator, limits: Range) -> float:
    """Return a standard deviation from a range, drawn in the logarithm; one from 0 is 0 to its upper end."""
    share = rng.uniform()
    low, high = limits
    return low * (high / low) ** share if low > 0.0 else high * share


def _grouped(factors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return factors with those of each group of nearly equal ones at their mean: each group has one speed."""
    order = np.argsort(factors, kind="stable")
    groups = max(1, min(_GROUPS, factors.size // _FEWEST), -(-factors.size // _LANES))
    grouped = np.empty_like(factors)
    for group in np.array_split(order, groups):
        if group.size:
            grouped[group] = factors[group].mean() if np.ptp(factors[group]) else factors[group[0]]
    return grouped


def _levels(scenes: list[Scene], population: Population) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return RMS (n,) and lines (n, 6) of the blocks of a life, m/s2; NaN where the motion diverges."""
    # Imported here: a population that is only configured must not load the compiled kernels.
    if isinstance(population.rig, Rig):
        from models.solve.six_dof.rows import settled_levels

        return settled_levels(scenes, population.rms_band)
    from models.maps.model_nodes import scene_levels

    return scene_levels([replace(scene, model=population.rig.model) for scene in scenes], population.rms_band)


def _shown(population: Population, speed: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which harmonics lie in the band of the population, shape (n, 6)."""
    if population.rms_band is None:
        return np.ones((speed.size, HARMONICS), dtype=bool)
    bpfo = kinematics(population.bearing, 1.0).bpfo * speed
    frequency = bpfo[:, None] * np.arange(1, HARMONICS + 1)
    return (frequency >= population.rms_band[0]) & (frequency <= population.rms_band[1])


_LIVES = Work("lives", simulate_life, memory=_MEMORY, threads=True)


def simulate_lives(
    population: Population, numbers: Sequence[int], runner: Runner = SERIAL, progress: Progress | None = None
) -> Iterator[LifeHistory]:
    """Yield lives of a population in the order of their numbers as given.

    The lives do not depend on ``runner``. ``progress`` is called with the lives done and their total.

    Raises:
        ValueError: if a scene is outside the model.
    """
    blocks = _BEYOND * math.sqrt(math.prod(population.durations)) / population.interval
    seconds = _BLOCK_SECONDS if isinstance(population.rig, Rig) else _MODEL_SECONDS
    work = _LIVES.sized(blocks * seconds, len(numbers))
    for done, life in enumerate(runner.run(work, population, numbers), start=1):
        if progress is not None:
            progress(done, len(numbers))
        yield life

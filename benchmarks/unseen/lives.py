"""Lives on which V_eq and TT are judged: machines, conditions and noise of their own, laws of ``unseen_laws``.

Nothing here is taken from ``models.lives``, from which libraries are made: only the six-degree-of-freedom model is
shared. A life is that of one machine (its rig differs from the nominal one in every parameter) at one nominal speed
and load. What the monitor does not know: a constant error of speed and load, their unsteadiness, the gain of the sensor
and of its path at each line, the drift of the gain, background and floor. In some lives the load is changed, known to
the monitor.

The noise of a block is modest: between neighbouring blocks of the PRONOSTIA runs (0.1 s each), the RMS scatters by 2 to
7 %, the amplitudes of envelope lines by 14 to 26 %.

A life depends on its law, seed and number alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.unseen.laws import DURATIONS, LAWS, OTHER_LAWS, Floats, Rng, draw_growth
from models.machine.bearing import Bearing, from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Slip
from models.path.defect import race_radius
from models.solve.response import HARMONICS
from models.solve.six_dof.rows import settled_levels

BAND = (0.0, 9500.0)
"""Band of the RMS, Hz: the default of ``library build``."""
INTERVAL = 300.0
"""Time from block to block, s."""
LOAD, SPEED = (3500.0, 4500.0), (22.0, 43.0)
"""Nominal loads, N, and speeds, Hz: within those of the library of ``judge`` with all steps and errors."""

_GRAVITY = 9.80665
_RIG_PARAMETERS = ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c", "c_i", "c_r", "alpha_c", "beta_c")
_LANES = 32
"""Blocks with slip that are simulated side by side, at one speed."""
_MIN_SPEEDS = 3


@dataclass(frozen=True, eq=False)
class Machine:
    """What one life is measured on; errors are relative, deviations are of the logarithm.

    Attributes:
        rig: its parameters.
        floor: of the defect.
        slip: largest slip angle, rad; 0 for none.
        load, speed: nominal, known to the monitor, N and Hz.
        load_error, speed_error: constant, unknown.
        load_jitter, speed_jitter: standard deviation from block to block, unknown.
        gain, line_gains: constant factors on all levels, and on each line, shape (6,).
        drift: standard deviation of ln gain after ``drift_time``, a random walk.
        background_rms, background_lines: m/s2; they add as power.
        noise_rms, noise_lines: standard deviation of each figure of a block.
        missing: share of blocks lost.
    """

    rig: Rig
    floor: Floor
    slip: float
    load: float
    speed: float
    load_error: float
    speed_error: float
    load_jitter: float
    speed_jitter: float
    gain: float
    line_gains: Floats
    drift: float
    background_rms: float
    background_lines: float
    noise_rms: float
    noise_lines: float
    missing: float


@dataclass(frozen=True, eq=False)
class UnseenLife:
    """Features of the blocks of one life, and the truth. SI units, n blocks.

    Attributes:
        t: time of each block since the onset, s, shape (n,).
        load, speed: as the monitor knows them, N and Hz, shape (n,).
        rms: in the band, m/s2, shape (n,).
        harmonics: amplitudes of BPFO lines 1..6, m/s2, shape (n, 6).
        v_eq: true volume per width, m2, shape (n,).
        crossing: true time of the threshold, s since the onset; infinity if never.
    """

    law: str
    number: int
    t: Floats
    load: Floats
    speed: Floats
    rms: Floats
    harmonics: Floats
    v_eq: Floats
    crossing: float


@dataclass(frozen=True)
class LifeOptions:
    """What differs between groups of lives.

    Attributes:
        durations: range of the time to the threshold, s.
        until: share of its duration after which nothing more is simulated; no method is asked later.
        hold_share: share of its duration at which the damage comes to stand still, or None.
        hold_s: how long it then stands still, s; the life ends there.
        load_step: (share of the duration, factor on the load, whether the monitor knows) of a change, or None for the
            changes that a part of the lives has.
    """

    durations: tuple[float, float] = DURATIONS
    until: float = 0.75
    hold_share: float | None = None
    hold_s: float = 0.0
    load_step: tuple[float, float, bool] | None = None


@dataclass(frozen=True, eq=False)
class Conditions:
    """Load (N) and speed (Hz) of the blocks of a life, shape (n,); ``groups`` are blocks that share a true speed.

    Without slip, they need not share it.
    """

    load: Floats
    speed: Floats
    true_load: Floats
    true_speed: Floats
    groups: Sequence[NDArray[np.int64]]


def _uniform_ln(rng: Rng, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def draw_machine(rng: Rng) -> Machine:
    """Return the machine of one life."""
    nominal, spread = Rig(), rng.uniform(0.02, 0.06)
    factors = np.exp(spread * rng.standard_normal(len(_RIG_PARAMETERS)))
    rig = {name: getattr(nominal, name) * float(f) for name, f in zip(_RIG_PARAMETERS, factors, strict=True)}
    floor = Floor("rough", sd=rng.uniform(0.4e-6, 1.6e-6), pitch=rng.uniform(1.5e-3, 3e-3), seed=_seed(rng))
    slips = rng.uniform() < 0.3
    return Machine(
        rig=replace(nominal, **rig),
        floor=floor,
        slip=rng.uniform(1e-3, 8e-3) if slips else 0.0,
        load=rng.uniform(*LOAD),
        speed=rng.uniform(*SPEED),
        load_error=rng.uniform(-0.03, 0.03),
        speed_error=rng.uniform(-0.005, 0.005),
        load_jitter=rng.uniform(0.003, 0.015),
        speed_jitter=_uniform_ln(rng, 0.0005, 0.004),
        gain=math.exp(0.12 * rng.standard_normal()),
        line_gains=np.exp(0.15 * rng.standard_normal(HARMONICS)),
        drift=0.05,
        background_rms=_GRAVITY * _uniform_ln(rng, 0.03, 0.08),
        background_lines=_GRAVITY * _uniform_ln(rng, 0.002, 0.02),
        noise_rms=rng.uniform(0.015, 0.04),
        noise_lines=rng.uniform(0.02, 0.08),
        missing=rng.uniform(0.0, 0.06),
    )


def _seed(rng: Rng) -> int:
    return int(rng.integers(1, 2**31))


def simulate_life(law: str, number: int, first_seed: int, options: LifeOptions | None = None) -> UnseenLife:
    """Return one life.

    Args:
        law: a name in ``unseen_laws.LAWS`` or ``OTHER_LAWS``.
        number: of the life among those of its law.
        first_seed: of a range in ``unseen_seeds``.
        options: of its group.
    """
    options = options or LifeOptions()
    rng = np.random.default_rng([first_seed, [*LAWS, *OTHER_LAWS].index(law), number])
    growth = draw_growth(law, rng, options.durations)
    machine = draw_machine(rng)
    duration, end = growth.crossing, options.until * growth.crossing
    if options.hold_share is not None:
        end = options.hold_share * duration + options.hold_s
        growth = growth.held_from(options.hold_share * duration, end)
    t = _times(rng, machine, end)
    conditions = _conditions(rng, machine, t / duration, options)
    v_eq, h_d, edge = growth.at(t)
    rms, harmonics = _levels(machine, conditions, v_eq, h_d, _seed(rng))
    rms, harmonics = measure(rng, machine, t / duration, rms * edge, harmonics * edge[:, None])
    there = np.isfinite(rms)
    return UnseenLife(
        law=law,
        number=number,
        t=t[there],
        load=conditions.load[there],
        speed=conditions.speed[there],
        rms=rms[there],
        harmonics=harmonics[there],
        v_eq=v_eq[there],
        crossing=growth.crossing,
    )


def _times(rng: Rng, machine: Machine, end: float) -> Floats:
    """Return the times of the blocks that there are, s: some lost one by one, in some lives up to an hour at once."""
    t = np.arange(0.0, end + 1.0, INTERVAL)
    there = rng.uniform(size=t.size) >= machine.missing
    begin, length, outage = rng.integers(t.size), rng.integers(3, 13), rng.uniform() < 0.15
    if outage:
        there[begin : begin + length] = False
    # A life needs a beginning.
    there[0] = True
    return np.asarray(t[there])


def _conditions(rng: Rng, machine: Machine, share: Floats, options: LifeOptions) -> Conditions:
    """Return load and speed of the blocks at shares of the nominal duration; with slip, speeds take few values."""
    known, unknown = np.ones(share.size), np.ones(share.size)
    # A fifth of the lives is loaded anew once to three times.
    steps = rng.uniform(0.1, 0.9, int(rng.integers(1, 4))) if rng.uniform() < 0.2 else np.empty(0)
    factors = rng.uniform(0.88, 1.1, steps.size)
    if options.load_step is None:
        for at, factor in zip(np.sort(steps), factors, strict=True):
            known[share >= at] = factor
    else:
        at, factor, told = options.load_step
        (known if told else unknown)[share >= at] = factor
    load_noise, speed_noise = rng.standard_normal((2, share.size))
    groups = [np.arange(share.size)]
    if machine.slip > 0.0:
        count = max(_MIN_SPEEDS, math.ceil(share.size / _LANES))
        groups = [part for part in np.array_split(rng.permutation(share.size), count) if part.size]
        for part, value in zip(groups, rng.standard_normal(len(groups)), strict=True):
            speed_noise[part] = value
    load, speed = machine.load * known, np.full(share.size, machine.speed)
    return Conditions(
        load=load,
        speed=speed,
        true_load=load * unknown * (1.0 + machine.load_error) * (1.0 + machine.load_jitter * load_noise),
        true_speed=speed * (1.0 + machine.speed_error) * (1.0 + machine.speed_jitter * speed_noise),
        groups=groups,
    )


def _levels(machine: Machine, conditions: Conditions, v_eq: Floats, h_d: Floats, seed: int) -> tuple[Floats, Floats]:
    """Return RMS (n,) and lines (n, 6) of the casing, m/s2; NaN where the motion diverges."""
    bearing = machine_bearing()
    extent = v_eq / (race_radius(bearing) * h_d)
    rms, harmonics = np.empty(v_eq.size), np.empty((v_eq.size, HARMONICS))
    for group, blocks in enumerate(conditions.groups):
        slip = Slip(machine.slip, seed=(seed + group) % 2**31) if machine.slip > 0.0 else None
        scenes = [
            Scene(
                speed=float(conditions.true_speed[k]),
                load=float(conditions.true_load[k]),
                bearing=bearing,
                rig=machine.rig,
                defect=Defect(float(extent[k]), float(h_d[k]), machine.floor),
                slip=slip,
            )
            for k in blocks.tolist()
        ]
        rms[blocks], harmonics[blocks] = settled_levels(scenes, BAND)
    return rms, harmonics


def machine_bearing() -> Bearing:
    """Return the bearing of all lives: that of the thesis and of the default library."""
    return from_catalogue("1205 ETN9")


def measure(rng: Rng, machine: Machine, share: Floats, rms: Floats, harmonics: Floats) -> tuple[Floats, Floats]:
    """Return levels as the sensor gives them, of the same shapes.

    Args:
        rng: of drift and noise.
        machine: of the life.
        share: of its nominal duration at each block, shape (n,).
        rms: of the casing, m/s2, shape (n,).
        harmonics: of the casing, m/s2, shape (n, 6).
    """
    steps = np.sqrt(np.diff(share, prepend=0.0)) * rng.standard_normal(share.size)
    gain = machine.gain * np.exp(machine.drift * np.cumsum(steps))
    noise = rng.standard_normal((share.size, 1 + HARMONICS))
    measured = np.hypot(gain * rms, machine.background_rms) * np.exp(machine.noise_rms * noise[:, 0])
    lines = np.hypot(gain[:, None] * machine.line_gains * harmonics, machine.background_lines)
    return np.asarray(measured), np.asarray(lines * np.exp(machine.noise_lines * noise[:, 1:]))

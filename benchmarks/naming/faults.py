"""Machines with a seeded fault, or without one: records whose truth is known, drawn by a seed.

The engine gives the passages over a defect: a scene over some turns of shaft or cage, cut into one piece a passage.
They are placed at the times that a bearing with cage slip and random jitter gives, each the piece of the nearest place
in the load zone, and pass through a resonance of the structure. The cage is synthetic: noise that swells once in a turn
of it. Besides: white and coloured noise, harmonics of the shaft in the signal and in its envelope, balls that pass the
load zone, and gears: mesh harmonics with sidebands at the turns of both wheels, whose teeth knock.

Nothing here knows anything of the detector. Lengths in s, frequencies in Hz; the broadband noise has unit variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Kinematics, catalogue_entry, from_catalogue, kinematics
from models.machine.rig import Rig, RigParameters
from models.machine.scene import Defect, Part, Scene
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.nominal_rigs import nominal_rig
from models.solve.response import Response
from models.solve.rotor.rig import RotorRig
from models.solve.simulate import simulate

Samples = NDArray[np.float64]

TRAINING = range(500)
VALIDATION = (*range(10_000, 10_500), *range(20_000, 20_500))
"""Seeds that were held out for earlier rules, each judged once, and looked at afterwards."""
HELD_OUT = range(30_000, 30_500)
"""Seeds that were set aside before what they judge was changed for the last time; judged once."""

BEARINGS = ("6305", "6203", "6205", "PRONOSTIA")
"""Of 7, 8 (BPFO at 3.05 times the shaft), 9 and 13 balls."""

BANDS = {
    12000.0: (600.0, 5400.0),
    20000.0: (1000.0, 9000.0),
    25600.0: (1000.0, 11000.0),
    48000.0: (1000.0, 16000.0),
    51200.0: (1000.0, 16000.0),
}
"""The band to demodulate at each sampling rate, as a person would configure it."""

Damage = Literal["outer", "inner", "ball", "cage"]
_PARTS: tuple[Damage | None, ...] = ("outer", "inner", "ball", "cage", None)
_SHARES = (0.27, 0.27, 0.17, 0.09, 0.20)
_RIGS: dict[str, type[RigParameters]] = {"six_dof": Rig, "ball_inertia": BallInertiaRig, "rotor": RotorRig}
_MOST_SECONDS = 10.0
_LEAST_TURNS = 20.0


@dataclass(frozen=True)
class Gear:
    """A pair of wheels, one on the shaft.

    Attributes:
        teeth: of the wheel on the shaft.
        other: turns of the other wheel, Hz.
        level: of the mesh over the noise.
        swing: how far the mesh swells once in a turn of either wheel.
        knock: height of a knock once in a turn of the other wheel over the noise, 0: none.
    """

    teeth: int
    other: float
    level: float
    swing: float
    knock: float


@dataclass(frozen=True)
class Plan:
    """All that was drawn for a record.

    Attributes:
        part: that is damaged, or None.
        bearing, model: of the catalogue, and of the engine.
        speed, stated: true and stated shaft speed, Hz.
        rate, duration: of the record, Hz and s.
        slip: share by which the cage is late.
        jitter: standard deviation of one interval between passages over its mean; the errors add up.
        level: RMS of the damage in the band over that of the noise.
        colour: exponent of the fall of the noise above a tenth of the Nyquist frequency.
        resonance, damping: of the structure, Hz and share of the critical.
        shaft: amplitude of the harmonics of the shaft in the signal over the noise, and in its envelope.
        compliance: modulation of the noise by passing balls.
        load, extent, depth: N, rad and m of the scene.
        gear: or None.
    """

    seed: int
    part: Damage | None
    bearing: str
    model: str
    speed: float
    stated: float
    rate: float
    duration: float
    slip: float
    jitter: float
    level: float
    colour: float
    resonance: float
    damping: float
    shaft: tuple[float, float]
    compliance: float
    load: float
    extent: float
    depth: float
    gear: Gear | None

    @property
    def lines(self) -> Kinematics:
        """Return the kinematic frequencies of pure rolling at the true speed."""
        return kinematics(from_catalogue(self.bearing), self.speed)

    @property
    def band(self) -> tuple[float, float]:
        """Return the band to demodulate, Hz."""
        return BANDS[self.rate]


@dataclass(frozen=True, eq=False)
class Seeded:
    """A record.

    Attributes:
        plan: what was drawn.
        samples: (n,) float32.
        line: frequency at which the passages came on the average, Hz; None where nothing is damaged.
    """

    plan: Plan
    samples: NDArray[np.float32] = field(repr=False)
    line: float | None


def draw(seed: int) -> Plan:
    """Draw a record by its seed."""
    rng = np.random.default_rng([17, seed])
    part = _PARTS[rng.choice(len(_PARTS), p=_SHARES)]
    short = rng.uniform() < 0.12
    speed = float(np.exp(rng.uniform(math.log(15.0 if short else 1.0), math.log(40.0))))
    least = _LEAST_TURNS / speed
    most = max(_MOST_SECONDS, least)
    duration = rng.uniform(0.1, 0.5) if short else float(np.exp(rng.uniform(math.log(least), math.log(most))))
    rate = float(rng.choice(list(BANDS)))
    models = [name for name in _RIGS if not (name == "ball_inertia" and part == "ball")]
    model = str(rng.choice(models, p=(0.6, 0.2, 0.2) if len(models) == 3 else (0.7, 0.3)))
    limit = 0.01 if rng.uniform() < 1.0 / 3.0 else 0.06
    low, high = BANDS[rate]
    gear = None
    if rng.uniform() < 0.35:
        teeth = int(rng.integers(13, 61))
        ratio = float(rng.choice([rng.uniform(0.2, 0.9), rng.uniform(1.1, 4.0)]))
        knock = rng.uniform(1.0, 8.0) if rng.uniform() < 0.3 else 0.0
        gear = Gear(teeth, speed * ratio, float(np.exp(rng.uniform(-2.3, 0.7))), rng.uniform(0.0, 0.8), knock)
    return Plan(
        seed=seed,
        part=part,
        bearing=str(rng.choice(BEARINGS)),
        model=model,
        speed=speed,
        stated=speed * (1.0 + rng.uniform(-limit, limit)),
        rate=rate,
        duration=duration,
        slip=rng.uniform(0.0, 0.04),
        jitter=float(np.exp(rng.uniform(math.log(0.001), math.log(0.02)))),
        level=float(np.exp(rng.uniform(math.log(0.2), math.log(6.0)))),
        colour=rng.uniform(0.0, 1.5),
        resonance=rng.uniform(low + 0.15 * (high - low), high - 0.15 * (high - low)),
        damping=rng.uniform(0.01, 0.06),
        shaft=(
            float(np.exp(rng.uniform(-3.0, 1.0))) if rng.uniform() < 0.8 else 0.0,
            rng.uniform(0.02, 0.3) if rng.uniform() < 0.5 else 0.0,
        ),
        compliance=rng.uniform(0.0, 0.06),
        load=float(np.exp(rng.uniform(math.log(200.0), math.log(4000.0)))),
        extent=rng.uniform(0.02, 0.2),
        depth=float(np.exp(rng.uniform(math.log(3e-6), math.log(60e-6)))),
        gear=gear,
    )


def make(seed: int) -> Seeded:
    """Return the record of a seed."""
    return realise(draw(seed))


def kept(seed: int, folder: Path | None) -> Seeded:
    """Return the record of a seed, from a folder that keeps records between runs where one is given."""
    file = None if folder is None else folder / f"{seed}.npz"
    if file is None:
        return make(seed)
    if not file.is_file():
        record = make(seed)
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez(file, samples=record.samples, line=np.nan if record.line is None else record.line)
        return record
    with np.load(file) as found:
        line = float(found["line"])
        return Seeded(draw(seed), found["samples"], None if math.isnan(line) else line)


def realise(plan: Plan) -> Seeded:
    """Return the record of a plan."""
    rng = np.random.default_rng([71, plan.seed])
    n = round(plan.rate * plan.duration)
    t = np.arange(n) / plan.rate
    x = _noise(rng, plan, n, t)
    line = None
    if plan.part == "cage":
        line = plan.lines.ftf * (1.0 - plan.slip)
        turns = _wander(rng, plan, line, t)
        x *= 1.0 + 2.0 * plan.level * np.exp(8.0 * (np.cos(2.0 * np.pi * turns) - 1.0))
    elif plan.part is not None:
        damage, line = _damage(rng, plan, plan.part, n)
        inside = band_rms(damage, plan)
        x += damage * (plan.level * band_rms(x, plan) / max(inside, 1e-30))
    x += _shaft_and_gear(rng, plan, t)
    return Seeded(plan, x.astype(np.float32), line)


def noise_of(plan: Plan) -> Samples:
    """Return the noise of a record, of which shaft, damage and gears are left out, shape (n,)."""
    n = round(plan.rate * plan.duration)
    return _noise(np.random.default_rng([71, plan.seed]), plan, n, np.arange(n) / plan.rate)


def band_rms(x: Samples, plan: Plan) -> float:
    """Return the RMS in the band."""
    power = np.square(np.abs(np.fft.rfft(x)))
    frequency = np.arange(power.size) * (plan.rate / x.size)
    return math.sqrt(2.0 * float(power[(frequency >= plan.band[0]) & (frequency <= plan.band[1])].sum())) / x.size


def _noise(rng: np.random.Generator, plan: Plan, n: int, t: Samples) -> Samples:
    """Return coloured noise, some of it through the structure, that balls and shaft modulate."""
    frequency = np.fft.rfftfreq(n, 1.0 / plan.rate)
    gain = (1.0 + np.square(frequency / (0.05 * plan.rate))) ** (-0.5 * plan.colour)
    gain = gain * (1.0 + rng.uniform(0.0, 1.0) * np.abs(resonance(frequency, plan)))
    x = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * gain, n)
    x /= x.std()
    passing = plan.lines.bpfo * (1.0 - plan.slip)
    swing = 1.0 + plan.compliance * np.cos(2.0 * np.pi * (passing * t + rng.uniform()))
    for order in range(1, 4):
        swing += plan.shaft[1] / order**1.5 * np.cos(2.0 * np.pi * (order * plan.speed * t + rng.uniform()))
    return x * np.maximum(swing, 0.0)


def resonance(frequency: NDArray[np.floating], plan: Plan) -> NDArray[np.complex128]:
    """Return the response of the structure, 1 far above its resonance."""
    share = frequency / plan.resonance
    return -np.square(share) / (1.0 - np.square(share) + 2j * plan.damping * share)


def _wander(rng: np.random.Generator, plan: Plan, line: float, t: Samples) -> Samples:
    """Return turns of what comes round at ``line``, with the jitter of each turn, at the times t."""
    count = int(t.size / plan.rate * line * 1.2) + 10
    times = np.cumsum((1.0 + plan.jitter * rng.standard_normal(count)) / line)
    return np.interp(t, times, np.arange(1.0, count + 1.0)) + rng.uniform()


def _damage(rng: np.random.Generator, plan: Plan, part: Part, n: int) -> tuple[Samples, float]:
    """Return the passages over a defect, through the structure, shape (n,), and their mean frequency."""
    lines = plan.lines
    cage = lines.ftf * (1.0 - plan.slip)
    line, carrier = {
        "outer": (lines.bpfo * (1.0 - plan.slip), plan.speed),
        "inner": (lines.bpfi + plan.slip * lines.ftf * from_catalogue(plan.bearing).n_elements, plan.speed),
        "ball": (2.0 * lines.bsf * (1.0 - plan.slip), cage),
    }[part]
    pieces, phases = _pieces(plan, part)
    count = int(plan.duration * line * 1.3) + 20
    times = np.cumsum((1.0 + plan.jitter * rng.standard_normal(count)) / line) - rng.uniform(1.0, 3.0) / line
    times = times[times < plan.duration]
    turn = carrier * times + rng.uniform()
    unbalance = rng.uniform(0.0, 0.3) if part == "outer" else 0.0
    weight = (1.0 + unbalance * np.cos(2.0 * np.pi * turn)) * np.exp(0.15 * rng.standard_normal(times.size))
    x = np.zeros(n + 2 * pieces.shape[1])
    parity = 2 if part == "ball" else 1
    for k, start in enumerate(np.rint(times * plan.rate).astype(np.intp) + pieces.shape[1]):
        if start < 0:
            continue
        # A ball meets the outer and the inner race by turns.
        alike = np.arange(k % parity, phases.size, parity)
        apart = np.abs((phases[alike] - turn[k] + 0.5) % 1.0 - 0.5)
        x[start : start + pieces.shape[1]] += weight[k] * pieces[alike[int(np.argmin(apart))]]
    x = x[pieces.shape[1] : pieces.shape[1] + n]
    inside = times[times >= 0.0]
    found = (inside.size - 1) / (inside[-1] - inside[0]) if inside.size > 1 else line
    return np.fft.irfft(np.fft.rfft(x) * resonance(np.fft.rfftfreq(n, 1.0 / plan.rate), plan), n), float(found)


def _pieces(plan: Plan, part: Part) -> tuple[Samples, Samples]:
    """Return the passages that the engine gives, (piece, sample), and the place of each in a turn of its carrier.

    The carrier is the shaft, of a ball the cage.
    """
    lines = plan.lines
    line, carrier, turns = {
        "outer": (lines.bpfo, plan.speed, 3.0 * plan.speed / lines.bpfo),
        "inner": (lines.bpfi, plan.speed, 3.0),
        "ball": (2.0 * lines.bsf, lines.ftf, 2.0),
    }[part]
    duration = turns / carrier
    scene = Scene(
        plan.speed,
        plan.load,
        bearing=from_catalogue(plan.bearing),
        rig=nominal_rig(_RIGS[plan.model], catalogue_entry(plan.bearing)),
        defect=Defect(plan.extent, plan.depth, part=part),
        model=plan.model,
    )
    signal = _signal(simulate(scene, accuracy=0.05, duration=duration, rate=plan.rate), plan.rate, duration)
    period = plan.rate / line
    length = max(4, math.floor(period))
    # A piece begins where, over all passages, least happens.
    folded = np.bincount((np.arange(signal.size) % period).astype(np.intp), np.square(signal), length + 1)[:length]
    width = max(1, length // 10)
    calm = np.convolve(np.concatenate([folded, folded[:width]]), np.ones(width), "valid")[:length]
    first = int(np.argmin(calm))
    starts = np.rint(np.arange(first, signal.size - length, period)).astype(np.intp)
    edge = np.minimum(1.0, np.minimum(np.arange(1, length + 1), np.arange(length, 0, -1)) / max(1.0, 0.05 * length))
    pieces = np.stack([signal[start : start + length] * edge for start in starts])
    return pieces, (starts / plan.rate * carrier) % 1.0


def _signal(response: Response, rate: float, duration: float) -> Samples:
    """Return the samples of the first sensor but the casing, of a motion over time or of one that repeats."""
    if response.record is not None:
        return response.record.signal[-1 if response.model == "six_dof" else 0]
    t = np.arange(round(rate * duration)) / rate
    found = np.zeros(t.size)
    for order in range(1, min(response.coefficients.shape[1], int(0.45 * rate / response.bpfo) + 1)):
        angle = 2.0 * np.pi * ((order * response.bpfo * t) % 1.0)
        value = response.coefficients[-1, order]
        found += 2.0 * (value.real * np.cos(angle) - value.imag * np.sin(angle))
    return found


def _shaft_and_gear(rng: np.random.Generator, plan: Plan, t: Samples) -> Samples:
    """Return the harmonics of the shaft and of the gears, shape (n,)."""
    x = np.zeros(t.size)
    for order in range(1, 9):
        amplitude = plan.shaft[0] * rng.uniform(0.0, 1.0) / math.sqrt(order)
        x += amplitude * np.cos(2.0 * np.pi * (order * plan.speed * t + rng.uniform()))
    gear = plan.gear
    if gear is None:
        return x
    swell = 1.0 + gear.swing * np.cos(2.0 * np.pi * (plan.speed * t + rng.uniform()))
    swell *= 1.0 + gear.swing * np.cos(2.0 * np.pi * (gear.other * t + rng.uniform()))
    for order in range(1, 4):
        mesh = order * gear.teeth * plan.speed
        if mesh < 0.45 * plan.rate:
            x += gear.level / order * swell * np.cos(2.0 * np.pi * (mesh * t + rng.uniform()))
    if gear.knock > 0.0:
        train = np.zeros(t.size)
        knocks = np.arange(rng.uniform(0.0, 1.0), plan.duration * gear.other, 1.0) / gear.other
        train[np.minimum((knocks * plan.rate).astype(np.intp), t.size - 1)] = 1.0
        rings = np.fft.irfft(np.fft.rfft(train) * resonance(np.fft.rfftfreq(t.size, 1.0 / plan.rate), plan), t.size)
        x += gear.knock * rings / max(float(np.abs(rings).max()), 1e-30)
    return x

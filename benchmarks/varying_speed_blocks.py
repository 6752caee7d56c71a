"""Blocks of simulated bearings at a varying speed, and their analyses: what ``benchmarks/varying_speed.py`` counts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import hilbert

from benchmarks.naming_of import namings_of
from models.machine.bearing import Bearing, kinematics
from models.machine.rig import Rig
from models.machine.scene import Defect, Part, Scene, Slip
from models.machine.shaft_marks import ShaftMarks, TimeAt, as_channel, time_of_turns
from models.machine.speed_profile import SpeedProfile, hunt, ramp
from models.solve.response import Response
from monitor.health.signal.condition import ConditionSettings, known_sd, speed_of
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.signal.lines import line_amplitudes
from monitor.health.signal.rotation.found import find_rotation
from monitor.health.signal.rotation.settings import TachoSettings
from streams.block import STANDARD_GRAVITY, Block
from streams.pulses import Pulses
from streams.rig_life import perturbed

RATE, SECONDS = 25600.0, 5.0
SAMPLES = round(RATE * SECONDS)
BAND = (500.0, 5000.0)
MEAN = 25.0
GRID = (10.0, *(11.25 + 2.5 * k for k in range(12)), MEAN, 40.0)
PULSES = 8
LEAST, HIGHEST = 10.0, 40.0
DEVELOPMENT, JUDGED = (1,), (101, 102)
RUN_UPS, HUNTS, HUNTING_HZ, HUNTING_SECONDS = (5.0, 20.0, 60.0), (0.05, 0.1, 0.2), 0.3, 10.0
NOISE = 0.05 * STANDARD_GRAVITY
SHAFT = ((1, 0.02), (2, 0.03), (3, 0.01))
# Extent, deg, and depth, um, at the middle of the sizes; each is drawn about it.
SIZES: Mapping[Part, tuple[tuple[float, float], ...]] = {
    "outer": ((0.8, 0.25), (5.0, 8.0), (12.0, 15.0)),
    "inner": ((0.8, 0.35), (5.0, 12.0), (12.0, 25.0)),
    "ball": ((3.5, 0.6), (15.0, 12.0), (25.0, 25.0)),
}
ALLOWED: Mapping[str, tuple[str, ...]] = {
    "outer": ("outer",),
    "inner": ("inner",),
    "ball": ("ball", "ball|cage"),
    "healthy": (),
}
FAMILY = {"outer": "outer", "inner": "inner", "ball": "ball"}
CLEAN = "8 pulses a turn"
TACHOS: Mapping[str, ShaftMarks] = {
    "1 pulse a turn": ShaftMarks(1),
    "8, 1 % missing": ShaftMarks(PULSES, missing=0.01),
    "8, 1 % doubled": ShaftMarks(PULSES),
    "8, 0.1 deg": ShaftMarks(PULSES, error=math.radians(0.1)),
    "8, 10 us": ShaftMarks(PULSES, jitter=10e-6),
    "8, all of these": ShaftMarks(PULSES, error=math.radians(0.1), jitter=10e-6, missing=0.01),
    "64, all of these": ShaftMarks(64, error=math.radians(0.1), jitter=10e-6, missing=0.01),
    "256, all of these": ShaftMarks(256, error=math.radians(0.1), jitter=10e-6, missing=0.01),
    "1,024, all of these": ShaftMarks(1024, error=math.radians(0.1), jitter=10e-6, missing=0.01),
}
DOUBLED = {name: 0.01 for name in TACHOS if "doubled" in name or "all" in name}

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recorded:
    """A block of a run: vibration, m/s2, with what is true of its rotation."""

    case: str
    fault: str
    run: str
    signal: Floats
    turns: Floats
    time_at: TimeAt
    bearing: Bearing
    mean_speed: float
    highest: float
    seed: int


@dataclass(frozen=True, eq=False)
class Judged:
    """What an analysis says of a block: the name, H of the fault's family, and whether there was an angle."""

    name: str | None
    h: float
    status: str | None
    features: BlockFeatures | None


def scenes(seed: int, sizes: int) -> Iterator[tuple[str, str, Scene]]:
    """Yield case, fault and scene of the six-degree-of-freedom model."""
    rng = np.random.default_rng([seed, 11])
    rig, load = perturbed(Rig(), rng), float(rng.uniform(2000.0, 5000.0))
    healthy = Scene(MEAN, load, rig=rig)
    yield f"{seed} healthy", "healthy", healthy
    for part, some in SIZES.items():
        for number, (extent, depth) in enumerate(some[3 - sizes :]):
            about = np.exp(rng.uniform(-0.3, 0.3, 2))
            position = float(rng.uniform(-0.4, 0.4)) if part == "outer" else float(rng.uniform(0.0, 6.0))
            defect = Defect(math.radians(extent * about[0]), depth * about[1] * 1e-6, position=position, part=part)
            slip = None if part == "ball" else Slip(math.radians(0.1), seed=seed)
            yield f"{seed} {part} {number + 1}", part, replace(healthy, defect=defect, slip=slip)


def runs(seed: int) -> dict[str, SpeedProfile]:
    """Return the profiles of the runs by name."""
    rng = np.random.default_rng([seed, 12])
    found = {f"10 to 40 Hz in {seconds:g} s": ramp(LEAST, HIGHEST, seconds) for seconds in RUN_UPS}
    for share in HUNTS:
        phase = float(rng.uniform(0.0, 2.0 * math.pi))
        found[f"±{100 * share:g} %"] = hunt(MEAN, share, HUNTING_HZ, HUNTING_SECONDS, phase=phase)
    return found


def recorded(
    response: Response, scene: Scene, names: tuple[str, str, str], seed: int, gain: float = 1.0
) -> Iterator[Recorded]:
    """Cut the response over a run into blocks, and add noise and lines of the shaft."""
    assert response.record is not None
    assert response.profile is not None
    signal, turns = gain * response.record.of(response.accelerometer), response.turns()
    rng = np.random.default_rng([seed, 13, *map(ord, "".join(names))])
    for begin in range(0, signal.size - SAMPLES + 1, SAMPLES):
        own = turns[begin : begin + SAMPLES] - turns[begin]
        noisy = signal[begin : begin + SAMPLES] + NOISE * rng.standard_normal(SAMPLES)
        for order, level in SHAFT:
            phase = rng.uniform(0.0, 2.0 * math.pi)
            noisy += level * STANDARD_GRAVITY * np.cos(2.0 * math.pi * order * own + phase)
        speeds = np.diff(own) * RATE
        end = float(own[-1] + own[-1] - own[-2])
        yield Recorded(
            *names, noisy, own, time_of_turns(own, RATE), scene.bearing, end / SECONDS, float(speeds.max()), seed
        )


def block_of(one: Recorded, pulses: Floats | None, per_turn: int) -> Block:
    """Return a block with the pulses as times, or without."""
    given = None if pulses is None else Pulses(pulses, per_turn)
    return Block(one.signal[None], RATE, ("a",), ("m/s2",), "bench", 1, one.run, pulses=given)


def with_channel(one: Recorded) -> Block:
    """Return a block with a tacho channel as recorded."""
    marks = ShaftMarks(PULSES, seed=one.seed)
    pulses = marks.pulses(one.time_at, SECONDS * one.mean_speed, SECONDS)
    tacho = as_channel(pulses, SAMPLES, RATE, PULSES * one.highest)
    return Block(np.stack((one.signal, tacho)), RATE, ("a", "tacho"), ("m/s2", "V"), "bench", 1, one.run)


def analysed(one: Recorded, block: Block, condition: ConditionSettings, fault: str) -> Judged:
    """Analyse a block as the monitor does: angle, speed, features, name."""
    found = find_rotation(block, condition)
    speed = speed_of(block.speed, {}, None, RATE, one.bearing, condition, rotation=found.rotation)
    if speed.value is None:
        return Judged(None, math.nan, found.status, None)
    lines = kinematics(one.bearing, speed.value)
    settings = FeatureSettings(
        rate=RATE,
        bands=(BAND,),
        fundamentals=fundamentals(lines),
        speed=speed.value,
        speed_sd=known_sd(speed, condition),
        rotation=found.rotation,
    )
    features = block_features(one.signal, RATE, settings)
    naming = namings_of(features, lines)[0]
    family = features.lines[0].get(FAMILY.get(fault, "outer"))
    return Judged(naming.fault, math.nan if family is None else family.total, found.status, features)


TACHO = ConditionSettings(tacho=TachoSettings(channel="tacho", per_revolution=PULSES))
TIMES = ConditionSettings(tacho=TachoSettings(of_source=True))
EXACT = ConditionSettings(speed_exact=True)


def over_orders(one: Recorded) -> Judged:
    """Return the analysis by a clean tacho channel."""
    return analysed(one, with_channel(one), TACHO, one.fault)


def in_hertz(one: Recorded) -> Judged:
    """Return the analysis over time at the mean speed."""
    return analysed(one, replace(block_of(one, None, 1), speed=one.mean_speed), EXACT, one.fault)


def by_tacho(one: Recorded, name: str) -> Judged:
    """Return the analysis by pulses with faults."""
    marks = replace(TACHOS[name], seed=one.seed)
    pulses = marks.pulses(one.time_at, SECONDS * one.mean_speed, SECONDS)
    share = DOUBLED.get(name, 0.0)
    if share > 0.0:
        rng = np.random.default_rng([one.seed, 14])
        again = np.flatnonzero(rng.uniform(size=pulses.size - 1) < share)
        pulses = np.sort(np.concatenate((pulses, pulses[again] + 0.1 * np.diff(pulses)[again])))
    return analysed(one, block_of(one, pulses, marks.per_turn), TIMES, one.fault)


def reference_h(one: Recorded, judged: Judged) -> float:
    """Return H of the block by its true angle at the full rate, read where the analysis found the lines."""
    assert judged.features is not None
    spectrum = np.fft.fft(one.signal)
    frequency = np.abs(np.fft.fftfreq(SAMPLES, 1.0 / RATE))
    passed = np.fft.ifft(np.where((frequency >= BAND[0]) & (frequency <= BAND[1]), spectrum, 0.0)).real
    envelope = np.abs(np.asarray(hilbert(passed)))
    count = 1 << 18
    turned = float(one.turns[-1])
    times = one.time_at(turned * np.arange(count) / count)
    even = CubicSpline(np.arange(SAMPLES) / RATE, envelope)(times)
    window = 0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(count) / count)
    amplitude = 2.0 * np.abs(np.fft.rfft((even - even.mean()) * window)) / window.sum()
    family = judged.features.lines[0][FAMILY[one.fault]]
    order = family.fundamental / one.mean_speed
    lines, resolved = line_amplitudes(amplitude, 1.0 / turned, order, 1.0, 5)
    return float(np.sum(lines[resolved]))


def verdict(one: Recorded, judged: Judged) -> str:
    """Return right, silent or wrong."""
    if judged.name is None or judged.name == "undecided":
        return "silent"
    return "right" if judged.name in ALLOWED[one.fault] else "wrong"

"""Blocks with a known angle of the shaft: a plain generator, another one for judging, and the model of six degrees.

The plain one is that with which the constants of ``monitor.health.signal.rotation.ridge`` were found: lines of the
shaft, one resonance that the fault rings, white noise. The one for judging shares no part with it: orders pass through
resonances that turn their phase while the speed changes, their depth wanders, elements slip at random from passage to
passage, a supply hums, a second shaft turns beside, and the noise is coloured.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Defect, Scene
from models.machine.speed_profile import SpeedProfile
from models.solve.six_dof.time_domain import simulate_time
from monitor.health.signal.rotation.rotation import Rotation

RATE, SECONDS = 25_600.0, 5.0
BEARING = from_catalogue("6205")
PROFILES = ("constant", "ramp 5 s", "ramp 20 s", "ramp 60 s", "hunting 1.7 %", "hunting 5 %", "hunting 10 %",
            "hunting 20 %")  # fmt: skip
FAULTS = ("none", "inner", "outer")
Array = NDArray[np.float64]


def rotation_of(profile: str, rng: np.random.Generator) -> Rotation:
    """Return a rotation: a part of a run-up from 10 to 40 Hz, or 25 Hz that swings at 0.1 to 0.5 Hz."""
    time = np.linspace(0.0, SECONDS, 2001)
    kind, _, amount = profile.partition(" ")
    if kind == "ramp":
        whole = float(amount.split()[0])
        begin = rng.uniform(0.0, whole - SECONDS) if whole > SECONDS else 0.0
        speed = 10.0 + 30.0 * (begin + time) / whole
    elif kind == "hunting":
        swing = rng.uniform(0.1, 0.5)
        wave = np.sin(2.0 * np.pi * (swing * time + rng.uniform()))
        speed = 25.0 * (1.0 + float(amount.split()[0]) / 100.0 * wave)
    else:
        speed = np.full(time.size, rng.uniform(15.0, 38.0))
    turns = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    return Rotation(time, turns, speed, SECONDS)


def plain(rotation: Rotation, fault: str, snr_db: float, rng: np.random.Generator) -> Array:
    """Return a signal with one to eight lines of the shaft and a fault, both of unit RMS, and noise."""
    turns = rotation.turns_at(np.arange(int(SECONDS * RATE)) / RATE)
    count = int(rng.integers(1, 9))
    amplitude = rng.lognormal(0.0, 0.7, count) * (rng.uniform(size=count) < 0.8)
    if not amplitude.any():
        amplitude[0] = 1.0
    signal = np.zeros(turns.size)
    for order, size in enumerate(amplitude, 1):
        signal += size * np.cos(2.0 * np.pi * (order * turns + rng.uniform()))
    signal /= signal.std()
    if fault != "none":
        slip = 1.0 - rng.uniform(0.0, 0.01)
        hits = impacts_of(rotation, fault, slip, 0.01, 0.0, rng)
        shape = ringing(0.23 * RATE, 0.03)
        rung = np.convolve(hits, shape)[: turns.size]
        signal = signal + rung / rung.std()
    return signal + 10.0 ** (-snr_db / 20.0) * rng.standard_normal(turns.size)


def for_judging(rotation: Rotation, fault: str, snr_db: float, rng: np.random.Generator) -> Array:
    """Return a signal of the other generator; the ratio is of the shaft's lines over the noise."""
    time = np.arange(int(SECONDS * RATE)) / RATE
    turns, speed = rotation.turns_at(time), rotation.speed_at(time)
    signal = np.zeros(time.size)
    modes = [(rng.uniform(30.0, 400.0), rng.uniform(0.02, 0.1)) for _ in range(3)]
    for order in range(1, int(rng.integers(3, 13))):
        size = rng.lognormal(-0.25 * order, 0.8)
        frequency = order * speed
        response = np.ones(time.size, dtype=np.complex128)
        for mode, damping in modes:
            ratio = frequency / mode
            response = response + 0.5 * ratio**2 / (1.0 - ratio**2 + 2j * damping * ratio)
        depth = 1.0 + 0.3 * np.sin(2.0 * np.pi * (rng.uniform(0.05, 0.4) * time + rng.uniform()))
        wave = np.exp(2j * np.pi * (order * turns + rng.uniform()))
        signal += size * depth * np.real(response * wave)
    signal /= signal.std()
    if fault != "none":
        hits = impacts_of(rotation, fault, 1.0 - rng.uniform(0.0, 0.015), 0.004, 0.003, rng)
        rung = sum(
            np.convolve(hits, ringing(rng.uniform(0.08, 0.4) * RATE, rng.uniform(0.01, 0.06)))[: time.size]
            for _ in range(2)
        )
        signal = signal + rng.uniform(0.3, 1.5) * np.asarray(rung) / np.std(rung)
    for harmonic in (1, 2, 4, 6):
        signal += 0.3 * rng.uniform() * np.cos(2.0 * np.pi * (50.02 * harmonic * time + rng.uniform()))
    other = rng.uniform(12.0, 45.0)
    for order in (1, 2, 3):
        signal += 0.2 * rng.uniform() * np.cos(2.0 * np.pi * (order * other * time + rng.uniform()))
    pole, resonance = -rng.uniform(0.2, 0.7), -1.9 * math.cos(rng.uniform(0.4, 2.0))
    noise = np.asarray(lfilter([1.0], [1.0, pole], rng.standard_normal(time.size)))
    noise = noise + 0.5 * np.asarray(lfilter([1.0], [1.0, resonance, 0.9], rng.standard_normal(time.size)))
    return signal + 10.0 ** (-snr_db / 20.0) * noise / noise.std()


def modelled(rotation: Rotation, fault: str, snr_db: float, rng: np.random.Generator) -> Array:
    """Return the casing of the model of six degrees of freedom with an unbalance and a fault, in white noise."""
    profile = SpeedProfile(
        tuple(rotation.time.tolist()), tuple((rotation.turns - rotation.turns[0]).tolist()), tuple(rotation.speed)
    )
    defect = None if fault == "none" else Defect(rng.uniform(0.02, 0.05), rng.uniform(1e-5, 4e-5), part=fault)  # type: ignore[arg-type]
    scene = Scene(
        speed=rotation.mean_speed,
        load=rng.uniform(800.0, 3000.0),
        bearing=BEARING,
        model="six_dof",
        defect=defect,
        unbalance=10.0 ** rng.uniform(-4.0, -2.5),
        speed_profile=profile,
    )
    record = simulate_time(scene, SECONDS, RATE).record
    if record is None:
        raise ValueError("the model gave no record over time")
    signal = record.of("mo")
    return signal / signal.std() + 10.0 ** (-snr_db / 20.0) * rng.standard_normal(signal.size)


def impacts_of(
    rotation: Rotation, fault: str, slip: float, jitter: float, walk: float, rng: np.random.Generator
) -> Array:
    """Return the impacts of a fault at the samples of a block: jitter and random walk in passages."""
    lines = kinematics(BEARING, 1.0)
    order = slip * (lines.bpfi if fault == "inner" else lines.bpfo)
    count = int(rotation.turned * order)
    passages = np.arange(count) + rng.uniform() + jitter * rng.standard_normal(count)
    passages = passages + np.cumsum(walk * rng.standard_normal(count))
    at = passages / order
    at = at[(at > 0.0) & (at < rotation.turned)]
    time = rotation.time_at(rotation.turns_at(0.0) + at)
    load = 1.0 + 0.8 * np.cos(2.0 * np.pi * at + 1.0) if fault == "inner" else np.ones(at.size)
    impacts = np.zeros(int(SECONDS * RATE))
    place = np.minimum((time * RATE).astype(np.intp), impacts.size - 1)
    np.add.at(impacts, place, load * (1.0 + 0.2 * rng.standard_normal(at.size)))
    return impacts


def ringing(frequency: float, damping: float) -> Array:
    """Return how a resonance rings, 10 ms at ``RATE``."""
    time = np.arange(int(0.01 * RATE)) / RATE
    return np.exp(-2.0 * np.pi * frequency * damping * time) * np.sin(2.0 * np.pi * frequency * time)

"""Gears beside the machines of ``benchmarks/seeded_faults.py``: mesh lines up to 20 dB over the noise of the band.

A record of a seed is that of ``seeded_faults`` as it is, bit for bit, to which the vibration of a pair of wheels is
added, one of them on the bearing's shaft. Loaded, the teeth mesh: one waveform a tooth, whose height swells with the
turns of both wheels (eccentricity) and from tooth to tooth, and whose phase weaves with both. Idle, they rattle: at
most passages of a tooth one of both flanks knocks, at times and with heights that are random, 10 dB below the load.
Both pass through the structure of the record.

Nothing here knows anything of the detector. Lengths in s, frequencies in Hz.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.seeded_faults import Plan, Seeded, band_rms, noise_of, realise, resonance

GearState = Literal["loaded", "idle"]

GEAR_TRAINING = range(500)
"""Seeds on which constants may be fitted."""
GEAR_HEALTHY_FIRST, GEAR_DAMAGED_FIRST = range(40_000, 41_000), range(41_000, 41_100)
"""Machines without damage and with a damaged bearing, set aside before anything was changed for gears; judged once, by
the first rule of what may be a wheel, and looked at afterwards."""
GEAR_HEALTHY, GEAR_DAMAGED = range(46_000, 47_000), range(41_100, 41_300)
"""The same, set aside before that rule was made stricter; judged once."""
GEAR_LIVES = range(42_000, 42_012)
"""Lives of the simulated rig, likewise."""

MAX_DB = 20.0
"""Level of the gears over the noise of the band."""
IDLE_DB = 10.0
"""By how much the rattle of gears without load is lower."""
_MOST_HARMONICS = 4000


@dataclass(frozen=True)
class GearDraw:
    """A pair of wheels, the driver on the shaft of the bearing.

    Attributes:
        driver, driven: teeth.
        db: RMS of the gears in the band over that of the noise in it.
        state: loaded or idle.
        swing: how far the mesh swells once in a turn of the driver, and of the driven wheel.
        weave: amplitude of the phase of the mesh once in a turn of each, rad.
        uneven: standard deviation of the heights of single teeth, relative.
        fall: exponent by which the harmonics of the mesh fall.
        wander: standard deviation of the speed in the record, relative.
    """

    driver: int
    driven: int
    db: float
    state: GearState
    swing: tuple[float, float]
    weave: tuple[float, float]
    uneven: float
    fall: float
    wander: float

    @property
    def turns(self) -> float:
        """Return the turns of the driven wheel in a turn of the driver."""
        return self.driver / self.driven


def draw_gears(seed: int, db: float = MAX_DB, state: GearState | None = None) -> GearDraw:
    """Draw a pair of wheels by the seed of a record; three in ten are idle where no state is given."""
    rng = np.random.default_rng([29, seed])
    driver = int(rng.integers(13, 61))
    ratio = float(rng.choice([rng.uniform(0.2, 0.9), rng.uniform(1.1, 4.0)]))
    idle = rng.uniform() < 0.3
    state = ("idle" if idle else "loaded") if state is None else state
    return GearDraw(
        driver=driver,
        driven=max(12, round(driver / ratio)),
        db=db - (IDLE_DB if state == "idle" else 0.0),
        state=state,
        swing=(rng.uniform(0.0, 0.8), rng.uniform(0.0, 0.8)),
        weave=tuple(np.exp(rng.uniform(math.log(0.003), math.log(0.05), 2)).tolist()),
        uneven=rng.uniform(0.0, 0.05),
        fall=rng.uniform(0.3, 1.2),
        wander=rng.uniform(0.0, 2e-4),
    )


def geared(seed: int, plan: Plan, gears: GearDraw) -> Seeded:
    """Return the record of a plan with gears, in place of those of ``seeded_faults`` where it has some."""
    record = realise(replace(plan, gear=None))
    return replace(record, samples=record.samples + added_gears(seed, plan, gears))


def added_gears(seed: int, plan: Plan, gears: GearDraw) -> NDArray[np.float32]:
    """Return the vibration of gears at their level over the noise of a plan, shape (n,)."""
    noise = noise_of(plan)
    added = gear_vibration(np.random.default_rng([31, seed]), plan, gears, noise.size)
    level = band_rms(noise, plan) * 10.0 ** (gears.db / 20.0)
    return (added * (level / max(band_rms(added, plan), 1e-30))).astype(np.float32)


def level_below(gears: GearDraw, db: float) -> float:
    """Return the level of damage, as of ``Plan.level``, whose RMS in the band is ``db`` over that of the gears."""
    return 10.0 ** ((gears.db + db) / 20.0)


def gear_vibration(rng: np.random.Generator, plan: Plan, gears: GearDraw, n: int) -> NDArray[np.float64]:
    """Return the vibration of the gears through the structure of a record, shape (n,), at some level."""
    t = np.arange(n) / plan.rate
    slow = [rng.standard_normal() * np.cos(2.0 * np.pi * (k * 0.35 * t + rng.uniform())) for k in (1, 2, 3)]
    turned = np.cumsum(plan.speed * (1.0 + gears.wander * np.sum(slow, axis=0) / math.sqrt(1.5))) / plan.rate
    make = _rattle if gears.state == "idle" else _mesh
    x = make(rng, plan, gears, turned)
    gain = 1.0 + rng.uniform(0.0, 1.0) * np.abs(resonance(np.fft.rfftfreq(n, 1.0 / plan.rate), plan))
    return np.fft.irfft(np.fft.rfft(x) * gain, n)


def _swell(
    rng: np.random.Generator, gears: GearDraw, turned: NDArray[np.float64], of: Sequence[float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what comes once in a turn of the driver and of the driven wheel, of such amplitudes."""
    first = of[0] * np.cos(2.0 * np.pi * (turned + rng.uniform()))
    return first, of[1] * np.cos(2.0 * np.pi * (gears.turns * turned + rng.uniform()))


def _mesh(rng: np.random.Generator, plan: Plan, gears: GearDraw, turned: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mesh of loaded teeth."""
    teeth = gears.driver * turned
    count = min(_MOST_HARMONICS, max(1, int(0.45 * plan.rate / (gears.driver * plan.speed))))
    orders = np.arange(1, count + 1)
    sizes = orders**-gears.fall * np.exp(0.5 * rng.standard_normal(count))
    lines = np.concatenate([[0.0], sizes * np.exp(2j * np.pi * rng.uniform(size=count)), np.zeros(7 * count)])
    table = np.fft.irfft(lines)
    first, second = _swell(rng, gears, turned, gears.weave)
    place = (teeth + (first + second) / (2.0 * np.pi)) % 1.0 * table.size
    low = place.astype(np.intp)
    share = place - low
    wave = (1.0 - share) * table[low % table.size] + share * table[(low + 1) % table.size]
    first, second = _swell(rng, gears, turned, gears.swing)
    height = (1.0 + first) * (1.0 + second)
    for wheel in (gears.driver, gears.driven):
        heights = 1.0 + gears.uneven * rng.standard_normal(wheel)
        # From tooth to tooth the height changes without a step.
        tooth = teeth % wheel
        height *= np.interp(tooth, np.arange(wheel + 1), np.append(heights, heights[0]))
    return wave * height


def _rattle(rng: np.random.Generator, plan: Plan, gears: GearDraw, turned: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the knocks of teeth without load, which ring as the structure does."""
    teeth = gears.driver * turned
    knocks = np.arange(math.ceil(teeth[0]), math.floor(teeth[-1]) + 1.0)
    knocks = knocks[rng.uniform(size=knocks.size) < 0.7]
    times = np.interp(knocks + 0.15 * rng.standard_normal(knocks.size), teeth, np.arange(teeth.size))
    first, second = _swell(rng, gears, knocks / gears.driver, gears.swing)
    heights = (1.0 + first) * (1.0 + second) * np.exp(0.5 * rng.standard_normal(knocks.size))
    x = np.zeros(teeth.size)
    np.add.at(x, np.clip(np.rint(times).astype(np.intp), 0, x.size - 1), heights * rng.choice([-1.0, 1.0], knocks.size))
    return np.fft.irfft(np.fft.rfft(x) * resonance(np.fft.rfftfreq(x.size, 1.0 / plan.rate), plan), x.size)

"""The angle of a shaft from the mesh of its gears, where nothing else gives it.

The stated speed is first refined by a comb of mesh lines. Then the phase of mesh lines is followed through the block,
harmonic after harmonic, in parts that are long enough to keep their sidebands apart: a synchronous average over fifty
turns of a wheel with 23 teeth needs the speed to 1e-5, which no shaft keeps. After Bonnardot et al.,
doi 10.1016/j.ymssp.2004.05.005.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from monitor.health.gears.settings import GearSettings
from monitor.health.signal.rotation.rotation import Rotation, constant

LINES = 8
"""Harmonics of each mesh by which the speed is sought and its phase followed: often not the first are high."""
PART_TURNS = 8.0
"""Turns of the slower wheel of a pair in a part: under a Hann window its sidebands are eight bins from the line."""
_NOISE_BINS = (3.0, 4.0, 5.0)
"""Bins on both sides of the line that neither it nor its sidebands reach."""
_SOUGHT_TURNS = 16.0
"""Turns of the slowest wheel in the parts whose mean spectrum is searched."""
_OVERLAP = 4
"""Beginnings of parts in the length of one: the phase must turn by less than half a turn from one to the next."""
MIN_PARTS = 5
_SMOOTHED = 0.5 * _OVERLAP**2 * (1.0 / 12.0 - 0.5 / math.pi**2)
"""Error of the angle over its second difference from part to part: a Hann window of length L takes the mean over it,
which is half the curvature times ``L^2 (1/12 - 1/(2 pi^2))`` off."""
MAX_PHASE_SD = 0.15
"""Largest error of the phase of the line that is followed, rad: at its third harmonic, the average reads 10 % low."""
MAX_STEP = 2.2
"""Largest step of the phase from part to part, rad: beyond half a turn it would be another one."""
MIN_MARGIN = 0.7
"""Least mean height of the comb found over that of any other, ln of power: sidebands lie a turn of a wheel away."""
_OTHER = 0.3
"""Turns of the slowest wheel, in its mesh order, beyond which a speed is another one."""
_NYQUIST = 0.45
_STEP = 0.25
_WIDTH_BINS = 3.0
"""Half width of a line under a Hann window, with a margin."""


@dataclass(frozen=True)
class MeshLine:
    """A line that may be followed.

    Attributes:
        order: multiple of the bearing's shaft.
        spacing: of its nearest sidebands, turns per turn of that shaft.
    """

    order: float
    spacing: float


def mesh_lines(settings: GearSettings) -> tuple[MeshLine, ...]:
    """Return the first line of each mesh, its sidebands those of the slower wheel of the pair."""
    found: dict[float, float] = {}
    for pair in settings.pairs:
        driver, driven = settings.by_name[pair.driver], settings.by_name[pair.driven]
        order, spacing = driver.mesh_order, min(driver.turns, driven.turns)
        found[order] = min(found.get(order, spacing), spacing)
    return tuple(MeshLine(order, spacing) for order, spacing in found.items())


def angle_of_mesh(
    samples: NDArray[np.floating], rate: float, speed: float, error: float, settings: GearSettings
) -> Rotation | None:
    """Return the angle of the bearing's shaft over a block, or None where the mesh does not show it.

    Withheld where no comb of mesh lines stands clear of others within the error of the speed, where the block is too
    short to keep the sidebands apart, and where the phase of the line is not known within ``MAX_PHASE_SD``.

    Args:
        samples: (sample,), any unit.
        rate: Hz.
        speed: of the bearing's shaft as stated, Hz.
        error: largest relative error of it.
        settings: the gears.
    """
    lines = mesh_lines(settings)
    slowest = min(line.spacing for line in lines) * speed
    found = _sought_speed(samples, rate, (speed, error), lines, slowest)
    if found is None:
        return None
    best = replace(constant(found, samples.size / rate, "phase"), turns_sd=math.inf)
    for harmonic in range(1, LINES + 1):
        for line in lines:
            best = _followed(samples, rate, best, line, harmonic) or best
    if not math.isfinite(best.turns_sd):
        return None
    bends = np.diff(best.turns, 2)
    unfollowed = _SMOOTHED * math.sqrt(float(np.mean(np.square(bends))))
    return replace(best, turns_sd=math.hypot(best.turns_sd, unfollowed))


def _sought_speed(
    samples: NDArray[np.floating],
    rate: float,
    stated: tuple[float, float],
    lines: tuple[MeshLine, ...],
    slowest: float,
) -> float | None:
    """Return the speed whose comb of mesh lines is highest, Hz, or None where another is nearly as high.

    Args:
        stated: speed, Hz, and its largest relative error.
        slowest: speed of the slowest wheel, Hz.
    """
    speed, error = stated
    length = min(samples.size, math.ceil(_SOUGHT_TURNS / slowest * rate))
    power, resolution = _mean_power(samples, rate, length)
    level = np.log(power + np.finfo(np.float64).tiny)
    orders = np.array([line.order * h for line in lines for h in range(1, LINES + 1)])
    orders = orders[orders * speed * (1.0 + error) < _NYQUIST * rate]
    if orders.size == 0:
        return None
    step = _STEP * resolution / float(orders.max())
    count = max(1, math.ceil(error * speed / step))
    speeds = speed + step * np.arange(-count, count + 1)
    places = np.outer(orders, speeds) / resolution
    score = level[np.rint(places).astype(np.intp)].mean(axis=0)
    at = int(np.argmax(score))
    highest = max(line.order / line.spacing for line in lines)
    near = max(_OTHER / highest, 2.0 * _WIDTH_BINS * resolution / (speed * float(orders.min())))
    other = np.abs(speeds / speeds[at] - 1.0) > near
    if np.any(other) and score[at] - float(score[other].max()) < MIN_MARGIN:
        return None
    return float(speeds[at])


def _mean_power(samples: NDArray[np.floating], rate: float, length: int) -> tuple[NDArray[np.float64], float]:
    """Return the mean power of half-overlapping parts under a Hann window, shape (bin,), and its resolution, Hz."""
    starts = np.linspace(0, samples.size - length, max(1, 2 * samples.size // length - 1)).astype(np.intp)
    window, n_fft = np.hanning(length + 2)[1:-1], 2 * length
    power = np.zeros(n_fft // 2 + 1)
    for start in starts:
        part = samples[start : start + length].astype(np.float64)
        power += np.square(np.abs(np.fft.rfft((part - part.mean()) * window, n_fft)))
    return power / starts.size, rate / n_fft


def _followed(
    samples: NDArray[np.floating], rate: float, known: Rotation, line: MeshLine, harmonic: int
) -> Rotation | None:
    """Return the angle by the phase of one mesh line beside the angle known so far; None where it knows no more."""
    duration, order = samples.size / rate, line.order * harmonic
    length = math.ceil(PART_TURNS / (line.spacing * known.mean_speed) * rate)
    parts = _OVERLAP * (samples.size - length) // length + 1
    if parts < MIN_PARTS or order * known.mean_speed > _NYQUIST * rate:
        return None
    time = np.arange(samples.size) / rate
    mixed = samples * np.exp(-2j * np.pi * order * known.turns_at(time))
    starts = np.linspace(0, samples.size - length, parts).astype(np.intp)
    cut = mixed[starts[:, None] + np.arange(length)] * np.hanning(length + 2)[1:-1]
    values = cut.sum(axis=1)
    bins = np.array([sign * bins for bins in _NOISE_BINS for sign in (-1.0, 1.0)])
    beside = cut @ np.exp(-2j * np.pi * np.outer(np.arange(length) / length, bins))
    noise = float(np.median(np.square(np.abs(beside)))) / math.log(2.0)
    power = float(np.square(np.abs(values)).mean())
    phase_sd = math.sqrt(0.5 * noise / power) if power > 0.0 else math.inf
    turns_sd = phase_sd / (2.0 * np.pi * order)
    steps = np.abs(np.angle(values[1:] * np.conj(values[:-1])))
    if phase_sd > MAX_PHASE_SD or turns_sd >= known.turns_sd or float(steps.max()) > MAX_STEP:
        return None
    middles = np.asarray((starts + 0.5 * (length - 1)) / rate, dtype=np.float64)
    turns = known.turns_at(middles) + np.unwrap(np.angle(values)) / (2.0 * np.pi * order)
    slope = np.asarray(np.gradient(turns, middles), dtype=np.float64)
    try:
        return Rotation(middles, turns, slope, duration, "phase", turns_sd, 0.0)
    except ValueError:
        # The phase is lost: the shaft would turn back.
        return None

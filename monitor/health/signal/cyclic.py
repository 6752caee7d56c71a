"""Cyclostationary evidence: spectral correlation and coherence of a block, over order and frequency.

Impacts of a fault recur with the angle of the shaft and ring what the structure rings with: they correlate the spectrum
at a frequency f, in Hz, with itself at f less a cyclic frequency, in events per revolution. The estimator is the fast
spectral correlation of J. Antoni, G. Xin and N. Hamzaoui, "Fast computation of the spectral correlation", Mechanical
Systems and Signal Processing 92 (2017) 248-277, doi 10.1016/j.ymssp.2017.01.011: products of neighbouring bins of one
short-time transform, summed over the distance of the bins, and one Fourier transform over the windows. Here windows
stand at equal steps of the angle of the shaft, so that the last transform is over orders (order-frequency spectral
correlation: D. Abboud, J. Antoni, M. Eltabach, S. Sieg-Zieba, "Angle/time cyclostationarity for the analysis of rolling
element bearing vibrations", Measurement 75 (2015) 29-39, doi 10.1016/j.measurement.2015.07.017).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing, kinematics
from models.words.numerics import gamma_quantile
from monitor.health.signal.plans import next_smooth
from monitor.health.signal.rotation.fit import rotation_of
from monitor.health.signal.rotation.repair import repaired
from monitor.health.signal.rotation.ridge import angle_from_vibration
from monitor.health.signal.rotation.rotation import Rotation, constant
from monitor.health.signal.settings import fundamentals
from monitor.health.signal.waterfall import SpectrumRow

Domain = Literal["order", "hertz"]
RESOLUTION = 100.0
"""About the spacing of frequencies, Hz: the window is one over it, and must be shorter than from impact to impact."""
MIN_WINDOWS = 64
"""Least number of windows side by side in a block."""
FALSE_ALARM = 0.01
"""Chance that noise exceeds the limit of the enhanced envelope spectrum at any of its cyclic frequencies."""
_SPARE_BINS = 2
"""Distance of bins beyond the highest cyclic frequency that is summed over, for the width of the window."""
_LEAST_CYCLES = 3
"""Cyclic frequencies below so many cycles a block are those of its trend."""
_INDEPENDENT = 0.45
"""Independent values a bin of a Hann window, in the mean of the coherence over a band."""
_PIECE = 4096
"""Windows that are transformed at once."""


@dataclass(frozen=True, eq=False)
class CyclicCoherence:
    """Squared spectral coherence by frequency and cyclic frequency.

    Attributes:
        domain: whether cyclic frequencies are in events per revolution ("order") or in Hz ("hertz").
        cyclic: shape (cyclic,), cyclic frequencies, from the first that a block resolves.
        frequency: shape (frequency,), Hz.
        coherence: shape (frequency, cyclic), squared magnitude: 0 for noise without end, at most about 1.
        band: of ``enhanced``, Hz.
        enhanced: shape (cyclic,), mean of ``coherence`` over the band: the enhanced envelope spectrum.
        limit: what stationary noise exceeds anywhere in ``enhanced`` with the chance ``FALSE_ALARM``.
    """

    domain: Domain
    cyclic: NDArray[np.float64]
    frequency: NDArray[np.float64]
    coherence: NDArray[np.float32]
    band: tuple[float, float]
    enhanced: NDArray[np.float64]
    limit: float

    def to_dict(self, columns: int = 512, rows: int = 128) -> dict[str, Any]:
        """Return it as plain values for JSON, thinned to so many cells, of each the highest value."""
        across = np.array_split(np.arange(self.cyclic.size), min(columns, self.cyclic.size))
        along = np.array_split(np.arange(self.frequency.size), min(rows, self.frequency.size))
        cells = [[round(float(self.coherence[np.ix_(row, column)].max()), 4) for column in across] for row in along]
        return {
            "domain": self.domain,
            "cyclic": [float(self.cyclic[column].mean()) for column in across],
            "frequency": [float(self.frequency[row].mean()) for row in along],
            "coherence": cells,
            "band": list(self.band),
            "enhanced": [round(float(self.enhanced[column].max()), 5) for column in across],
            "limit": self.limit,
        }


def cyclic_coherence(
    samples: NDArray[np.floating],
    rate: float,
    highest: float,
    rotation: Rotation | None = None,
    band: tuple[float, float] | None = None,
    resolution: float = RESOLUTION,
) -> CyclicCoherence:
    """Return the spectral coherence of a block.

    Args:
        samples: shape (sample,), any unit.
        rate: Hz.
        highest: cyclic frequency, events per revolution where there is a rotation, else Hz.
        rotation: angle of the shaft over the block, or None: cyclic frequencies are in Hz.
        band: frequencies over which the enhanced envelope spectrum is averaged, Hz; by default all.
        resolution: about the spacing of the frequencies, Hz.

    Raises:
        ValueError: the block is too short or constant, the band is empty, or the highest cyclic frequency is not
            between that of the block and a quarter of the sampling rate.
    """
    duration = samples.size / rate
    turning = constant(1.0, duration) if rotation is None else rotation
    width = 2 * round(0.5 * rate / resolution)
    if width < 8 or samples.size < MIN_WINDOWS * width:
        raise ValueError(
            f"a block needs {MIN_WINDOWS} windows of {width} samples for a resolution of {resolution:g} Hz, "
            f"got {samples.size} samples"
        )
    highest_hz = highest * turning.speed_range[1]
    if not _LEAST_CYCLES / turning.turned < highest or highest_hz > 0.25 * rate:
        raise ValueError(
            f"highest cyclic frequency must lie between {_LEAST_CYCLES / turning.turned:g} and "
            f"{0.25 * rate / turning.speed_range[1]:g}, got {highest:g}"
        )
    x = samples - samples.mean(dtype=np.float64)
    scale = float(np.abs(x).max())
    if not (0.0 < scale < math.inf):
        raise ValueError("a constant block has no spectral coherence")
    reach = math.ceil(highest_hz / (rate / width)) + _SPARE_BINS
    products, power = _products((x / scale).astype(np.float32), rate, turning, width, reach)
    count = products.shape[1]
    first = _LEAST_CYCLES
    last = min(math.floor(highest * turning.turned), count // 2 - 1)
    # The power itself would leak to its neighbours.
    products -= products.mean(axis=1, keepdims=True)
    # Twice as many cyclic frequencies as a block resolves: a line between two of them loses a fifth at most.
    correlation = np.fft.fft(products, 2 * count, axis=1)[:, 2 * first : 2 * last + 1] / count
    cyclic = np.arange(2 * first, 2 * last + 1) / (2.0 * turning.turned)
    bins = np.arange(width // 2 + 1, dtype=np.float64)
    spacing = rate / width
    correlation /= _response(cyclic, turning, width, spacing, reach)
    # The power at the frequency less the cyclic one, which is that of a shaft at its mean speed.
    lower = np.abs(bins[:, None] * spacing - cyclic * turning.mean_speed) / spacing
    both = power[:, None] * np.interp(lower, bins, power)
    coherence = (np.square(np.abs(correlation)) / np.maximum(both, np.finfo(np.float64).tiny)).astype(np.float32)
    frequency = bins * spacing
    chosen = (0.0, 0.5 * rate) if band is None else band
    inside = (frequency >= chosen[0]) & (frequency <= chosen[1]) & (bins > 0) & (bins < width // 2)
    if not inside.any():
        raise ValueError(f"band {chosen[0]:g} to {chosen[1]:g} Hz holds no frequency of a spacing of {spacing:g} Hz")
    enhanced = coherence[inside].mean(axis=0, dtype=np.float64)
    domain: Domain = "hertz" if rotation is None else "order"
    limit = noise_limit(enhanced, int(np.count_nonzero(inside)))
    return CyclicCoherence(domain, cyclic, frequency, coherence, chosen, enhanced, limit)


def _products(
    x: NDArray[np.float32], rate: float, rotation: Rotation, width: int, reach: int
) -> tuple[NDArray[np.complex64], NDArray[np.float64]]:
    """Return the products of bins, summed over their distance, and the mean power of each bin.

    Returns:
        Shape (frequency, window), windows at equal steps of the angle; and shape (frequency,).
    """
    # The products hold cyclic frequencies up to the reach, and the width of the window.
    slowest = rotation.speed_range[0]
    step = width / (2.0 * (reach + _SPARE_BINS)) / rate
    count = next_smooth(math.ceil(rotation.turned / (slowest * step)))
    begin = float(rotation.turns_at(0.0))
    centre = rotation.time_at(begin + (np.arange(count) + 0.5) * (rotation.turned / count)) * rate
    starts = np.rint(centre).astype(np.intp)
    padded = np.pad(x, (width // 2, width))
    window = np.hanning(width + 1)[:-1].astype(np.float32)
    half = width // 2
    products = np.empty((half + 1, count), dtype=np.complex64)
    power = np.zeros(half + 1)
    # In the middle of the window all distances are in phase.
    sign = np.where(np.arange(width) % 2 == 0, 1.0, -1.0).astype(np.float32)
    for begin_at in range(0, count, _PIECE):
        part = slice(begin_at, min(begin_at + _PIECE, count))
        pieces = padded[starts[part, None] + np.arange(width)] * window
        spectrum = np.fft.fft(pieces, axis=1) * sign
        wrapped = np.concatenate((spectrum[:, -reach - 1 :], spectrum, spectrum[:, :reach]), axis=1)
        summed = np.cumsum(wrapped, axis=1)
        near = summed[:, 2 * reach + 1 :] - summed[:, :width]
        own = spectrum[:, : half + 1]
        products[:, part] = (own * np.conj(near[:, : half + 1])).T
        power += np.square(np.abs(own)).sum(axis=0)
    return products, power / count


def _response(
    cyclic: NDArray[np.float64], rotation: Rotation, width: int, spacing: float, reach: int
) -> NDArray[np.float64]:
    """Return what the sum over distances makes of a correlation of one, shape (cyclic,), in the mean over speeds."""
    window = np.square(np.hanning(width + 1)[:-1])
    offset = np.arange(width, dtype=np.float64) - width // 2
    kernel = window * np.array([_dirichlet(2.0 * np.pi * float(each) / width, reach) for each in offset])
    speeds = rotation.speed_at((np.arange(9) + 0.5) / 9.0 * rotation.duration)
    grid = np.linspace(0.0, float(cyclic[-1]) * float(speeds.max()), 512)
    wave = np.cos(2.0 * np.pi * np.outer(grid / (spacing * width), offset))
    response = np.asarray(wave @ kernel, dtype=np.float64) / float(window.sum())
    total = np.zeros(cyclic.size)
    for speed in speeds:
        total += np.interp(cyclic * float(speed), grid, response)
    return total / speeds.size


def _dirichlet(angle: float, reach: int) -> float:
    """Return the sum of exp(i k angle) for k from -reach to reach."""
    if abs(math.sin(0.5 * angle)) < 1e-12:
        return 2.0 * reach + 1.0
    return math.sin((reach + 0.5) * angle) / math.sin(0.5 * angle)


def noise_limit(enhanced: NDArray[np.float64], bins: int) -> float:
    """Return what the mean coherence of stationary noise over so many bins exceeds anywhere with ``FALSE_ALARM``.

    It has a gamma distribution, whose scale is taken from the median of the spectrum, which few lines do not move.
    """
    shape = max(1.0, _INDEPENDENT * bins)
    each = 1.0 - FALSE_ALARM / enhanced.size
    return float(np.median(enhanced)) * gamma_quantile(shape, each) / gamma_quantile(shape, 0.5)


HARMONICS = 4
"""Lines of each part that are looked at."""
SLIP = 0.02


@dataclass(frozen=True)
class CyclicLine:
    """The first line of a part of the bearing.

    Attributes:
        order: by its kinematics, events per revolution.
        found: order of the highest value near it.
        coherence: there, mean over the band.
        stands_out: whether that exceeds the limit of noise.
        frequency: at which the coherence is highest there, Hz.
    """

    order: float
    found: float
    coherence: float
    stands_out: bool
    frequency: float


@dataclass(frozen=True, eq=False)
class CyclicStudy:
    """Coherence of a recording, the angle of its shaft, and the first lines of a bearing, events per revolution."""

    found: CyclicCoherence
    rotation: Rotation
    orders: dict[str, float]

    def lines(self) -> dict[str, CyclicLine]:
        """Return what stands at the first line of each part that the coherence reaches."""
        return lines_of(self.found, self.orders)


def lines_of(found: CyclicCoherence, orders: Mapping[str, float]) -> dict[str, CyclicLine]:
    """Return what stands at the first line of each part that a coherence reaches.

    Args:
        orders: first line of each part, in the unit of the cyclic frequencies.
    """
    result: dict[str, CyclicLine] = {}
    for part, order in orders.items():
        near = np.abs(found.cyclic / order - 1.0) <= SLIP
        if near.any():
            place = int(np.argmax(np.where(near, found.enhanced, -np.inf)))
            top = float(found.enhanced[place])
            loudest = float(found.frequency[int(np.argmax(found.coherence[:, place]))])
            result[part] = CyclicLine(order, float(found.cyclic[place]), top, top > found.limit, loudest)
    return result


def cyclic_study(
    samples: NDArray[np.floating],
    rate: float,
    bearing: Bearing,
    rotation: Rotation,
    band: tuple[float, float] | None = None,
    resolution: float = RESOLUTION,
) -> CyclicStudy:
    """Return the coherence of a block up to the fourth line of the inner race, as far as the sampling rate allows.

    Raises:
        ValueError: see ``cyclic_coherence``.
    """
    lines = kinematics(bearing, 1.0)
    highest = min((HARMONICS + 0.5) * lines.bpfi, 0.24 * rate / rotation.speed_range[1])
    found = cyclic_coherence(samples, rate, highest, rotation, band, resolution)
    return CyclicStudy(found, rotation, fundamentals(lines))


def known_rotation(
    samples: NDArray[np.floating],
    rate: float,
    bearing: Bearing,
    speed: float | None = None,
    limits: tuple[float, float] | None = None,
    pulses: NDArray[np.float64] | None = None,
    per_revolution: int = 1,
) -> Rotation:
    """Return the angle of the shaft over a block by what is known of it.

    Args:
        speed: where it is steady, Hz.
        limits: lowest and highest speed, Hz, between which the angle is found in the vibration.
        pulses: times of the pulses of a tacho, s from the first sample.
        per_revolution: pulses of a turn.

    Raises:
        ValueError: none of the three is given, or no angle is found.
    """
    duration = samples.size / rate
    if pulses is not None:
        found = repaired(pulses, duration, per_revolution)
        if found.train is None:
            raise ValueError(f"the pulses give no angle of the shaft: {found.status}")
        return rotation_of(found.train, duration)
    if limits is not None:
        rotation, status = angle_from_vibration(samples, rate, bearing, limits)
        if rotation is None:
            raise ValueError(f"no angle of the shaft is found between {limits[0]:g} and {limits[1]:g} Hz: {status}")
        return rotation
    if speed is None:
        raise ValueError("the speed is not known: give one, or the range in which it is found in the vibration")
    return constant(speed, duration)


VIEW_HARMONICS = 4.2
"""Cyclic frequencies reach beyond the fourth line of the part with the highest first one."""


def kept_coherence(row: SpectrumRow) -> CyclicCoherence:
    """Return the coherence of the waveform of a row with a view, over the demodulated band and orders of the shaft.

    Raises:
        ValueError: the row has no view or no speed, or its waveform is too short.
    """
    if row.view is None or not row.view.waveform.size or not row.speed > 0.0 or not row.lines:
        raise ValueError("nothing is kept of the samples of this block, or its speed is not known")
    rate, samples = row.view.rate, np.asarray(row.view.waveform, dtype=np.float64)
    duration = samples.size / rate
    rotation = constant(row.speed, duration)
    if row.speed_course is not None:
        rotation = rotation_of_course(row.speed_course, row.view.samples / rate, duration)
    highest = VIEW_HARMONICS * max(row.lines.values()) / row.speed
    highest = min(highest, 0.25 * rate / rotation.speed_range[1])
    return cyclic_coherence(samples, rate, highest, rotation, row.band)


def rotation_of_course(course: Sequence[float], whole: float, duration: float) -> Rotation:
    """Return the rotation over the beginning of a block.

    Args:
        course: speed at equal steps of the whole block, Hz.
        whole, duration: of the block, and of its beginning, s.
    """
    speed = np.asarray(course, dtype=np.float64)
    step = whole / (speed.size - 1)
    # The trapezoids, and what they lack where the speed is curved.
    slope = np.gradient(speed, step)
    pieces = 0.5 * step * (speed[:-1] + speed[1:]) - step * step / 12.0 * np.diff(slope)
    turns = np.concatenate(([0.0], np.cumsum(pieces)))
    last = min(speed.size, int(np.ceil(duration / step)) + 2)
    time = np.arange(last, dtype=np.float64) * step
    return Rotation(time, turns[:last], speed[:last], duration)

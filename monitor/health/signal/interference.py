"""Lines of other origin (gear mesh, line frequency, other shafts) are taken out of a band before its envelope.

A tone in the demodulated band raises the mean of the envelope, on which depths are relative, and beats with the noise
and with other tones: sidebands of a mesh are a comb of the shaft in the envelope. Where lines are configured, the bins
around each that stand out of the noise beside it are set to the level of that noise, their phases kept; everything else
stays as it is, bit for bit. The bearing's own lines stay: slip spreads them, and no two families share a comb.

It was compared with a notch to zero, with the liftering of
the cepstrum (Randall and Sawalhi, doi 10.1016/j.ymssp.2010.12.005) and with synchronous averages, by depth and cost.

Lines that follow a shaft of varying speed are taken out of a band before its envelope.

Over time such a line is no line. The analytic signal of the band is brought to equal steps of angle with its carrier,
which spreads the band's own edges over a range of orders; there the lines are limited as everywhere
(:mod:`monitor.health.signal.interference`), and the magnitude of what is left is the envelope over the angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.orders import Warp, between, grid_bins

_STANDS_OUT = 12.0
"""Power of the highest bin at a line over the noise, above which the line is removed."""
_PRESENT, _PRESENT_SD = 0.7, 3.0
"""A comb is removed if its lines stand higher than the places midway between by this, in mean log power, and by this
over the root of their number: damage lifts both alike."""
_HIGH = 4.6
"""Mean log power of the harmonics of a mesh over the noise from which it is there, whatever stands between: 20 dB."""
MESH_SD = 3e-4
"""Relative standard deviation of a speed that is read from a mesh: a bin of one of its lines, and the wander."""
_CORE_BINS, _WANDER = 6.0, 5e-4
"""Least half width of a line: bins, as the spectrum is of the samples as they are, and share of its frequency, as no
speed is constant over a block."""
_MAX_WANDER = 3e-3
"""Largest half width, over the frequency; skirts count as wander."""
_SKIRT_BINS = 64.0
_RING_BINS, _RING_OVER_NOISE = 4, 3.0
"""A line ends where the mean power of so many bins on both sides is less than this over the noise."""
MIN_SPACING_BINS = 12.0
"""Sidebands closer than this stay in, and a comb of closer lines is not removed: short blocks resolve neither."""
_NOISE_SPACINGS, _NOISE_BINS, _NOISE_SAMPLES, _NOISE_QUANTILE = 3.0, 64.0, 129, 0.2
"""The noise at a line is a low quantile of the power of bins around it: of those that no line reaches."""
_SOUGHT = 8
"""Lowest lines of a comb in the band, by which it is found: higher ones are smeared more."""
_STEP = 0.5
_CAP = 6.0


@dataclass(frozen=True)
class Interference:
    """Lines of other origin, as configured.

    Attributes:
        orders: multiples of the shaft speed, such as the number of teeth of a gear on the shaft.
        lines: frequencies that do not depend on the speed, Hz.
        harmonics: how many multiples of each belong to it; None for all up to the Nyquist frequency.
        sidebands: how many lines on each side of each multiple, ``spacing`` orders of the shaft apart.
        spacing: of the sidebands, orders of the shaft.
        tolerance: the lines are sought within this share of where they should be.
        name: for people.
        beside: further spacings of sidebands, orders of the shaft: those of both wheels of a pair stand beside its
            mesh, and their sums and differences up to ``sidebands`` steps in all.
    """

    orders: tuple[float, ...] = ()
    lines: tuple[float, ...] = ()
    harmonics: int | None = None
    sidebands: int = 0
    spacing: float = 1.0
    tolerance: float = 0.005
    name: str = ""
    beside: tuple[float, ...] = ()

    def combs(self, speed: float | None) -> tuple[Comb, ...]:
        """Return the combs at a shaft speed, Hz; without one, those of the fixed lines, without sidebands."""
        sidebands = 0 if speed is None else self.sidebands
        spacing = 0.0 if speed is None else self.spacing * speed
        beside = () if speed is None else tuple(other * speed for other in self.beside)
        lines = [] if speed is None else [(order * speed, True) for order in self.orders]
        lines += [(line, False) for line in self.lines]
        return tuple(
            Comb(line, self.harmonics, sidebands, spacing, self.tolerance, of_shaft, beside) for line, of_shaft in lines
        )


@dataclass(frozen=True)
class Comb:
    """One line with its harmonics and sidebands.

    Attributes:
        fundamental: Hz.
        harmonics: how many, or None for all.
        sidebands: how many on each side of each harmonic.
        spacing: of the sidebands, Hz.
        tolerance: share by which the fundamental is uncertain.
        of_shaft: whether the fundamental is a multiple of the shaft speed.
        beside: further spacings of sidebands, Hz.
    """

    fundamental: float
    harmonics: int | None
    sidebands: int
    spacing: float
    tolerance: float
    of_shaft: bool = False
    beside: tuple[float, ...] = ()

    def centres(self, low: float, high: float) -> NDArray[np.float64]:
        """Return the harmonics from ``low`` to ``high``, Hz."""
        reach = 0.5 * self.fundamental if self.beside else self.sidebands * self.spacing
        last = math.floor((high + reach) / self.fundamental)
        last = last if self.harmonics is None else min(last, self.harmonics)
        first = max(1, math.ceil((low - reach) / self.fundamental))
        return self.fundamental * np.arange(first, last + 1, dtype=np.float64)

    def sides(self, resolution: float) -> tuple[NDArray[np.float64], float]:
        """Return the offsets of a harmonic's lines from it, rising, and the least distance between lines, Hz.

        A sideband closer than ``MIN_SPACING_BINS`` to one of fewer steps is left out: the block cannot resolve it.
        """
        least = MIN_SPACING_BINS * resolution
        if not self.beside:
            count = self.sidebands if self.spacing >= least else 0
            sides = self.spacing * np.arange(-count, count + 1, dtype=np.float64)
            return sides, min(self.fundamental, self.spacing) if count else self.fundamental
        steps = range(-self.sidebands, self.sidebands + 1)
        ways = product(steps, repeat=1 + len(self.beside))
        nearest = sorted((sum(map(abs, way)), way) for way in ways if sum(map(abs, way)) <= self.sidebands)
        kept = [0.0]
        for _, way in nearest:
            place = sum(n * spacing for n, spacing in zip(way, (self.spacing, *self.beside), strict=True))
            # Beyond half the way to the next harmonic its own sidebands stand.
            if abs(place) <= 0.5 * self.fundamental and min(abs(place - other) for other in kept) >= least:
                kept.append(place)
        sides = np.sort(np.array(kept))
        across = self.fundamental - float(sides[-1] - sides[0])
        between = float(np.diff(sides).min(initial=self.fundamental))
        return sides, between if across < least else min(between, across)


def all_combs(settings: Iterable[Interference], speed: float | None) -> tuple[Comb, ...]:
    """Return the combs of several settings at a shaft speed, Hz, or None where it is not known."""
    return tuple(comb for one in settings for comb in one.combs(speed))


def wheel_turns(settings: Iterable[Interference]) -> tuple[float, ...]:
    """Return the turns of all wheels of pairs, in a turn of the shaft, each once."""
    found = (turn for one in settings if one.beside for turn in (one.spacing, *one.beside))
    return tuple(dict.fromkeys(found))


def fixed_combs(combs: Iterable[Comb]) -> tuple[Comb, ...]:
    """Return the combs whose lines do not follow the shaft, without their sidebands, which do."""
    return tuple(replace(comb, sidebands=0, beside=()) for comb in combs if not comb.of_shaft)


def remove_lines(
    spectrum: NDArray[np.complexfloating], resolution: float, combs: Sequence[Comb], low: float, high: float
) -> float | None:
    """Set the lines of combs between two frequencies to the level of the noise beside them, in place.

    Lines that the resolution cannot separate from what is between them stay: see ``MIN_SPACING_BINS``.

    Args:
        spectrum: (bin,) transform of real samples without a window, bin 0 at 0 Hz; any normalisation.
        resolution: spacing of its bins, Hz.
        combs: what to remove.
        low, high: Hz; nothing outside is touched.

    Returns:
        The speed of the shaft over the stated one, as the first mesh of gears that stands high shows it; else None.
    """
    shown: float | None = None
    first, last = max(1, math.ceil(low / resolution)), min(spectrum.size - 2, math.floor(high / resolution))
    for comb in combs:
        centres = comb.centres(low, high)
        if centres.size == 0 or comb.fundamental < MIN_SPACING_BINS * resolution:
            continue
        factor = _factor(spectrum, resolution, centres[:_SOUGHT], comb.tolerance)
        centres *= factor
        sides, spacing = comb.sides(resolution)
        places = np.add.outer(centres, sides).ravel() / resolution
        places = places[(places >= first) & (places <= last)]
        lowest = places[: _SOUGHT * sides.size]
        high_mesh = bool(comb.beside) and _stand_high(
            spectrum, centres[:_SOUGHT] / resolution, comb.fundamental / resolution
        )
        if high_mesh and shown is None:
            shown = factor
        if lowest.size and (high_mesh or _is_present(spectrum, lowest, spacing / resolution)):
            _limit(spectrum, places, spacing / resolution, first, last)
    return shown


def _is_present(spectrum: NDArray[np.complexfloating], places: NDArray[np.float64], spacing: float) -> bool:
    """Return whether lines (in bins) stand higher than the places midway between them."""
    reach = max(1, min(math.ceil(_WANDER * float(places.max())), int(spacing / 4.0)))
    apart = min(0.5 * spacing, _SKIRT_BINS)
    tiny = float(np.finfo(np.float32).tiny)
    levels: list[float] = []
    for middles in (places, places - apart, places + apart):
        highest: NDArray[np.floating] = _power(spectrum, middles, reach).max(axis=1)
        levels.append(float(np.mean(np.log(np.maximum(highest, tiny)))))
    return levels[0] - max(levels[1:]) > _PRESENT + _PRESENT_SD / math.sqrt(places.size)


def _stand_high(spectrum: NDArray[np.complexfloating], centres: NDArray[np.float64], spacing: float) -> bool:
    """Return whether the harmonics of a mesh (in bins) stand high over the noise.

    Its sidebands, of two wheels, may be so close together that the places between them tell nothing.
    """
    reach = max(1, math.ceil(_WANDER * float(centres.max())))
    highest: NDArray[np.floating] = _power(spectrum, centres, reach).max(axis=1)
    tiny = float(np.finfo(np.float32).tiny)
    over = np.maximum(highest, tiny) / np.maximum(_noise(spectrum, centres, spacing), tiny)
    return float(np.mean(np.log(over))) > _HIGH


def _limit(
    spectrum: NDArray[np.complexfloating], places: NDArray[np.float64], spacing: float, first: int, last: int
) -> None:
    """Set lines, as wide as they are, to the level of the noise between them, phases kept, in place.

    Args:
        spectrum: (bin,).
        places: (line,) of the lines, in bins.
        spacing: of neighbouring lines, bins.
        first, last: bins that may be touched.
    """
    noise = _noise(spectrum, places, spacing)[:, None]
    core = np.minimum(_CORE_BINS + _WANDER * places, 0.25 * spacing)
    most = np.minimum(_SKIRT_BINS + _MAX_WANDER * places, 0.5 * spacing)
    reach = max(1, int(most.max()))
    power = _power(spectrum, places, reach)
    offsets = np.arange(-reach, reach + 1)
    rings = power[:, reach:] + power[:, reach::-1]
    sums = np.cumsum(np.pad(rings, ((0, 0), (1, _RING_BINS - 1)), mode="edge"), axis=1, dtype=np.float64)
    ends = (sums[:, _RING_BINS:] - sums[:, :-_RING_BINS]) < 2.0 * _RING_BINS * _RING_OVER_NOISE * noise
    ends &= np.arange(reach + 1) >= core[:, None]
    ends[:, -1] = True
    half = np.minimum(np.argmax(ends, axis=1), most)[:, None]
    inside = np.abs(offsets) <= np.maximum(core, 1.0)[:, None]
    stands_out = np.max(np.where(inside, power, 0.0), axis=1, keepdims=True) > _STANDS_OUT * noise
    around = np.rint(places).astype(np.intp)[:, None] + offsets
    touched = stands_out & (np.abs(offsets) <= half) & (around >= first) & (around <= last) & (power > noise)
    factors = np.sqrt(noise / np.where(touched, power, 1.0)).astype(power.dtype)
    spectrum[around[touched]] *= factors[touched]


def _power(spectrum: NDArray[np.complexfloating], places: NDArray[np.float64], reach: int) -> NDArray[np.floating]:
    """Return the power of the bins around places, shape (place, 2 reach + 1)."""
    return _power_of(spectrum, np.rint(places).astype(np.intp)[:, None] + np.arange(-reach, reach + 1))


def _power_of(spectrum: NDArray[np.complexfloating], bins: NDArray[np.intp]) -> NDArray[np.floating]:
    """Return the power of bins, of the nearest there is for those outside."""
    found = spectrum.take(bins, mode="clip")
    return np.square(found.real) + np.square(found.imag)


def _noise(spectrum: NDArray[np.complexfloating], places: NDArray[np.float64], spacing: float) -> NDArray[np.floating]:
    """Return the mean power of the noise at places, shape (place,)."""
    span = max(_NOISE_BINS, _NOISE_SPACINGS * spacing)
    span = min(span, 0.25 * spectrum.size)
    around = np.rint(places[:, None] + np.linspace(-span, span, _NOISE_SAMPLES)).astype(np.intp)
    power = _power_of(spectrum, np.abs(around))
    rank = int(_NOISE_QUANTILE * _NOISE_SAMPLES)
    return np.partition(power, rank, axis=1)[:, rank] / power.dtype.type(-math.log(1.0 - _NOISE_QUANTILE))


def _factor(
    spectrum: NDArray[np.complexfloating], resolution: float, centres: NDArray[np.float64], tolerance: float
) -> float:
    """Return by what the lines stand off their stated places, found where they stand highest together."""
    count = math.ceil(tolerance * float(centres[-1]) / (_STEP * resolution))
    if count == 0:
        return 1.0
    factors = 1.0 + tolerance * np.arange(-count, count + 1) / count
    score = np.zeros(factors.size)
    for centre in centres.tolist():
        bins = np.clip(np.rint(factors * (centre / resolution)).astype(np.intp), 1, spectrum.size - 2)
        # The difference of neighbours is the Hann window: without it, the skirts of one line outweigh the others.
        hann = 2.0 * spectrum[bins] - spectrum[bins - 1] - spectrum[bins + 1]
        power = np.square(hann.real, dtype=np.float64) + np.square(hann.imag, dtype=np.float64)
        noise = max(float(np.median(power)), np.finfo(np.float64).tiny)
        score += np.minimum(np.log1p(power / noise), _CAP)
    return float(factors[np.argmax(score)])


_MIN_ROOM = 1.05
"""Samples over the angle, over the range of orders that the band covers."""
_MIRRORED_SPACINGS, _MIRRORED_BINS = 4.0, 128
"""Beyond the ends of that range the spectrum is mirrored: the noise at a line is read on both sides."""


def envelope_beside(
    bins: NDArray[np.complexfloating], first: int, warp: Warp, combs: Sequence[Comb], least: int
) -> NDArray[np.floating]:
    """Return the envelope of a band at equal steps of angle, without the lines of combs of the shaft.

    Args:
        bins: (bin,) of the band, of the FFT of the signal over ``warp.duration``, not normalised.
        first: number of the first of them.
        warp: times at equal steps of angle.
        combs: at the mean speed.
        least: number of steps.

    Returns:
        Magnitude of the sum of the bins, each turning; shape (step of angle,).
    """
    lowest = math.floor(first / warp.duration * warp.mean_speed / warp.fastest / warp.resolution)
    highest = math.ceil((first + bins.size) / warp.duration * warp.mean_speed / warp.slowest / warp.resolution)
    points = warp.n_points(max(_MIN_ROOM * (highest - lowest), least))
    corrected, length = grid_bins(bins)
    grid = np.fft.ifft(corrected, length, norm="forward")
    times = warp.points(points, 1.0)
    places = times * (length / warp.duration)
    signal = between(grid, places)
    steps = np.arange(points).reshape(-1, places.shape[0]).T
    turns = times * (first / warp.duration) - steps * (lowest / points)
    angle = (2.0 * np.pi * (turns - np.rint(turns))).astype(signal.real.dtype)
    signal *= np.cos(angle) + 1j * np.sin(angle)
    width = highest - lowest
    spectrum = np.fft.fft(signal.T.ravel())
    spectrum[:width] = _without(spectrum[:width], lowest, warp.resolution, combs)
    return np.abs(np.fft.ifft(spectrum))


def _without(
    spectrum: NDArray[np.complexfloating], lowest: int, resolution: float, combs: Sequence[Comb]
) -> NDArray[np.complexfloating]:
    """Return a spectrum, whose first bin has the number ``lowest``, without the lines of combs."""
    spacing = max(comb.fundamental for comb in combs) / resolution
    mirrored = min(round(_MIRRORED_SPACINGS * spacing) + _MIRRORED_BINS, spectrum.size - 1)
    begin, end = lowest, lowest + spectrum.size
    whole = np.zeros(end + mirrored, dtype=spectrum.dtype)
    padded = np.pad(spectrum, mirrored, mode="reflect")
    least = max(begin - mirrored, 0)
    whole[least:] = padded[least - begin + mirrored :]
    remove_lines(whole, resolution, combs, begin * resolution, (end - 1) * resolution)
    return whole[begin:end]

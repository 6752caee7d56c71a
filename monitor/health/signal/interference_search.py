"""Proposals of ``[[interference]]``: strong narrow lines in the demodulated band that are not those of the bearing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.floor import noise_floor
from monitor.health.signal.interference import Comb, remove_lines
from monitor.health.signal.transform import Band, fast_length

_FLOOR_BINS = 257
_OVER_FLOOR = 300.0
"""Power of a line over the noise beside it, at which it takes part: 25 dB."""
_NARROW_BINS = 12
"""A line is narrow if it has fallen to a tenth within so many bins, which is what wandering speeds leave of a tone."""
MIN_SHARE = 0.03
"""Share of the power of the band that a proposal must carry; less changes depths by no more."""
_MOST_LINES = 400
_MOST_PARTS = 12
_NEARLY_ALL = 0.9
_SIDEBANDS = 3
_LOWEST_ORDER = 8.0
_LINE_BINS, _BINS_PER_ORDER = 1.5, 0.05
"""How far a line may be from its place on a comb of the bearing whose fundamental was found by five harmonics."""
_SIDEBANDS_OF_BEARING = (-2, -1, 0, 1, 2)
_EXACT, _NEAR_ORDER = 3e-3, 0.1
"""How exact a speed is, and how near an integer an order must be; beyond order 33 any frequency would be near one."""


@dataclass(frozen=True)
class Proposal:
    """A line or comb that may be of other origin than the bearing.

    Attributes:
        fundamental: Hz.
        order: multiple of the shaft, where it is an integer that the speed can tell, else None.
        harmonics: how many multiples stand out in the band.
        sidebands: whether lines at distances of the shaft speed stand beside them.
        share: of the power in the band.
    """

    fundamental: float
    order: int | None
    harmonics: int
    sidebands: bool
    share: float


def propose(
    x: NDArray[np.number],
    rate: float,
    band: Band,
    speed: float | None,
    own: Sequence[float] = (),
    known: Sequence[Comb] = (),
) -> tuple[Proposal, ...]:
    """Return the lines and combs of a band that carry much of its power, the strongest first.

    Lines on the combs of the bearing are left out. With a wrong speed an integer order is
    not recognised and the line is given in Hz.

    Args:
        x: (sample,) one block.
        rate: Hz.
        band: demodulated, Hz.
        speed: of the shaft, Hz, or None.
        own: fundamentals of combs that are the bearing's, Hz, as found.
        known: combs that are removed already.

    Raises:
        ValueError: the block is shorter than 64 samples.
    """
    n = fast_length(x.size)
    resolution = rate / n
    block = x[:n] - float(np.mean(x[:n]))
    if known:
        spectrum = np.fft.rfft(block)
        remove_lines(spectrum, resolution, known, *band)
        block = np.fft.irfft(spectrum, n)
    amplitude = np.abs(np.fft.rfft(block * np.hanning(n + 1)[:-1])).astype(np.float32)
    power = np.square(amplitude, dtype=np.float64)
    first, last = math.ceil(band[0] / resolution), min(power.size - 1, math.floor(band[1] / resolution))
    total = float(power[first : last + 1].sum())
    if total <= 0.0 or last - first < _FLOOR_BINS:
        return ()
    lines = _lines(amplitude, power, first, last)
    lines = lines[[not _is_of_bearing(line * resolution, speed, own, resolution) for line in lines]]
    found: list[Proposal] = []
    strengths = {int(line): _strength(power, int(line)) for line in lines}
    while strengths:
        proposal, explained = _strongest(strengths, resolution, speed, total)
        for line in explained:
            del strengths[line]
        if proposal.share >= MIN_SHARE:
            found.append(proposal)
    return tuple(sorted(found, key=lambda one: -one.share))


def _lines(amplitude: NDArray[np.float32], power: NDArray[np.float64], first: int, last: int) -> NDArray[np.intp]:
    """Return the bins of the strongest narrow maxima between two bins, rising."""
    floor = noise_floor(amplitude, _FLOOR_BINS)
    first, last = max(first, _NARROW_BINS), min(last, power.size - 1 - _NARROW_BINS)
    bins = np.flatnonzero(power[first : last + 1] > _OVER_FLOOR * floor[first : last + 1]) + first
    around = power[bins[:, None] + np.arange(-_NARROW_BINS, _NARROW_BINS + 1)]
    at = around[:, _NARROW_BINS]
    sides = np.maximum(around[:, :2].max(axis=1), around[:, -2:].max(axis=1))
    bins = bins[(at >= around.max(axis=1)) & (sides < 0.1 * at)]
    return np.sort(bins[np.argsort(power[bins])[-_MOST_LINES:]])


def _strength(power: NDArray[np.float64], line: int) -> float:
    return float(power[line - _NARROW_BINS // 2 : line + _NARROW_BINS // 2 + 1].sum())


def _is_of_bearing(frequency: float, speed: float | None, own: Sequence[float], resolution: float) -> bool:
    """Return whether a line stands on a comb of the bearing, or on a sideband of the shaft beside it."""
    shifts = (0.0,) if speed is None else tuple(k * speed for k in _SIDEBANDS_OF_BEARING)
    for fundamental in own:
        for shift in shifts:
            place = frequency - shift
            order = round(place / fundamental)
            reach = resolution * (_LINE_BINS + _BINS_PER_ORDER * order)
            if order > 0 and abs(place - order * fundamental) <= reach:
                return True
    return False


def _strongest(
    strengths: Mapping[int, float], resolution: float, speed: float | None, total: float
) -> tuple[Proposal, set[int]]:
    """Return the comb of the strongest line, or that line alone, and the lines that belong to it."""
    top = max(strengths, key=lambda line: strengths[line])
    lowest = _LOWEST_ORDER * speed / resolution if speed is not None else 0.0
    candidates = [(top / parts, _members(strengths, top / parts)) for parts in range(1, _MOST_PARTS + 1)]
    candidates = [candidate for candidate in candidates if candidate[0] >= lowest] or candidates[:1]
    most = max(sum(strengths[line] for line in members) for _, members in candidates)
    # The highest fundamental that explains nearly as much: each part of it explains it all, too.
    fundamental, members = next(
        (place, lines) for place, lines in candidates if sum(strengths[line] for line in lines) >= _NEARLY_ALL * most
    )
    orders = np.array([round(line / fundamental) for line in members], dtype=np.float64)
    fundamental = float(np.sum(orders * np.array(list(members))) / np.sum(orders * orders))
    beside = set[int]() if speed is None else _beside(strengths, members, speed / resolution)
    explained = members | beside
    share = sum(strengths[line] for line in explained) / total
    order = None if speed is None else _integer_order(fundamental * resolution / speed)
    proposal = Proposal(fundamental * resolution, order, len(members), bool(beside), share)
    return proposal, explained


def _integer_order(order: float) -> int | None:
    """Return the integer that an order is within the error of a stated speed, or None."""
    nearest = round(order)
    near = abs(order - nearest) <= _EXACT * order
    return nearest if near and nearest >= _LOWEST_ORDER and _EXACT * order <= _NEAR_ORDER else None


def _members(strengths: Mapping[int, float], fundamental: float) -> set[int]:
    """Return the lines at multiples of a fundamental, in bins."""
    return {line for line in strengths if abs(line - fundamental * round(line / fundamental)) <= 1.5 + 1e-4 * line} or {
        max(strengths, key=lambda line: strengths[line])
    }


def _beside(strengths: Mapping[int, float], members: set[int], spacing: float) -> set[int]:
    """Return the lines that are sidebands of the members, ``spacing`` bins of the shaft apart."""
    shifts = [k * spacing for k in range(-_SIDEBANDS, _SIDEBANDS + 1) if k]
    return {
        line
        for line in strengths
        if line not in members and any(abs(line - member - shift) <= 3.0 for member in members for shift in shifts)
    }

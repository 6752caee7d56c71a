"""What has to be known of a channel to compute its features, and how far its spectra are needed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from models.machine.bearing import Kinematics
from monitor.health.signal.interference import Comb
from monitor.health.signal.lines import SEARCH
from monitor.health.signal.rotation.rotation import Rotation
from monitor.health.signal.search import FamilySearch, slip_searches, widened_searches
from monitor.health.signal.shaft import ACCEPTED, highest_order, measurable
from monitor.health.signal.transform import Band
from monitor.words.parts import FAULTS, PARTS

N_HARMONICS = 5
"""Harmonics of each family in the envelope spectrum (Eq. 96)."""
N_RAW_HARMONICS = 6
"""BPFO harmonics of the raw spectrum; A* takes the first five (Eq. 57)."""
SPECTRUM_LINES = 6.5
"""An envelope spectrum that is kept or drawn reaches this many times the first line of the highest family."""
_RAW_MARGIN_BINS, SOUGHT_MARGIN_BINS = 210, 10


@dataclass(frozen=True)
class FeatureSettings:
    """What has to be known about a channel to compute its features.

    Attributes:
        rate: sampling rate, Hz.
        bands: bands to demodulate, (lo, hi) in Hz; the first is the one whose sums are the channel's H_or and so on.
        fundamentals: frequency of the first line of each of ``FAULTS``, Hz (2 BSF of a ball: it meets both races).
        rms_band: band of RMS and A*, Hz, or None for the full bandwidth.
        speed: stated shaft speed, Hz, or None: then lines of the shaft are not separated.
        speed_sd: standard deviation of its error where it is known, Hz; None: it is nominal, and the shaft is sought
            near it in the signal.
        held: speed that neighbouring blocks show over the nominal one, taken where this block shows none.
        average_blocks: neighbouring blocks in whose mean envelope spectrum the families are sought.
        search: half width of the range of the speed factor at a speed that is not known.
        searches: range of each family whose nominal frequency is an estimate; the others have ``search``.
        slip: range of each family at a known speed.
        interference: combs that are removed before the envelopes, at the stated speed of the block.
        view: whether the raw spectrum is kept to be looked at.
        rotation: angle of the shaft over the block, by which its spectra are those of a shaft at its mean speed; None:
            they are over time.
    """

    rate: float
    bands: tuple[Band, ...]
    fundamentals: Mapping[str, float]
    rms_band: Band | None = None
    speed: float | None = None
    speed_sd: float | None = None
    held: float = 1.0
    average_blocks: int = 1
    search: float = SEARCH
    searches: Mapping[str, FamilySearch] = field(default_factory=dict[str, FamilySearch])
    slip: Mapping[str, FamilySearch] = field(default_factory=slip_searches)
    interference: tuple[Comb, ...] = ()
    view: bool = False
    rotation: Rotation | None = None

    def __post_init__(self) -> None:
        """Refuse settings without a band or with a missing or senseless frequency."""
        if not self.bands:
            raise ValueError("bands: at least one band is needed, got none")
        if set(self.fundamentals) != set(FAULTS):
            raise ValueError(f"fundamentals: expected {', '.join(FAULTS)}, got {', '.join(sorted(self.fundamentals))}")
        for fault, frequency in self.fundamentals.items():
            if not (math.isfinite(frequency) and frequency > 0.0):
                raise ValueError(f"fundamentals: {fault} must be positive and finite, got {frequency!r} Hz")

    def at_speed(self, factor: float, sd: float | None = None) -> FeatureSettings:
        """Return the settings at another speed, ``factor`` times the stated one, known where ``sd`` is given."""
        if self.speed is None or (factor == 1.0 and sd is None):
            return self
        scaled = {fault: line * factor for fault, line in self.fundamentals.items()}
        widened = {} if sd is None else {"searches": widened_searches(self.slip, sd / (factor * self.speed))}
        return replace(self, speed=self.speed * factor, fundamentals=scaled, **widened)


def fundamentals(kinematics: Kinematics) -> dict[str, float]:
    """Return the frequency of the first line of each fault family, Hz."""
    return {part.name: part.frequency(kinematics) for part in PARTS}


def highest_rival(fundamentals: Mapping[str, float], speed: float | None) -> float:
    """Return the highest fundamental that competes with the families: ten shaft speeds, or a tenth above them, Hz."""
    return max(10.0 * (speed or 0.0), 1.1 * max(fundamentals.values()))


def _room(settings: FeatureSettings, resolution: float) -> float:
    """Return how far above the stated speed the shaft may be found."""
    nominal = settings.speed is not None and settings.speed_sd is None
    return 1.0 + ACCEPTED if nominal and measurable(settings.speed or 0.0, resolution) else 1.0


def raw_limit(settings: FeatureSettings, resolution: float) -> float:
    """Return the highest frequency of the raw spectrum that is used, Hz."""
    room = _room(settings, resolution)
    lines = N_RAW_HARMONICS * settings.fundamentals["outer"] * reach(settings, "outer") * room
    shaft = highest_order(settings.speed or 0.0) if room > 1.0 else 0.0
    return max(lines, shaft) + _RAW_MARGIN_BINS * resolution


def rounded_up(limit: float) -> float:
    """Return the next power of two: a speed that varies from block to block must not ask for ever new plans."""
    return 2.0 ** math.ceil(math.log2(limit))


def sought_limit(settings: FeatureSettings, resolution: float) -> float:
    """Return the highest frequency of the envelope at which combs are sought, Hz."""
    room = _room(settings, resolution)
    families = {fault: line * _margin(settings, fault) for fault, line in settings.fundamentals.items()}
    return N_HARMONICS * highest_rival(families, settings.speed) * 1.05 * room


def envelope_limit(settings: FeatureSettings, resolution: float) -> float:
    """Return the highest frequency of the envelope that is used, Hz, with a margin for the floor under it."""
    shown = SPECTRUM_LINES * max(settings.fundamentals.values())
    return max(sought_limit(settings, resolution), shown) + 2 * SOUGHT_MARGIN_BINS * resolution


def _margin(settings: FeatureSettings, fault: str) -> float:
    """Return by how much a family of estimated frequency can stand above its nominal one."""
    return reach(settings, fault) if fault in settings.searches else 1.0


def reach(settings: FeatureSettings, fault: str) -> float:
    """Return the highest factor of the nominal frequency at which a family is sought."""
    search = settings.searches.get(fault)
    return 1.0 + settings.search if search is None else max(search.places) * (search.centre + search.width)


WIDTH_BINS = 2.0
"""Two lines of a Hann-windowed signal that are closer are one peak."""
Line = tuple[str, int]
"""A family and the order of a line in it."""


def shared_lines(
    fundamentals: Mapping[str, float], resolution: float, orders: int = N_HARMONICS
) -> tuple[tuple[Line, ...], ...]:
    """Return the groups of lines of different families that stand on one peak, in the order of their frequency.

    Args:
        fundamentals: first line of each family, Hz; families whose first lines coincide share all of them.
        resolution: spacing of the bins, Hz.
        orders: lines of each family.
    """
    lines = [
        (order * first, family, order)
        for family, first in fundamentals.items()
        if first > 0.0
        for order in range(1, orders + 1)
    ]
    lines.sort(key=lambda line: line[0])
    groups: list[list[tuple[float, str, int]]] = []
    for line in lines:
        if groups and line[0] - groups[-1][-1][0] < WIDTH_BINS * resolution:
            groups[-1].append(line)
        else:
            groups.append([line])
    several = (group for group in groups if len({family for _, family, _ in group}) > 1)
    return tuple(tuple((family, order) for _, family, order in group) for group in several)

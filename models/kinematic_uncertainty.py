"""Uncertainty of the fault frequencies from that of the geometry.

Given the number of elements N, all fault frequencies depend on one ratio g = D_w cos(alpha) / D_pw (``Kinematics``):
BPFO and FTF (inner ring turning) with 1 - g, BPFI with 1 + g, BSF with (1 - g^2) / g. So their relative uncertainties
follow from that of g to first order. The number is a discrete alternative: N + 1 elements move BPFO and BPFI to other
places, by 1 / N, and leave FTF and BSF where they are; it does not widen a frequency but adds another one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from models.bearing import CatalogueEntry

_LEAST_PROBABILITY = 0.02


@dataclass(frozen=True)
class KinematicUncertainty:
    """Relative standard uncertainties of the fault frequencies, given the number of elements, and its alternatives.

    Attributes:
        alternatives: factors of BPFO and BPFI, N' / N, of other numbers of elements that are at least as likely as 2 %,
            the likeliest first; empty where the number is known.
    """

    bpfo: float = 0.0
    bpfi: float = 0.0
    ftf: float = 0.0
    bsf: float = 0.0
    alternatives: tuple[float, ...] = ()

    @property
    def known(self) -> bool:
        """Whether the frequencies are taken as exact."""
        return self == KinematicUncertainty()


KNOWN = KinematicUncertainty()


def kinematics_uncertainty(entry: CatalogueEntry) -> KinematicUncertainty:
    """Return the relative standard uncertainties of the fault frequencies of a catalogue entry; they fit any speed.

    The spreads of element diameter, pitch diameter and contact angle are taken as independent.
    """
    bearing, origins = entry.bearing, entry.origins

    def spread(name: str) -> float:
        return origins[name].spread if name in origins else 0.0

    sine, cosine = math.sin(bearing.contact_angle), math.cos(bearing.contact_angle)
    size, pitch, angle = spread("element_diameter"), spread("pitch_diameter"), spread("contact_angle")
    ratio = bearing.element_diameter / bearing.pitch_diameter * cosine
    # d(ln g) of each; the angle enters g through its cosine, BSF also through D_pw / D_w without it.
    relative = math.hypot(size, pitch, sine / cosine * angle)
    toward, away = ratio / (1.0 - ratio), ratio / (1.0 + ratio)
    proportion = (1.0 + ratio * ratio) / (1.0 - ratio * ratio)
    inclination = 2.0 * ratio * ratio / (1.0 - ratio * ratio) * sine / cosine * angle
    likeliest = entry.counts[0][0]
    alternatives = tuple(
        count / likeliest for count, probability in entry.counts[1:] if probability >= _LEAST_PROBABILITY
    )
    inner = bearing.rotating_ring == "inner"
    return KinematicUncertainty(
        bpfo=toward * relative,
        bpfi=away * relative,
        ftf=(toward if inner else away) * relative,
        bsf=math.hypot(proportion * math.hypot(size, pitch), inclination),
        alternatives=alternatives,
    )

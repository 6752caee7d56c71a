"""Uncertainty of the fault frequencies from that of the geometry.

Given the number of elements N, all fault frequencies depend on one ratio g = D_w cos(alpha) / D_pw (``Kinematics``):
BPFO and FTF (inner ring turning) with 1 - g, BPFI with 1 + g, BSF with (1 - g^2) / g. So their relative uncertainties
follow from that of g to first order. The number is a discrete alternative: another one does not widen BPFO and BPFI but
adds another place for each. Fewer elements are larger ones: over the series, the diameter falls with the square root of
the number (``with_count``). FTF and BSF do not depend on the number itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from models.machine.bearing import kinematics

if TYPE_CHECKING:
    from models.machine.bearing import Bearing, CatalogueEntry

_LEAST_PROBABILITY = 0.02
_SIZE_EXPONENT = -0.5
"""Of the element diameter with the number of elements: -0.54 over 92 bearings of even bore code whose number differs
from that of the rule of their series (docs/evidence/catalogue.md)."""


@dataclass(frozen=True)
class KinematicUncertainty:
    """Relative standard uncertainties of the fault frequencies, given the number of elements, and its alternatives.

    Attributes:
        bpfo_places: factors of BPFO that other numbers of elements give, of those that are at least as likely as 2 %,
            the likeliest first; empty where the number is known.
        bpfi_places: the same of BPFI.
    """

    bpfo: float = 0.0
    bpfi: float = 0.0
    ftf: float = 0.0
    bsf: float = 0.0
    bpfo_places: tuple[float, ...] = ()
    bpfi_places: tuple[float, ...] = ()

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
    lines = kinematics(bearing, 1.0)
    others = [
        kinematics(with_count(bearing, count), 1.0)
        for count, probability in entry.counts[1:]
        if probability >= _LEAST_PROBABILITY
    ]
    inner = bearing.rotating_ring == "inner"
    return KinematicUncertainty(
        bpfo=toward * relative,
        bpfi=away * relative,
        ftf=(toward if inner else away) * relative,
        bsf=math.hypot(proportion * math.hypot(size, pitch), inclination),
        bpfo_places=tuple(other.bpfo / lines.bpfo for other in others),
        bpfi_places=tuple(other.bpfi / lines.bpfi for other in others),
    )


def with_count(bearing: Bearing, count: int) -> Bearing:
    """Return a bearing with another number of elements, and of the diameter that usually goes with it."""
    size = bearing.element_diameter * (count / bearing.n_elements) ** _SIZE_EXPONENT
    return replace(bearing, n_elements=count, element_diameter=size)

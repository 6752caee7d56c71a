"""Where the lines of a fault family are sought.

Where the speed is stated, within ``SEARCH`` or the tolerance of the speed. Where it is known, as far as a cage that
slips takes them: rolling elements that are pressed too little do not roll, and the cage falls behind by up to 4 %
(the unloaded bearings of UESTC). Cage and outer race fall with it; the inner race, which runs past the
cage, rises by about two thirds of it, and a ball may keep to either race. One per cent the other way is left for the
contact angle, which follows the axial load. An uncertain ratio of the diameters widens all by two standard deviations.
An uncertain number of elements adds other places, at which the family is sought as well. Families whose ranges overlap
cannot be told apart where they do: naming answers with both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from models.machine.bearing import KNOWN, KinematicUncertainty
from monitor.health.signal.lines import SEARCH
from monitor.words.parts import PARTS

_DEVIATIONS = 2.0


@dataclass(frozen=True)
class FamilySearch:
    """Range of one family about each of the places, which are factors of the nominal line.

    Attributes:
        width: half width, relative to the place.
        places: of the numbers of elements that the bearing may have.
        centre: middle of the range, relative to the place.
    """

    width: float = SEARCH
    places: tuple[float, ...] = (1.0,)
    centre: float = 1.0

    def holds(self, ratio: float) -> bool:
        """Tell whether a line at this ratio to the nominal one can be of the family."""
        return any(abs(ratio / place - self.centre) <= self.width for place in self.places)


PLAIN = FamilySearch()
"""Range of a family of a bearing whose geometry is known."""

UNVERIFIED_SLIP = {part.name: part.slip for part in PARTS} | {"ball": (-0.01, 0.01)}
"""Lowest and highest departure of each family from pure rolling, relative, at a speed that is not known.

Balls that keep to both races by turns depart by less than at a known one; as far as one race takes them, the outer race
of the bearing at the other end of a motor would be the ball of the one at this end."""


def family_searches(uncertainty: KinematicUncertainty, tolerance: float = SEARCH) -> dict[str, FamilySearch]:
    """Return the range of each fault family at a stated speed; empty where it is ``PLAIN`` for all."""
    if uncertainty.known and tolerance == SEARCH:
        return {}
    places = {"bpfo": uncertainty.bpfo_places, "bpfi": uncertainty.bpfi_places}
    return {
        part.name: FamilySearch(
            tolerance + _DEVIATIONS * getattr(uncertainty, part.rate), (1.0, *places.get(part.rate, ()))
        )
        for part in PARTS
    }


def slip_searches(uncertainty: KinematicUncertainty = KNOWN) -> dict[str, FamilySearch]:
    """Return the range of each fault family at a known shaft speed."""
    plain = family_searches(uncertainty, 0.0)
    return {
        fault: FamilySearch(0.5 * (high - low) + plain[fault].width, plain[fault].places, 1.0 + 0.5 * (low + high))
        for fault, (low, high) in ((part.name, part.slip) for part in PARTS)
    }


def stated_searches(tolerance: float) -> dict[str, FamilySearch]:
    """Return the range of each fault family of a known bearing at a shaft speed that is stated with such an error."""
    return {
        fault: FamilySearch(0.5 * (high - low) + tolerance, centre=1.0 + 0.5 * (low + high))
        for fault, (low, high) in UNVERIFIED_SLIP.items()
    }


def widened_searches(searches: Mapping[str, FamilySearch], speed_error: float) -> dict[str, FamilySearch]:
    """Return the ranges for a speed with such a relative standard deviation of its error."""
    wider = _DEVIATIONS * speed_error
    return {fault: replace(search, width=search.width + wider) for fault, search in searches.items()}


def overlapping(lines: Mapping[str, float], searches: Mapping[str, FamilySearch]) -> list[tuple[str, str]]:
    """Return the pairs of families whose ranges overlap, for the nominal lines at one speed, Hz."""
    return [
        (first, second)
        for first, second in combinations(lines, 2)
        if any(
            low_a <= high_b and low_b <= high_a
            for low_a, high_a in _bounds(lines[first], searches.get(first, PLAIN))
            for low_b, high_b in _bounds(lines[second], searches.get(second, PLAIN))
        )
    ]


def _bounds(line: float, search: FamilySearch) -> list[tuple[float, float]]:
    low, high = search.centre - search.width, search.centre + search.width
    return [(line * place * low, line * place * high) for place in search.places]

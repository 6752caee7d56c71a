"""Where the lines of a fault family are sought when the geometry of the bearing is an estimate.

Slip and the stated speed need ``SEARCH``; an uncertain ratio of the diameters widens that by two standard deviations.
An uncertain number of elements adds other places, at which the family is sought as well. Families whose ranges overlap
cannot be told apart where they do: naming answers with both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

from models.kinematic_uncertainty import KinematicUncertainty
from monitor.health.spectrum.lines import SEARCH

_DEVIATIONS = 2.0


@dataclass(frozen=True)
class FamilySearch:
    """Range of one family: half width, relative, about each of the places, which are factors of the nominal line."""

    width: float = SEARCH
    places: tuple[float, ...] = (1.0,)

    def holds(self, ratio: float) -> bool:
        """Tell whether a line at this ratio to the nominal one can be of the family."""
        return any(abs(ratio / place - 1.0) <= self.width for place in self.places)


PLAIN = FamilySearch()
"""Range of a family of a bearing whose geometry is known."""


def family_searches(uncertainty: KinematicUncertainty) -> dict[str, FamilySearch]:
    """Return the range of each fault family; empty where the geometry is known."""
    if uncertainty.known:
        return {}
    return {
        "outer": FamilySearch(SEARCH + _DEVIATIONS * uncertainty.bpfo, (1.0, *uncertainty.bpfo_places)),
        "inner": FamilySearch(SEARCH + _DEVIATIONS * uncertainty.bpfi, (1.0, *uncertainty.bpfi_places)),
        "ball": FamilySearch(SEARCH + _DEVIATIONS * uncertainty.bsf),
        "cage": FamilySearch(SEARCH + _DEVIATIONS * uncertainty.ftf),
    }


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
    return [(line * place * (1.0 - search.width), line * place * (1.0 + search.width)) for place in search.places]

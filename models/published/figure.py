"""The static figures that A. Gabrielli's thesis (Ferrara 2022) prints, each beside what this program obtains.

A figure is "reproduced" where the obtained value lies within half a unit of its last printed digit (or keeps the bound
that the text gives), "close" within 3 %, and "not reproduced" beyond. The rule is the same for all; what is known of a
difference is said in the note. Figures that are read off pictures, finite-element results and measurements are not here
(docs/evidence/published-figures.md lists them).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from models.hertz import (
    BALL_EXPONENT,
    contact_stiffness,
    in_series,
    point_contact_stiffness,
    relative_radii,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from models.bearing import Bearing

Relation = Literal["=", "<", ">"]
Verdict = Literal["reproduced", "close", "not reproduced"]

CLOSE = 0.03
SELF_ALIGNING, DEEP_GROOVE, ROLLER = "1205 ETN9", "6210", "NU 202 ECP"


@dataclass(frozen=True)
class Figure:
    """One printed figure.

    Attributes:
        condition: under which load, speed and so on; empty where there is only one.
        text: the figure as printed, from which its last digit is known.
        relation: "=", or the bound that the text gives.
        note: what is known of the difference.
    """

    designation: str
    place: str
    quantity: str
    condition: str
    unit: str
    text: str
    obtained: float
    relation: Relation = "="
    note: str = ""

    @property
    def printed(self) -> float:
        """The printed value."""
        return float(self.text)

    @property
    def difference(self) -> float:
        """Obtained less printed, divided by printed."""
        return self.obtained / self.printed - 1.0

    @property
    def verdict(self) -> Verdict:
        """How well the figure is met, by the rule of this module."""
        if self.relation != "=":
            below = self.obtained < self.printed
            return "reproduced" if below == (self.relation == "<") else "not reproduced"
        mantissa, _, power = self.text.partition("e")
        last = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
        if abs(self.obtained - self.printed) <= 0.5 * last * (1.0 + 1e-9):
            return "reproduced"
        return "close" if abs(self.difference) <= CLOSE else "not reproduced"


def group(
    designation: str,
    place: str,
    quantity: str,
    unit: str,
    rows: Iterable[tuple[str, str, float]],
    *,
    note: str = "",
    relation: Relation = "=",
) -> list[Figure]:
    """Return figures of one place and quantity from rows of (condition, text as printed, obtained)."""
    return [Figure(designation, place, quantity, c, unit, text, value, relation, note) for c, text, value in rows]


def worst(figures: Iterable[Figure]) -> Figure:
    """Return the figure of the poorest verdict, and of those the one with the largest difference."""
    order = ("reproduced", "close", "not reproduced")
    # Rounded, so that of figures that differ by rounding only the first is returned on every machine.
    return max(figures, key=lambda f: (order.index(f.verdict), round(abs(f.difference), 9)))


def contact_stiffness_figures(bearing: Bearing, place: str, text: str, unit: str, factor: float) -> list[Figure]:
    """Return k_c as the geometry gives it, exactly, and with the slip that the printed figure rests on."""
    (_, across_inner), outer = relative_radii(bearing)
    slipped = in_series(
        point_contact_stiffness(inner_taken_as_concave(bearing), across_inner),
        point_contact_stiffness(*outer),
        BALL_EXPONENT,
    )
    rows = (
        (
            "k_c, Eq. 17 mended",
            contact_stiffness(bearing),
            "xi belongs inside the bracket of Eq. 17; E' is twice Eq. 3",
        ),
        (
            "k_c, exact elliptic Hertz",
            contact_stiffness(bearing, method="elliptic"),
            "no fits of the elliptic integrals",
        ),
        (
            "k_c, inner race taken as concave",
            slipped,
            "1/r_b - 1/r_i for 1/r_b + 1/r_i, as in Table 11; met within the rounding of the radii",
        ),
    )
    return [
        figure
        for quantity, value, note in rows
        for figure in group(bearing.designation, place, quantity, unit, [("", text, value * factor)], note=note)
    ]


def inner_taken_as_concave(bearing: Bearing) -> float:
    """Return the relative radius that Eq. 6 gives with the radius of the inner race entered as positive, m."""
    return 1.0 / (2.0 / bearing.element_diameter - 1.0 / (bearing.inner_race_radius or math.nan))

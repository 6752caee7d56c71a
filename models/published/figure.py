"""A printed figure beside what this program obtains, and how well the two agree.

A figure is "reproduced" where the obtained value lies within half a unit of its last printed digit (or keeps the bound
that the text gives), "close" within 3 %, and "not reproduced" beyond. The rule is the same for all; what is known of a
difference is said in the note.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterable

Relation = Literal["=", "<", ">"]
Verdict = Literal["reproduced", "close", "not reproduced"]

CLOSE = 0.03


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

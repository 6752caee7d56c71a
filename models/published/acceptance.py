"""A row of the acceptance table, of all models but the thesis' bearings: what is printed, what this program obtains.

The status says how the value comes about, not how well it is met: "EXACT" is closed form from printed values, "REPRO" a
simulation from printed values alone, "CALIB" one for which a value that is not printed was chosen to meet it (no
evidence that the model is right), "QUAL" a trend or a line that is there, while numbers differ, and "NO" is not
reproduced; the note says what is missing.

A printed figure beside what this program obtains, and how well the two agree.

A figure is "reproduced" where the obtained value lies within half a unit of its last printed digit (or keeps the bound
that the text gives), "close" within 3 %, and "not reproduced" beyond. The rule is the same for all; what is known of a
difference is said in the note.

The highest line of an envelope, as the sources of the models read it off their spectra.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.solve.response import band_passed

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray


Status = Literal["EXACT", "REPRO", "CALIB", "QUAL", "NO"]


@dataclass(frozen=True)
class AcceptanceRow:
    """One row.

    Attributes:
        test: its name in the table, such as "S1".
        source: document and place.
        printed: the value as printed.
        tolerance: largest relative difference with which it counts as met, or None where none is claimed.
        note: what was chosen, or what is missing.
    """

    test: str
    source: str
    quantity: str
    unit: str
    printed: str
    obtained: float
    status: Status
    tolerance: float | None = None
    note: str = ""

    def __post_init__(self) -> None:
        """Raise a ValueError where a status and a tolerance contradict each other."""
        if (self.status == "NO") != (self.tolerance is None):
            raise ValueError(
                f"{self.test} {self.quantity}: a tolerance is claimed by all but NO, got {self.tolerance!r}"
            )

    @property
    def difference(self) -> float:
        """Obtained less printed, divided by printed."""
        return self.obtained / float(self.printed) - 1.0

    @property
    def met(self) -> bool:
        """Whether the difference is within the tolerance; false where none is claimed."""
        return self.tolerance is not None and abs(self.difference) <= self.tolerance


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


BAND = (500.0, 10_000.0)
"""Band of the envelope, Hz (Ceruti, section 6.1)."""


def envelope(signal: NDArray[np.float64], rate: float, band: tuple[float, float] = BAND) -> NDArray[np.float64]:
    """Return the magnitude of the analytic signal (Hilbert's transform) within a band, Hz."""
    half = np.fft.fft(band_passed(signal, rate, band))
    half[len(signal) // 2 :] = 0.0
    return np.abs(np.fft.ifft(2.0 * half))


def highest_line(signal: NDArray[np.float64], rate: float, least: float = 1.0) -> float:
    """Return the frequency of the highest line of the envelope in ``BAND`` at or above ``least`` Hz, Hz.

    The envelope is taken less its mean, with Hann's window.
    """
    found = envelope(signal, rate)
    lines = np.abs(np.fft.rfft((found - np.mean(found)) * np.hanning(len(found))))
    first = round(least * len(signal) / rate)
    return float(first + np.argmax(lines[first:])) * rate / len(signal)

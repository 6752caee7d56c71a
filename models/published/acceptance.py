"""A row of the acceptance table, of all models but the thesis' bearings: what is printed, what this program obtains.

The status says how the value comes about, not how well it is met: "EXACT" is closed form from printed values, "REPRO" a
simulation from printed values alone, "CALIB" one for which a value that is not printed was chosen to meet it (no
evidence that the model is right), "QUAL" a trend or a line that is there, while numbers differ, and "NO" is not
reproduced; the note says what is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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

"""The one table of the parts of a bearing whose damage is told: their names, lines and colours.

Schema, features, detector, naming, figures and page read it. To add a part, append a row: the integers of files and the
``fault`` dimension follow from the order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from models.machine.bearing import Kinematics


@dataclass(frozen=True)
class BearingPart:
    """A part of a bearing.

    Attributes:
        name: in records and files.
        words: for people.
        line: name of the first line of its damage.
        rate: field of ``Kinematics`` of which that is a multiple.
        multiple: 2 of a ball, which meets both races in one spin.
        carrier: field of ``Kinematics`` with which its damage turns through the load zone; None of a cage, whose lines
            are no impacts.
        feature: sum of its lines, in records.
        slip: lowest and highest departure of its lines from pure rolling, relative, at a known shaft speed.
        colour, marker: of its lines in spectra, as of ``monitor.report.figures.drawing.PALETTE``.
        trend_colour, mail_colour: of its sum of lines over time, in a report and in a mail.
    """

    name: str
    words: str
    line: str
    rate: str
    multiple: float
    carrier: str | None
    feature: str
    slip: tuple[float, float]
    colour: str
    marker: str
    trend_colour: str
    mail_colour: str

    def frequency(self, kinematics: Kinematics) -> float:
        """Return the frequency of its first line, Hz."""
        return self.multiple * getattr(kinematics, self.rate)

    def sidebands(self, kinematics: Kinematics) -> float | None:
        """Return how far apart the sidebands of its lines are, Hz, None without a carrier."""
        return None if self.carrier is None else getattr(kinematics, self.carrier)


PARTS = (
    BearingPart(
        "outer", "outer race", "BPFO", "bpfo", 1.0, "speed", "h_or", (-0.04, 0.01), "vermilion", "o", "purple", "blue"
    ),
    BearingPart(
        "inner", "inner race", "BPFI", "bpfi", 1.0, "speed", "h_ir", (-0.01, 0.027), "blue", "s", "blue", "vermilion"
    ),
    BearingPart(
        *("ball", "rolling element", "2×BSF", "bsf", 2.0, "ftf", "h_ball", (-0.04, 0.027)),
        *("green", "^", "green", "green"),
    ),
    BearingPart("cage", "cage", "FTF", "ftf", 1.0, None, "h_cage", (-0.04, 0.01), "purple", "D", "orange", "purple"),
)
PART_OF = {part.name: part for part in PARTS}
FAULTS = tuple(PART_OF)
"""Names of the parts, in the order of the ``fault`` dimension of the records."""

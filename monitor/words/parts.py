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
        name="outer",
        words="outer race",
        line="BPFO",
        rate="bpfo",
        multiple=1.0,
        carrier="speed",
        feature="h_or",
        slip=(-0.04, 0.01),
        colour="vermilion",
        marker="o",
        trend_colour="purple",
        mail_colour="blue",
    ),
    BearingPart(
        name="inner",
        words="inner race",
        line="BPFI",
        rate="bpfi",
        multiple=1.0,
        carrier="speed",
        feature="h_ir",
        slip=(-0.01, 0.027),
        colour="blue",
        marker="s",
        trend_colour="blue",
        mail_colour="vermilion",
    ),
    BearingPart(
        name="ball",
        words="rolling element",
        line="2×BSF",
        rate="bsf",
        multiple=2.0,
        carrier="ftf",
        feature="h_ball",
        slip=(-0.04, 0.027),
        colour="green",
        marker="^",
        trend_colour="green",
        mail_colour="green",
    ),
    BearingPart(
        name="cage",
        words="cage",
        line="FTF",
        rate="ftf",
        multiple=1.0,
        carrier=None,
        feature="h_cage",
        slip=(-0.04, 0.01),
        colour="purple",
        marker="D",
        trend_colour="orange",
        mail_colour="purple",
    ),
)
PART_OF = {part.name: part for part in PARTS}
FAULTS = tuple(PART_OF)
"""Names of the parts, in the order of the ``fault`` dimension of the records."""

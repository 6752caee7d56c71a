"""Rolling bearings of a train whose elements press by themselves, with defects: what the kernel needs of them.

Depths of defects and the contact law are those of the rotor (``models.solve.rotor.plan``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.gears.train.bearings import RollingSupport
from models.gears.train.kernel_forces import L_SIZE, Rolling, RollingCourse
from models.machine.bearing import kinematics
from models.machine.hertz import contact_exponent, element_angles
from models.solve.engine.passages import half_wave_meetings, in_intervals
from models.words.checks import check_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.gears.train.parts import GearTrain
    from models.machine.scene import Defect


@dataclass(frozen=True)
class RollingElements(RollingSupport):
    """The rolling bearing of a support, element by element; the outer ring stands still in the casing.

    Attributes:
        damping: of one loaded element, N s/m.
        cage_angle: angle of the first element from x at the beginning, rad.
        defects: of its parts; ``position`` is the angle from x at the beginning.
        counterclockwise: whether the body turns from x towards y.
    """

    damping: float = 0.0
    cage_angle: float = 0.0
    defects: tuple[Defect, ...] = ()
    counterclockwise: bool = True

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        super().__post_init__()
        check_numbers(self, f"support {self.support}: ", "not negative", "damping")
        check_numbers(self, f"support {self.support}: ", "finite", "cage_angle")
        for defect in self.defects:
            if defect.first_row + defect.rows > self.bearing.rows:
                raise ValueError(f"support {self.support}: a defect lies on a row that the bearing does not have")


def rolling_of(train: GearTrain, elements: Sequence[RollingElements], names: Sequence[str], duration: float) -> Rolling:
    """Return what the kernel needs of the bearings of a run of ``duration`` seconds.

    Args:
        names: of the degrees of freedom.
    """
    body_of = {support.name: body.name for body in train.bodies for support in body.supports}
    speeds = train.speeds()
    laws, slots, begin = np.zeros((len(elements), L_SIZE)), [np.zeros(0)], [0]
    columns: list[tuple[NDArray[np.float64], ...]] = [tuple(np.zeros(0) for _ in range(6))]
    for b, one in enumerate(elements):
        speed = speeds[body_of[one.support]] * (1.0 if one.counterclockwise else -1.0)
        cage = math.copysign(2.0 * math.pi * kinematics(one.bearing, abs(speed)).ftf, speed)
        power = contact_exponent(one.bearing)
        laws[b] = one.k_c, power, one.clearance, one.damping, cage, 1.0 / (power + 1.0)
        angles = element_angles(one.bearing, one.cage_angle)
        for defect in one.defects:
            if defect.moves_balls:
                found = half_wave_meetings(one.bearing, speed, angles, defect, duration)
                number = (found.element + begin[-1]).astype(np.float64)
                columns.append((found.begin, found.end, number, found.depth, found.rate, found.offset))
        slots.append(angles)
        begin.append(begin[-1] + len(angles))
    first, last, number, depth, rate, offset = (np.concatenate(column) for column in zip(*columns, strict=True))
    cut, angle = in_intervals(first, last, duration), np.concatenate(slots)
    return Rolling(
        place=np.array([names.index(f"{body_of[one.support]}.x") for one in elements], dtype=np.int64),
        elements=np.array(begin, dtype=np.int64),
        law=laws,
        slots=np.stack([np.cos(angle), np.sin(angle)]),
        bounds=cut.bounds,
        first=cut.first,
        element=number[cut.record].astype(np.int64),
        depth=depth[cut.record],
        rate=rate[cut.record],
        offset=offset[cut.record],
    )


def rolling_course(bearings: int, elements: int) -> RollingCourse:
    """Return the beginning of a run."""
    return RollingCourse(
        interval=np.zeros(1, dtype=np.int64),
        relief=np.zeros(elements),
        sinking=np.zeros(elements),
        reaction=np.zeros((bearings, 2)),
        contact_energy=np.zeros(3),
    )

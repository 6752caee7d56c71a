"""Stiffness and displacement error of a mesh as tables over the turns of its two wheels.

Conventions that a solver relies on, with phases in pitches and turns positive in the driven sense of each wheel:

* phase 0 of a pitch: tooth 0 of the driver begins contact with tooth 0 of the driven wheel. Tooth i of the driver does
  so at i / z1 turns, tooth j of the driven wheel at j / z2 turns.
* the deflection of the mesh is approach - e: a positive error e holds the flanks apart (material is missing), the force
  on the driving flank is k * (approach - e) where that is positive.
* all tables have n samples a pitch, sample i at i / n, are periodic and interpolated linearly between samples. A step
  takes 1 / n of a pitch.
* losses of both wheels add up. That is exact unless two damaged teeth share one mesh; k is never below zero.

Where the teeth of a pair stand: a tooth of the driver begins its mesh where the tip of its mate reaches the line of
action, at A. A wheel that meshes twice, an idler, has its teeth at equal steps: what one mesh says of them gives the
phase of the other. R. Parker and J. Lin, Mesh phasing relationships in planetary and epicyclic gears, J. Mech. Des. 126
(2004) 365, derive the same for planets.

A given stiffness comes as CSV, whose first line names the columns; "#" begins a comment:

* ``pitch,stiffness_newton_per_m[,error_um]``: phase from 0 to below 1, ascending, any spacing; periodic, linear between
  the lines. A last line at 1 is allowed where it repeats the first.
* ``order,stiffness_newton_per_m[,phase_deg]``: amplitude of the cosine of each mesh order, order 0 is the mean; k is
  the sum of amplitude * cos(2 pi order * pitch - phase).
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from models.gears.teeth.geometry import GearPair
from models.words.checks import check_positive, check_whole
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
_COURSE, _ORDERS = ("pitch", "stiffness_newton_per_m"), ("order", "stiffness_newton_per_m")
_HEADS = (_COURSE, (*_COURSE, "error_um"), _ORDERS, (*_ORDERS, "phase_deg"))


class GearTableError(WrongInputError):
    """A table of a mesh cannot be used; the message names the file, the line, and what was expected."""


def read_stiffness(content: str, name: str, samples: int) -> tuple[Array, Array | None]:
    """Return stiffness over one pitch, N/m, shape (samples,), and the error, m, in that shape where it is given.

    Raises:
        GearTableError: where the text cannot be used.
    """
    lines = [(number, line) for number, line in enumerate(content.lstrip("\ufeff").splitlines(), 1) if _counts(line)]
    if not lines:
        raise GearTableError(f"{name}: expected a line of column names, got an empty file")
    head = tuple(cell.strip() for cell in lines[0][1].split(","))
    if head not in _HEADS:
        expected = " or ".join(",".join(known) for known in _HEADS)
        raise GearTableError(f"{name}, line {lines[0][0]}: expected the columns {expected}, got {lines[0][1].strip()}")
    if len(lines) == 1:
        raise GearTableError(f"{name}: expected lines of numbers below the column names, got none")
    rows = np.array([_numbers(name, number, line, head) for number, line in lines[1:]])
    numbers = [number for number, _ in lines[1:]]
    if head[0] == "order":
        return _from_orders(name, numbers, rows, samples), None
    return _from_course(name, numbers, rows, samples)


def _counts(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _numbers(name: str, number: int, line: str, head: tuple[str, ...]) -> list[float]:
    cells = next(csv.reader([line]))
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        values = []
    if len(values) != len(head) or not all(map(math.isfinite, values)):
        raise GearTableError(f"{name}, line {number}: expected {len(head)} finite numbers, got {line.strip()!r}")
    return values


def _from_course(name: str, numbers: list[int], rows: Array, samples: int) -> tuple[Array, Array | None]:
    pitch = rows[:, 0]
    if len(rows) > 1 and pitch[-1] == 1.0 and pitch[0] == 0.0:
        if not np.array_equal(rows[-1, 1:], rows[0, 1:]):
            raise GearTableError(f"{name}, line {numbers[-1]}: expected at pitch 1 what stands at pitch 0")
        rows, pitch = rows[:-1], pitch[:-1]
    for place, number in enumerate(numbers[: len(rows)]):
        if not 0.0 <= pitch[place] < 1.0 or (place and pitch[place] <= pitch[place - 1]):
            raise GearTableError(
                f"{name}, line {number}: expected pitch to ascend from 0 to below 1, got {pitch[place]!r}"
            )
        if rows[place, 1] < 0.0:
            raise GearTableError(f"{name}, line {number}: expected a stiffness not below zero, got {rows[place, 1]!r}")
    if not rows[:, 1].any():
        raise GearTableError(f"{name}: expected a stiffness that is not zero throughout")
    grid = np.arange(samples) / samples
    columns: list[Array] = [np.interp(grid, pitch, column, period=1.0) for column in rows[:, 1:].T]
    return columns[0], 1e-6 * columns[1] if len(columns) > 1 else None


def _from_orders(name: str, numbers: list[int], rows: Array, samples: int) -> Array:
    course, seen = np.zeros(samples), set[int]()
    phase = math.tau * np.arange(samples) / samples
    for number, row in zip(numbers, rows, strict=True):
        order = int(row[0])
        if order != row[0] or order < 0 or order in seen or 2 * order >= samples:
            raise GearTableError(
                f"{name}, line {number}: expected whole orders from 0 to below {samples / 2:g}, each once, "
                f"got {row[0]!r}"
            )
        seen.add(order)
        course += row[1] * np.cos(order * phase - (math.radians(row[2]) if row.size > 2 else 0.0))
    if 0 not in seen or course.min() < 0.0:
        got = "no order 0" if 0 not in seen else f"a least value of {course.min():.4g} N/m"
        raise GearTableError(f"{name}: expected order 0 and a stiffness that is never below zero, got {got}")
    return course


def begin_of_mesh(pair: GearPair, to_driven: float, *, counterclockwise: bool) -> tuple[float, float]:
    """Return the directions of the centre lines of both teeth when they begin their mesh, rad, from x towards y.

    Args:
        pair: whose flanks touch without backlash on the driving side.
        to_driven: direction from the centre of the driver to that of the driven wheel, rad.
        counterclockwise: whether the driver turns from x towards y.
    """
    driver, driven = pair.profiles
    begin = pair.contact_path[0]
    left = pair.tangent_length - begin
    # Of each tooth from the line of centres, in the sense in which its wheel turns.
    ahead = math.atan(begin / driver.base_radius) - pair.working_angle
    ahead -= float(driver.half_angle(math.hypot(driver.base_radius, begin)))
    behind = pair.working_angle - math.atan(left / driven.base_radius)
    behind += float(driven.half_angle(math.hypot(driven.base_radius, left)))
    sense = 1.0 if counterclockwise else -1.0
    return to_driven + sense * ahead, to_driven + math.pi - sense * behind


def turns_between(first: float, second: float, *, counterclockwise: bool) -> float:
    """Return the turns of a wheel from where a tooth stands in the direction ``first`` to ``second``, rad, -1 to 1."""
    turns = (second - first) / math.tau
    return math.fmod(turns if counterclockwise else -turns, 1.0)


if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
DEFAULT_SAMPLES = 128


@dataclass(frozen=True, eq=False)
class MeshStiffness:
    """Stiffness along the line of action in the plane of rotation, and displacement error, of one pair of wheels.

    Attributes:
        driver_teeth, driven_teeth: z1 and z2.
        base: stiffness over one pitch of the driver, N/m, shape (n,).
        driver_loss, driven_loss: stiffness lost over a turn of the wheel, N/m, shape (z * n,), or None for none.
        driver_error, driven_error: displacement over a turn of the wheel, m, shape (z * n,), or None for none.
    """

    driver_teeth: int
    driven_teeth: int
    base: Array
    driver_loss: Array | None = None
    driven_loss: Array | None = None
    driver_error: Array | None = None
    driven_error: Array | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names a table of a wrong shape or with values that cannot be."""
        check_whole(self.driver_teeth, "driver_teeth", 1)
        check_whole(self.driven_teeth, "driven_teeth", 1)
        base = _table(self.base, "base", None)
        if not (base >= 0.0).all() or not base.any():
            raise ValueError(f"base must not be negative and not zero throughout, least value {base.min()!r} N/m")
        object.__setattr__(self, "base", base)
        for name, teeth in (("driver", self.driver_teeth), ("driven", self.driven_teeth)):
            for kind in ("loss", "error"):
                value: Array | None = getattr(self, f"{name}_{kind}")
                if value is not None:
                    object.__setattr__(self, f"{name}_{kind}", _table(value, f"{name}_{kind}", teeth * base.size))

    @property
    def samples(self) -> int:
        """Samples n of a pitch."""
        return self.base.size

    @property
    def mean(self) -> float:
        """Mean stiffness over whole turns, N/m, losses included."""
        lost = sum(float(table.mean()) for table in (self.driver_loss, self.driven_loss) if table is not None)
        return float(self.base.mean()) - lost

    def at(self, driver_turns: Array | float, driven_turns: Array | float) -> tuple[Array, Array]:
        """Return stiffness, N/m, and error, m, at turns of the two wheels, in the shape of both together."""
        driver, driven = np.broadcast_arrays(np.asarray(driver_turns, float), np.asarray(driven_turns, float))
        k, e = look_up(self.base, driver * self.driver_teeth), np.zeros(driver.shape)
        for turns, loss, error in (
            (driver, self.driver_loss, self.driver_error),
            (driven, self.driven_loss, self.driven_error),
        ):
            if loss is not None:
                k = k - look_up(loss, turns)
            if error is not None:
                e = e + look_up(error, turns)
        return np.maximum(k, 0.0), e

    def scaled_to(self, mean: float) -> Self:
        """Return the same course with another mean stiffness, N/m: stiffness and losses times one factor."""
        check_positive(mean=mean)
        factor = mean / self.mean
        losses = {
            name: factor * table
            for name, table in (("driver_loss", self.driver_loss), ("driven_loss", self.driven_loss))
            if table is not None
        }
        return replace(self, base=factor * self.base, **losses)

    @classmethod
    def rectangular(
        cls, teeth: tuple[int, int], mean: float, share: float, contact_ratio: float, samples: int = DEFAULT_SAMPLES
    ) -> Self:
        """Return two levels: the higher one while the pair that is leaving contact shares the load.

        Args:
            teeth: of driver and driven wheel.
            mean: mean stiffness, N/m.
            share: difference of the levels over the mean.
            contact_ratio: its fraction is the share of the pitch with the higher stiffness.
            samples: of a pitch; the mean is that of the samples.

        Raises:
            ValueError: where an argument is out of range, or the lower level would not be positive.
        """
        check_positive(mean=mean, contact_ratio=contact_ratio)
        fraction = contact_ratio - math.floor(contact_ratio)
        higher = np.clip(fraction * samples - np.arange(samples), 0.0, 1.0)
        base = mean * (1.0 + share * (higher - higher.mean()))
        if not (share >= 0.0 and base.min() > 0.0):
            raise ValueError(f"share must not be negative and leave a positive stiffness, got {share!r}")
        return cls(*teeth, base)

    @classmethod
    def harmonic(
        cls,
        teeth: tuple[int, int],
        mean: float,
        amplitudes: Sequence[float],
        phases: Sequence[float] | None = None,
        samples: int = DEFAULT_SAMPLES,
    ) -> Self:
        """Return k = mean + sum of amplitude_j cos(2 pi j phase - phase_j), j = 1 ...

        Args:
            teeth: of driver and driven wheel.
            mean: mean stiffness, N/m.
            amplitudes: of the harmonics of the mesh, N/m.
            phases: of the harmonics, rad; zero by default.
            samples: of a pitch, more than twice the number of harmonics.

        Raises:
            ValueError: where an argument is out of range, or the stiffness would not be positive throughout.
        """
        check_positive(mean=mean)
        shifts = [0.0] * len(amplitudes) if phases is None else list(phases)
        if len(shifts) != len(amplitudes):
            raise ValueError(f"phases must be as many as amplitudes, {len(amplitudes)}, got {len(shifts)}")
        check_whole(samples, "samples", 2 * len(amplitudes) + 1)
        phase = math.tau * np.arange(samples) / samples
        parts = [a * np.cos(j * phase - s) for j, (a, s) in enumerate(zip(amplitudes, shifts, strict=True), 1)]
        base = mean + np.sum(parts, axis=0) if parts else np.full(samples, mean)
        if not base.min() > 0.0:
            raise ValueError(f"amplitudes must leave a positive stiffness, the least would be {base.min()!r} N/m")
        return cls(*teeth, base)

    @classmethod
    def from_csv(
        cls, teeth: tuple[int, int], content: str, name: str = "stiffness", samples: int = DEFAULT_SAMPLES
    ) -> Self:
        """Return a given stiffness from the text of a CSV file, see ``models.gears.teeth.mesh``.

        Args:
            teeth: of driver and driven wheel.
            content: text of the file.
            name: of the file, for messages.
            samples: of a pitch.

        Raises:
            GearTableError: where the text cannot be used, with the line and what was expected.
        """
        course, error = read_stiffness(content, name, samples)
        return cls(*teeth, course, driver_error=None if error is None else np.tile(error, teeth[0]))


def look_up(table: Array, turns: Array) -> Array:
    """Return a periodic table at turns of its period, by linear interpolation."""
    place = (turns - np.floor(turns)) * table.size
    first = np.minimum(place.astype(np.int64), table.size - 1)
    after = np.where(first + 1 < table.size, first + 1, 0)
    return table[first] + (place - first) * (table[after] - table[first])


def _table(values: Array, name: str, size: int | None) -> Array:
    table = np.array(values, dtype=np.float64, order="C")
    if table.ndim != 1 or table.size == 0 or size not in (None, table.size):
        wanted = "(n,) with n of 1 at least" if size is None else f"({size},), teeth times samples of the base"
        raise ValueError(f"{name} must have the shape {wanted}, got {table.shape}")
    if not np.isfinite(table).all():
        raise ValueError(f"{name} must be finite, sample {int(np.argmin(np.isfinite(table)))} is not")
    table.setflags(write=False)
    return table

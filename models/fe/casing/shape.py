"""What a casing is: walls of a box, seats of bearings in two of them, feet.

The box is ``length`` along x, ``height`` along y, which is upwards, and ``depth`` along z, the direction of the shafts;
its outside begins at the origin. Seats are in the walls z0 (at z = 0) and z1 (at z = depth), feet on y = 0. Lengths are
in m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

from models.words.checks import check_choice, check_numbers, check_whole

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

SIDES = ("x0", "x1", "y0", "y1", "z0", "z1")
Wall = Literal["z0", "z1"]
Spider = Literal["rigid", "mean"]
# A patch of cells about a seat reaches this many times the radius of the boss, where there is room, and this at least.
_PATCH, _MIN_PATCH = 1.35, 1.05


@dataclass(frozen=True)
class Material:
    """Elastic constants: Young's modulus, Pa, Poisson's ratio, density, kg/m3."""

    modulus: float
    poisson: float
    density: float

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "material.", "positive", "modulus", "density")
        if not 0.0 <= self.poisson < 0.5:
            raise ValueError(f"material.poisson must be from 0 to below 0.5, got {self.poisson!r}")


CAST_IRON = Material(90e9, 0.3, 7250.0)
"""Of the casing in appendix A of the thesis."""
STEEL = Material(210e9, 0.3, 7850.0)


@dataclass(frozen=True)
class Seat:
    """A bearing's seat: a bore through a wall, and a boss about it that reaches into the box.

    Attributes:
        name: of the bearing; forces on it are ``NAME.x``, ``NAME.y``, ``NAME.z``.
        wall: "z0" or "z1".
        centre: x and y.
        bore, boss: diameters.
        boss_length: of the boss beyond the wall.
        cover: thickness of a lid over the outer end of the bore, part of the wall; 0 for an open bore.
        mass: carried by the seat in all directions, such as of shaft and wheels, kg.
        spider: "rigid" for a bore that stays round and moves as one; "mean" for a force spread evenly over a bore that
            may deform.
    """

    name: str
    wall: Wall
    centre: tuple[float, float]
    bore: float
    boss: float
    boss_length: float = 0.0
    cover: float = 0.0
    mass: float = 0.0
    spider: Spider = "rigid"

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        prefix = f"seat {self.name!r}: "
        if not self.name or self.name in SIDES or "." in self.name:
            raise ValueError(f"name of a seat must be a word without a point and no side, got {self.name!r}")
        check_choice(self.wall, f"{prefix}wall", ("z0", "z1"))
        check_choice(self.spider, f"{prefix}spider", ("rigid", "mean"))
        check_numbers(self, prefix, "positive", "bore", "boss")
        check_numbers(self, prefix, "not negative", "boss_length", "cover", "mass")
        if self.boss <= self.bore:
            raise ValueError(f"{prefix}boss must be wider than the bore of {self.bore!r} m, got {self.boss!r}")
        if not all(map(math.isfinite, self.centre)):
            raise ValueError(f"{prefix}centre must be finite, got {self.centre!r}")


@dataclass(frozen=True)
class Foot:
    """A rectangle of the underside that is held: from and to along x and z."""

    x: tuple[float, float]
    z: tuple[float, float]


@dataclass(frozen=True)
class CasingShape:
    """Walls, seats and feet.

    Attributes:
        length, height, depth: outer sizes along x, y, z.
        walls: side -> thickness; a side that is left out is open. A plate has the one wall "z0" as thick as the depth.
        seats, feet: without feet the whole underside is held.
    """

    length: float
    height: float
    depth: float
    walls: Mapping[str, float]
    seats: tuple[Seat, ...] = ()
    feet: tuple[Foot, ...] = ()

    def __post_init__(self) -> None:
        """Raise a ValueError that names the part of an unusable value."""
        check_numbers(self, "casing.", "positive", "length", "height", "depth")
        for side, thickness in self.walls.items():
            check_choice(side, "side of a wall", SIDES)
            room = self.size(side)
            if not 0.0 < thickness <= room:
                raise ValueError(f"wall {side} must be above 0 and up to {room!r} m thick, got {thickness!r}")
        for axis, room in (("x", self.length), ("y", self.height), ("z", self.depth)):
            both = self.thickness(f"{axis}0") + self.thickness(f"{axis}1")
            if both > room:
                raise ValueError(f"walls {axis}0 and {axis}1 are {both!r} m thick together, there are {room!r} m")
        if not self.walls:
            raise ValueError("a casing needs one wall at least, got none")
        names = [seat.name for seat in self.seats]
        if len(set(names)) < len(names):
            raise ValueError(f"seats must have different names, got {', '.join(names)}")
        for seat in self.seats:
            self._check_seat(seat)
        for foot in self.feet:
            for axis, (begin, end), room in (("x", foot.x, self.length), ("z", foot.z, self.depth)):
                if not 0.0 <= begin < end <= room:
                    raise ValueError(f"foot: {axis} must ascend within 0 to {room!r} m, got {begin!r} to {end!r}")
        tuple(self.patches())

    @classmethod
    def plate(cls, length: float, height: float, thickness: float, seats: tuple[Seat, ...] = ()) -> Self:
        """Return a flat plate; seats are in "z0"."""
        return cls(length, height, thickness, {"z0": thickness}, seats)

    @classmethod
    def box(
        cls,
        size: tuple[float, float, float],
        thickness: float,
        seats: tuple[Seat, ...] = (),
        feet: tuple[Foot, ...] = (),
    ) -> Self:
        """Return a closed box with walls of one thickness."""
        return cls(*size, dict.fromkeys(SIDES, thickness), seats, feet)

    def size(self, side: str) -> float:
        """Return the outer size across a side, m."""
        return {"x": self.length, "y": self.height, "z": self.depth}[side[0]]

    def thickness(self, side: str) -> float:
        """Return the thickness of a wall, m, 0 for an open side."""
        return self.walls.get(side, 0.0)

    def reach(self, seat: Seat) -> tuple[float, float, float]:
        """Return where cover, wall and boss of a seat end, m from the outside of its wall."""
        wall = self.thickness(seat.wall)
        return seat.cover, wall, wall + seat.boss_length

    def patches(self) -> Iterator[Patch]:
        """Yield the square patches of cells about the seats; seats on one axis share one.

        Raises:
            ValueError: a boss is nearer to another, to a side wall or to the edge than the cells allow.
        """
        radius: dict[tuple[float, float], float] = {}
        for seat in self.seats:
            radius[seat.centre] = max(0.5 * seat.boss, radius.get(seat.centre, 0.0))
        for (x, y), outer in radius.items():
            here = tuple(seat for seat in self.seats if seat.centre == (x, y))
            room = [
                x - self.thickness("x0"), self.length - self.thickness("x1") - x,
                y - self.thickness("y0"), self.height - self.thickness("y1") - y,
            ]  # fmt: skip
            # The larger of the distances in x and y is shared out by the radii.
            room += [
                max(abs(x - u), abs(y - v)) * outer / (outer + other)
                for (u, v), other in radius.items()
                if (u, v) != (x, y)
            ]
            half = min(_PATCH * outer, *room)
            if half < _MIN_PATCH * outer * (1.0 - 1e-9):
                raise ValueError(
                    f"seat {here[0].name!r}: its boss needs {_MIN_PATCH * outer:.4g} m in x or y on each side of the "
                    f"centre, clear of other bosses and side walls, there are {max(half, 0.0):.4g} m"
                )
            yield Patch((x, y), half, tuple(sorted({0.5 * d for seat in here for d in (seat.bore, seat.boss)})), here)

    def _check_seat(self, seat: Seat) -> None:
        prefix = f"seat {seat.name!r}: "
        cover, wall, end = self.reach(seat)
        if not wall:
            raise ValueError(f"{prefix}the casing has no wall {seat.wall}")
        if cover >= wall:
            raise ValueError(f"{prefix}cover must be thinner than the wall of {wall!r} m, got {cover!r}")
        inside = self.depth - self.thickness("z1" if seat.wall == "z0" else "z0")
        facing = [
            self.reach(other)[2] for other in self.seats if (other.centre, other.wall) == (seat.centre, _across(seat))
        ]
        if end > inside or any(end + other > self.depth for other in facing):
            raise ValueError(f"{prefix}boss_length {seat.boss_length!r} m has no room in a depth of {self.depth!r} m")


@dataclass(frozen=True)
class Patch:
    """A square of cells about one axis of seats: centre, half side, radii of bores and bosses ascending, seats."""

    centre: tuple[float, float]
    half: float
    radii: tuple[float, ...]
    seats: tuple[Seat, ...]


@dataclass(frozen=True)
class CasingMeshRule:
    """Sizes of the cells: largest edge in a wall, m, and cells through the thickness of a wall at least."""

    size: float
    through: int = 1

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "rule.", "positive", "size")
        check_whole(self.through, "rule.through", 1)


def _across(seat: Seat) -> str:
    return "z1" if seat.wall == "z0" else "z0"

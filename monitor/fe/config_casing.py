"""File of a casing for ``spallwatch gear --casing``: a box with seats of bearings, points and microphones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from models.fe.casing.model import Point
from models.fe.casing.modes import Damping
from models.fe.casing.shape import CAST_IRON, STEEL, CasingMeshRule, CasingShape, Material, Seat
from monitor.config.explain import explain_problems
from monitor.config.fields import ConfigSection, Finite, Name, NotNegative, Positive
from monitor.config.load import ConfigError, read_toml, sort_problems
from monitor.config.positions import find_lines

_MM = 1e-3
_MATERIALS: dict[str, Material] = {"cast_iron": CAST_IRON, "steel": STEEL}
Place = tuple[Finite, Finite, Finite]


class CasingSeatSection(ConfigSection):
    """The seat of a bearing in a wall across the shafts; ``name`` is that of a ``[[gear.support]]``."""

    name: Name
    wall: Literal["z0", "z1"]
    at_mm: tuple[Positive, Positive]
    bore_mm: Positive
    boss_mm: Positive
    boss_length_mm: NotNegative = 0.0
    cover_mm: NotNegative = 0.0
    mass_kg: NotNegative = 0.0

    def to_seat(self) -> Seat:
        """Return the seat in SI."""
        return Seat(
            self.name,
            self.wall,
            centre=(_MM * self.at_mm[0], _MM * self.at_mm[1]),
            bore=_MM * self.bore_mm,
            boss=_MM * self.boss_mm,
            boss_length=_MM * self.boss_length_mm,
            cover=_MM * self.cover_mm,
            mass=self.mass_kg,
        )


class PlaceSection(ConfigSection):
    """A point of the casing, or a microphone."""

    name: Name
    at_mm: Place

    @property
    def place(self) -> tuple[float, float, float]:
        """Where it is, m, in the axes of the casing."""
        x, y, z = self.at_mm
        return _MM * x, _MM * y, _MM * z


class CasingFile(ConfigSection):
    """A closed box that stands on its underside: x and y are those of the train, y up, z along the shafts.

    ``damping`` has pairs of a frequency, Hz, and a share of critical damping.
    """

    size_mm: tuple[Positive, Positive, Positive]
    wall_mm: Positive
    cell_mm: Positive
    band_hz: tuple[Positive, Positive]
    damping: Annotated[tuple[tuple[NotNegative, NotNegative], ...], Field(min_length=1)]
    material: Literal["cast_iron", "steel"] = "cast_iron"
    sound_lines: Annotated[int, Field(ge=4, le=1000)] = 30
    seat: Annotated[tuple[CasingSeatSection, ...], Field(min_length=1)]
    point: tuple[PlaceSection, ...] = ()
    microphone: tuple[PlaceSection, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.band_hz[0] >= self.band_hz[1]:
            raise ValueError("band_hz: the lower end must be below the upper end")
        if not self.point and not self.microphone:
            raise ValueError("give at least one [[point]] or [[microphone]]")
        for tables in (self.point, self.microphone):
            names = [table.name for table in tables]
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise ValueError(f"the name {twice!r} is given twice")
        if self.microphone and any(seat.cover_mm == 0.0 for seat in self.seat):
            raise ValueError("a [[microphone]] needs a closed surface: give every [[seat]] a cover_mm above 0")
        # Walls, seats and damping are checked where they are made.
        self.shape.size("x0")
        self.to_damping()
        return self

    @property
    def shape(self) -> CasingShape:
        """Walls and seats, SI."""
        x, y, z = self.size_mm
        seats = tuple(seat.to_seat() for seat in self.seat)
        return CasingShape.box((_MM * x, _MM * y, _MM * z), _MM * self.wall_mm, seats)

    @property
    def rule(self) -> CasingMeshRule:
        """Sizes of the cells, SI."""
        return CasingMeshRule(_MM * self.cell_mm)

    @property
    def made_of(self) -> Material:
        """Material of the walls."""
        return _MATERIALS[self.material]

    @property
    def points(self) -> list[Point]:
        """The points of the casing, SI."""
        return [Point(point.name, point.place) for point in self.point]

    def to_damping(self) -> Damping:
        """Return the modal damping by frequency."""
        return Damping(tuple(hz for hz, _ in self.damping), tuple(ratio for _, ratio in self.damping))


def read_casing(path: Path) -> CasingFile:
    """Return the casing in a TOML file.

    Raises:
        ConfigError: with one line for each problem: the file, the line, the key, what was found and what is allowed.
    """
    text, values = read_toml(path)
    try:
        return CasingFile.model_validate(values)
    except ValidationError as error:
        raise ConfigError(sort_problems(explain_problems(error, CasingFile), path, find_lines(text))) from None

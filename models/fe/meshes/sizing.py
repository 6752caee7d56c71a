"""Sizes of a mesh from the contact that it must resolve: Hertz's half widths at the load, times the factors of a rule.

The mesh of a body is fine in a patch about its contact and coarsens outwards. Patch and size of its elements are
multiples of the contact's half width at the load in question, so that another load has another mesh (thesis,
section 3.3).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.machine.hertz import point_contact_semi_axes
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry, Race

Layout = Literal["fan", "rows"]

# Share of the shoulder's distance, and of the ball's radius, up to which a contact's grid may reach along the shaft.
_GROOVE_REACH, _BALL_REACH = 0.97, 0.8


MeshName = Literal["coarse", "default", "fine"]
"""Meshes between which people choose by speed and error."""


@dataclass(frozen=True)
class MeshRule:
    """How a mesh follows from the half width b of a contact.

    Attributes:
        patch: half width of the fine patch by b.
        size: size of the elements in the patch by b, across the contact.
        growth: factor by which layers of elements grow outwards, above 1.
        along: layers of elements along the half length of the contact.
        along_patch: half length of the patch by the half length a of an elliptical contact; a line contact's patch is
            as long as the contact.
        end: size of the last layer of a line contact, at the end of the roller, by the even size of the others.
        over: layers of a line contact's cells on the rounded edge, of which as much is taken as three times the
            indentation b^2 / (2 r) reaches; 0 ends the contact with the effective length, as the thesis does, and the
            pressure at the roller's end then grows with each refinement (the approach moves by 0.2 %).
        coarse: size of the largest elements away from the contact, by the thickness of the body.
        max_size: size of the largest elements beyond the patch, m; layers of a fan are not limited.
        layout: "fan", in which elements coarsen in all directions from the contact, or "rows": rows and columns through
            the whole body, as in a mesh of one size, or of a local and a global one.
    """

    patch: float = 1.6
    size: float = 0.4
    growth: float = 1.7
    along: int = 5
    along_patch: float = 1.3
    end: float = 0.25
    over: int = 0
    coarse: float = 3.0
    max_size: float = math.inf
    layout: Layout = "fan"

    def __post_init__(self) -> None:
        """Refuse factors that make no mesh."""
        for name in ("patch", "size", "along_patch", "end", "coarse", "max_size"):
            if not getattr(self, name) > 0.0:
                raise WrongInputError(f"mesh rule: {name} must be positive, got {getattr(self, name)!r}")
        if self.layout not in ("fan", "rows"):
            raise WrongInputError(f"mesh rule: layout must be fan or rows, got {self.layout!r}")
        if not 1.05 <= self.growth <= 5.0:
            raise WrongInputError(f"mesh rule: growth must be from 1.05 to 5, got {self.growth!r}")
        if self.size > self.patch * (1.0 + 1e-9):
            raise WrongInputError(f"mesh rule: size {self.size!r} must not exceed patch {self.patch!r}")
        if self.along < 1 or self.over < 0:
            raise WrongInputError(
                f"mesh rule: along must be 1 at least and over not negative, got {self.along!r} and {self.over!r}"
            )
        if self.end > 1.0:
            raise WrongInputError(f"mesh rule: end must be up to 1, got {self.end!r}")

    @property
    def columns(self) -> int:
        """Elements across the half patch: the least number of which none is larger than ``size`` times b."""
        return max(1, math.ceil(self.patch / self.size - 1e-9))

    def key(self) -> dict[str, Any]:
        """Return its values as JSON can hold them: a largest size without a bound is None."""
        return {**asdict(self), "max_size": None if math.isinf(self.max_size) else self.max_size}


# Cells on the rounded edge of a roller: without them the pressure at its end grows with each refinement.
_OVER = 2

NAMED_RULES: dict[MeshName, MeshRule] = {
    "coarse": MeshRule(patch=1.6, size=0.8, growth=2.0, along=4, over=_OVER),
    "default": MeshRule(over=_OVER),
    "fine": MeshRule(patch=1.6, size=0.27, growth=1.5, along=7, over=_OVER),
}
"""Elements across the half width of the contact: about 1, 2 and 4."""


def chapter_rule(geometry: FeGeometry, race: Race, force: float, eta: float) -> MeshRule:
    """Return the rule that the thesis found: one element over the half patch of a roller, g = l / eta elsewhere.

    Rollers: w = l = 1.5 a, four layers on half the roller (Table 8, third row); balls: w = 1.5 b and 1.5 a, l = b
    (Table 10, third row, found for tetrahedra; here two elements of 0.75 b).
    """
    _, half_width = half_sizes(geometry, race, force)
    size = 1.5 if geometry.element == "roller" else 1.0
    return MeshRule(
        patch=1.5,
        size=size,
        growth=2.0,
        along=4,
        along_patch=1.5,
        end=1.0,
        max_size=size * half_width / eta,
        layout="rows",
    )


@dataclass(frozen=True, eq=False)
class ContactGrid:
    """Grid lines of a contact in its tangent plane, shared by the meshes of both bodies.

    ``x`` along rolling and ``z`` along the shaft are coordinates in the tangent plane: the surfaces' points are
    projected along the contact's axis. Only the quarter x >= 0, z >= 0 is there.

    Attributes:
        half_width: b of Hertz (Eq. 4 or Eq. 12), m.
        half_length: half the effective length, or a of Eq. 11, m.
        columns: elements across the patch; the line ``x[columns]`` is its border, one more line follows.
        x, z: grid lines from 0, ascending, m.
    """

    half_width: float
    half_length: float
    columns: int
    x: NDArray[np.float64]
    z: NDArray[np.float64]

    def cells(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return x0, x1, z0, z1 of the cells of the grid, m, each (cells,); z runs fastest."""
        x0, z0 = np.meshgrid(self.x[:-1], self.z[:-1], indexing="ij")
        x1, z1 = np.meshgrid(self.x[1:], self.z[1:], indexing="ij")
        return x0.ravel(), x1.ravel(), z0.ravel(), z1.ravel()


def half_sizes(geometry: FeGeometry, race: Race, force: float) -> tuple[float, float]:
    """Return half length and half width of the contact of one element with a race under a force, m.

    Rollers: half the effective length and a of Eq. 4; balls: a and b of Eqs. 11 and 12; with the modulus and Poisson's
    ratio of the geometry.

    Raises:
        WrongInputError: the force is not positive.
    """
    if not (math.isfinite(force) and force > 0.0):
        raise WrongInputError(f"force of a contact must be positive and finite, got {force!r} N")
    radius, sign = geometry.element_radius, 1.0 if race == "inner" else -1.0
    modulus = geometry.modulus / (1.0 - geometry.poisson**2)
    rolling = 1.0 / (1.0 / radius + sign / geometry.race_radius(race))
    groove = geometry.groove_radius(race)
    if groove is None:
        assert geometry.effective_length is not None
        width = math.sqrt(8.0 * rolling * force / (math.pi * geometry.effective_length * modulus))
        return 0.5 * geometry.effective_length, width
    across = 1.0 / (1.0 / radius - 1.0 / groove)
    long, short = point_contact_semi_axes(rolling, across, force, modulus=modulus)
    return (long, short) if across >= rolling else (short, long)


def contact_grid(geometry: FeGeometry, race: Race, force: float, rule: MeshRule | None = None) -> ContactGrid:
    """Return the grid of the contact of one element with a race at a force, N.

    Raises:
        WrongInputError: the contact is so long that it reaches over the shoulder of the groove, or so wide that the
            body cannot hold the patch.
    """
    rule = rule or MeshRule()
    half_length, half_width = half_sizes(geometry, race, force)
    width = rule.patch * half_width
    if width > 0.4 * geometry.element_radius:
        raise WrongInputError(
            f"{geometry.designation}: half patch {width!r} m at {force!r} N exceeds 0.4 of element_radius "
            f"{geometry.element_radius!r} m: the load is too large for small strains, or the rule's patch is"
        )
    inside = np.linspace(0.0, width, rule.columns + 1)
    x = np.append(inside, width + min(rule.growth * width / rule.columns, max(rule.max_size, width / rule.columns)))
    if geometry.groove_radius(race) is None:
        lines = np.concatenate((_line_layers(half_length, rule), _edge_layers(geometry, race, half_width, rule)))
        return ContactGrid(half_width, half_length, rule.columns, x, lines)
    reach = min(groove_reach(geometry, race) * _GROOVE_REACH, _BALL_REACH * geometry.element_radius)
    if half_length > reach:
        raise WrongInputError(
            f"{geometry.designation}: half length {half_length!r} m of the contact with the {race} race at {force!r} N "
            f"reaches over the shoulder or the ball's side, {reach!r} m from the middle"
        )
    end = min(rule.along_patch * half_length, reach)
    return ContactGrid(half_width, half_length, rule.columns, x, np.linspace(0.0, end, rule.along + 1))


def groove_reach(geometry: FeGeometry, race: Race) -> float:
    """Return the half width of the groove of a race at its shoulder, at most half the ring's width, m.

    Raises:
        WrongInputError: the race has no groove.
    """
    groove = geometry.groove_radius(race)
    if groove is None:
        raise WrongInputError(f"{geometry.designation}: the {race} race has no groove")
    if race == "outer" and geometry.spherical_outer:
        return min(0.5 * geometry.width, 0.9 * groove)
    height = min(geometry.shoulder_height, groove)
    return min(math.sqrt(groove**2 - (groove - height) ** 2), 0.5 * geometry.width)


def uniform_rule(geometry: FeGeometry, race: Race, force: float, size: float, along: int | None = None) -> MeshRule:
    """Return the rule of elements of one size, m, throughout; ``along`` layers on half the contact, by default as many.

    The patch is 1.5 half widths rounded up to whole elements, so that the cells of the contact are those of the mesh.

    Raises:
        WrongInputError: the size is not positive.
    """
    if not size > 0.0:
        raise WrongInputError(f"size of elements must be positive, got {size!r} m")
    half_length, half_width = half_sizes(geometry, race, force)
    relative = size / half_width
    columns = max(1, math.ceil(1.5 / relative))
    reach = half_length if geometry.element == "roller" else 1.3 * half_length
    layers = max(1, math.ceil(reach / size)) if along is None else along
    return MeshRule(
        patch=columns * relative,
        size=relative,
        growth=1.05,
        along=layers,
        along_patch=1.3,
        end=1.0,
        max_size=size,
        layout="rows",
    )


def _line_layers(half_length: float, rule: MeshRule) -> NDArray[np.float64]:
    """Return lines along a line contact: even, the last layers halved until the end has its size."""
    sizes = np.ones(rule.along)
    size, place = rule.end, rule.along - 1
    while size < 1.0 and place > 0:
        sizes[place] = size
        size, place = 2.0 * size, place - 1
    lines = np.concatenate(([0.0], np.cumsum(sizes)))
    return half_length * lines / lines[-1]


def _edge_layers(geometry: FeGeometry, race: Race, half_width: float, rule: MeshRule) -> NDArray[np.float64]:
    """Return the lines of a line contact beyond the effective length, on the rounded edge."""
    assert geometry.effective_length is not None
    half_length, edge = 0.5 * geometry.effective_length, geometry.edge_radius
    if rule.over == 0 or edge == 0.0:
        return np.empty(0)
    sign = 1.0 if race == "inner" else -1.0
    curvature = 1.0 / geometry.element_radius + sign / geometry.race_radius(race)
    reach = min(math.sqrt(3.0 * edge * curvature) * half_width, 0.6 * edge)
    return half_length + reach * np.linspace(0.0, 1.0, rule.over + 1)[1:]


def growing_lines(start: float, end: float, first: float, growth: float, largest: float) -> NDArray[np.float64]:
    """Return lines from ``start`` to ``end``, m, whose spacings grow from about ``first`` up to ``largest``."""
    span = end - start
    sizes: list[float] = []
    size = min(first, largest)
    while sum(sizes) + 0.5 * size < span or not sizes:
        sizes.append(size)
        size = min(size * growth, largest)
    if max(sizes) * span / sum(sizes) > 1.02 * largest:
        sizes.append(size)
    lines = np.concatenate(([0.0], np.cumsum(sizes)))
    return start + span * lines / lines[-1]

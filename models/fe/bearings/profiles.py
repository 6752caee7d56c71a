"""Pressure along rollers of a given profile: what a straight, a crowned and a logarithmic roller do at their ends.

A profile is micrometres deep. It belongs to the gap of the contact, not to the mesh, so that one pair of bodies serves
all profiles of a roller. The roller's mesh is a cylinder up to its end faces, where cells are fine about the end of the
effective length; the race is as wide as the ring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.fe.bearings.element import element_body, ring_body, surface_gap
from models.fe.meshes.sizing import ContactGrid, MeshRule, contact_grid, growing_lines
from models.fe.solid.condense import ContactCells, compliance
from models.fe.solid.contact import ContactState, press_to_force
from models.fe.solid.elastic import FeError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry, Race

RULE = MeshRule(patch=1.5, size=0.375, growth=2.0)
END_SIZE = 0.005
"""Elements about the end of the effective length, as a share of half of it."""
_MIDDLE_SIZE, _GROWTH = 0.25, 1.7
# A place along the roller is pressed where its largest pressure exceeds this share of that in the middle.
_PRESSED = 1e-3


@dataclass(frozen=True, eq=False)
class ProfilePressure:
    """Pressure of one contact along a roller, on the half from its middle to its end.

    Attributes:
        load: of the whole contact, N.
        approach: of the race's back to the mid-plane of the roller, m.
        z0, z1: ends of the cells along the roller, m, shape (n,).
        pressure: on the middle line of the contact, Pa, shape (n,).
        line_load: force per length of the roller, N/m, shape (n,).
        hertz: pressure of an infinite cylinder under the mean line load, Pa.
        mean_line_load: load over the effective length, N/m.
        converged: whether the contact is.
    """

    load: float
    approach: float
    z0: NDArray[np.float64]
    z1: NDArray[np.float64]
    pressure: NDArray[np.float64]
    line_load: NDArray[np.float64]
    hertz: float
    mean_line_load: float
    converged: bool

    @property
    def middle_hertz(self) -> float:
        """Pressure of an infinite cylinder under the line load in the middle, Pa: the plane value there."""
        return self.hertz * math.sqrt(float(self.line_load[0]) / self.mean_line_load)

    @property
    def middle(self) -> float:
        """Pressure in the middle of the roller, Pa."""
        return float(self.pressure[0])

    @property
    def peak(self) -> float:
        """Largest pressure, Pa: the mean of one cell."""
        return float(self.pressure.max())

    @property
    def peak_place(self) -> float:
        """Where it is, m from the middle."""
        k = int(np.argmax(self.pressure))
        return 0.5 * float(self.z0[k] + self.z1[k])

    @property
    def loaded_length(self) -> float:
        """Length of the pressed part of the roller, m."""
        pressed = self.pressure > _PRESSED * self.middle
        return 2.0 * float(self.z1[pressed].max(initial=0.0))

    @property
    def unevenness(self) -> float:
        """Largest less smallest pressure over nine tenths of the pressed length, by that in the middle."""
        inner = self.pressure[self.z1 <= 0.45 * self.loaded_length]
        return float(np.ptp(inner)) / self.middle if len(inner) else math.nan


@dataclass(frozen=True, eq=False)
class RollerOnRace:
    """A roller on a race, condensed: any profile at any load near that of the meshes costs milliseconds.

    Attributes:
        geometry: of the bearing; the profile of the roller does not matter here.
        race: which.
        made_for: load of the meshes, N.
        cells: of the quarter x, z >= 0; z runs fastest.
        compliance: of race and half roller, m^3/Pa.
        unknowns: of roller and ring.
    """

    geometry: FeGeometry
    race: Race
    made_for: float
    cells: ContactCells
    compliance: NDArray[np.float64]
    unknowns: tuple[int, int]

    def press(self, geometry: FeGeometry, load: float) -> ProfilePressure:
        """Return the pressure of a roller with the profile of a geometry under a load, N.

        Raises:
            FeError: the geometry differs in more than profile, edge and effective length, or the load is so much larger
                than that of the meshes that the contact leaves them.
        """
        same = replace(
            geometry,
            profile=self.geometry.profile,
            crown_radius=self.geometry.crown_radius,
            effective_length=self.geometry.effective_length,
            edge_radius=self.geometry.edge_radius,
        )
        if same != self.geometry:
            raise FeError(f"{geometry.designation}: only profile, edge_radius and effective_length may differ")
        gap = surface_gap(geometry, self.race, self.cells)
        state = press_to_force(self.compliance, gap, self.cells.area, 0.25 * load)
        if bool(np.any(state.pressure[self.cells.x1 >= float(self.cells.x1.max()) * (1.0 - 1e-9)] > 0.0)):
            raise FeError(
                f"{geometry.designation}: at {load:g} N the contact with the {self.race} race is wider than the patch "
                f"of meshes for {self.made_for:g} N"
            )
        return self._along(geometry, load, state)

    def _along(self, geometry: FeGeometry, load: float, state: ContactState) -> ProfilePressure:
        """Return the pressures of a state along the roller."""
        first = self.cells.x0 == self.cells.x0.min()
        z0, z1 = self.cells.z0[first], self.cells.z1[first]
        rows = state.pressure.reshape(-1, len(z0))
        widths = (self.cells.x1 - self.cells.x0).reshape(-1, len(z0))
        length = geometry.effective_length
        assert length is not None
        half_width = contact_grid(replace(geometry, profile="straight"), self.race, load).half_width
        return ProfilePressure(
            load, state.approach, z0, z1, rows[0], 2.0 * np.sum(rows * widths, axis=0),
            2.0 * load / (math.pi * half_width * length), load / length, state.converged,
        )  # fmt: skip


def roller_on_race(
    geometry: FeGeometry, race: Race, load: float, rule: MeshRule = RULE, *, end_size: float = END_SIZE
) -> RollerOnRace:
    """Return roller and race of a bearing on meshes made for a load of the roller, N.

    Raises:
        FeError: the bearing has balls.
        WrongInputError: the sizes do not fit the bodies.
    """
    if geometry.element != "roller" or geometry.effective_length is None or geometry.roller_length is None:
        raise FeError(f"{geometry.designation}: balls have no profile")
    whole = replace(
        geometry, profile="straight", crown_radius=None, effective_length=geometry.roller_length, edge_radius=0.0
    )
    sizes = contact_grid(replace(geometry, profile="straight"), race, load, rule)
    lines = profile_lines(0.5 * geometry.effective_length, 0.5 * geometry.roller_length, end_size)
    grid = ContactGrid(sizes.half_width, 0.5 * geometry.roller_length, sizes.columns, sizes.x, lines)
    ring, roller = ring_body(whole, race, grid, rule), element_body(whole, grid, rule)
    cells = ContactCells.about_nodes(grid.x, grid.z)
    total = compliance(ring, "contact", cells) + compliance(roller, "contact", cells)
    return RollerOnRace(geometry, race, load, cells, total, (roller.unknowns, ring.unknowns))


def profile_lines(half: float, end: float, end_size: float = END_SIZE) -> NDArray[np.float64]:
    """Return lines from the middle of a roller to its end, m, fine on both sides of the end of the effective length."""
    inside = growing_lines(0.0, half, end_size * half, _GROWTH, _MIDDLE_SIZE * half)
    lines = half - inside[::-1]
    lines[0] = 0.0
    if end <= half * (1.0 + 1e-9):
        return lines
    return np.concatenate((lines, growing_lines(half, end, end_size * half, _GROWTH, _MIDDLE_SIZE * half)[1:]))


def lundberg_load(geometry: FeGeometry) -> float:
    """Return the load at which a logarithmic profile makes the pressure even along the roller, N.

    Lundberg's profile has the factor 2 Q / (pi L E') where ISO 16281 has 0.00035 or 0.0005 times the diameter.

    Raises:
        FeError: the profile is not logarithmic.
    """
    if geometry.profile != "logarithmic" or geometry.effective_length is None:
        raise FeError(f"{geometry.designation}: expected a logarithmic profile, got {geometry.profile!r}")
    # The drop at 2 z / l = sqrt(1 - 1/e) is the factor itself.
    place = np.array([0.5 * geometry.effective_length * math.sqrt(1.0 - math.exp(-1.0))])
    factor = float(geometry.drop(place)[0])
    modulus = geometry.modulus / (1.0 - geometry.poisson**2)
    return 0.5 * factor * math.pi * geometry.effective_length * modulus

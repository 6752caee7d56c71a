"""A radially loaded bearing from its dimensions: the meshes that a load needs, and the assembled bearing.

Meshes are made for loads of one series, so that bearings at different loads share them, in a cache too.

On a rigid shaft and in a rigid housing a bearing is stiffer than the analytic one: its rings are thin and stick to what
does not yield, while Hertz' half spaces yield to any depth and Palmgren's formula was measured on thick plates. Under
a pressure on its bore the inner ring bends, which takes most of that away.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from models.fe.bearings.assembly import AssembledBearing, FeBearing
from models.fe.bearings.element import ELEMENT_STEPS, MAX_SHARE, RACES, ElementMesh, FeContact, Progress, element_mesh
from models.fe.bearings.law import ElementLaw
from models.fe.bearings.ring_bodies import INFLUENCE_RULE, bore_load, influence_load, ring_influence
from models.fe.bearings.rings import SUPPORTS, BoreLoad, RingInfluence, Support
from models.fe.cache import CacheEntry, FeCache
from models.fe.meshes.grid import FeMeshError
from models.fe.meshes.sizing import MeshRule, contact_grid
from models.fe.solid.condense import ContactCells
from models.machine.hertz import BALL_EXPONENT, PALMGREN, ROLLER_EXPONENT, in_series, point_contact_stiffness
from models.words.checks import check_choice
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from models.fe.meshes.geometry import FeGeometry, Race

# Meshes are made for these powers, N: each serves loads from a fifth to 1.3 times its own, so that neighbours overlap.
LOAD_STEP = 5.0
# Range of loads on the bearing, by the load asked for, within which the result is valid.
VALID_SHARE = 4.0
# Loads of elements by the analytic Q_max: rings that yield shift the load, mostly away from the most loaded element.
_MARGIN = 1.3


def analytic_law(geometry: FeGeometry) -> ElementLaw:
    """Return the element law of Eqs. 15 to 18, valid for any load: k_c of Hertz for balls, of Palmgren for rollers."""
    if geometry.element == "roller":
        assert geometry.effective_length is not None
        single = PALMGREN * geometry.effective_length ** (8.0 / 9.0)
        return ElementLaw.from_power(in_series(single, single, ROLLER_EXPONENT), ROLLER_EXPONENT, 1e-3, 1e9)
    modulus = geometry.modulus / (1.0 - geometry.poisson**2)
    inner, outer = (
        _point_stiffness(geometry, race, sign, modulus) for race, sign in zip(RACES, (1.0, -1.0), strict=True)
    )
    return ElementLaw.from_power(in_series(inner, outer, BALL_EXPONENT), BALL_EXPONENT, 1e-3, 1e9)


def _point_stiffness(geometry: FeGeometry, race: Race, sign: float, modulus: float) -> float:
    groove = geometry.groove_radius(race)
    assert groove is not None
    curvature = 1.0 / geometry.element_radius
    rolling, across = curvature + sign / geometry.race_radius(race), curvature - 1.0 / groove
    return point_contact_stiffness(1.0 / rolling, 1.0 / across, "elliptic", modulus=modulus)


def largest_load(geometry: FeGeometry, load: float, clearance: float = 0.0) -> float:
    """Return the analytic load of an element that stands in the direction of a load on the bearing, N."""
    bearing = AssembledBearing(analytic_law(geometry), geometry.n_elements, max(clearance, 0.0))
    return float(bearing.state(load).loads.max())


def mesh_loads(lowest: float, highest: float) -> tuple[float, ...]:
    """Return the loads, N, ascending, for which meshes are made so that they serve loads between two, N."""
    last = math.ceil(math.log(highest / MAX_SHARE) / math.log(LOAD_STEP) - 1e-9)
    first = math.floor(math.log(lowest) / math.log(LOAD_STEP) + 1.0 + 1e-9)
    return tuple(LOAD_STEP**k for k in range(min(first, last), last + 1))


def fe_bearing(
    geometry: FeGeometry,
    load: float,
    *,
    clearance: float = 0.0,
    support: Support = "rigid-shaft",
    rule: MeshRule | None = None,
    cache: FeCache | None = None,
    progress: Progress | None = None,
) -> FeBearing:
    """Return a bearing of one row under a radial load, N, its outside fixed to a rigid housing.

    Args:
        clearance: radial clearance h of Eq. 20, m.
        support: what holds the inner ring: a rigid shaft that its bore sticks to, or a sinusoidal pressure on the bore
            over the load zone (thesis, Fig. 21).
        rule: of the meshes about the contacts.
        cache: where results are kept; nowhere if None.
        progress: told before each step what is done, the steps done and their number.

    Raises:
        WrongInputError: the load is not positive, or the bearing has several rows or a contact angle.
        FeError, LawError: meshes or contacts that fail; the message says why.
    """
    check_choice(support, "support", SUPPORTS)
    if not (math.isfinite(load) and load > 0.0):
        raise WrongInputError(f"expected a load that is finite and positive, got {load!r} N")
    if geometry.rows != 1 or geometry.contact_angle != 0.0:
        raise WrongInputError(
            f"{geometry.designation}: an assembled bearing has one row without a contact angle, "
            f"got rows {geometry.rows}, contact_angle {geometry.contact_angle:.4g} rad"
        )
    builder = _Builder(geometry, rule or MeshRule(), cache or FeCache(None), progress or _silent)
    largest = largest_load(geometry, load, clearance)
    loads = _that_fit(
        geometry, builder.rule, mesh_loads(largest / (2.0 * VALID_SHARE), _MARGIN * VALID_SHARE * largest)
    )
    builder.total = ELEMENT_STEPS * len(loads) + 2 + (support == "sinusoidal")
    meshes = _meshes(builder, loads, _MARGIN * largest)
    law = ElementLaw.from_tables([mesh.table() for mesh in meshes])
    inner, outer = (builder.ring(race, support) for race in RACES)
    bore = builder.bore(bore_extent(geometry, load, clearance)) if support == "sinusoidal" else None
    assembled = AssembledBearing(law, geometry.n_elements, clearance, inner, outer, bore)
    found = float(assembled.state(load).loads.max())
    serving = min((mesh for mesh in meshes if found <= MAX_SHARE * mesh.made_for), key=lambda mesh: mesh.made_for)
    contacts: dict[Race, FeContact] = {race: serving.contact(race, found) for race in RACES}
    unknowns = {name: max(mesh.unknowns[name] for mesh in meshes) for name in meshes[0].unknowns}
    return FeBearing(assembled, contacts, unknowns)


def _that_fit(geometry: FeGeometry, rule: MeshRule, loads: tuple[float, ...]) -> tuple[float, ...]:
    """Return the loads whose contacts stay on the races and are small beside the element."""

    def fits(load: float) -> bool:
        try:
            return all(contact_grid(geometry, race, load, rule).half_width > 0.0 for race in RACES)
        except WrongInputError:
            return False

    return tuple(load for load in loads if fits(load))


def _meshes(builder: _Builder, loads: tuple[float, ...], highest: float) -> list[ElementMesh]:
    """Return meshes for loads, as far as the bodies hold them, and up to a highest load on an element, N, at least."""
    meshes: list[ElementMesh] = []
    with suppress(FeMeshError):
        for made_for in loads:
            meshes.append(builder.element(made_for))  # noqa: PERF401
    if not meshes or MAX_SHARE * meshes[-1].made_for < highest:
        # The next mesh of the series has a contact that the bodies do not hold: one for this load alone.
        meshes.append(builder.element(highest / MAX_SHARE))
    return meshes


def bore_extent(geometry: FeGeometry, load: float, clearance: float) -> float:
    """Return the load zone of Eq. 26 from the analytic law, rad: the extent of the pressure on the bore."""
    if clearance <= 0.0:
        return math.pi
    state = AssembledBearing(analytic_law(geometry), geometry.n_elements, clearance).state(load)
    return 2.0 * math.acos(min(clearance / float(state.displacement[0]), 1.0))


def _silent(what: str, done: int, total: int) -> None:
    del what, done, total


class _Builder:
    """Makes the parts of a bearing, or takes them from the cache, and reports each step."""

    def __init__(self, geometry: FeGeometry, rule: MeshRule, cache: FeCache, progress: Progress) -> None:
        self.geometry, self.rule, self.cache, self.progress = geometry, rule, cache, progress
        self.done, self.total = 0, 0

    def element(self, made_for: float) -> ElementMesh:
        """Return the condensed contacts of an element on meshes for a load, N."""
        before = self.done

        def step(what: str, done: int, total: int) -> None:
            del total
            self.progress(what, before + done, self.total)

        def make() -> CacheEntry:
            return _kept_mesh(element_mesh(self.geometry, made_for, self.rule, step))

        key = self._key("element", self.rule, made_for)
        mesh = _mesh_from(self.geometry, made_for, self.cache.get(key, make))
        self.done += ELEMENT_STEPS
        return mesh

    def ring(self, race: Race, support: Support) -> RingInfluence:
        """Return the influence of a ring on its support; the outer one is in a rigid housing."""
        balanced = race == "inner" and support == "sinusoidal"

        def make() -> CacheEntry:
            found = ring_influence(self.geometry, race, self._coarse, balanced=balanced)
            return CacheEntry({"angle": found.angle, "race": found.race}, {"own": found.own, "support": found.support})

        self.progress(f"influence of the {race} ring", self.done, self.total)
        key = self._key("ring", INFLUENCE_RULE, self._coarse)
        entry = self.cache.get({**key, "race": race, "balanced": balanced}, make)
        self.done += 1
        values = entry.values
        return RingInfluence(entry.arrays["angle"], entry.arrays["race"], values["own"], values["support"])

    def bore(self, extent: float) -> BoreLoad:
        """Return the inner ring under a sinusoidal pressure over an extent, rad."""

        def make() -> CacheEntry:
            found = bore_load(self.geometry, self._coarse, extent=extent)
            arrays = {"angle": found.angle, "race": found.race, "under": found.bore_under_element}
            return CacheEntry(arrays, {"at_load": found.bore_at_load})

        self.progress("load on the bore", self.done, self.total)
        key = self._key("bore", INFLUENCE_RULE, self._coarse)
        entry = self.cache.get({**key, "extent": extent}, make)
        self.done += 1
        arrays = entry.arrays
        return BoreLoad(arrays["angle"], arrays["race"], entry.values["at_load"], arrays["under"])

    @property
    def _coarse(self) -> float:
        """Load for the mesh of the rings' influence, N."""
        return influence_load(self.geometry)

    def _key(self, kind: str, rule: MeshRule, load: float) -> dict[str, Any]:
        return {
            "kind": kind,
            "geometry": asdict(self.geometry),
            "rule": rule.key(),
            "load_newton": load,
        }


def _kept_mesh(mesh: ElementMesh) -> CacheEntry:
    arrays: dict[str, Any] = {}
    for race in RACES:
        cells = mesh.cells[race]
        for name in ("x0", "x1", "z0", "z1"):
            arrays[f"{race}_{name}"] = getattr(cells, name)
        arrays[f"{race}_compliance"], arrays[f"{race}_gap"] = mesh.compliance[race], mesh.gap[race]
    return CacheEntry(arrays, {"unknowns": dict(mesh.unknowns)})


def _mesh_from(geometry: FeGeometry, made_for: float, entry: CacheEntry) -> ElementMesh:
    arrays = entry.arrays
    return ElementMesh(
        geometry,
        made_for,
        {race: ContactCells(*(arrays[f"{race}_{name}"] for name in ("x0", "x1", "z0", "z1"))) for race in RACES},
        {race: arrays[f"{race}_compliance"] for race in RACES},
        {race: arrays[f"{race}_gap"] for race in RACES},
        entry.values["unknowns"],
    )

"""The bearing from its dimensions, on meshes of a few hundred unknowns."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from models.fe.bearings import bearing, ring_bodies
from models.fe.bearings.assembly import FeBearing
from models.fe.bearings.bearing import analytic_law, fe_bearing, largest_load, mesh_loads
from models.fe.bearings.element import MAX_SHARE, MIN_SHARE, ElementMesh, Progress, element_mesh, surface_gap
from models.fe.bearings.rings import Support
from models.fe.cache import CacheEntry, FeCache
from models.fe.extra import has_extra
from models.fe.meshes.geometry import FeGeometry, fe_geometry
from models.fe.meshes.grid import FeMeshError
from models.fe.meshes.sizing import MeshRule, half_sizes
from models.fe.solid.condense import ContactCells
from models.machine.bearing import catalogue_entry
from models.machine.hertz import contact_stiffness
from models.machine.load_distribution import largest_element_load
from models.words.errors import WrongInputError

needs_extra = pytest.mark.skipif(not has_extra(), reason="scikit-fem is not installed")

ROLLER, BALL = fe_geometry(catalogue_entry("NU 202 ECP")), fe_geometry(catalogue_entry("6210"))
LOAD = 2000.0
COARSE = MeshRule(patch=1.6, size=0.8, growth=4.0, along=1, end=1.0, coarse=4.0)


Maker = Callable[[Support], FeBearing]


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> FeCache:
    return FeCache(tmp_path_factory.mktemp("parts"))


@pytest.fixture(scope="module")
def coarse(parts: FeCache) -> Maker:
    @cache
    def make(support: Support) -> FeBearing:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ring_bodies, "INFLUENCE_RULE", MeshRule(patch=1.6, size=1.6, growth=3.0, along=1, end=1.0))
            # Fewer meshes: valid about this load only.
            patch.setattr(bearing, "VALID_SHARE", 1.0)
            return fe_bearing(ROLLER, LOAD, support=support, rule=COARSE, cache=parts)

    return make


def test_the_analytic_law_is_that_of_the_analytic_bearing():
    for geometry in (ROLLER, BALL):
        entry = catalogue_entry(geometry.designation).bearing
        k_c = contact_stiffness(entry, "elliptic")
        exponent = 10.0 / 9.0 if geometry.element == "roller" else 1.5
        np.testing.assert_allclose(
            analytic_law(geometry).approach_of(np.array([500.0])), (500.0 / k_c) ** (1 / exponent)
        )
        assert largest_load(geometry, 1000.0) == pytest.approx(largest_element_load(entry, 1000.0, k_c), rel=0.03)


@pytest.mark.parametrize(("lowest", "highest"), [(1.0, 1.1), (30.0, 900.0), (5.0, 25.0 * MAX_SHARE), (0.3, 7e4)])
def test_the_meshes_serve_all_loads_and_no_more(lowest: float, highest: float):
    loads = mesh_loads(lowest, highest)
    assert loads[0] * MIN_SHARE <= lowest * (1.0 + 1e-9)
    assert highest <= loads[-1] * MAX_SHARE * (1.0 + 1e-9)
    if len(loads) > 1:
        assert loads[1] * MIN_SHARE > lowest * (1.0 - 1e-9)
        assert loads[-2] * MAX_SHARE < highest


def test_the_gap_is_that_of_circles_and_of_the_profile():
    cells = ContactCells.grid(np.array([0.0, 1e-4, 2e-4]), np.array([0.0, 1e-3, 2e-3]))
    for geometry in (ROLLER, BALL):
        for race, sign in (("inner", 1.0), ("outer", -1.0)):
            across = geometry.groove_radius(race)  # pyright: ignore[reportArgumentType]
            rolling = 1.0 / geometry.element_radius + sign / geometry.race_radius(race)  # pyright: ignore[reportArgumentType]
            curvature = 0.0 if across is None else 1.0 / geometry.element_radius - 1.0 / across
            x2 = (cells.x0**2 + cells.x0 * cells.x1 + cells.x1**2) / 3.0
            z2 = (cells.z0**2 + cells.z0 * cells.z1 + cells.z1**2) / 3.0
            gap = surface_gap(geometry, race, cells)  # pyright: ignore[reportArgumentType]
            # Parabolas, and the next order of the circles: 5 % on a ball at z = 0.3 r.
            np.testing.assert_allclose(gap, 0.5 * (rolling * x2 + curvature * z2), rtol=0.1)
    crowned = fe_geometry(catalogue_entry("NU 202 ECP"), profile="crowned", crown_radius=1.0)
    drop = surface_gap(crowned, "inner", cells) - surface_gap(ROLLER, "inner", cells)
    np.testing.assert_allclose(drop, (cells.z0**2 + cells.z0 * cells.z1 + cells.z1**2) / 6.0, rtol=1e-6)


@needs_extra
def test_a_coarse_mesh_gives_the_bearing_in_kind(coarse: Maker):
    found = coarse("rigid-shaft")
    state = found.assembled.state(LOAD)
    assert state.converged
    assert state.mesh_error < 0.1
    # Of the fine meshes at 1 kN and 4 kN: 3.24e8 and 3.8e8 N/m.
    assert state.stiffness[0, 0] == pytest.approx(3.5e8, rel=0.1)
    largest = float(state.loads.max())
    assert found.assembled.law.lowest < 0.5 * largest
    assert found.assembled.law.covers(1.2 * largest)
    assert set(found.unknowns) == {"inner ring", "outer ring", "roller"}


@needs_extra
def test_the_contacts_are_those_of_the_most_loaded_element(coarse: Maker):
    found = coarse("rigid-shaft")
    load = float(found.assembled.state(LOAD).loads.max())
    approach = 0.0
    for race, contact in found.contacts.items():
        assert contact.force == pytest.approx(load)
        assert 4.0 * float(contact.pressure @ contact.cells.area) == pytest.approx(load)
        assert contact.half_width == half_sizes(ROLLER, race, load)[1]
        assert contact.found_half_width == pytest.approx(contact.half_width, rel=0.1)
        approach += contact.approach
    law = found.assembled.law
    assert approach == pytest.approx(float(law.approach_of(np.array([load]))[0]), rel=2.0 * law.mesh_error)


@needs_extra
def test_a_ring_under_a_pressure_yields_more_than_one_on_a_rigid_shaft(coarse: Maker):
    stiff, soft = (coarse(support).assembled.state(LOAD) for support in ("rigid-shaft", "sinusoidal"))
    assert soft.converged
    assert soft.stiffness[0, 0] < 0.95 * stiff.stiffness[0, 0]
    assert soft.bore_line != soft.displacement[0]


@needs_extra
def test_what_was_computed_is_kept(coarse: Maker, parts: FeCache, monkeypatch: pytest.MonkeyPatch):
    first = coarse("rigid-shaft")
    steps = list[tuple[str, int, int]]()
    made = parts.made
    monkeypatch.setattr(bearing, "VALID_SHARE", 1.0)
    again = fe_bearing(ROLLER, LOAD, rule=COARSE, cache=parts, progress=lambda *step: steps.append(step))
    assert parts.made == made
    np.testing.assert_array_equal(first.assembled.state(LOAD).loads, again.assembled.state(LOAD).loads)
    assert first.unknowns == again.unknowns
    assert steps[-1][1] == steps[-1][2] - 1


def test_meshes_whose_contact_leaves_the_race_are_left_out():
    # At 78 kN on a ball the contact of the 6210 would reach over the shoulder.
    assert bearing._that_fit(BALL, MeshRule(), (3125.0, 15625.0, 78125.0)) == (3125.0, 15625.0)  # pyright: ignore[reportPrivateUsage]


@needs_extra
def test_a_mesh_that_a_body_cannot_hold_is_replaced_by_one_for_the_load(
    coarse: Maker, parts: FeCache, monkeypatch: pytest.MonkeyPatch
):
    made = list[float]()

    def small_only(geometry: FeGeometry, load: float, rule: MeshRule, progress: Progress | None) -> ElementMesh:
        if load > 1000.0:
            raise FeMeshError("the patch reaches too far")
        made.append(load)
        return element_mesh(geometry, load, rule, progress)

    coarse("rigid-shaft")
    monkeypatch.setattr(bearing, "VALID_SHARE", 1.0)
    monkeypatch.setattr(bearing, "element_mesh", small_only)
    # Nothing that is kept may stand for what is refused.
    monkeypatch.setattr(parts, "get", lambda key, make: make() if key["kind"] == "element" else _get(parts, key, make))
    largest = largest_load(ROLLER, LOAD)
    found = fe_bearing(ROLLER, LOAD, rule=COARSE, cache=parts)
    assert made == pytest.approx([625.0, largest])
    assert found.assembled.state(LOAD).converged
    assert not found.assembled.law.covers(2.0 * largest)


def _get(parts: FeCache, key: Mapping[str, object], make: Callable[[], CacheEntry]) -> CacheEntry:
    return FeCache.get(parts, key, make)


def test_the_pressure_on_the_bore_spans_the_load_zone():
    assert bearing.bore_extent(ROLLER, 1000.0, 0.0) == math.pi
    loose = [bearing.bore_extent(ROLLER, load, 2e-5) for load in (100.0, 1000.0, 10000.0)]
    # Table 12 has 38.0, 82.4 and 138.2 degrees, from smeared rollers.
    np.testing.assert_allclose(np.degrees(loose), [38.0, 82.4, 138.2], atol=5.0)


def test_wrong_input_is_refused_by_name():
    with pytest.raises(WrongInputError, match="load"):
        fe_bearing(ROLLER, 0.0)
    with pytest.raises(ValueError, match="support must be one of"):
        fe_bearing(ROLLER, 1.0, support="loose")  # pyright: ignore[reportArgumentType]
    with pytest.raises(WrongInputError, match="rows 2"):
        fe_bearing(replace(ROLLER, rows=2), 100.0)
    assert math.isfinite(mesh_loads(1.0, 2.0)[0])

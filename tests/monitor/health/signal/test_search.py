"""The search of families of an estimated bearing: wider, at the places of other numbers, joined where they overlap."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.bearing import (
    KNOWN,
    CatalogueEntry,
    Kinematics,
    KinematicUncertainty,
    catalogue,
    catalogue_entry,
    kinematics,
    kinematics_uncertainty,
    with_count,
)
from monitor.health.name.naming import Naming, name_fault
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from monitor.health.signal.lines import SEARCH
from monitor.health.signal.search import FamilySearch, family_searches, overlapping, slip_searches, stated_searches
from monitor.health.signal.settings import WIDTH_BINS, shared_lines
from reference.signals import Samples, impacts
from tests.support.effort import effort_count

RATE, BAND, SPEED = 25600.0, (1000.0, 9000.0), 30.0
ENTRY = catalogue_entry("6207")


def name(x: Samples, lines: Kinematics, searches: dict[str, FamilySearch]) -> Naming:
    slip = slip_searches(kinematics_uncertainty(ENTRY) if searches else KNOWN)
    settings = FeatureSettings(RATE, (BAND,), fundamentals(lines), speed=lines.speed, searches=searches, slip=slip)
    features = block_features(x.astype(np.float32), RATE, settings)
    return name_fault(features.sought[0], lines, features.families[0], searches, verified=features.shaft is not None)


def searches_of(entry: CatalogueEntry) -> dict[str, FamilySearch]:
    return family_searches(kinematics_uncertainty(entry))


def test_a_known_geometry_has_the_plain_search() -> None:
    assert family_searches(KNOWN) == {}
    for designation in catalogue():
        assert bool(searches_of(catalogue_entry(designation))) == (designation == "22207"), designation


def test_the_plain_search_and_an_equal_one_give_the_same_bits() -> None:
    lines = kinematics(catalogue()["6205"], SPEED)
    equal = stated_searches(SEARCH)
    for seed, fault in enumerate(("outer", "inner", "ball", "cage")):
        x = impacts(np.random.default_rng(seed), fault, lines, height=12.0)
        plain, searched = name(x, lines, {}), name(x, lines, equal)
        assert plain.fault == searched.fault
        for family, found in plain.families.items():
            other = searched.families[family]
            assert (found.fundamental, found.comb_score, found.score) == (
                other.fundamental,
                other.comb_score,
                other.score,
            )
            np.testing.assert_array_equal(found.amplitude, other.amplitude)


def test_width_and_places_follow_the_uncertainty() -> None:
    uncertainty = KinematicUncertainty(0.005, 0.003, 0.005, 0.02, (0.9, 1.1), (0.88, 1.12))
    found = family_searches(uncertainty)
    assert found["outer"] == FamilySearch(SEARCH + 0.01, (1.0, 0.9, 1.1))
    assert found["inner"].places == (1.0, 0.88, 1.12)
    assert found["ball"] == FamilySearch(SEARCH + 0.04, (1.0,))
    assert found["outer"].holds(0.9 * 1.029)
    assert not found["outer"].holds(0.95)


@pytest.mark.parametrize("count", [8, 9, 10])
@pytest.mark.parametrize("fault", ["outer", "inner"])
def test_a_fault_is_named_whatever_the_number_of_balls(count: int, fault: str) -> None:
    """The estimate says nine balls; the bearing that runs has one fewer, as many, or one more.

    So few turns do not show the shaft: with ten, the races stand at four and six times its speed.
    """
    lines, real = kinematics(ENTRY.bearing, SPEED), kinematics(with_count(ENTRY.bearing, count), SPEED)
    x = impacts(np.random.default_rng(count), fault, real, height=25.0, duration=1.45)
    naming = name(x, lines, searches_of(ENTRY))
    assert naming.fault is not None
    assert fault in naming.fault.split("|")
    assert naming.families[fault].fundamental == pytest.approx(fundamentals(real)[fault], rel=0.02)
    if count != 9:
        plain = name(x, lines, {})
        assert plain.fault is None or fault not in plain.fault.split("|")


def test_families_whose_ranges_overlap_are_named_together() -> None:
    lines = kinematics(ENTRY.bearing, SPEED)
    nominal = fundamentals(lines)
    wide = {**searches_of(ENTRY), "ball": FamilySearch(0.2)}
    assert ("inner", "ball") in overlapping(nominal, wide)
    x = impacts(np.random.default_rng(1), "inner", lines, height=12.0)
    assert name(x, lines, wide).fault == "inner|ball"
    assert name(x, lines, {}).fault == "inner"


def test_noise_gets_no_name_in_the_wider_search() -> None:
    lines, searches = kinematics(ENTRY.bearing, SPEED), searches_of(ENTRY)
    for seed in range(effort_count(quick=60, full=600)):
        x = np.random.default_rng(seed).standard_normal(51_200)
        assert name(x, lines, searches).fault is None, seed


def test_three_bpfo_that_are_two_bpfi_are_one_peak() -> None:
    lines = {"outer": 80.0, "inner": 120.1, "ball": 91.0, "cage": 8.0}
    assert shared_lines(lines, 0.2) == ((("outer", 3), ("inner", 2)),)
    assert shared_lines(lines, 0.02) == ()
    assert shared_lines({"outer": 80.0, "inner": 80.0}, 0.2, orders=2) == (
        (("outer", 1), ("inner", 1)),
        (("outer", 2), ("inner", 2)),
    )
    assert shared_lines({}, 0.2) == ()


@given(
    st.dictionaries(st.sampled_from(["outer", "inner", "ball", "cage"]), st.floats(1.0, 500.0), max_size=4),
    st.floats(0.01, 5.0),
)
def test_a_line_is_shared_where_another_family_has_one_nearby(lines: dict[str, float], resolution: float) -> None:
    groups = shared_lines(lines, resolution)
    listed = [line for group in groups for line in group]
    assert len(listed) == len(set(listed))
    near = WIDTH_BINS * resolution
    for family, first in lines.items():
        for order in range(1, 6):
            rivals = [n * other for name, other in lines.items() if name != family for n in range(1, 6)]
            if any(abs(order * first - rival) < near * 0.999999 for rival in rivals):
                assert (family, order) in listed
    for group in groups:
        places = sorted(lines[family] * order for family, order in group)
        assert all(b - a < near for a, b in itertools.pairwise(places))
        assert places == pytest.approx([lines[family] * order for family, order in group])

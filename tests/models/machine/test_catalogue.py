"""The catalogue of series: possible geometry, agreement with the published ratings, designations and their suffixes."""

from __future__ import annotations

import itertools
import math
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.bearing import Bearing, catalogue, catalogue_entry, from_catalogue, kinematics
from models.machine.catalogue.designation import BALLS, compact, suffixes
from models.machine.catalogue.ratings import Internal, dynamic_rating, static_factor
from models.machine.catalogue.series import (
    RULES,
    count_probabilities,
    estimate,
    families,
    geometry,
    read_designation,
    series_of,
)

BASES = sorted(families())
SERIES = sorted({series_of(base) for base in BASES})


def bases_of(series: str) -> list[str]:
    return [base for base in BASES if series_of(base) == series]


def test_the_common_series_are_there() -> None:
    assert len(BASES) >= 300
    found = {series_of(base) for base in BASES}
    assert found >= {"60", "62", "63", "64", "618", "619", "160", "12", "13", "22", "23"}
    assert found >= {"NU2", "NU3", "NU22", "NU23", "222", "223", "302", "303", "72", "73"}
    assert {base[:2] for base in BASES if base.startswith("N")} == {"NU", "NJ"}


@pytest.mark.parametrize("series", SERIES)
def test_geometry_is_possible(series: str) -> None:
    bases = bases_of(series)
    for base in [*bases, *(f"{base}E" for base in bases if base.startswith("NU"))]:
        assert_possible(base)


def assert_possible(base: str) -> None:
    found = geometry(base)
    fields = ("designation", "n_elements", "element_diameter", "pitch_diameter", "contact_angle", "rows")
    derived = Bearing(**{name: getattr(found, name) for name in fields})
    bearing = from_catalogue(base) if base not in catalogue() else derived
    radius, pitch = 0.5 * found.element_diameter, 0.5 * found.pitch_diameter
    assert pitch * math.sin(math.pi / found.n_elements) > radius * math.cos(found.contact_angle), f"{base}: overlap"
    assert pitch - radius * math.cos(found.contact_angle) > 0.5 * found.bore, f"{base}: through the bore"
    assert pitch + radius * math.cos(found.contact_angle) < 0.5 * found.outside, f"{base}: through the outside"
    if found.effective_length is not None:
        assert found.rows * found.effective_length < found.width, base
    else:
        assert found.element_diameter < found.width, base
    lines = kinematics(bearing, 25.0)
    assert lines.bpfo + lines.bpfi == pytest.approx(25.0 * bearing.n_elements), base
    assert sum(probability for _, probability in found.counts) == pytest.approx(1.0), base
    assert found.counts[0][1] == max(probability for _, probability in found.counts), base


# ISO 76, table 1: 6205 and 6310 print f0 of 13.9 and 13.2; ISO 281, table 2: f_c = 59.9 at gamma 0.2, 46.7 at 0.05.
def test_factors_of_the_standards() -> None:
    assert static_factor(7.938 / 38.5, "deep_groove") == pytest.approx(13.9, rel=0.012)
    assert static_factor(19.05 / 80.0, "deep_groove") == pytest.approx(13.2, rel=0.012)
    for gamma, factor in ((0.05, 46.7), (0.1, 55.5), (0.2, 59.9), (0.3, 56.0)):
        one = Internal("deep_groove", 1, gamma, 1.0)
        assert dynamic_rating(one) / 1.3 / gamma**1.8 == pytest.approx(factor, rel=3e-3)
    with pytest.raises(ValueError, match=r"0\.01 to 0\.45"):
        static_factor(0.5, "deep_groove")


def test_bearings_of_the_file_are_taken_as_they_are() -> None:
    text = (Path(__file__).parents[3] / "models" / "bearings.toml").read_text(encoding="utf-8")
    entries = tomllib.loads(text)["bearing"]
    assert len(entries) == 13
    for entry in entries:
        bearing = from_catalogue(entry["designation"])
        assert bearing is catalogue()[entry["designation"]]
        assert bearing.n_elements == entry["n_elements"]
        assert bearing.element_diameter == entry["element_diameter_mm"] * 1e-3
        assert bearing.pitch_diameter == entry["pitch_diameter_mm"] * 1e-3
        assert bearing.effective_length == (
            entry["effective_length_mm"] * 1e-3 if "effective_length_mm" in entry else None
        )


@pytest.mark.parametrize(
    ("written", "base", "angle_deg", "n_elements"),
    [
        ("6205-2RS", "6205", 0.0, 9),
        ("6205 2RS1/C3", "6205", 0.0, 9),
        ("62052RS", "6205", 0.0, 9),
        ("6205.zz", "6205", 0.0, 9),
        ("NU205ECP", "NU205", 0.0, 13),
        ("NU 205 ECML/C3", "NU205", 0.0, 13),
        ("nj 205", "NJ205", 0.0, 13),
        ("22208 EK/W33", "22208", 10.6, 16),
        ("30205 J2/Q", "30205", 13.9, 17),
        ("7205 BEP", "7205", 40.0, 13),
        ("7205 BECBP", "7205", 40.0, 13),
        ("7205C", "7205", 15.0, 13),
        ("6804 ZZ", "61804", 0.0, 13),
        ("2205-2RS1", "2205", 10.6, 12),
        ("1205 EKTN9", "1205", 10.6, 12),
        ("SKF 6205-2Z", "6205", 0.0, 9),
        ("FAG 6205.2RSR", "6205", 0.0, 9),
    ],
)
def test_spellings(written: str, base: str, angle_deg: float, n_elements: int) -> None:
    found = geometry(written)
    assert found.base == base
    assert math.degrees(found.contact_angle) == pytest.approx(angle_deg, abs=0.05)
    assert found.n_elements == n_elements


@given(
    st.sampled_from(BASES),
    st.lists(st.integers(0, 999), max_size=3),
    st.lists(st.sampled_from(["", " ", "-", "/"]), min_size=3, max_size=3),
    st.booleans(),
)
def test_every_chain_of_suffixes_is_read(base: str, chosen: list[int], separators: list[str], lower: bool) -> None:
    """All suffixes of the family, in any order and spelling, leave the base number what it is."""
    known = sorted(suffixes(families()[base]))
    parts = [known[i % len(known)] for i in chosen]
    text = base + "".join(separator + part for separator, part in zip(separators, parts, strict=False))
    found = read_designation(text.lower() if lower else text)
    # A suffix that begins with a digit can only be told from the number if a separator stands between.
    if not (parts and parts[0][0].isdigit() and separators[0] == ""):
        assert found.base == base
        assert compact("".join(suffix.text for suffix in found.suffixes)) == compact("".join(parts))
    assert geometry(text).n_elements >= 5


def test_an_unknown_suffix_is_named_with_those_that_are_known() -> None:
    with pytest.raises(KeyError, match=r"6205-QQQ.*unknown suffix 'QQ'|unknown suffix 'QQQ'.*2RS1.*C3"):
        from_catalogue("6205-QQQ")


def test_suffixes_with_a_meaning_for_the_geometry() -> None:
    plain, reinforced = geometry("NU205"), geometry("NU205 ECP")
    assert reinforced.element_diameter > plain.element_diameter
    assert catalogue_entry("6205 ETN9").origins["n_elements"].kind == "estimated"
    assert catalogue_entry("6205-2RS").origins["n_elements"].kind == "measured"
    assert catalogue_entry("6205 ETN9").bearing == catalogue()["6205"]
    assert not catalogue_entry("1205 ETN9").estimated
    assert catalogue_entry("1205").estimated


# ISO 5753-1, radial internal clearance in um.
@pytest.mark.parametrize(
    ("designation", "low", "high"),
    [
        ("6205", 5, 20),
        ("6205/C3", 13, 28),
        ("6205-2RS C2", 1, 11),
        ("6310/C3", 18, 36),
        ("NU205 ECP", 20, 45),
        ("NU210/C4", 70, 100),
        ("22207", 30, 45),
        ("1205/C3", 19, 35),
    ],
)
def test_clearance_of_a_class(designation: str, low: float, high: float) -> None:
    found = catalogue_entry(designation).clearance_range
    assert found is not None
    assert found == pytest.approx((1e-6 * low, 1e-6 * high))


@pytest.mark.parametrize("designation", ["7205 BEP", "30205", "22207 K", "PRONOSTIA"])
def test_clearance_that_the_designation_does_not_state(designation: str) -> None:
    assert catalogue_entry(designation).clearance_range is None


def test_clearance_classes_rise_at_every_bore() -> None:
    for base in BASES:
        if families()[base] not in (*BALLS, "cylindrical", "spherical"):
            continue
        ranges = [geometry(f"{base} {grade}").clearance_range for grade in ("C2", "CN", "C3", "C4", "C5")]
        if any(found is None for found in ranges):
            assert families()[base] == "angular_contact", base
            continue
        for low, high in itertools.pairwise(ranges):
            assert low is not None
            assert high is not None
            assert low[0] < low[1] <= high[1]
            assert low[0] <= high[0]


def test_every_series_has_a_rule() -> None:
    for base in BASES:
        assert series_of(base) in RULES, base


@given(st.floats(5.0, 40.0), st.floats(0.05, 2.0))
def test_probabilities_of_a_count(mean: float, spread: float) -> None:
    counts = count_probabilities(mean, spread)
    assert sum(probability for _, probability in counts) == pytest.approx(1.0)
    assert abs(counts[0][0] - mean) <= 0.5 + 1e-9
    assert [share for _, share in counts] == sorted((share for _, share in counts), reverse=True)


def test_a_rule_scales_with_the_bearing() -> None:
    small, large = estimate("62", 25.0, 52.0, 15.0), estimate("62", 50.0, 104.0, 30.0)
    assert large.counts == small.counts
    assert large.element_diameter == pytest.approx(2.0 * small.element_diameter)

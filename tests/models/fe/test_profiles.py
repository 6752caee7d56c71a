"""Pressure along rollers: the plane value in the middle, a peak at straight ends, Lundberg's even pressure."""

import math
from dataclasses import replace

import numpy as np
import pytest

from models.fe.bearings.profiles import RollerOnRace, lundberg_load, profile_lines, roller_on_race
from models.fe.extra import has_extra
from models.fe.meshes.geometry import fe_geometry
from models.fe.meshes.sizing import MeshRule
from models.fe.solid.elastic import FeError
from models.machine.bearing import catalogue_entry

ENTRY = catalogue_entry("NU 202 ECP")
STRAIGHT = fe_geometry(ENTRY)
CROWNED = fe_geometry(ENTRY, profile="crowned", crown_radius=0.392)
LOGARITHMIC = fe_geometry(ENTRY, profile="logarithmic")
LOAD = 3706.0


@pytest.fixture(scope="module")
def roller() -> RollerOnRace:
    if not has_extra():
        pytest.skip("needs the extra fe (scikit-fem)")
    return roller_on_race(
        STRAIGHT, "inner", LOAD, MeshRule(patch=1.5, size=0.75, growth=4.0, coarse=3.0), end_size=0.02
    )


def test_profile_lines_are_finest_about_the_end_of_the_effective_length() -> None:
    lines = profile_lines(2.8e-3, 3.0e-3)
    assert (lines[0], lines[-1]) == (0.0, pytest.approx(3.0e-3))
    sizes, k = np.diff(lines), int(np.argmin(np.abs(lines - 2.8e-3)))
    assert lines[k] == pytest.approx(2.8e-3)
    assert max(sizes[k - 1], sizes[k]) < 1.4 * sizes.min() < 0.02e-3
    assert np.all(np.diff(sizes[:k]) <= 1e-12)
    assert profile_lines(3e-3, 3e-3)[-1] == pytest.approx(3e-3)


def test_straight_roller_has_the_plane_pressure_in_the_middle_and_a_peak_at_its_end(roller: RollerOnRace) -> None:
    found = roller.press(STRAIGHT, LOAD)
    assert found.converged
    assert 2.0 * float(found.line_load @ (found.z1 - found.z0)) == pytest.approx(LOAD)
    assert found.middle == pytest.approx(found.middle_hertz, rel=0.03)
    assert found.peak > 1.8 * found.middle
    assert found.peak_place == pytest.approx(2.8e-3, abs=0.05e-3)
    # The rounded edge lets it reach beyond the effective length, as far as its radius and the overlap allow.
    beyond = math.sqrt(2.0 * 0.2e-3 * found.approach)
    assert 2.8e-3 < 0.5 * found.loaded_length < 2.8e-3 + 1.1 * beyond


def test_logarithmic_roller_is_even_at_its_load_and_humped_below(roller: RollerOnRace) -> None:
    assert lundberg_load(LOGARITHMIC) == pytest.approx(3908.0, rel=1e-3)
    even, low = roller.press(LOGARITHMIC, LOAD), roller.press(LOGARITHMIC, 0.2 * LOAD)
    straight = roller.press(STRAIGHT, LOAD)
    assert even.peak < 1.15 * even.middle
    assert even.unevenness < 0.12
    humps = [state.line_load[0] / state.mean_line_load for state in (straight, even, low)]
    assert humps[0] < 1.0 < humps[1] < 1.12 < humps[2]
    assert even.approach > straight.approach


def test_crowned_roller_is_pressed_on_a_part_of_its_length_that_grows(roller: RollerOnRace) -> None:
    states = [roller.press(CROWNED, load) for load in (300.0, 1000.0, LOAD)]
    lengths = [state.loaded_length for state in states]
    assert lengths[0] < lengths[1] < lengths[2]
    assert states[0].peak_place < 0.5e-3
    assert states[0].middle > 1.3 * states[0].hertz


def test_what_does_not_fit_is_refused(roller: RollerOnRace) -> None:
    with pytest.raises(FeError, match="only profile, edge_radius and effective_length may differ"):
        roller.press(replace(STRAIGHT, element_radius=2.7e-3), LOAD)
    with pytest.raises(FeError, match="wider than the patch"):
        roller.press(STRAIGHT, 20.0 * LOAD)
    with pytest.raises(FeError, match="balls have no profile"):
        roller_on_race(fe_geometry(catalogue_entry("6210")), "inner", 100.0)
    with pytest.raises(FeError, match="expected a logarithmic profile"):
        lundberg_load(CROWNED)

from __future__ import annotations

import json
import math
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.health.size import EdvStatus, level_set
from monitor.health.size.edv import EdvSettings, EdvState, step
from monitor.health.size.level_set import LevelMap, least_volume, step_back
from tests.oracles.edv_oracle import scan_least_volume
from tests.support.effort import effort_count

RADIUS = 0.02291
MICRON = 1e-6


def grid(n: int = 51, m: int = 33) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.radians(np.linspace(0, 50, n)), np.linspace(0, 32 * MICRON, m)


def striped_map(n: int = 51, m: int = 33) -> LevelMap:
    """Grows with depth, hardly with extent, and oscillates along the extent, as the simulated maps do."""
    dphi_d, h_d = grid(n, m)
    stripes = 1 + 0.3 * np.sin(2 * np.pi * np.degrees(dphi_d)[None, :] / 7.6)
    rms = 0.3 + (h_d[:, None] / MICRON) ** 0.6 * (np.degrees(dphi_d)[None, :] + 0.1) ** 0.1 * stripes
    return LevelMap(dphi_d, h_d, rms, RADIUS)


def rising_map() -> LevelMap:
    dphi_d, h_d = grid(11, 9)
    dphi_d = dphi_d + np.radians(2)
    rms = 1 + np.degrees(dphi_d)[None, :] / 50 + 3 * h_d[:, None] / h_d[-1]
    return LevelMap(dphi_d, h_d, rms, RADIUS)


@st.composite
def maps(draw: st.DrawFn, *, monotone: bool, holes: bool = False) -> LevelMap:
    """Small maps on uneven grids; half of them of whole numbers, which have plateaus and levels through corners."""
    n, m = draw(st.integers(2, 6)), draw(st.integers(2, 6))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    whole = draw(st.booleans())
    rms = rng.integers(0, 4, (m, n)).astype(float) if whole else rng.uniform(0, 4, (m, n))
    if monotone:
        rms = np.cumsum(np.cumsum(rms + 1e-3, axis=0), axis=1)
    if holes:
        rms[rng.random((m, n)) < 0.15] = math.nan
        rms[:2, :2] = [[0.0, 1.0], [2.0, 3.0]]
    start = 0.0 if draw(st.booleans()) else 0.05
    dphi_d = start + np.cumsum(rng.uniform(0.01, 0.2, n)) - 0.01
    h_d = (start + np.cumsum(rng.uniform(0.5, 4, m)) - 0.5) * MICRON
    if start == 0.0:
        dphi_d[0] = h_d[0] = 0.0
    return LevelMap(dphi_d, h_d, rms, RADIUS)


def inside(axis: NDArray[np.float64], share: float) -> float:
    return min(float(axis[0] + share * np.ptp(axis)), float(axis[-1]))


def check_against_scan(map_slice: LevelMap, share: float, corner: tuple[float, float]) -> None:
    level = map_slice.rms_min + share * (map_slice.rms_max - map_slice.rms_min)
    dphi_from, h_from = inside(map_slice.dphi_d, corner[0]), inside(map_slice.h_d, corner[1])
    found = least_volume(map_slice, level, dphi_from, h_from)
    with mock.patch.object(level_set, "MAX_SCANNED_CELLS", 0):
        assert least_volume(map_slice, level, dphi_from, h_from) == found
    scanned, slack = scan_least_volume(
        map_slice.dphi_d, map_slice.h_d, map_slice.rms, RADIUS, level, (dphi_from, h_from)
    )
    if found is None:
        assert math.isinf(scanned)
        return
    size = RADIUS * map_slice.dphi_d[-1] * map_slice.h_d[-1]
    assert found.v_eq <= scanned + 1e-12 * size
    assert found.v_eq >= scanned - slack - 1e-12 * size
    assert found.v_eq == pytest.approx(RADIUS * found.dphi_d * found.h_d, rel=1e-15)
    assert dphi_from <= found.dphi_d <= map_slice.dphi_d[-1]
    assert h_from <= found.h_d <= map_slice.h_d[-1]
    if not map_slice.has_holes:
        assert map_slice.value_at(found.dphi_d, found.h_d) == pytest.approx(level, abs=1e-9 * map_slice.rms_max)


shares = st.one_of(st.floats(0, 1), st.sampled_from([0.0, 1 / 3, 0.5, 2 / 3, 1.0]))
corners = st.one_of(st.just((0.0, 0.0)), st.tuples(st.floats(0, 1), st.floats(0, 1)))


@settings(max_examples=effort_count(quick=30, full=3000))
@given(maps(monotone=False), shares, corners)
def test_least_volume_is_that_of_the_scan_on_any_map(
    map_slice: LevelMap, share: float, corner: tuple[float, float]
) -> None:
    check_against_scan(map_slice, share, corner)


@settings(max_examples=effort_count(quick=20, full=2000))
@given(maps(monotone=True), shares, corners)
def test_least_volume_is_that_of_the_scan_on_monotone_maps(
    map_slice: LevelMap, share: float, corner: tuple[float, float]
) -> None:
    check_against_scan(map_slice, share, corner)


@settings(max_examples=effort_count(quick=20, full=2000))
@given(maps(monotone=False, holes=True), shares, corners)
def test_least_volume_is_that_of_the_scan_on_maps_with_holes(
    map_slice: LevelMap, share: float, corner: tuple[float, float]
) -> None:
    check_against_scan(map_slice, share, corner)


@settings(max_examples=effort_count(quick=24, full=600))
@given(maps(monotone=True), st.lists(st.floats(0, 1), min_size=2, max_size=12))
def test_rising_rms_on_a_monotone_map_never_widens_and_never_shrinks(map_slice: LevelMap, shares: list[float]) -> None:
    span = map_slice.rms_max - map_slice.rms_min
    state, before = EdvState(), (0.0, 0.0, 0.0)
    for share in sorted(shares):
        level = map_slice.rms_min + share * span
        state, result = step(state, level, map_slice=map_slice, settings=EdvSettings(smoothing_blocks=1))
        now = (result.dphi_d, result.h_d, result.v_eq)
        assert result.status is EdvStatus.OK
        assert all(b <= n for b, n in zip(before, now, strict=True))
        before = now


@settings(max_examples=effort_count(quick=20, full=1000))
@given(st.integers(0, 2**32 - 1), st.booleans(), shares)
def test_the_shortlist_of_a_large_map_loses_nothing(seed: int, whole: bool, share: float) -> None:
    rng = np.random.default_rng(seed)
    dphi_d, h_d = grid()
    rms = rng.uniform(0, 4, (33, 51)) if not whole else rng.integers(0, 4, (33, 51)).astype(float)
    rms += np.linspace(0, 10, 33)[:, None] * rng.integers(0, 2)
    map_slice = LevelMap(dphi_d, h_d, rms, RADIUS)
    level = map_slice.rms_min + share * (map_slice.rms_max - map_slice.rms_min)
    short = least_volume(map_slice, level, 0.0, 0.0)
    with mock.patch.object(level_set, "MAX_SCANNED_CELLS", 10_000):
        assert least_volume(map_slice, level, 0.0, 0.0) == short


def widen_slowly(map_slice: LevelMap, level: float, dphi_from: float, h_from: float) -> tuple[int, float]:
    for count in range(1, map_slice.dphi_d.size + map_slice.h_d.size):
        back = step_back(map_slice.dphi_d, dphi_from, count), step_back(map_slice.h_d, h_from, count)
        point = least_volume(map_slice, level, *back)
        if point is not None:
            return count, point.v_eq
    return 0, math.nan


@settings(max_examples=effort_count(quick=30, full=2000))
@given(maps(monotone=False), shares, corners)
def test_widening_goes_back_one_grid_step_at_a_time_and_no_further(
    map_slice: LevelMap, share: float, corner: tuple[float, float]
) -> None:
    level = map_slice.rms_min + share * (map_slice.rms_max - map_slice.rms_min)
    dphi_from, h_from = inside(map_slice.dphi_d, corner[0]), inside(map_slice.h_d, corner[1])
    state = EdvState(dphi_d=dphi_from, h_d=h_from)
    after, result = step(state, level, map_slice=map_slice)
    if result.status is EdvStatus.OK:
        assert least_volume(map_slice, level, dphi_from, h_from) is not None
        return
    assert result.status is EdvStatus.WIDENED
    count, v_eq = widen_slowly(map_slice, level, dphi_from, h_from)
    assert count >= 1
    assert result.v_eq == v_eq
    assert (after.dphi_d, after.h_d) == (result.dphi_d, result.h_d)


@settings(max_examples=effort_count(quick=20, full=1000))
@given(st.floats(0.05, 5), st.floats(0.05, 5), st.floats(0.01, 0.98))
def test_a_minimum_inside_the_cell_is_the_one_of_calculus(x0: float, y0: float, level: float) -> None:
    """X = u v on a cell from (x0, y0): the volume (x0 + u)(y0 + X/u) is least at u = sqrt(x0 X / y0)."""
    map_slice = LevelMap(np.array([x0, x0 + 1]), np.array([y0, y0 + 1]), np.array([[0.0, 0.0], [0.0, 1.0]]), 1.0)
    point = least_volume(map_slice, level, x0, y0)
    assert point is not None
    u = min(max(math.sqrt(x0 * level / y0), level), 1.0)
    assert point.v_eq == pytest.approx((x0 + u) * (y0 + level / u), rel=1e-12)
    assert point.dphi_d == pytest.approx(x0 + u, rel=1e-6)


def test_constant_rms_stays_where_it_is() -> None:
    map_slice = striped_map()
    state, points = EdvState(), set()
    for _ in range(50):
        state, result = step(state, 4.1, map_slice=map_slice)
        assert result.status is EdvStatus.OK
        points.add((result.dphi_d, result.h_d))
    assert len(points) == 1


def test_the_mean_is_trailing_and_begins_with_what_there_is() -> None:
    map_slice = rising_map()
    values = [1.5, 1.6, 1.4, 1.9, 2.0, 2.1, 2.4, 2.2]
    state = EdvState()
    for k, value in enumerate(values):
        state, result = step(state, value, map_slice=map_slice)
        assert result.rms_smoothed == pytest.approx(np.mean(values[max(0, k - 5) : k + 1]), rel=1e-15)
    assert state.window == tuple(values[-6:])


def test_falling_rms_widens_and_may_lower_the_volume() -> None:
    map_slice = rising_map()
    settings_ = EdvSettings(smoothing_blocks=1)
    state, high = step(EdvState(), 3.0, map_slice=map_slice, settings=settings_)
    state, low = step(state, 2.0, map_slice=map_slice, settings=settings_)
    assert low.status is EdvStatus.WIDENED
    assert low.v_eq < high.v_eq


@pytest.mark.parametrize(("rms", "status"), [(0.5, EdvStatus.BELOW_MAP), (6.0, EdvStatus.ABOVE_MAP)])
def test_outside_the_map_nothing_moves_and_tracking_resumes(rms: float, status: EdvStatus) -> None:
    map_slice = rising_map()
    settings_ = EdvSettings(smoothing_blocks=1)
    before, _ = step(EdvState(), 2.0, map_slice=map_slice, settings=settings_)
    after, result = step(before, rms, map_slice=map_slice, settings=settings_)
    assert result.status is status
    assert math.isnan(result.v_eq)
    assert (after.dphi_d, after.h_d) == (before.dphi_d, before.h_d)
    _, resumed = step(after, 2.1, map_slice=map_slice, settings=settings_)
    assert resumed.status is EdvStatus.OK


def test_stop_rule_of_the_thesis_ends_the_tracking_for_good() -> None:
    map_slice = rising_map()
    settings_ = EdvSettings(smoothing_blocks=1, stop_outside_map=True)
    state, _ = step(EdvState(), 6.0, map_slice=map_slice, settings=settings_)
    state, result = step(state, 2.0, map_slice=map_slice, settings=settings_)
    assert result.status is EdvStatus.ABOVE_MAP
    assert EdvState.from_dict(json.loads(json.dumps(state.to_dict()))) == state


@pytest.mark.parametrize("rms", [math.nan, math.inf, -1.0])
def test_an_impossible_rms_is_a_bad_block(rms: float) -> None:
    state, result = step(EdvState(), rms, map_slice=rising_map())
    assert state == EdvState()
    assert result.status is EdvStatus.BAD_BLOCK


def test_without_a_map_the_answer_is_no_map() -> None:
    state, result = step(EdvState(), 1.0, map_slice=None)
    assert state == EdvState()
    assert result.status is EdvStatus.NO_MAP


def test_a_level_swallowed_by_a_hole_is_no_map() -> None:
    dphi_d, h_d = grid(5, 2)
    row = np.array([1.0, 2.0, math.nan, 5.0, 6.0])
    map_slice = LevelMap(dphi_d, h_d, np.array([row, row]), RADIUS)
    _, result = step(EdvState(), 3.5, map_slice=map_slice)
    assert result.status is EdvStatus.NO_MAP


def test_a_map_that_is_not_zero_at_no_depth_answers_with_no_volume_at_the_least_advance() -> None:
    """The weakness of the method on rough maps: a wide defect of no depth has the least volume of all."""
    dphi_d, h_d = grid(11, 9)
    rms = 1 + 0.5 * np.sin(np.linspace(0, 9, 11))[None, :] + 2 * h_d[:, None] / h_d[-1]
    result = step(EdvState(), 1.3, map_slice=LevelMap(dphi_d, h_d, rms, RADIUS))[1]
    row = rms[0] - 1.3
    first = int(np.flatnonzero(row[:-1] * row[1:] < 0)[0])
    assert result.v_eq == 0.0
    assert dphi_d[first] <= result.dphi_d <= dphi_d[first + 1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dphi_d": [0.0, 0.0]}, "dphi_d must ascend"),
        ({"h_d": [-1.0, 1.0]}, "h_d must ascend"),
        ({"h_d": [0.0, math.nan]}, "h_d must be two or more finite"),
        ({"rms": [[1.0, 2.0]]}, "rms must have shape"),
        ({"rms": [[1.0, math.inf], [1.0, 2.0]]}, "infinite"),
        ({"rms": [[1.0, math.nan], [1.0, 2.0]]}, "no cell"),
        ({"part_radius": 0.0}, "part_radius"),
    ],
)
def test_what_is_not_a_map_is_refused(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {"dphi_d": [0.0, 1.0], "h_d": [0.0, 1.0], "rms": [[0.0, 1.0], [2.0, 3.0]]}
    parts = {"part_radius": RADIUS, **good, **change}
    with pytest.raises(ValueError, match=message):
        LevelMap(**parts)  # pyright: ignore[reportArgumentType] - wrong values are what is tested


def test_a_mean_over_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="smoothing_blocks"):
        EdvSettings(smoothing_blocks=0)

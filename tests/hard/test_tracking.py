"""Histories and maps that trackers and forecasts were not made for: every answer has a status and a meaning."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from monitor.health.schema import EDV_STATUSES, TT_STATUSES
from monitor.health.size import Damage, DamageInput, EdvStatus, Remaining
from monitor.health.size.filter.particle_filter import FilterSettings
from monitor.health.size.library.fit import FitSettings, fit_library
from monitor.health.size.library.forecaster import LibrarySettings
from monitor.health.size.library.model import Library
from monitor.health.tracker import (
    DamageGate,
    DamageSettings,
    DamageState,
    PartMap,
    TrackMethod,
    step,
)
from tests.oracles.toy_lives import INTERVAL, RADIUS, THRESHOLD, toy_lives
from tests.support.effort import effort_count
from tests.support.tracking import LOAD, METHODS, SPEED, Array, Map, growing, plain_map, settings_of

WITH_VALUE = {"ok", "widened", "ambiguous"}


@pytest.fixture(scope="module")
def library() -> Library:
    settings = FitSettings(columns=effort_count(quick=60, full=FitSettings().columns))
    lives = toy_lives(60)
    return fit_library(
        lives, thresholds=(THRESHOLD,), interval=INTERVAL, prior="toy lives", made_of={}, settings=settings
    )


def with_plateau() -> Map:
    """No louder between two depths, whatever the extent."""
    plain = plain_map()
    rms = plain.rms.copy()
    rms[8:14] = np.maximum(rms[8], 1e-9)
    return replace(plain, rms=rms)


def not_zero_at_no_depth() -> Map:
    """As loud at no depth as a real defect, and louder the wider: volumes of zero explain an RMS."""
    plain = plain_map()
    return replace(plain, rms=plain.rms + 2.0 + 2.0 * plain.axes[0][None, :])


def with_hole() -> Map:
    plain = plain_map()
    rms, lines = plain.rms.copy(), plain.lines.copy()
    rms[5:12, 4:20], lines[5:12, 4:20] = math.nan, math.nan
    return replace(plain, rms=rms, lines=lines)


Said = tuple[list[Damage], list[Remaining], DamageState]


def follow(
    times: Array,
    rms: Array,
    lines: Array,
    settings: DamageSettings,
    state: DamageState | None = None,
    *,
    through_json: bool = False,
) -> Said:
    state, damages, forecasts = state or DamageState(), [], []
    for t, level, harmonics in zip(times.tolist(), rms.tolist(), lines.tolist(), strict=True):
        if through_json:
            state = DamageState.from_dict(json.loads(json.dumps(state.to_dict(), allow_nan=False)))
        reading = DamageInput(t, level, tuple(harmonics), LOAD, SPEED)
        state, damage, (forecast,) = step(state, reading, DamageGate(), settings)
        damages.append(damage)
        forecasts.append(forecast)
    return damages, forecasts, state


def check(damages: Sequence[Damage], forecasts: Sequence[Remaining]) -> None:
    """Every value has a status, every status its value, and every interval holds its middle."""
    for damage in damages:
        assert damage.status in EDV_STATUSES
        assert math.isfinite(damage.v_eq) == (damage.status in WITH_VALUE)
        if math.isfinite(damage.v_eq_lower):
            assert 0.0 <= damage.v_eq_lower <= damage.v_eq <= damage.v_eq_upper < math.inf
    for forecast in forecasts:
        assert forecast.status in TT_STATUSES
        if forecast.status in ("ok", "already_crossed"):
            assert 0.0 <= forecast.tt < math.inf
        elif forecast.status != "beyond_horizon":
            assert math.isnan(forecast.tt)
        if math.isfinite(forecast.tt_lower):
            assert 0.0 <= forecast.tt_lower <= forecast.tt <= forecast.tt_upper


def falling(rms: Array, lines: Array) -> tuple[Array, Array]:
    """Grows for two thirds of the history, then seems to heal."""
    places = np.concatenate((np.arange(40), np.arange(39, 19, -1)))
    return rms[places], lines[places]


def constant(rms: Array, lines: Array) -> tuple[Array, Array]:
    return np.full_like(rms, rms[20]), np.repeat(lines[20:21], len(lines), axis=0)


def step_beyond(rms: Array, lines: Array) -> tuple[Array, Array]:
    factor = np.where((np.arange(rms.size) >= 40) & (np.arange(rms.size) < 50), 50.0, 1.0)
    return rms * factor, lines * factor[:, None]


def outlier(rms: Array, lines: Array) -> tuple[Array, Array]:
    factor = np.where(np.arange(rms.size) == 30, 2.0, 1.0)
    return rms * factor, lines * factor[:, None]


def silent(rms: Array, lines: Array) -> tuple[Array, Array]:
    quiet = np.where(np.arange(rms.size) % 7 == 3, 0.0, 1.0)
    return rms * quiet, lines * quiet[:, None]


HISTORIES: dict[str, Callable[[Array, Array], tuple[Array, Array]]] = {
    "falling": falling,
    "constant": constant,
    "a step beyond the map": step_beyond,
    "one outlier": outlier,
    "silent blocks": silent,
}
MAPS = {
    "plain": plain_map,
    "plateau": with_plateau,
    "not zero at no depth": not_zero_at_no_depth,
    "hole": with_hole,
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("history", HISTORIES)
def test_hard_histories_are_answered_with_statuses(method: TrackMethod, history: str, library: Library) -> None:
    times, rms, lines = growing()
    settings = settings_of(method, plain_map(), library)
    damages, forecasts, _ = follow(times, *HISTORIES[history](rms, lines), settings)
    check(damages, forecasts)
    assert sum(damage.status in WITH_VALUE for damage in damages) > 30


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("made", MAPS)
def test_hard_maps_are_answered_with_statuses(method: TrackMethod, made: str, library: Library) -> None:
    damages, forecasts, _ = follow(*growing(), settings_of(method, MAPS[made](), library))
    check(damages, forecasts)


@pytest.mark.parametrize("method", METHODS)
def test_states_written_as_json_after_every_block_change_nothing(method: TrackMethod, library: Library) -> None:
    settings = settings_of(method, plain_map(), library)
    whole, parts = follow(*growing(), settings), follow(*growing(), settings, through_json=True)
    assert repr(whole[:2]) == repr(parts[:2])


@pytest.mark.parametrize("method", METHODS)
def test_times_may_be_irregular_and_repeat(method: TrackMethod, library: Library) -> None:
    times, rms, lines = growing()
    rng = np.random.default_rng(5)
    uneven = np.sort(times * rng.uniform(0.5, 1.5, times.size))
    uneven[10:14] = uneven[10]
    damages, forecasts, _ = follow(uneven, rms, lines, settings_of(method, plain_map(), library))
    check(damages, forecasts)
    assert damages[-1].status in WITH_VALUE


@pytest.mark.parametrize("method", METHODS)
def test_ten_points_are_enough_for_an_answer(method: TrackMethod, library: Library) -> None:
    times, rms, lines = growing(60)
    settings = settings_of(method, plain_map(), library)
    damages, forecasts, _ = follow(times[:10], rms[:10], lines[:10], settings)
    check(damages, forecasts)
    assert forecasts[1].status == "too_few_points"
    assert damages[-1].status in WITH_VALUE


@pytest.mark.parametrize(
    ("method", "quick"), [("thesis", 2_000), ("filter", 200), ("library", 500)], ids=lambda value: str(value)
)
def test_a_hundred_thousand_points_take_no_more_memory_than_a_few(
    method: TrackMethod, quick: int, library: Library
) -> None:
    """The filter and the library take milliseconds a block: the full count is for full effort."""
    count = effort_count(quick=quick, full=100_000)
    times, rms, lines = growing(count)
    settings = settings_of(method, plain_map(), library)
    times = times * (60.0 / count)
    first, second = slice(count // 2), slice(count // 2, None)
    *_, middle = follow(times[first], rms[first], lines[first], settings)
    damages, forecasts, end = follow(times[second], rms[second], lines[second], settings, middle)
    check(damages, forecasts)
    sizes = [len(json.dumps(state.to_dict())) for state in (middle, end)]
    # Numbers have more or fewer digits, and a crossing is remembered; nothing else is added.
    assert sizes[1] <= 1.05 * sizes[0] + 400


def test_a_falling_rms_heals_nothing_in_the_thesis(library: Library) -> None:
    """The ratchet forbids it; where nothing is left the search goes back, and says so."""
    times, rms, lines = growing()
    damages, _, _ = follow(times, *falling(rms, lines), settings_of("thesis", plain_map(), library))
    assert {damage.status for damage in damages[1:]} <= {"ok", "widened"}
    for before, after in itertools.pairwise(damages):
        assert after.v_eq >= before.v_eq * (1.0 - 1e-12) or after.status == "widened"
    assert damages[-1].status == "widened"


@pytest.mark.parametrize("method", ["filter", "library"])
def test_a_falling_rms_does_not_undo_the_damage_in_filter_and_library(method: TrackMethod, library: Library) -> None:
    """Their V_eq is an estimate without a ratchet and may fall, but not to where it was on the way up."""
    times, rms, lines = growing()
    rms, lines = falling(rms, lines)
    assert rms[-1] == rms[20]
    damages, _, _ = follow(times, rms, lines, settings_of(method, plain_map(), library))
    assert damages[-1].v_eq > 1.2 * damages[20].v_eq


def test_a_constant_rms_is_a_constant_volume_and_no_crossing_in_the_thesis(library: Library) -> None:
    times, rms, lines = growing()
    damages, forecasts, _ = follow(times, *constant(rms, lines), settings_of("thesis", plain_map(), library))
    assert [damage.v_eq for damage in damages] == pytest.approx([damages[0].v_eq] * len(damages), rel=1e-9)
    assert forecasts[-1].status in ("no_crossing", "concave", "beyond_horizon")


@pytest.mark.parametrize(
    ("method", "status"), [("thesis", "above_map"), ("filter", "above_map"), ("library", "implausible")]
)
def test_a_step_beyond_the_map_says_so_and_is_left_behind(method: TrackMethod, status: str, library: Library) -> None:
    times, rms, lines = growing()
    damages, _, _ = follow(times, *step_beyond(rms, lines), settings_of(method, plain_map(), library))
    assert {damage.status for damage in damages[40:50]} == {status}
    assert damages[-1].status in WITH_VALUE


@pytest.mark.parametrize(("method", "factor"), [("filter", 1.5), ("library", 1.5)])
def test_one_outlier_is_forgotten_by_filter_and_library(method: TrackMethod, factor: float, library: Library) -> None:
    times, rms, lines = growing()
    settings = settings_of(method, plain_map(), library)
    clean, _, _ = follow(times, rms, lines, settings)
    hit, _, _ = follow(times, *outlier(rms, lines), settings)
    for before, after in zip(clean[45:55], hit[45:55], strict=True):
        assert 1.0 / factor < after.v_eq / before.v_eq < factor


def test_one_outlier_stays_in_the_thesis_for_good(library: Library) -> None:
    """What the ratchet costs: the mean of six blocks carries the outlier into V_eq, and V_eq never gives it back."""
    times, rms, lines = growing()
    settings = settings_of("thesis", plain_map(), library)
    clean, _, _ = follow(times, rms, lines, settings)
    hit, _, _ = follow(times, *outlier(rms, lines), settings)
    assert hit[30].v_eq > clean[30].v_eq
    assert all(
        after.v_eq >= before.v_eq * (1.0 - 1e-12) or after.status == "widened"
        for before, after in zip(clean[30:], hit[30:], strict=True)
    )


def test_on_a_map_that_is_not_zero_at_no_depth_the_thesis_finds_no_volume(library: Library) -> None:
    """The least volume that explains a little RMS is none at all, on a wide defect without depth."""
    times, _, lines = growing()
    quiet = np.linspace(2.1, 3.5, times.size)
    damages, forecasts, _ = follow(times, quiet, lines, settings_of("thesis", not_zero_at_no_depth(), library))
    check(damages, forecasts)
    assert all(damage.v_eq == 0.0 for damage in damages)
    assert damages[-1].dphi_d > math.radians(20.0)


def test_a_map_with_a_hole_is_crossed_or_refused(library: Library) -> None:
    damages, _, _ = follow(*growing(), settings_of("thesis", with_hole(), library))
    assert {damage.status for damage in damages} <= {"ok", "widened", "no_map"}


@pytest.mark.parametrize("method", METHODS)
def test_conditions_without_a_map_or_lives_keep_the_block_out(method: TrackMethod, library: Library) -> None:
    times, rms, lines = growing()
    settings = replace(
        settings_of(method, plain_map(), library),
        maps={
            "outer": PartMap(
                lambda load, speed: (None, EdvStatus.OUTSIDE_CONDITIONS),
                lambda load, speed: (None, EdvStatus.OUTSIDE_CONDITIONS),
                FilterSettings(part_radius=RADIUS, particles=200),
            )
        },
    )
    reading = DamageInput(times[0], rms[0], tuple(lines[0]), 9000.0, SPEED)
    state, damage, forecasts = step(DamageState(), reading, DamageGate(), settings)
    check([damage], forecasts)
    assert damage.status == "outside_conditions"
    assert (state.edv.dphi_d, state.filter.count, state.library.history) == (None, 0, None)


@pytest.mark.parametrize("method", ["filter", "library"])
def test_features_configured_anew_begin_a_new_history_and_break_nothing(method: TrackMethod, library: Library) -> None:
    times, rms, lines = growing()
    settings = settings_of(method, plain_map(), library)
    fewer = replace(
        settings,
        maps={
            "outer": replace(settings.maps["outer"], filter=FilterSettings(part_radius=RADIUS, particles=200, lines=0))
        },
        library_settings=LibrarySettings(features="rms"),
    )
    *_, state = follow(times[:30], rms[:30], lines[:30], settings)
    damages, forecasts, _ = follow(times[30:], rms[30:], lines[30:], fewer, state)
    check(damages, forecasts)
    alone, _, _ = follow(times[30:], rms[30:], lines[30:], fewer)
    assert [damage.v_eq for damage in damages] == pytest.approx([damage.v_eq for damage in alone], nan_ok=True)

"""What the physical tracker does with the spread of a map over uncertain rigs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from monitor.health.size import Damage, DamageInput
from monitor.health.size.filter.prior import ErrorModel, build_lookup
from tests.support.filter import SETTINGS, TOY, follow, toy_life, toy_map

ERRORS = ErrorModel()


def rms_spread(common: float = 0.0, rig: float = 0.0, floors: float = 0.0) -> tuple[float, np.ndarray]:
    """Return the standard deviation of the gain of the RMS, and that of the rest at each depth, at one extent."""
    plain = toy_map(spread=floors)
    shared = np.array([common, *[0.0] * 6])
    lookup = build_lookup(replace(plain, rms_rig_std=rig * plain.rms, rig_common=shared), ERRORS, 1)
    assert lookup is not None
    spread = lookup.table[:, 2].reshape(plain.h_d.size, plain.dphi_d.size)
    return float(lookup.gains[0]), spread[:, 40]


def test_the_spread_that_all_nodes_share_is_a_gain_and_the_rest_is_not() -> None:
    gain, rest = rms_spread(rig=0.5, floors=0.2)
    assert gain == ERRORS.rms_gain_sd
    assert rest[9] == pytest.approx(math.sqrt(math.log1p(0.5**2 + 0.2**2)))
    gain, rest = rms_spread(common=0.4, rig=0.5, floors=0.2)
    assert gain == pytest.approx(math.hypot(ERRORS.rms_gain_sd, 0.4))
    assert rest[9] == pytest.approx(math.sqrt(math.log1p(0.3**2 + 0.2**2)))
    # No rest is left where nodes differ by less than what they share.
    assert rms_spread(common=0.6, rig=0.5, floors=0.2)[1][9] == pytest.approx(math.sqrt(math.log1p(0.2**2)))


def test_rigs_drawn_over_one_floor_do_not_hide_that_floors_differ() -> None:
    _, rest = rms_spread(rig=0.12)
    # At 9 um floors alone spread the RMS by 8 %, at 2 um by 25 %.
    assert rest[9] == pytest.approx(math.sqrt(math.log1p(0.12**2 + math.expm1(0.08**2))))
    assert rest[2] > 0.25
    # A map of several floors has their spread.
    assert rms_spread(rig=0.12, floors=0.15)[1][2] == pytest.approx(math.sqrt(math.log1p(0.12**2 + 0.15**2)))


def widths(results: list[Damage]) -> float:
    """Return the median width of the interval of ln V_eq over the second half."""
    return float(np.median([math.log(r.v_eq_upper / r.v_eq_lower) for r in results[len(results) // 2 :]]))


def inside(results: list[Damage], v: np.ndarray) -> float:
    """Return the share of the blocks of the second half whose interval holds the truth."""
    half = len(results) // 2
    held = [r.v_eq_lower <= x <= r.v_eq_upper for r, x in zip(results[half:], v[half:], strict=True)]
    return float(np.mean(held))


def test_a_rig_that_is_off_everywhere_widens_the_interval_until_it_holds_the_truth() -> None:
    inputs, v = toy_life()
    # All that the machine shows is 1.7 times what the map says, beside the gain of the sensor.
    off = [
        DamageInput(one.time, 1.7 * one.rms, tuple(1.7 * line for line in one.harmonics or ()), one.load, one.speed)
        for one in inputs
    ]
    found = {
        common: follow(off, SETTINGS, replace(TOY, rig_common=np.full(7, common)))[1] for common in (0.0, 0.2, 0.5)
    }
    assert widths(found[0.0]) < widths(found[0.2]) < widths(found[0.5])
    assert inside(found[0.0], v) < inside(found[0.5], v)
    assert inside(found[0.5], v) > 0.8

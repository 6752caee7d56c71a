"""Spectral coherence over orders: closed forms, the averaged cyclic periodogram, and what is refused."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.machine.bearing import from_catalogue
from monitor.health.signal.cyclic import CyclicCoherence, cyclic_coherence, cyclic_study, known_rotation
from monitor.health.signal.rotation.rotation import Rotation, constant
from tests.support.cyclic import DEPTH, DURATION, ORDER, RATE, hunting, modulated


@cache
def found() -> CyclicCoherence:
    return cyclic_coherence(modulated(hunting()), RATE, 20.0, hunting())


def near(coherence: CyclicCoherence, order: float) -> float:
    """Return the highest mean coherence within half a step of what a block resolves."""
    step = 2.0 * (coherence.cyclic[1] - coherence.cyclic[0])
    return float(coherence.enhanced[np.abs(coherence.cyclic - order) <= step].max())


def test_modulated_noise_has_the_coherence_of_its_depth() -> None:
    """E[x(t)^2] = 1 + m^2/2 + 2 m cos + (m^2/2) cos 2: coherence m and m^2/4 over 1 + m^2/2, at all frequencies."""
    level = 1.0 + DEPTH**2 / 2.0
    assert near(found(), ORDER) == pytest.approx((DEPTH / level) ** 2, rel=0.1)
    assert near(found(), 2.0 * ORDER) == pytest.approx((0.25 * DEPTH**2 / level) ** 2, rel=0.35)
    middle = found().coherence[10:-10, np.argmin(np.abs(found().cyclic - ORDER))]
    assert np.std(middle) < 0.4 * np.mean(middle)


def test_nothing_else_stands_above_the_limit_and_over_time_all_is_blurred() -> None:
    resolved = 2.0 * (found().cyclic[1] - found().cyclic[0])
    away = np.all([np.abs(found().cyclic - k * ORDER) > 4.0 * resolved for k in (1, 2)], axis=0)
    assert found().enhanced[away].max() < 1.3 * found().limit
    over_time = cyclic_coherence(modulated(hunting()), RATE, 400.0)
    assert over_time.domain == "hertz"
    assert over_time.enhanced.max() < 0.25 * near(found(), ORDER)


def test_it_is_the_averaged_cyclic_periodogram() -> None:
    """Against windows of the signal and of the signal turned by each cyclic order, at every eighth sample."""
    rotation, x = hunting(), modulated(hunting())
    width = 2 * (found().frequency.size - 1)
    turns = rotation.turns_at(np.arange(x.size) / RATE)
    centre = np.rint(rotation.time_at(np.linspace(0.02, rotation.turned - 0.02, 6000) + turns[0]) * RATE).astype(int)
    places = np.clip(centre - width // 2, 0, x.size - width)[:, None] + np.arange(width)
    window = np.hanning(width + 1)[:-1]
    plain = np.fft.rfft(x[places] * window, axis=1)
    power = np.mean(np.abs(plain) ** 2, axis=0)
    for order in (ORDER, 2.0 * ORDER):
        place = int(np.argmin(np.abs(found().cyclic - order)))
        shifted = np.fft.fft((x * np.exp(2j * np.pi * found().cyclic[place] * turns))[places] * window, axis=1)
        kept = shifted[:, : width // 2 + 1]
        oracle = np.abs(np.mean(plain * np.conj(kept), axis=0)) ** 2 / (power * np.mean(np.abs(kept) ** 2, axis=0))
        inside = slice(4, -4)
        fast = found().coherence[inside, place]
        assert np.mean(fast) == pytest.approx(np.mean(oracle[inside]), rel=0.05)
        assert np.corrcoef(fast, oracle[inside])[0, 1] > 0.9


def test_noise_stays_below_its_limit() -> None:
    exceeded = 0
    for seed in range(4):
        noise = np.random.default_rng([5, seed]).standard_normal(int(RATE * DURATION))
        coherence = cyclic_coherence(noise, RATE, 20.0, hunting())
        exceeded += bool(np.any(coherence.enhanced > coherence.limit))
    assert exceeded <= 1


def test_a_steady_angle_is_time() -> None:
    x = modulated(constant(20.0, DURATION))
    orders = cyclic_coherence(x, RATE, 20.0, constant(20.0, DURATION))
    hertz = cyclic_coherence(x, RATE, 400.0)
    assert np.allclose(20.0 * orders.cyclic, hertz.cyclic)
    assert np.allclose(orders.enhanced, hertz.enhanced, rtol=1e-3, atol=1e-5)


@settings(max_examples=4, deadline=None)
@given(st.floats(-12.0, 12.0), st.integers(0, 1000))
def test_the_unit_does_not_matter_and_values_are_shares(exponent: float, seed: int) -> None:
    x = modulated(hunting(), seed=seed)[: int(2 * RATE)]
    half = Rotation(hunting().time[:401], hunting().turns[:401], hunting().speed[:401], 2.0)
    one, other = (cyclic_coherence(x * unit, RATE, 20.0, half) for unit in (1.0, 10.0**exponent))
    assert np.allclose(one.enhanced, other.enhanced, rtol=1e-3, atol=1e-7)
    assert one.coherence.min() >= 0.0
    assert one.coherence.max() < 1.2


def test_the_values_for_json_keep_the_highest() -> None:
    values = found().to_dict(columns=100, rows=20)
    assert json.loads(json.dumps(values)) == values
    assert np.shape(values["coherence"]) == (20, 100)
    assert np.max(values["coherence"]) == pytest.approx(found().coherence.max(), abs=1e-3)
    assert max(values["enhanced"]) == pytest.approx(found().enhanced.max(), abs=1e-4)


def test_what_is_refused() -> None:
    x = modulated(hunting())
    with pytest.raises(ValueError, match="64 windows"):
        cyclic_coherence(x[:2000], RATE, 400.0)
    with pytest.raises(ValueError, match="constant block"):
        cyclic_coherence(np.ones(x.size), RATE, 400.0)
    with pytest.raises(ValueError, match="highest cyclic frequency"):
        cyclic_coherence(x, RATE, 3000.0)
    with pytest.raises(ValueError, match="holds no frequency"):
        cyclic_coherence(x, RATE, 400.0, band=(5000.0, 6000.0))


def test_lines_of_a_bearing_by_what_is_known_of_the_angle() -> None:
    bearing = from_catalogue("6205")
    x = modulated(hunting(), depth=0.9, order=5.39)
    pulses = hunting().time_at(np.arange(1, int(hunting().turned)))
    lines = cyclic_study(x, RATE, bearing, known_rotation(x, RATE, bearing, pulses=pulses)).lines()
    assert lines["inner"].stands_out
    assert lines["inner"].found == pytest.approx(5.39, abs=0.01)
    assert not lines["outer"].stands_out
    steady = cyclic_study(x, RATE, bearing, known_rotation(x, RATE, bearing, speed=20.0)).lines()
    assert steady["inner"].coherence < 0.3 * lines["inner"].coherence
    with pytest.raises(ValueError, match="not known"):
        known_rotation(x, RATE, bearing)
    with pytest.raises(ValueError, match="cannot_tell"):
        known_rotation(x, RATE, bearing, limits=(15.0, 26.0))
    with pytest.raises(ValueError, match="too_few"):
        known_rotation(x, RATE, bearing, pulses=pulses[:2])

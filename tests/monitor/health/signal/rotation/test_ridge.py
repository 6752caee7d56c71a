"""The angle of the shaft from the vibration itself, and when it is withheld."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from monitor.health.signal.rotation.plane import Plane, best_path
from monitor.health.signal.rotation.ridge import angle_from_vibration
from monitor.health.signal.rotation.rotation import Rotation, constant
from tests.support.ridge import BEARING, DURATION, RATE, shaken, turning

LIMITS = (9.0, 45.0)


def ramp() -> Rotation:
    return turning(np.linspace(10.0, 40.0, 1001))


def hunting(share: float) -> Rotation:
    time = np.linspace(0.0, DURATION, 1001)
    return turning(24.0 * (1.0 + share * np.sin(2.0 * np.pi * 0.4 * time + 0.3)))


def found(signal: NDArray[np.float64], **options: object) -> tuple[Rotation | None, str]:
    return angle_from_vibration(signal, RATE, bearing=BEARING, limits=LIMITS, **options)  # type: ignore[arg-type]


def angle_error(rotation: Rotation, true: Rotation) -> float:
    """Return the standard deviation of the error of the angle without its drift, turns, the last turns left out."""
    time = np.linspace(0.1, DURATION - 0.1, 500)
    error = rotation.turns_at(time) - true.turns_at(time)
    return float(np.std(error - np.polyval(np.polyfit(time, error, 1), time)))


@pytest.mark.parametrize("true", [ramp(), hunting(0.2), hunting(0.017), turning(np.full(3, 21.3))])
def test_the_angle_is_found_and_its_error_is_as_stated(true: Rotation) -> None:
    rotation, status = found(shaken(true))
    assert status == "ok"
    assert rotation is not None
    assert rotation.source == "phase"
    assert angle_error(rotation, true) < min(0.01, 2.0 * rotation.turns_sd)
    assert abs(rotation.mean_speed / true.mean_speed - 1.0) < 3.0 * rotation.speed_sd < 0.01
    assert rotation.duration == DURATION


def test_weak_lines_have_a_larger_uncertainty() -> None:
    clear, _ = found(shaken(hunting(0.05), noise=0.5))
    weak, _ = found(shaken(hunting(0.05), noise=4.0))
    assert clear is not None
    assert weak is not None
    assert weak.turns_sd > 1.5 * clear.turns_sd


def test_unit_does_not_matter() -> None:
    signal = shaken(hunting(0.05))
    one, other = found(signal)[0], found(signal * 2.0**-40)[0]
    assert one is not None
    assert other is not None
    assert np.array_equal(one.turns, other.turns)


def test_orders_of_a_mesh_are_followed() -> None:
    true = hunting(0.05)
    rotation, status = found(shaken(true, (19, 38)), orders=(19.0, 38.0))
    assert status == "ok"
    assert rotation is not None
    assert angle_error(rotation, true) < 0.002
    assert rotation.mean_speed == pytest.approx(true.mean_speed, rel=1e-3)


def test_a_race_without_the_shaft_tells_no_angle() -> None:
    passages = kinematics(BEARING, 1.0).bpfo * np.arange(1, 5)
    assert found(shaken(ramp(), tuple(passages.tolist()), noise=0.3)) == (None, "cannot_tell")


def test_even_orders_alone_may_be_a_faster_shaft() -> None:
    assert found(shaken(hunting(0.05), (2, 4, 6, 8)))[0] is None


def test_noise_tells_no_angle() -> None:
    for seed in range(3):
        assert found(shaken(ramp(), (), seed=seed)) == (None, "cannot_tell")


def test_lines_of_a_supply_are_no_shaft() -> None:
    time = np.arange(int(DURATION * RATE)) / RATE
    hum = sum(np.cos(2.0 * np.pi * 50.0 * order * time + order) for order in range(1, 9))
    assert found(hum + shaken(ramp(), ()))[0] is None


def test_a_shaft_that_is_heard_in_a_part_of_the_block_is_refused() -> None:
    signal = shaken(ramp(), noise=0.0)
    signal[int(0.45 * signal.size) : int(0.7 * signal.size)] = 0.0
    assert found(signal + shaken(ramp(), (), seed=1)) == (None, "cannot_tell")


def test_two_shafts_do_not_pass_for_one() -> None:
    slow, fast = (shaken(constant(speed, DURATION)) for speed in (14.0, 33.0))
    both = np.where(np.arange(slow.size) < 0.5 * slow.size, slow, fast)
    assert found(both) == (None, "cannot_tell")


def test_a_short_or_silent_block() -> None:
    assert found(shaken(ramp())[: int(2.0 * RATE)]) == (None, "too_few")
    assert found(np.zeros(int(DURATION * RATE))) == (None, "cannot_tell")


def test_what_cannot_be_asked() -> None:
    with pytest.raises(ValueError, match="0 < low < high"):
        angle_from_vibration(np.zeros(100), RATE, BEARING, (5.0, 5.0))
    with pytest.raises(ValueError, match="orders must be positive"):
        angle_from_vibration(np.zeros(100), RATE, BEARING, (5.0, 6.0), orders=(0.0, 1.0))


def test_the_path_is_the_best_of_all() -> None:
    """Against all paths of a small plane, at a growth of zero, where a path steps by one speed at most."""
    rng = np.random.default_rng(5)
    score = rng.standard_normal((5, 1, 4)).astype(np.float32)
    log_speed = 0.01 * np.arange(4.0)
    plane = Plane(0.1 * np.arange(5.0), log_speed, np.zeros(1), score)
    best = -np.inf
    for number in range(4**5):
        path = [number // 4**at % 4 for at in range(5)]
        steps = np.abs(np.diff(path))
        if steps.max() <= 1:
            best = max(best, float(sum(score[at, 0, place] for at, place in enumerate(path))) - 0.5 * steps.sum())
    speeds, growth, mean = best_path(plane)
    assert mean * 5 == pytest.approx(best, abs=1e-5)
    assert np.all(growth == 0.0)
    assert np.all(np.isin(speeds, log_speed))


def test_a_constant_speed_is_that_of_the_estimate() -> None:
    from monitor.health.signal.speed import estimate_speed

    signal = shaken(constant(22.0, DURATION))
    rotation, _ = found(signal)
    estimate = estimate_speed(signal, RATE, BEARING, LIMITS)
    assert rotation is not None
    assert abs(rotation.mean_speed - estimate.speed) < 3.0 * (rotation.speed_sd * 22.0 + estimate.sd)

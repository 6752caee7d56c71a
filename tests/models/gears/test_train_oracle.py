"""Trains of gears against an integration body by body, and the order of the scheme."""

from __future__ import annotations

import numpy as np
import pytest

from models.gears.train.kernel import first_crossing
from models.gears.train.motion import TrainMotion, TrainState, simulate_train
from models.gears.train.parts import GearTrain
from tests.oracles.gear_train_oracle import Oracle
from tests.support.gear_train_oracle import coarse, faulty, moving, placed


def two_instants(train: GearTrain, start: TrainState, duration: float, step: float) -> TrainMotion:
    """The motion at the start and after a time."""
    return simulate_train(train, duration=2.0 * duration, rate=1.0 / duration, step=step, settle=0.0, start=start)


@pytest.mark.parametrize(
    ("train", "duration", "accuracy"),
    [(coarse(film=False), 1.2e-3, 1e-7), (coarse(film=True), 1.2e-3, 1e-7), (faulty(), 1.5e-3, 1e-6)],
    ids=["pair", "film", "both flanks"],
)
def test_motion_is_that_of_the_oracle(train: GearTrain, duration: float, accuracy: float) -> None:
    start = moving(train, 0.05)
    found = two_instants(train, start, duration, 2e-6)
    assert found.touches.sum() >= 2
    oracle = Oracle(train).run(placed(train, start.displacement, start.velocity), duration, 1e-8, 1.5e-5)
    ours = placed(train, found.displacement[1], found.velocity[1])
    for part in (0, 1):
        one, other = (z.reshape(-1, 2, 3)[:, part] for z in (ours, oracle))
        np.testing.assert_allclose(one, other, rtol=0.0, atol=accuracy * np.abs(other).max())


def test_both_flanks_are_met_in_what_the_oracle_checks() -> None:
    found = simulate_train(faulty(), duration=0.05, settle=0.05, rate=1e3)
    assert (found.back_contact > 0.0).all()
    assert (found.out_of_contact > 0.1).all()
    assert found.energy_residual() < 1e-4


@pytest.mark.parametrize("film", [False, True])
def test_the_order_of_the_scheme_is_kept_where_flanks_part(film: bool) -> None:
    train = coarse(film=film)
    start, interval = moving(train, 0.05), 1.0 / (90.0 * 37 * 4)

    def after(parts: int) -> np.ndarray:
        motion = two_instants(train, start, 3e-3, 1.0001 * interval / parts)
        assert motion.touches[0] > 5
        return motion.displacement[1]

    reference = after(128)
    errors = [float(np.abs(after(parts) - reference).max()) for parts in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders.min() > 4.5
    assert orders.max() < 5.7


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ((-1.0, 0.0, 1.0, 0.0), 0.5),
        ((-1.0, 0.0, -1.0, 0.0), 2.0),
        # Above zero between two ends that are below.
        ((-0.01, 1.0, -0.01, -1.0), 0.01 / 0.99),
        # On zero at the beginning and on the way down: it rises later.
        ((1e-20, -1.0, 1.0, 3.0), 0.5),
        ((0.0, -1.0, -1.0, -1.0), 2.0),
    ],
)
def test_the_first_rise_above_zero_is_found(ends: tuple[float, float, float, float], expected: float) -> None:
    found = first_crossing(*ends)
    if expected <= 1.0:
        u = found
        a, b, c, d = ends[0], ends[1], ends[2], ends[3]
        value = (1 - u) ** 2 * ((1 + 2 * u) * a + u * b) + u * u * ((3 - 2 * u) * c - (1 - u) * d)
        assert value == pytest.approx(0.0, abs=1e-9)
        assert found == pytest.approx(expected, abs=0.02)
    else:
        assert found == expected

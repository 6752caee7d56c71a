"""Pulses of a block: what is refused, and how they are cut."""

import numpy as np
import pytest

from streams.turns.pulses import Pulses


def test_between_counts_from_its_begin() -> None:
    cut = Pulses(np.array([0.1, 0.5, 1.0, 1.5]), 2).between(0.5, 1.5)
    np.testing.assert_array_equal(cut.times, [0.0, 0.5])
    assert cut.per_revolution == 2


@pytest.mark.parametrize(
    ("times", "per_revolution", "message"),
    [
        ([[0.0]], None, "shape"),
        ([1.0, 0.5], None, "never fall"),
        ([0.0, float("nan")], None, "finite"),
        ([0.0], 0, "1 or more"),
    ],
)
def test_senseless_pulses_are_refused(times: list[float], per_revolution: int | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Pulses(np.array(times), per_revolution)

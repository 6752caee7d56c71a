from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from models.gears.transfer.mode_sets import ModeSet, assurance, paired
from monitor.gears.frf_files import FrfError
from monitor.gears.mode_set_files import read_mode_set
from tests.support.effort import effort_count

HEAD = "frequency_hz,damping_percent,name,real,imag\n"
UNKNOWN = np.array([np.nan, np.nan])


@settings(max_examples=effort_count(quick=25, full=500), deadline=None)
@given(
    arrays(np.float64, (5, 2), elements=st.floats(-10.0, 10.0).filter(lambda x: abs(x) > 1e-3)),
    st.complex_numbers(min_magnitude=0.1, max_magnitude=10.0),
)
def test_assurance_is_between_nought_and_one_and_knows_no_scale(shapes: NDArray[np.float64], factor: complex) -> None:
    found = assurance(shapes, factor * shapes)
    np.testing.assert_allclose(np.diag(found), 1.0)
    assert found.min() >= 0.0
    assert found.max() <= 1.0 + 1e-12
    np.testing.assert_allclose(found, assurance(shapes, shapes), atol=1e-12)


def test_shapes_that_cannot_be_compared_are_named() -> None:
    with pytest.raises(ValueError, match="same places, got 3 and 4"):
        assurance(np.ones((3, 1)), np.ones((4, 1)))
    with pytest.raises(ValueError, match="zero at all places"):
        assurance(np.ones((3, 1)), np.zeros((3, 1)))


def test_modes_are_paired_by_shape_within_a_band_of_frequency() -> None:
    shapes = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
    computed = ModeSet(np.array([100.0, 104.0, 900.0]), ("a.x", "a.y", "b.x"), shapes, np.full(3, np.nan))
    given = ModeSet(np.array([101.0, 300.0]), ("b.x", "a.y"), np.array([[0.0, 1.0], [2j, 0.0]]), UNKNOWN)
    first, second = paired(given, computed)
    assert second is None
    assert first is not None
    # The mode at 100 Hz is nearer but has nothing at these places.
    assert (first.given, first.computed) == (0, 1)
    assert first.assurance == pytest.approx(1.0)
    assert first.difference == pytest.approx(3.0 / 101.0)
    with pytest.raises(ValueError, match=r"not computed at 'a.x'; there are b.x, a.y"):
        paired(computed, given)


def test_a_set_is_read_with_its_damping() -> None:
    text = HEAD + "1221,,p.x,1,0\n1221,,p.y,0,-1\n828,7.6,p.y,3,0\n828,7.6,p.x,2,1\n"
    found = read_mode_set(text.encode(), "ema.csv")
    assert found.frequency.tolist() == [828.0, 1221.0]
    np.testing.assert_array_equal(found.damping, [0.076, np.nan])
    assert found.names == ("p.y", "p.x")
    np.testing.assert_array_equal(found.shapes, [[3.0, -1j], [2.0 + 1j, 1.0]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "ema.csv: expected the columns frequency_hz,.*, found nothing"),
        ("a,b\n", "ema.csv: expected the columns .*, found line 1: a,b"),
        (HEAD, "ema.csv: expected modes, found none"),
        (HEAD + "1,2,p,x,0\n", "ema.csv, line 2: expected a frequency above 0"),
        (HEAD + "-1,2,p,1,0\n", "ema.csv, line 2: expected a frequency above 0"),
        (HEAD + "1,2,,1,0\n", "ema.csv, line 2: expected a frequency above 0"),
        (HEAD + "1,2,p,1,0\n1,2,p,1,0\n", "line 3: the mode at 1 Hz has p twice"),
        (HEAD + "1,2,p,1,0\n1,3,q,1,0\n", "line 3: the mode at 1 Hz has two values of damping"),
        (HEAD + "1,2,p,1,0\n2,3,q,1,0\n", "expected all modes at the same places, p is not in both"),
    ],
)
def test_sets_that_cannot_be_used_are_named(text: str, message: str) -> None:
    with pytest.raises(FrfError, match=message):
        read_mode_set(text.encode(), "ema.csv")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frequency": np.array([2.0, 1.0])}, "frequency must be"),
        ({"names": ("a", "a")}, "names must be given, each once"),
        ({"shapes": np.zeros((3, 2))}, r"shapes must have shape \(names, modes\) = \(2, 2\)"),
        ({"shapes": np.full((2, 2), np.inf)}, "shapes must be finite"),
    ],
)
def test_unusable_fields_are_named(change: dict[str, object], message: str) -> None:
    fields: dict[str, object] = {
        "frequency": np.array([1.0, 2.0]), "names": ("a", "b"), "shapes": np.ones((2, 2)), "damping": UNKNOWN
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        ModeSet(**(fields | change))  # type: ignore[arg-type]

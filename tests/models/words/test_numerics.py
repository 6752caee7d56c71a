"""Numerical methods of the models that are their own, against SciPy's."""

from __future__ import annotations

import scipy.fft
from hypothesis import given
from hypothesis import strategies as st

from models.words.numerics import fast_length


@given(st.integers(1, 2**24))
def test_fast_lengths_are_those_of_scipy(length: int) -> None:
    assert fast_length(length) == scipy.fft.next_fast_len(length, real=True)

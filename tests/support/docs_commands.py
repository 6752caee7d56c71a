"""Makers and checks that tests of docs commands share."""

from __future__ import annotations

import pytest

TOLERANCE = 0.02


def same(shown: str, printed: str) -> bool:
    try:
        return float(shown) == pytest.approx(float(printed), rel=TOLERANCE)
    except ValueError:
        return shown == printed

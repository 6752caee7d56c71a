"""What the demo's forecasts lean on: the growth that its library holds, and that by which its bearing really grows.

Its bearing grows by a quadratic of Table 22 of the thesis; the library has to expect any growth. Here V_eq as it was
tracked is forecast once more, by a library of growth alone that holds quadratics only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from models.lives.growth import GROWTH, TrackingError, grow_lives
from models.lives.population import Population
from monitor.health.size import DamageInput, Remaining

if TYPE_CHECKING:
    from monitor.health.size.library.model import Library

SHIPPED = Path(__file__).with_name("demo_quadratic.npz")
"""The library of quadratic growth (``benchmarks.forecast.demo_libraries`` makes it)."""
LIVES = 300
_COLUMNS = 150
_ERROR = TrackingError(sd=(0.1, 0.4))
QUADRATIC = replace(GROWTH, laws=(("quadratic", 1.0),), durations=Population.durations, v_0=Population.v_0, seed=22)
"""Quadratic growth alone, otherwise as the lives of the demo's library."""


@cache
def quadratic_library() -> Library:
    """Return the library of quadratic growth alone."""
    from monitor.records.library_file import load_library

    return load_library(SHIPPED)


def build_quadratic() -> Library:
    """Fit the library that ships, which takes some seconds."""
    from monitor.health.size.library.fit import FitSettings, fit_library
    from monitor.service.libraries import growth_words

    return fit_library(
        list(grow_lives(QUADRATIC, range(LIVES), _ERROR)),
        thresholds=(QUADRATIC.threshold,),
        interval=QUADRATIC.interval,
        prior=growth_words(QUADRATIC, _ERROR, LIVES),
        made_of={},
        settings=FitSettings(columns=_COLUMNS),
        features=("v_eq",),
    )


def forecast_quadratic(history: Sequence[tuple[int, float, float]]) -> dict[int, Remaining]:
    """Return by block the forecast of V_eq as tracked up to it, known to grow by a quadratic.

    ``history`` has the number of each block, its time in s, and V_eq in m2.
    """
    from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step

    library, state, found = quadratic_library(), LibraryState(), {}
    settings = LibrarySettings(features="v_eq")
    for block, t, v_eq in history:
        state, _, (found[block],) = step(
            state, DamageInput(t, v_eq=v_eq), library, settings, thresholds=library.thresholds
        )
    return found

"""What the demo's forecasts lean on: the growth that its library holds, and that by which its bearing really grows.

Its bearing grows by a quadratic of Table 22 of the thesis; the library has to expect any growth. Here V_eq as it was
tracked is forecast once more, by a library of growth alone that holds quadratics only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from models.lives.growth import GROWTH, TrackingError, grow_lives
from models.lives.population import Population
from monitor.health.damage import DamageInput, Remaining

if TYPE_CHECKING:
    from monitor.health.damage.library.model import Library

LIVES = 300
_COLUMNS = 150
_ERROR = TrackingError(sd=(0.1, 0.4))
QUADRATIC = replace(GROWTH, laws=(("quadratic", 1.0),), durations=Population.durations, v_0=Population.v_0, seed=22)
"""Quadratic growth alone, otherwise as the lives of the demo's library."""


@cache
def quadratic_library() -> Library:
    """Return a library of quadratic growth alone; the fit takes some seconds."""
    from monitor.health.damage.library.fit import FitSettings, fit_library
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
    from monitor.health.damage.library.forecaster import LibrarySettings, LibraryState, step

    library, state, found = quadratic_library(), LibraryState(), {}
    settings = LibrarySettings(features="v_eq")
    for block, t, v_eq in history:
        state, _, (found[block],) = step(
            state, DamageInput(t, v_eq=v_eq), library, settings, thresholds=library.thresholds
        )
    return found

"""``spallwatch forecast`` on a history of V_eq by the library that ships: growth alone, without a rig.

Its lives have no scale of their own: their blocks come at the usual interval of the history, and V_eq is taken as a
share of the threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from statistics import median

from monitor.commands.common import input_errors
from monitor.commands.history_files import Volumes
from monitor.health.damage import DamageInput, Remaining
from monitor.health.damage.library.forecaster import LibrarySettings, LibraryState, step
from monitor.service.libraries import shipped_library


def forecast_shipped(
    history: Volumes, thresholds: Sequence[float], settings: LibrarySettings
) -> list[tuple[Remaining, ...]]:
    """Return the forecasts at each point of a history, one per threshold (m2), from the points up to it.

    Raises:
        ValueError: a volume below zero, named by its row.
    """
    for row, v_eq in enumerate(history.v_eq, 1):
        if v_eq < 0.0:
            raise ValueError(f"row {row}: v_eq must be a volume, got {v_eq * 1e6:g} mm3/mm")
    with input_errors("the library that ships"):
        library = shipped_library()
    gaps = [after - before for before, after in pairwise(history.running) if after > before]
    library = library.at_interval(median(gaps)) if gaps else library
    own = library.thresholds[0]
    columns = []
    for threshold in thresholds:
        state, found = LibraryState(), []
        for t, v_eq in zip(history.running, history.v_eq, strict=True):
            block = DamageInput(t, v_eq=v_eq * own / threshold)
            state, _, (one,) = step(state, block, library, settings, thresholds=(own,))
            found.append(replace(one, threshold=threshold))
        columns.append(found)
    return list(zip(*columns, strict=True))

"""Which lines of the parts stand on one peak, in words."""

from __future__ import annotations

from collections.abc import Mapping

from monitor.health.spectrum.coincidence import shared_lines
from monitor.words.statuses import LINE_NAMES


def shared_words(lines: Mapping[str, float], resolution: float) -> str:
    """Return which lines of the parts stand on one peak, "" for none."""
    groups = [
        " = ".join(f"{order} × {LINE_NAMES[family]}" for family, order in group)
        for group in shared_lines(lines, resolution)
    ]
    return f"One peak each, which counts for neither part alone: {'; '.join(groups)}." if groups else ""

"""Printed figures beside what this program computes."""

from __future__ import annotations

from models.published.chapter_3 import deep_groove, roller
from models.published.figure import DEEP_GROOVE, ROLLER, SELF_ALIGNING, Figure
from models.published.self_aligning import self_aligning


def published_figures(designation: str | None = None) -> list[Figure]:
    """Return the printed static figures of one bearing, or of all three that the thesis treats.

    Of any other bearing than "1205 ETN9", "6210" and "NU 202 ECP" there is none.
    """
    parts = {SELF_ALIGNING: self_aligning, DEEP_GROOVE: deep_groove, ROLLER: roller}
    chosen = parts.values() if designation is None else [parts[designation]] if designation in parts else []
    return [figure for part in chosen for figure in part()]

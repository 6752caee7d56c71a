"""Several runs side by side."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from monitor.report.drawing import Picture
from monitor.report.options import Options
from monitor.report.reading import Run
from monitor.report.run_section import RunPart
from monitor.report.run_tables import milestones
from monitor.report.tables import Table


@dataclass(frozen=True)
class Comparison:
    """What is said of several runs together."""

    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...]


def compare(
    runs: Sequence[Run], parts: Sequence[RunPart], options: Options, numbers: itertools.count[int]
) -> Comparison:
    """Compare."""
    return Comparison((), (milestones(*runs),))

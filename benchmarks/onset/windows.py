"""Where an onset is defensible on each axis of eleven PRONOSTIA runs, and the histories of their features.

The windows were set on the plots of the histories and on the README of the recordings before any rule of
:mod:`monitor.health.onset` that they judge was tuned. Where a level settles higher for most of a life (2_1) only the
last rise counts, so that an onset at the first one is early.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from monitor.health.onset import LINES, DetectInput
from streams.types.block import STANDARD_GRAVITY


@dataclass(frozen=True)
class Window:
    """Where the onset of one axis may be said to begin.

    Attributes:
        run: of the data set, such as "1_1".
        axis: "h" or "v".
        first, last: blocks between which t_fs is defensible.
        known_by: block by which it must be known.
        seen: on what this rests.
    """

    run: str
    axis: str
    first: int
    last: int
    known_by: int
    seen: str

    def judge(self, onset: int | None, known: int | None) -> str:
        """Return what an onset is: defensible, early, late or missed."""
        if onset is None or known is None:
            return "missed"
        if onset < self.first:
            return "early"
        return "defensible" if onset <= self.last and known <= self.known_by else "late"


WINDOWS = (
    Window("1_1", "h", 1130, 2000, 2000, "README: slow growth from about 1350, twice the baseline from 1945"),
    Window("1_1", "v", 1340, 2749, 2766, "README: bursts near 1300 are no failure, twice the baseline from 2749"),
    Window("1_3", "h", 1150, 1750, 1800, "README: from about 1440; the plot rises from 1200"),
    Window("1_3", "v", 1600, 1760, 1800, "README: from about 1710; dense bursts from 1620"),
    Window("1_5", "h", 2380, 2412, 2425, "README: from about 2410; a step at 2412"),
    Window("1_5", "v", 2280, 2412, 2425, "the same; bursts from 2290"),
    Window("1_7", "h", 2100, 2213, 2225, "README: about 2208; a slow rise from 2120, a step at 2212"),
    Window("1_7", "v", 2180, 2213, 2225, "the same; a slow rise from 2190"),
    Window("2_1", "h", 840, 876, 890, "README: settles higher near 164, debatable; a step at 875"),
    Window("2_1", "v", 840, 876, 890, "the same"),
    Window("2_4", "h", 729, 748, 750, "as in reference/recordings.py"),
    Window("2_4", "v", 729, 748, 750, "the same"),
    Window("2_5", "h", 2250, 2306, 2311, "README: begins at twice its later level; rises from 2301"),
    Window("2_5", "v", 2250, 2306, 2311, "dense bursts from 2260, a level from 2301"),
    Window("2_6", "h", 655, 688, 695, "README: 667 to 690; a step at 688"),
    Window("2_6", "v", 650, 688, 695, "the same"),
    Window("2_7", "h", 211, 227, 230, "README: rises at 224 to 226; 230 is the last block"),
    Window("2_7", "v", 211, 227, 230, "the same"),
    Window("3_1", "h", 486, 497, 505, "as in reference/recordings.py"),
    Window("3_1", "v", 486, 497, 505, "the same"),
    Window("3_2", "h", 1425, 1600, 1620, "outer lines rise at 1435, RMS at 1585"),
    Window("3_2", "v", 1425, 1600, 1620, "README: rises from about 1435; falls by 1560, a step at 1585"),
)


def inputs_of(folder: Path, window: Window) -> list[DetectInput]:
    """Return what the detector takes from each block of an axis.

    The histories have the noise floor under the outer race's lines only; it stands for that of the other families too.
    """
    return list(_inputs(folder / "femto_histories" / f"Bearing{window.run}.csv", window.axis))


def _inputs(path: Path, axis: str) -> Iterator[DetectInput]:
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            value = {name: float(text or "nan") for name, text in row.items()}
            floor = value[f"{axis}_outer_floor_g"]
            shown = {name: value[f"{axis}_{name}_g"] for name in LINES}
            yield DetectInput(
                sequence=int(row["block"]),
                time=value["elapsed_s"],
                rms=value[f"{axis}_rms_g"] * STANDARD_GRAVITY,
                prominence={name: total / floor for name, total in shown.items() if total > 0.0},
                peak=value[f"{axis}_peak_g"] * STANDARD_GRAVITY,
            )

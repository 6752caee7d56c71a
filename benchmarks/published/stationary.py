"""The 18 stationary conditions of the thesis (Table 13 x D1 to D3): RMS, peak and A* of each, the spectrum of every
condition as a picture, and what slip does to them. benchmarks.gallery draws the figures of the thesis (Figs. 45 to 51).

python -m benchmarks.published.stationary [--quick] [--json FILE] [--pictures FOLDER]

Defects as seeded: extents of Table 2, deeper than a ball reaches (Eq. 51), in one row; parameters of Tables 14 and 18,
sensor on m_o, no slip except in benchmarks.published.slip. The thesis draws these features (Figs. 45, 46 and 51)
without printing one, so that nothing here is compared with a printed value; what its text says of them in words, and
the resonances that it prints for Fig. 48, are.
``--quick`` leaves out the comparison with finer steps.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from benchmarks.common import Row, print_table, write_json
from benchmarks.published.slip import (
    slip_levels,
    slip_rows,
    slip_spectra,
    slip_spectrum_rows,
    slip_statements,
)
from models.machine.scene import Defect, Scene
from models.published.thesis import EXTENTS_DEG, SEEDED_DEPTH
from models.solve.simulate import simulate
from streams.types.block import STANDARD_GRAVITY

if TYPE_CHECKING:
    from models.solve.response import Response

mpl.use("Agg")

import matplotlib.pyplot as plt

LOADS = (1000.0, 2000.0)
SPEEDS = (20.0, 30.0, 40.0)
BAND = (0.0, 9500.0)
"""What the recordings of the thesis were low-passed to, Hz (section 2.3.1)."""
RESONANCES = (357.1, 1543.8, 7392.6)
"""Printed for Fig. 48, Hz."""
COLORS = {"D1": "#0072b2", "D2": "#b84a00", "D3": "#7b3f72"}
FINE_STEP = 1.25e-6
"""Step of the runs that the RMS is compared with, s."""


@dataclass(frozen=True)
class Condition:
    """One defect at one load and speed, and what it sounds like."""

    defect: str
    load: float
    speed: float
    response: Response
    rms_error: float | None
    peak_error: float | None

    @property
    def rms(self) -> float:
        """RMS within 0 to 9.5 kHz, g."""
        return self.response.rms / STANDARD_GRAVITY

    @property
    def a_star(self) -> float:
        """A* of Eq. 57, g: root of the sum of squares of the amplitudes of the first five lines of BPFO."""
        return float(np.linalg.norm(self.response.harmonics[:5])) / STANDARD_GRAVITY


def scene(defect: str, load: float, speed: float) -> Scene:
    """Return the scene of one condition."""
    return Scene(speed, load, defect=Defect(math.radians(EXTENTS_DEG[defect]), SEEDED_DEPTH))


def conditions(*, compare: bool) -> list[Condition]:
    """Return all 18, with the differences of RMS and peak from those of finer steps where that is asked for."""
    found = []
    for defect in EXTENTS_DEG:
        for load in LOADS:
            for speed in SPEEDS:
                s = scene(defect, load, speed)
                response = simulate(s, band=BAND)
                rms_error = peak_error = None
                if compare:
                    steps = math.ceil(1.0 / (response.bpfo * FINE_STEP))
                    fine = simulate(s, band=BAND, steps_per_period=steps, tolerance=1e-8)
                    rms_error, peak_error = response.rms / fine.rms - 1.0, response.peak / fine.peak - 1.0
                found.append(Condition(defect, load, speed, response, rms_error, peak_error))
    return found


def feature_rows(found: list[Condition]) -> list[Row]:
    """Return RMS, peak and A* of every condition."""
    return [
        {
            "defect": c.defect,
            "load N": c.load,
            "speed Hz": c.speed,
            "BPFO Hz": c.response.bpfo,
            "RMS g": c.rms,
            "peak g": c.response.peak / STANDARD_GRAVITY,
            "A* g": c.a_star,
            "RMS m_r g": c.response.levels_of("mr")[0] / STANDARD_GRAVITY,
            "RMS error": c.rms_error,
            "peak error": c.peak_error,
            "status": c.response.status,
        }
        for c in found
    ]


def resonance_rows(found: list[Condition]) -> list[Row]:
    """Return the largest line near each printed resonance of Fig. 48 (D2, 2000 N, 30 Hz)."""
    [condition] = [c for c in found if (c.defect, c.load, c.speed) == ("D2", 2000.0, 30.0)]
    frequency, amplitude = condition.response.lines()
    bpfo = condition.response.bpfo
    rows: list[Row] = []
    for printed, (low, high) in zip(RESONANCES, ((0.0, 800.0), (800.0, 3000.0), (6000.0, 9000.0)), strict=True):
        inside = np.flatnonzero((frequency >= low) & (frequency <= high))
        top = inside[np.argmax(amplitude[inside])]
        rows.append(
            {
                "printed Hz": printed,
                "zone Hz": f"{low:g} to {high:g}",
                "largest line Hz": float(frequency[top]),
                "amplitude g": float(amplitude[top]) / STANDARD_GRAVITY,
                "lines away": float(frequency[top] - printed) / bpfo,
            }
        )
    return rows


def statement_rows(found: list[Condition]) -> list[Row]:
    """Return what the text says of measured and simulated features, and how many of our conditions do it too."""
    value = {(c.defect, c.load, c.speed): c for c in found}
    defects = tuple(EXTENTS_DEG)

    def count(pairs: list[tuple[float, float]]) -> str:
        return f"{sum(a < b for a, b in pairs)} of {len(pairs)}"

    loads = [(value[d, 1000.0, s], value[d, 2000.0, s]) for d in defects for s in SPEEDS]
    speeds = [(value[d, w, a], value[d, w, b]) for d in defects for w in LOADS for a, b in ((20.0, 30.0), (30.0, 40.0))]
    widths = [(value[a, w, s], value[b, w, s]) for a, b in (("D1", "D2"), ("D2", "D3")) for w in LOADS for s in SPEEDS]
    falls = [(value[d, w, 30.0], value[d, w, 20.0]) for d in ("D1", "D2") for w in LOADS]
    rises = [(value[d, w, 30.0], value[d, w, 40.0]) for d in defects for w in LOADS]
    dips = [(value["D2", w, 30.0], value[d, w, 30.0]) for d in ("D1", "D3") for w in LOADS]
    return [
        {"text": "measured: RMS rises with the load", "here": count([(a.rms, b.rms) for a, b in loads])},
        {"text": "measured: RMS rises with the speed", "here": count([(a.rms, b.rms) for a, b in speeds])},
        {"text": "measured: RMS rises with the width", "here": count([(a.rms, b.rms) for a, b in widths])},
        {
            "text": "measured: A* falls from 20 to 30 Hz (D1, D2)",
            "here": count([(a.a_star, b.a_star) for a, b in falls]),
        },
        {"text": "measured: A* rises from 30 to 40 Hz", "here": count([(a.a_star, b.a_star) for a, b in rises])},
        {
            "text": "simulated: at 30 Hz the RMS of D2 leaves the trend",
            "here": count([(a.rms, b.rms) for a, b in dips]),
        },
    ]


def draw_spectra(found: list[Condition], path: Path) -> None:
    """Draw the lines of every condition (as Fig. 48, which shows one)."""
    figure, axes = plt.subplots(6, 3, figsize=(12, 12), sharex=True, sharey="row", layout="constrained")
    for c, ax in zip(found, axes.flat, strict=True):
        frequency, amplitude = c.response.lines()
        inside = frequency <= BAND[1]
        ax.vlines(frequency[inside], 0.0, amplitude[inside] / STANDARD_GRAVITY, color=COLORS[c.defect], lw=0.9)
        ax.set_title(f"{c.defect}, {c.load:g} N, {c.speed:g} Hz", fontsize=9)
        ax.set_xlim(BAND)
        ax.grid(alpha=0.25)
    for ax in axes[:, 0]:
        ax.set(ylim=(0.0, None), ylabel="[g]")
    for ax in axes[-1]:
        ax.set_xlabel("frequency [Hz], multiples of BPFO")
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main() -> None:
    """Print the tables; write the JSON file and draw the pictures if they were asked for."""
    parser = argparse.ArgumentParser(description="The 18 stationary conditions of the thesis, simulated.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="without the comparison with finer steps")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw the conditions into this folder")
    options = parser.parse_args()
    found = conditions(compare=not options.quick)
    tables = {
        "features": feature_rows(found),
        "lines of Fig. 48": resonance_rows(found),
        "statements of sections 4.3 and 4.4.3": statement_rows(found),
    }
    scenes = {(c.defect, c.load, c.speed): scene(c.defect, c.load, c.speed) for c in found}
    levels = slip_levels(scenes, BAND)
    tables["slip: levels over those without"] = slip_rows(levels)
    tables["slip: statements of section 4.4.5"] = slip_statements(levels)
    spectra = slip_spectra(scenes["D2", 2000.0, 30.0])
    tables["slip: largest lines, D2 at 2000 N and 30 Hz, per passage"] = slip_spectrum_rows(spectra)
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
        draw_spectra(found, options.pictures / "stationary_spectra.png")


if __name__ == "__main__":
    main()

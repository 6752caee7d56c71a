"""Stiffness of the three bearings of the thesis against load, with clearance and without, and what computing it takes.

python -m benchmarks.published.statics [--quick] [--json FILE] [--pictures FOLDER]

Loads of Tables 11 and 12 (Figs. 23, 24 and 28, whose analytical curves are Eq. 19). The passages of Figs. 36 and 37 are
drawn by benchmarks.gallery.
``--quick`` measures the times with fewer repetitions.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from benchmarks.common import Row, calibration_kernel, interleaved_ms, print_table, write_json
from models.machine.bearing import from_catalogue
from models.machine.hertz import bearing_stiffness, contact_exponent, contact_stiffness, static_equilibrium
from models.machine.load_distribution import load_distribution, load_zone, stiffness_over_passage
from models.machine.rig import Rig
from models.machine.scene import Defect
from models.published.thesis import EXTENTS_DEG, SEEDED_DEPTH

if TYPE_CHECKING:
    from models.machine.bearing import Bearing

mpl.use("Agg")

import matplotlib.pyplot as plt

CASES = (
    ("NU 202 ECP", 0.0, (100.0, 500.0, 1000.0, 2500.0, 5000.0, 10000.0)),
    ("NU 202 ECP", 20e-6, (100.0, 500.0, 1000.0, 2500.0, 5000.0, 10000.0)),
    ("6210", 0.0, (500.0, 2500.0, 5000.0, 10000.0, 15000.0, 23000.0)),
    ("6210", 20e-6, (500.0, 2500.0, 5000.0, 10000.0, 15000.0, 23000.0)),
)
COLORS = {1000.0: "#0072b2", 2000.0: "#b84a00"}


def load_rows() -> list[Row]:
    """Return k_yy (Eq. 19) with an element in the load direction and between two, and how the load is shared."""
    rows: list[Row] = []
    for designation, clearance, loads in CASES:
        bearing = from_catalogue(designation)
        k_c = contact_stiffness(bearing)
        for load in loads:
            shared = load_distribution(bearing, load, k_c, clearance=clearance)
            rows.append(
                {
                    "bearing": designation,
                    "clearance um": 1e6 * clearance,
                    "load N": load,
                    "k_yy position 1 MN/m": 1e-6 * _k_yy(bearing, load, k_c, clearance, 0.0),
                    "k_yy position 2 MN/m": 1e-6 * _k_yy(bearing, load, k_c, clearance, math.pi / bearing.n_elements),
                    "displacement um": 1e6 * float(shared.displacement[0]),
                    "load zone deg": math.degrees(load_zone(float(shared.displacement[0]), clearance)),
                    "loaded elements": int(np.sum(shared.loads > 1e-9 * load)),
                    "largest load N": float(shared.loads.max()),
                }
            )
    return rows


def _k_yy(bearing: Bearing, load: float, k_c: float, clearance: float, cage_angle: float) -> float:
    return float(bearing_stiffness(bearing, load, k_c, clearance=clearance, cage_angle=cage_angle)[0, 0])


def time_rows(rounds: int) -> list[Row]:
    """Return the time of an equilibrium and of a passage, with the calibration kernel beside them."""
    bearing, k_c = from_catalogue("1205 ETN9"), Rig().k_c
    angles = load_distribution(bearing, 1000.0, k_c).angles
    defect = Defect(math.radians(EXTENTS_DEG["D3"]), SEEDED_DEPTH)
    times = interleaved_ms(
        {
            "static equilibrium of 24 balls": lambda: static_equilibrium(
                angles, 1000.0, k_c, exponent=contact_exponent(bearing)
            ),
            "passage over D3, 96 cage angles": lambda: stiffness_over_passage(bearing, 1000.0, k_c, defect=defect),
            "calibration FFT": calibration_kernel(),
        },
        rounds,
    )
    return [{"what": name, "ms": value} for name, value in times.items()]


def draw_loads(path: Path) -> None:
    """Draw k_yy against load (as the analytical curves of Figs. 23, 24 and 28)."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for ax, designation in zip(axes, ("NU 202 ECP", "6210"), strict=True):
        for (_, clearance, loads), style in zip([c for c in CASES if c[0] == designation], ("-", "--"), strict=True):
            bearing = from_catalogue(designation)
            k_c, steps = contact_stiffness(bearing), np.geomspace(loads[0], loads[-1], 60)
            for position, (turn, color) in enumerate(((0.0, "#0072b2"), (math.pi / bearing.n_elements, "#b84a00"))):
                values = [1e-6 * _k_yy(bearing, float(load), k_c, clearance, turn) for load in steps]
                label = f"position {position + 1}, h = {1e6 * clearance:g} um"
                ax.plot(1e-3 * steps, values, style, color=color, label=label)
        ax.set(title=designation, xlabel="load [kN]", ylabel="k_yy [MN/m]", ylim=(0, None))
        ax.grid(alpha=0.25)
        ax.legend(fontsize=8)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def main() -> None:
    """Print the tables; write the JSON file and draw the pictures if they were asked for."""
    parser = argparse.ArgumentParser(description="Bearing stiffness against load and while the elements pass.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions of the timings")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw the stiffness into this folder")
    options = parser.parse_args()
    tables = {"radial stiffness": load_rows(), "times": time_rows(3 if options.quick else 7)}
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
        draw_loads(options.pictures / "stiffness_load.png")


if __name__ == "__main__":
    main()

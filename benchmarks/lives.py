"""What a simulated life costs, with and without slip of the balls, and how far its figures are from longer simulations.

Run as ``python -m benchmarks.lives [--quick] [--json FILE]``. Times are thread times, compilation aside. Without slip
the error is that of the steps, against ``models.solve.simulate`` asked for 1e-4; with slip it is that of the short
record (four times seven ball periods), against records ten times as long. Blocks of damage at random places of lives,
no noise.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.lives.life import LifePlan, draw_life, simulate_life
from models.lives.population import Population
from models.machine.scene import Scene, Slip
from models.path.defect import race_radius
from models.solve.simulate import simulate
from models.solve.six_dof.lanes import LaneOptions, LaneRunner
from models.solve.six_dof.rows import settled_levels

BAND = (0.0, 9500.0)
SLIPS = (0.002, 0.005, 0.01)
_LONG = 40
_FINE = 1e-4


def cost_rows(lives: int) -> list[Row]:
    """Return what lives of the default population cost, without slip and with some."""
    rows: list[Row] = []
    for slip in (0.0, 0.005):
        population = replace(Population(), slip=(slip, slip))
        simulate_life(population, lives)
        begin = time.thread_time()
        blocks = [simulate_life(population, number).t.size for number in range(lives)]
        seconds = time.thread_time() - begin
        rows.append(
            {
                "slip_mrad": 1e3 * slip,
                "lives": lives,
                "blocks_per_life": float(np.mean(blocks)),
                "ms_per_block": 1e3 * seconds / sum(blocks),
                "core_s_for_250_lives": 250.0 * seconds / lives,
            }
        )
    return rows


def error_rows(lives: int) -> list[Row]:
    """Return how far the figures of blocks are from those of finer or longer simulations."""
    found = [_against_finer(lives)]
    found += [_against_longer(lives, slip) for slip in SLIPS]
    return found


def _scenes(plan: LifePlan, count: int, slip: Slip | None) -> list[Scene]:
    population = Population()
    t = np.linspace(0.0, plan.path.crossing(population.until), count)
    defects = plan.defects(t, population.threshold, race_radius(population.bearing))
    return [Scene(plan.speed, plan.load, population.bearing, plan.rig, defect, slip=slip) for defect in defects]


def _against_finer(lives: int) -> Row:
    rms, lines = [], []
    for number in range(lives):
        scenes = _scenes(draw_life(Population(), number), 8, None)
        levels, harmonics = settled_levels(scenes, BAND)
        for scene, level, harmonic in zip(scenes, levels, harmonics, strict=True):
            fine = simulate(scene, band=BAND, accuracy=_FINE)
            rms.append(level / fine.rms - 1.0)
            lines.append(harmonic[0] / fine.harmonics[0] - 1.0)
    return _row("finer steps", 0.0, rms, lines)


def _against_longer(lives: int, slip: float) -> Row:
    rms, lines = [], []
    for number in range(lives):
        scenes = _scenes(draw_life(Population(), number), 8, Slip(slip, seed=number))
        levels, harmonics = settled_levels(scenes, BAND)
        longer = LaneRunner(LaneOptions(slip_blocks=_LONG, band=BAND)).run(scenes, number=1)
        rms += (levels / longer.rms - 1.0).tolist()
        lines += (harmonics[:, 0] / longer.harmonics[:, 0] - 1.0).tolist()
    return _row("longer records", slip, rms, lines)


def _row(against: str, slip: float, rms: Sequence[float], lines: Sequence[float]) -> Row:
    return {
        "against": against,
        "slip_mrad": 1e3 * slip,
        "blocks": len(rms),
        "rms_percent": 100.0 * float(np.sqrt(np.mean(np.square(rms)))),
        "rms_most_percent": 100.0 * float(np.max(np.abs(rms))),
        "line_1_percent": 100.0 * float(np.sqrt(np.mean(np.square(lines)))),
    }


def main() -> None:
    """Run the tables and print them, and write them where asked."""
    options = arguments("What a simulated life costs, and how far its figures are from longer simulations.")
    costs, errors = (cost_rows(2), error_rows(1)) if options.quick else (cost_rows(12), error_rows(6))
    print_table("cost", costs)
    print_table("error", errors)
    write_json(options.json, {"cost": costs, "error": errors})


if __name__ == "__main__":
    main()

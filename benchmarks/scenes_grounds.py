"""Two grounds of the choice of a model: what one ball period saves, and why impacts on rings stand for no other model.

Run as ``python -m benchmarks.scenes_grounds [--quick] [--json FILE]``.

1. Balls with inertia over one ball period beside the run over time, both asked for 1 % and 0.1 % of the RMS, with true
   errors against an eighth of the steps over time (training seeds of ``benchmarks.scenes_random``).
2. The level of both models over defects of several depths.
"""

from __future__ import annotations

from dataclasses import replace

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.scenes_random import draw
from benchmarks.scenes_trial import timed, truth_of
from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Scene
from models.solve.ball_inertia import period as ball_period
from models.solve.ball_inertia import solver as ball_inertia
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.simulate import simulate

SEEDS = {"balls": range(40_000, 40_012), "balls, defect": range(40_600, 40_612)}
QUICK = 2
ACCURACIES = (1e-2, 1e-3)
DEPTHS = (2e-6, 20e-6)


def period_rows(count: int | None) -> list[Row]:
    """Return a row for each scene and accuracy."""
    rows: list[Row] = []
    for kind, seeds in SEEDS.items():
        for seed in seeds[:count]:
            drawn = draw(seed, kind)
            plain = replace(drawn.request, quantity="rms")
            truth = truth_of(drawn.scene, plain, ball_inertia.SOLVER)
            for accuracy in ACCURACIES:
                request = replace(plain, accuracy=accuracy)
                ours, spent = timed(lambda scene=drawn.scene, request=request: ball_period.solve(scene, request))
                _, whole = timed(lambda scene=drawn.scene, request=request: ball_inertia.solve(scene, request))
                row: Row = {
                    "kind": kind,
                    "seed": seed,
                    "accuracy": accuracy,
                    "solver": ours.solver,
                    "ms": 1e3 * spent,
                    "over time ms": 1e3 * whole,
                    "RMS error": abs(ours.rms / truth.rms - 1.0),
                    "stated": ours.rms_error,
                }
                rows.append(row)
    return rows


def depth_rows() -> list[Row]:
    """Return the levels, m/s2, of both models over each depth."""
    rows: list[Row] = []
    for rig in (RingImpactRig(), BallInertiaRig(c_ci=500.0, c_co=500.0, defect_shape="half_sine")):
        scene = Scene(30.0, 2000.0, bearing=from_catalogue("6206"), rig=rig)
        levels = {
            f"{1e6 * depth:.0f} um": simulate(
                replace(scene, defect=Defect(0.03, depth)), accuracy=1e-2, duration=0.2, rate=25600.0
            ).rms
            for depth in DEPTHS
        }
        rows.append({"model": rig.model, **levels})
    return rows


def main() -> None:
    """Print and write both."""
    given = arguments(__doc__ or "")
    period, depth = period_rows(QUICK if given.quick else None), depth_rows()
    print_table("One ball period", period)
    print_table("Depth", depth)
    write_json(given.json, {"period": period, "depth": depth})


if __name__ == "__main__":
    main()

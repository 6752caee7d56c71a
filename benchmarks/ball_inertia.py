"""Cost and error of the balls with inertia, against scipy with the same compiled equations.

Run as ``python -m benchmarks.ball_inertia [--quick] [--json FILE]``. Error: RMS of the difference of the ring's path
from that with steps of 0.5 us, over the RMS of its swing, in the first 0.1 s (scipy: of its shorter run). Time:
processor seconds of a simulated second, the least of three. scipy's best is the fastest of its settings whose error is
at most ours; it calls the kernel's compiled equations from Python.
"""

from __future__ import annotations

import time
from typing import Any, cast

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.common import Row, arguments, print_table, write_json
from models.dynamics.ball_inertia import at_rest, prepare_plan
from models.kernels.ball_inertia import Plan, Work, new_work, run, slope_of
from models.kernels.passages import fill_depth
from models.published.marin import INNER, scene_of
from models.scene import Scene

STEPS = (6.25e-6, 5e-6, 2.5e-6)
REFERENCE = 0.5e-6
GRID = 25e-6
SCIPY_SPAN = 0.02
SETTINGS = (("RK45", 1e-4), ("RK45", 1e-6), ("DOP853", 1e-4), ("DOP853", 1e-6), ("LSODA", 1e-4), ("LSODA", 1e-6))
PROTOTYPE = "0.9 to 1.2 (3 balls), 2.0 to 2.3 (9 balls)"


@cast("Any", numba.njit)(cache=False)
def rate(t: float, z: NDArray[np.float64], plan: Plan, work: Work) -> NDArray[np.float64]:
    """Return the time derivative of a state with the kernel's own forces, contacts as they are."""
    i = np.searchsorted(plan.bounds, t, side="right") - 1
    for k in range(2):
        work.turn[0, 2 * k], work.turn[0, 2 * k + 1] = np.cos(t * plan.parameter[k]), np.sin(t * plan.parameter[k])
    fill_depth(t, 0.0, i, plan, work.depth)
    work.closed[:] = 1.0
    slope_of(z, np.int64(0), plan, work, np.int64(0))
    return work.slope[0].copy()


def scenes() -> dict[str, Scene]:
    """Return the scenes."""
    return {f"{n} balls, {w}": scene_of(n, defect=d) for n in (3, 9) for w, d in (("healthy", None), ("inner", INNER))}


def path(scene: Scene, duration: float, step: float) -> tuple[float, NDArray[np.float64]]:
    """Return processor seconds of a simulated second, and the ring's path at multiples of GRID, m."""
    plan, steps = prepare_plan(scene, duration + 1.0), round(duration / step)
    wave, place = np.empty((steps, 1)), np.empty((steps, 2 + plan.slots.shape[1]))
    rest, times = at_rest(scene), list[float]()
    for _ in range(3):
        begin = time.process_time()
        run(rest.copy(), wave, np.empty((0, 2)), step, plan)
        times.append(time.process_time() - begin)
    run(rest.copy(), wave, place, step, plan)
    return min(times) / duration, place[:: round(GRID / step), :2].copy()


def error_of(found: NDArray[np.float64], exact: NDArray[np.float64]) -> float:
    """Return the error of a path."""
    swing = exact - np.mean(exact, axis=0)
    return float(np.sqrt(np.mean((found - exact) ** 2) / np.mean(swing**2)))


def scipy_best(scene: Scene, wanted: float, exact: NDArray[np.float64]) -> Row:
    """Return the fastest setting of scipy that is at least so good."""
    plan = prepare_plan(scene, 1.0)
    work, z, times = new_work(plan), at_rest(scene), GRID * np.arange(len(exact))
    rate(0.0, z, plan, work)
    scale = np.concatenate((np.full(2, 1e-6), np.full(2, 1e-3), np.full(len(z) - 4, 1e-6)))
    scale[4 + plan.slots.shape[1] :] = 1e-3
    best: Row = {"scipy": "none reaches it", "scipy s per s": None, "scipy error": None}
    for method, tolerance in SETTINGS:
        begin = time.process_time()
        solved = solve_ivp(
            lambda t, y: rate(t, y, plan, work), (0.0, SCIPY_SPAN), z, method=cast("Any", method), t_eval=times,
            rtol=tolerance, atol=scale * tolerance, max_step=1e-4,
        )  # fmt: skip
        took = (time.process_time() - begin) / SCIPY_SPAN
        error = error_of(solved.y[:2].T, exact)
        if error <= wanted and (best["scipy s per s"] is None or took < cast("float", best["scipy s per s"])):
            best = {"scipy": f"{method}, {tolerance:g}", "scipy s per s": took, "scipy error": error}
    return best


def main() -> None:
    """Print the tables; write the JSON file if it was asked for."""
    options = arguments("Cost and error of the balls with inertia, against scipy.")
    duration, costs, against = 0.1, list[Row](), list[Row]()
    for name, scene in scenes().items():
        exact, short = path(scene, duration, REFERENCE)[1], round(SCIPY_SPAN / GRID)
        for step in STEPS:
            took, found = path(scene, duration, step)
            row = {"scene": name, "step us": 1e6 * step, "s per s": took, "error": error_of(found, exact)}
            costs.append(row)
            if step == STEPS[1] and not (options.quick and "inner" in name):
                wanted = error_of(found[:short], exact[:short])
                best = scipy_best(scene, wanted, exact[:short])
                slow = best["scipy s per s"]
                times = None if slow is None else cast("float", slow) / took
                against.append({"scene": name, "s per s": took, "error": wanted, **best, "times": times})
    print_table(f"cost and error (prototypes: {PROTOTYPE} s per s at 5 to 6.7 us)", costs)
    print_table(f"against scipy's best at equal error, 5 us, the first {SCIPY_SPAN:g} s", against)
    write_json(options.json, {"cost": costs, "scipy": against})


if __name__ == "__main__":
    main()

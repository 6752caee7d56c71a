"""Bounds of the errors of stand-ins, fitted to true errors of random scenes, for ``models/solve/mappings/table.py``.

Run as ``python -m benchmarks.scenes.fit [--quick] [--json FILE]``. Training seeds: 40,000 on for healthy balls,
40,400 on for shafts, 42,000 on for unbalanced balls, 43,000 on for rotors; ``benchmarks.scenes.judged`` has others.
Errors are against the reference at a tenth of the finest accuracy that is asked for there. The constants of a bound are
those of a linear fit of the logarithm of the error to those of the groups, and the factor before it is exceeded in 2 %
of the scenes; without groups the highest error counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.scenes.draws import draw
from benchmarks.scenes.trial import error_of
from models.machine.scene import Scene
from models.solve.mappings.table import Groups, groups_of_balls, groups_of_shaft
from models.solve.simulate import choose, stand_ins
from models.words.request import Quantity


@dataclass(frozen=True)
class Training:
    """Scenes to which a bound is fitted.

    Attributes:
        model: that stands for the reference.
        kind: of ``benchmarks.scenes.draws``.
        first, count: seeds.
        groups: on which the error depends, None where it is a constant.
        keeps: which scenes count.
        quantity: whose steps are fine enough in both.
    """

    model: str
    kind: str
    first: int
    count: int
    groups: Callable[[Scene], Groups] | None
    keeps: Callable[[Scene], bool]
    quantity: Quantity = "rms"


def _is_stiff(scene: Scene) -> bool:
    """Whether a shaft is not much softer than its bearings: another is no rigid one."""
    return next(iter(groups_of_shaft(scene).values())) <= MOST_OF_STIFFNESS


MOST_OF_STIFFNESS = 0.3
TRAINING: dict[str, Training] = {
    "balls": Training("six_dof", "balls", 40_000, 400, groups_of_balls, lambda scene: True),
    "shaft, healthy": Training(
        "rotor", "shaft", 40_400, 600, groups_of_shaft, lambda scene: not scene.defects and _is_stiff(scene)
    ),
    "shaft, damaged": Training(
        "rotor", "shaft", 40_400, 600, groups_of_shaft, lambda scene: bool(scene.defects) and _is_stiff(scene)
    ),
    "rotor": Training("six_dof", "rotor", 43_000, 200, None, lambda scene: True, "waveform"),
    "balls, unbalance": Training("rotor", "balls, unbalance", 42_000, 60, None, lambda scene: True),
}
QUICK = 8
QUANTITIES = ("waveform", "rms", "lines")
ACCURACY: dict[Quantity, float] = {"rms": 3e-4, "waveform": 1e-3}
# Of each fitted power, towards zero; a smaller error counts as this.
_RIDGE, _LEAST = 0.3, 1e-4
# Share of the scenes whose errors are within the bound.
_WITHIN = 0.98


def measured(training: Training, count: int) -> list[tuple[Scene, dict[str, float]]]:
    """Return scenes and the true errors of their stand-in."""
    found: list[tuple[Scene, dict[str, float]]] = []
    for seed in range(training.first, training.first + count):
        drawn = draw(seed, training.kind)
        if not training.keeps(drawn.scene):
            continue
        request = replace(drawn.request, quantity=training.quantity, accuracy=ACCURACY[training.quantity])
        reference = choose(drawn.scene, request)[0]
        truth = reference.solve(drawn.scene, request)
        offered = stand_ins(drawn.scene, request, reference)[0]
        one = next(one for one in offered if one.solver.model == training.model)
        ours = one.mapped.back(one.solver.solve(one.mapped.scene, one.request))
        asked = QUANTITIES if drawn.scene.repeats else ("rms",)
        errors = {name: error_of(ours, truth, replace(request, quantity=name), 1.0) for name in asked}
        found.append((drawn.scene, errors))
    return found


def fitted(logs: NDArray[np.float64], errors: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], float]:
    """Return constant and powers of a bound from logarithms of groups, (scenes, groups), and the factor within."""
    middle, values = logs.mean(axis=0), np.log(np.maximum(errors, _LEAST))
    moved = logs - middle
    matrix = moved.T @ moved + _RIDGE * np.eye(moved.shape[1])
    powers = np.linalg.solve(matrix, moved.T @ (values - values.mean()))
    left = values - values.mean() - moved @ powers
    margin = float(np.quantile(left, _WITHIN))
    return math.exp(float(values.mean() - middle @ powers) + margin), powers, math.exp(margin)


def fit(kind: str, count: int) -> list[Row]:
    """Return a row for each quantity."""
    found, groups_of = measured(TRAINING[kind], count), TRAINING[kind].groups
    rows: list[Row] = []
    for name in QUANTITIES:
        some = [(scene, errors[name]) for scene, errors in found if name in errors]
        if not some:
            continue
        errors = np.array([error for _, error in some])
        row: dict[str, Any] = {"kind": kind, "quantity": name, "scenes": len(some)}
        row |= {
            "median error": float(np.median(errors)),
            "98 %": float(np.quantile(errors, _WITHIN)),
            "highest": float(np.max(errors)),
        }
        if groups_of is not None:
            logs = np.log([list(groups_of(scene).values()) for scene, _ in some])
            constant, powers, factor = fitted(logs, errors)
            row |= {"constant": constant, "powers": " ".join(f"{power:.3f}" for power in powers), "factor": factor}
            groups = np.exp(logs)
            ends = zip(groups.min(axis=0), groups.max(axis=0), strict=True)
            row["ranges"] = " ".join(f"({low:.3g}, {high:.3g})" for low, high in ends)
        rows.append(row)
    return rows


def main() -> None:
    """Fit all kinds."""
    given = arguments(__doc__ or "")
    counts = [QUICK if given.quick else training.count for training in TRAINING.values()]
    rows: list[Row] = []
    with ProcessPoolExecutor(2) as pool:
        for found in pool.map(fit, TRAINING, counts):
            print_table(str(found[0]["kind"]), found)
            rows += found
    write_json(given.json, {"bounds": rows})


if __name__ == "__main__":
    main()

"""Cost and error of every model of a bearing, beside what else could integrate it.

Run as ``python -m benchmarks.models [--quick] [--json FILE] [--stored FILE] [--document docs/evidence/models.md]``.

1. costs: processor time of a simulated second and error of the kernels for some steps;
2. against: the step with which a model begins beside scipy's fastest integrator that is at least as good (called on
   compiled equations), the same in plain Python, and prototypes that were not part of the project
   (``benchmarks.models.problem`` says how each is judged);
3. linear: impacts on rings beside ``scipy.signal.lsim`` and a discretised filter;
4. simulate: all that a user waits for at an accuracy of 0.5 %, a second at 25.6 kHz: time dropped at the beginning,
   error estimate, filter; its stated errors beside those against steps of an eighth or less;
5. asked: the least of each ratio beside what is aimed at.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.common import Row, print_table, write_json
from benchmarks.models import linear, periodic
from benchmarks.models.angular import SPALL, AngularProblem, angular_scene
from benchmarks.models.integrated import BallProblem, OverTimeProblem, RotorProblem
from benchmarks.models.problem import ROUNDS, Judge, Problem, seconds_of
from benchmarks.published import markdown_table, renewed
from models.machine.scene import Defect, Scene
from models.published import ceruti, marin
from models.solve.response import Response
from models.solve.simulate import simulate

MARKS = ("<!-- table of benchmarks.models -->\n", "<!-- end of the table -->\n")
SIMULATE_MARKS = ("<!-- simulate table of benchmarks.models -->\n", "<!-- end of the simulate table -->\n")
LINEAR_MARKS = ("<!-- linear table of benchmarks.models -->\n", "<!-- end of the linear table -->\n")
LIGHT = ceruti.rotor(length=0.2, end_mass=0.3)
D2 = Defect(math.radians(4.236), 500e-6)
ACCURACY, RATE = 5e-3, 25600.0
FINE = 0.6e-6
"""Step of the reference of ``simulate``, s."""
# Name, rows' column, what is aimed at, and whether more is better.
ASKED = (
    ("scipy's best integrator over ours", "times scipy", 5.0, True),
    ("plain Python over ours", "times plain", 20.0, True),
    ("scipy.signal.lsim over ours", "times the kernel", 1.0, True),
    ("ours over the prototypes'", "share of prototype", 0.1, False),
)


def problems(*, quick: bool) -> list[Problem]:
    """Return the scenes that are integrated over time."""
    every: list[Problem] = [
        RotorProblem("outer race", ceruti.damaged("outer")),
        BallProblem(3, damaged=False),
        OverTimeProblem("D2, 2 kN, 30 Hz", 30.0, 2000.0, D2),
        AngularProblem("healthy, 6000 rpm", None),
        AngularProblem("spall on the outer race, 6000 rpm", SPALL),
        RotorProblem("healthy, equal balls", ceruti.rotor(0.0)),
        RotorProblem("inner race", ceruti.damaged("inner")),
        RotorProblem("ball", ceruti.damaged("ball")),
        RotorProblem("outer race, elastic, ends of 0.3 kg", ceruti.damaged("outer", LIGHT), elastic=True),
        RotorProblem("healthy, elastic", ceruti.rotor(length=0.2), elastic=True),
        BallProblem(3, damaged=True),
        BallProblem(9, damaged=False),
        BallProblem(9, damaged=True),
    ]
    return every[:4] if quick else every


def user_scenes(*, quick: bool) -> dict[str, Scene]:
    """Return the scenes that ``simulate`` is timed with."""
    every = {
        "six_dof: D2, 2 kN, 30 Hz": Scene(30.0, 2000.0, defect=D2),
        "six_dof: inner race": Scene(30.0, 2000.0, defect=Defect(D2.dphi_d, D2.h_d, part="inner")),
        "rotor: outer race": ceruti.damaged("outer"),
        "rotor: outer race, elastic": replace(ceruti.damaged("outer", LIGHT), physics=("elastic_shaft",)),
        "ball_inertia: 9 balls, inner race": marin.scene_of(9, defect=marin.INNER),
        "ring_impact: inner race": linear.scene_of("inner"),
    }
    if quick:
        return dict(list(every.items())[:3])
    return {**every, "angular: spall on the outer race": angular_scene(SPALL)}


def simulate_row(name: str, scene: Scene) -> Row:
    """Return time and errors of ``simulate``, stated and against fine steps."""

    # The angular model is slow: a part of a second, once.
    slow = scene.rig.model == "angular"
    duration, rounds, step = (0.2, 1, 2.0 * FINE) if slow else (1.0, ROUNDS, FINE)

    def asked() -> Response:
        return simulate(scene, accuracy=ACCURACY, duration=duration, rate=RATE)

    found = asked()
    took = seconds_of(asked, rounds) / duration
    steps = round(1.0 / (found.bpfo * step))
    fine = simulate(scene, accuracy=ACCURACY, duration=duration, rate=RATE, steps_per_period=steps)
    ours, truth = (response.acceleration(RATE, duration) for response in (found, fine))
    return {
        "scene": name,
        "solver": found.solver,
        "status": found.status,
        "RMS error stated": found.rms_error,
        "measured": abs(found.rms / fine.rms - 1.0),
        "waveform error stated": found.waveform_error,
        "waveform measured": float(np.sqrt(np.mean((ours - truth) ** 2) / np.mean(truth**2))),
        "ms per s": 1e3 * took,
    }


def asked_rows(against: Sequence[Row], methods: Sequence[Row]) -> list[Row]:
    """Return the worst of each ratio beside what is aimed at."""
    rows: list[Row] = []
    for name, column, aim, more in ASKED:
        of = [row for row in methods if "lsim" in str(row["method"])] if column == "times the kernel" else against
        known = [(cast("float", row[column]), row) for row in of if row[column] is not None]
        worst, row = (min if more else max)(known, key=lambda pair: pair[0])
        where = f"{row['model']}, {row['scene']}" if "model" in row else f"{row['method']}, {row['grid']}"
        met = worst >= aim if more else worst <= aim
        rows.append({"ratio": name, "aim": aim, "worst": worst, "where": where, "met": "yes" if met else "no"})
    return rows


def _text(value: float | str | None, form: str = ".3g") -> str | None:
    return None if value is None else format(float(value), form)


def _two_digits(value: float | str | None) -> str | None:
    """Return a number with two significant digits, and commas between thousands."""
    return None if value is None else format(float(format(float(value), ".2g")), ",g")


def document_rows(against: Sequence[Row]) -> list[Row]:
    """Return the table of the document, model by model."""
    order = [row["model"] for row in against]
    return [
        {
            "model": row["model"],
            "scene": row["scene"],
            "step, µs": _text(row["step us"]),
            "error": _text(row["error"], ".1e"),
            "ms per simulated second": _two_digits(row["ms per s"]),
            "scipy's best": row["scipy"],
            "its ms": _two_digits(row["scipy ms per s"]),
            "times ours": _two_digits(row["times scipy"]),
            "plain Python, times ours": _two_digits(row["times plain"]),
            "prototype, ms": _two_digits(row["prototype ms per s"]),
            "our share of it": _text(row["share of prototype"], ".2f"),
        }
        for row in sorted(against, key=lambda row: order.index(row["model"]))
    ]


def simulate_rows(users: Sequence[Row]) -> list[Row]:
    """Return the second table of the document."""
    return [
        {
            "scene": row["scene"],
            "solver": row["solver"],
            "RMS error, stated": _text(row["RMS error stated"], ".1e"),
            "measured": _text(row["measured"], ".1e"),
            "waveform error, stated": _text(row["waveform error stated"], ".1e"),
            "measured there": _text(row["waveform measured"], ".1e"),
            "ms": _two_digits(row["ms per s"]),
        }
        for row in users
    ]


def linear_rows(methods: Sequence[Row]) -> list[Row]:
    """Return the third table of the document, of the inner race."""
    return [
        {
            "method": row["method"],
            "grid": row["grid"],
            "error": _text(row["error"], ".1e"),
            "ms per simulated second": _two_digits(row["ms per s"]),
            "times the kernel": _two_digits(row["times the kernel"]),
        }
        for row in methods
        if row["defect"] == "inner"
    ]


def with_tables(text: str, tables: Mapping[str, Sequence[Row]]) -> str:
    """Return the text of the document with its three tables renewed."""
    text = renewed(text, markdown_table(document_rows(tables["against"])), MARKS)
    text = renewed(text, markdown_table(simulate_rows(tables["simulate"])), SIMULATE_MARKS)
    return renewed(text, markdown_table(linear_rows(tables["linear"])), LINEAR_MARKS)


def stored_tables(path: Path) -> dict[str, list[Row]]:
    """Return the tables of a file that ``--json`` wrote."""
    content = json.loads(path.read_text(encoding="utf-8"))
    return {name: table for name, table in content.items() if isinstance(table, list)}


def measure(*, quick: bool) -> dict[str, list[Row]]:
    """Return all tables."""
    costs: list[Row] = []
    against: list[Row] = []
    for name, settled in periodic.problems(quick=quick).items():
        costs += periodic.cost_rows(name, settled)
        against.append(periodic.against(name, settled, quick=quick))
    for problem in problems(quick=quick):
        judge = Judge(problem)
        costs += [judge.cost(step) for step in problem.steps]
        against.append(judge.against())
    methods: list[Row] = []
    for part in linear.PARTS[2:] if quick else linear.PARTS:
        row, found = linear.against(part, quick=quick)
        against.append(row)
        methods += found
    users = [simulate_row(name, scene) for name, scene in user_scenes(quick=quick).items()]
    return {
        "costs": costs,
        "against": against,
        "linear": methods,
        "simulate": users,
        "asked": asked_rows(against, methods),
    }


def main() -> None:
    """Print the tables; write the JSON file and renew the document if they were asked for."""
    parser = argparse.ArgumentParser(description="Cost and error of every model.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="a scene or two a model: ends within a minute")
    parser.add_argument("--document", type=Path, metavar="FILE", help="renew the tables in this file")
    parser.add_argument("--stored", type=Path, metavar="FILE", help="show the figures of this file, measure nothing")
    options = parser.parse_args()
    tables = measure(quick=options.quick) if options.stored is None else stored_tables(options.stored)
    for title, rows in tables.items():
        print_table(title, rows)
    if options.stored is None:
        write_json(options.json, tables)
    if options.document is not None:
        text = with_tables(options.document.read_text(encoding="utf-8"), tables)
        options.document.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

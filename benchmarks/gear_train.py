"""Trains of gears over time: order of convergence, cost beside scipy, balances, natural frequencies.

Run as ``python -m benchmarks.gear_train [--quick] [--json FILE]``. The trains are:

* "nine": the train of appendix A (Table 24, J times 10^-2): nine degrees of freedom at Table 23's operating point. Its
  k_m(t) and module are confidential; assumed here: 10 % of one harmonic, module 8 mm, pressure angle 20 degrees, 0.1 mm
  of backlash.
* "pair": 37 and 41 teeth, two levels of stiffness, at a speed at which the flanks part in each pitch.
* "both flanks": a motor and three shafts with 20, 50, 25 and 75 teeth under little load, with eccentric wheels, a
  cracked tooth and pitch errors; the teeth hammer on both flanks.

Errors are those of the displacements after a span, over the largest of them, against steps of an eighth.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.linalg
from scipy.integrate import solve_ivp

from benchmarks.common import Row, arguments, print_table, write_json
from models.gears.teeth.mesh import MeshStiffness
from models.gears.train.damping import with_rayleigh
from models.gears.train.linear import matrices, natural_frequencies
from models.gears.train.motion import TrainState, longest_step, simulate_train
from models.gears.train.parts import Body, GearTrain, Mesh, Support, Wheel, alike, line_of_action
from models.machine.scene import Part
from tests.oracles.gear_train_oracle import Oracle
from tests.support.gear_rolling import rotor_and_body
from tests.support.gear_train import chain, pair
from tests.support.gear_train_oracle import coarse, faulty, moving, placed

POWER, SPEED = 50e3, 506.4 / 60.0
SCIPY = ("DOP853", "LSODA", "Radau")


def nine(share: float = 0.1) -> GearTrain:
    """Return the train of appendix A, with what is not printed as the module says."""
    angle, k_b, k_m = math.radians(20.0), 1.82e9, 7.73e8
    radius = 0.5 * 37 * 8e-3 * math.cos(angle)
    stiffness = MeshStiffness.harmonic((37, 37), k_m, [share * k_m])
    masses = {"1": (15.88, 2.36e-2), "3": (16.85, 5.38e-2), "5": (10.69, 1.72e-2)}
    torques = {"1": 0.0, "3": 0.0, "5": -POWER / (2.0 * math.pi * SPEED)}
    train = GearTrain(
        bodies=tuple(
            Body(name, mass, inertia, (Support(f"bearing {name}", alike(k_b)),), torques[name])
            for name, (mass, inertia) in masses.items()
        ),
        wheels=tuple(Wheel(f"gear {name}", name, 37, radius) for name in masses),
        meshes=tuple(
            Mesh(
                f"gear {a}",
                f"gear {b}",
                stiffness,
                line_of_action(0.0, angle, counterclockwise=turns),
                line_of_action(0.0, angle, counterclockwise=turns, back=True),
                backlash=1e-4,
            )
            for a, b, turns in (("1", "3", True), ("3", "5", False))
        ),
        drive="1",
        speed=SPEED,
    )
    beta = {"1": 1e-4, "3": 5e-4, "5": 6e-4, "gear 1-gear 3": 1e-4, "gear 3-gear 5": 5e-4}
    return with_rayleigh(train, 1.0, beta)


def after(train: GearTrain, start: TrainState, span: float, step: float) -> np.ndarray:
    """Return displacements and velocities after a span."""
    found = simulate_train(train, duration=2.0 * span, rate=1.0 / span, step=step, settle=0.0, start=start)
    return np.concatenate([found.displacement[1], found.velocity[1]])


def error_of(found: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest difference of the displacements over the largest of them."""
    half = len(reference) // 2
    return float(np.abs(found[:half] - reference[:half]).max() / np.abs(reference[:half]).max())


def orders() -> list[Row]:
    """Errors by steps of an interval between samples of the tables, and the order between halvings."""
    rows: list[Row] = []
    cases = {
        "pair, damping in contact": (coarse(film=False), 3e-3, 90.0 * 37 * 4),
        "pair, damping always": (coarse(film=True), 3e-3, 90.0 * 37 * 4),
        "both flanks": (faulty(), 3e-3, 60.0 * 20 * 16),
    }
    for name, (train, span, samples) in cases.items():
        start = moving(train, 0.05)
        steps = [1.0001 / samples / parts for parts in (2, 4, 8, 16, 32)]
        reference = after(train, start, span, steps[-1] / 8.0)
        before = math.nan
        for step in steps:
            error = error_of(after(train, start, span, step), reference)
            order = math.log2(before / error) if math.isfinite(before) else None
            rows.append({"train": name, "step_us": 1e6 * step, "error": error, "order": order})
            before = error
    return rows


def against_oracle() -> list[Row]:
    """Difference from scipy's DOP853, restarted at each sample of the tables and each change of contact."""
    rows: list[Row] = []
    for name, train, span in (
        ("pair, damping in contact", coarse(film=False), 3e-3),
        ("pair, damping always", coarse(film=True), 3e-3),
        ("both flanks", faulty(), 3e-3),
    ):
        start = moving(train, 0.05)
        begin = time.thread_time()
        oracle = Oracle(train).run(placed(train, start.displacement, start.velocity), span, 1e-11, 5e-6)
        spent = time.thread_time() - begin
        found = simulate_train(train, duration=2.0 * span, rate=1.0 / span, step=1e-6, settle=0.0, start=start)
        ours = placed(train, found.displacement[1], found.velocity[1]).reshape(-1, 2, 3)
        other = oracle.reshape(-1, 2, 3)
        rows.append(
            {
                "train": name,
                "contacts": int(found.touches.sum()),
                "displacement": float(np.abs(ours - other)[:, 0].max() / np.abs(other[:, 0]).max()),
                "velocity": float(np.abs(ours - other)[:, 1].max() / np.abs(other[:, 1]).max()),
                "oracle_s_per_s": spent / span,
            }
        )
    return rows


def smooth_rates(train: GearTrain) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return the time derivative of a state by matrices, contacts decided at each call: for scipy in one piece."""
    parts, ratios = matrices(train), train.ratios()
    wheels = [(train.wheel(mesh.driver), train.wheel(mesh.driven)) for mesh in train.meshes]
    speeds = [(ratios[a.body] * train.speed, ratios[b.body] * train.speed) for a, b in wheels]
    count = len(parts.names)

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        force = parts.force - parts.stiffness @ z[:count] - parts.damping @ z[count:]
        for m, mesh in enumerate(train.meshes):
            (f1, f2), stiffness = speeds[m], mesh.stiffness
            k, _ = stiffness.at(mesh.driver_start + f1 * t, mesh.driven_start + f2 * t)
            for row, gap in ((parts.drive[m], 0.0), (parts.back[m], mesh.backlash)):
                way = row @ z[:count] - gap
                if way > 0.0:
                    force = force - (float(k) * way + mesh.damping * (row @ z[count:])) * row
        return np.concatenate([z[count:], force / parts.mass])

    return rates


def costs(quick: bool) -> list[Row]:
    """Thread time of a simulated second and error, beside scipy's solvers in one piece."""
    rows: list[Row] = []
    for name, train, span in (("nine", nine(), 0.02), ("pair", pair(90.0), 0.01)):
        start, step = moving(train, 0.05), longest_step(train)
        reference = after(train, start, span, step / 8.0)
        length = 0.2 if quick else 1.0
        for factor in (1.0, 0.5):
            begin = time.thread_time()
            simulate_train(train, duration=length, step=factor * step, settle=0.0, start=start)
            spent = (time.thread_time() - begin) / length
            error = error_of(after(train, start, span, factor * step), reference)
            rows.append(
                {"train": name, "solver": f"this, {1e6 * factor * step:.2f} us", "s_per_s": spent, "error": error}
            )
        state = np.concatenate([start.displacement, start.velocity])
        for method in SCIPY:
            for rtol in (1e-6, 1e-9):
                begin = time.thread_time()
                found = solve_ivp(smooth_rates(train), (0.0, span), state, method=method, rtol=rtol, atol=rtol * 1e-6)
                spent = (time.thread_time() - begin) / span
                error = error_of(found.y[:, -1], reference)
                rows.append({"train": name, "solver": f"{method}, {rtol:g}", "s_per_s": spent, "error": error})
    return rows


def balances() -> list[Row]:
    """Energy and torque over 0.2 s of settled motion with default steps."""
    rows: list[Row] = []
    cases = {
        "nine": nine(),
        **{f"pair, {speed:g} Hz": pair(speed) for speed in (30.0, 60.0, 90.0, 100.0)},
        "both flanks": faulty(),
    }
    for name, train in cases.items():
        found = simulate_train(train, duration=0.2, rate=51200.0)
        force = found.mesh_force.mean(axis=0)
        load = -sum(body.torque for body in train.bodies)
        last = train.meshes[-1]
        rows.append(
            {
                "train": name,
                "energy_residual": found.energy_residual(),
                "torque_residual": float(force[-1] * train.wheel(last.driven).base_radius / load - 1.0),
                "out_of_contact": float(found.out_of_contact.max()),
                "on_other_flanks": float(found.back_contact.max()),
                "peak_over_mean_force": float(found.drive_force[:, -1].max() / force[-1]),
            }
        )
    return rows


def frequencies() -> list[Row]:
    """Natural frequencies against scipy's eigensolution of matrices that are differences of the oracle's rates."""
    rows: list[Row] = []
    for name, train in (("nine", nine(0.0)), ("chain", chain())):
        flat = tuple(
            replace(
                mesh,
                stiffness=MeshStiffness.harmonic(
                    (mesh.stiffness.driver_teeth, mesh.stiffness.driven_teeth), mesh.stiffness.mean, []
                ),
                backlash=0.0,
            )
            for mesh in train.meshes
        )
        flat_train = replace(train, meshes=flat)
        oracle = Oracle(flat_train)
        for flanks in oracle.flanks:
            flanks.touching = flanks.sense > 0
        courses = {mesh.name: (mesh.stiffness.mean, 0.0, 0.0, 0.0) for mesh in flat}
        size = 6 * len(train.bodies)
        rest = oracle.rates(0.0, np.zeros(size), 0.0, courses)
        columns = [oracle.rates(0.0, unit, 0.0, courses) - rest for unit in np.eye(size)]
        ways = [6 * k + j for k in range(len(train.bodies)) for j in range(3)]
        slopes = -np.array([[columns[a][b + 3] for a in ways] for b in ways])
        masses = np.array([m for body in train.bodies for m in (body.mass or 1.0, body.mass or 1.0, body.inertia)])
        free = np.abs(slopes).sum(axis=1) > 0.0
        stiffness = (masses[:, None] * slopes)[np.ix_(free, free)]
        values = scipy.linalg.eigh(stiffness, np.diag(masses[free]), eigvals_only=True)
        theirs = np.sqrt(np.maximum(values, 0.0)) / (2.0 * math.pi)
        ours = natural_frequencies(train).frequencies
        theirs[theirs < 1e-3] = 0.0
        rows += [
            {"train": name, "hz": a, "eigh_hz": b, "difference": abs(a / b - 1.0) if b > 0.0 else abs(a)}
            for a, b in zip(ours.tolist(), theirs.tolist(), strict=True)
        ]
    return rows


def against_rotor() -> list[Row]:
    """Difference of a body on two bearings with defects from the rotor on two bearings, whose kernel is another one."""
    rows: list[Row] = []
    parts: tuple[Part, ...] = ("outer", "inner", "ball")
    for part in parts:
        for step in (5e-6, 2.5e-6, 1.25e-6):
            rotor, body = rotor_and_body(part, step, 0.05)
            error = float(np.abs(rotor - body).max() / np.ptp(np.real(rotor)))
            rows.append({"defect": part, "step_us": 1e6 * step, "displacement": error})
    return rows


def main() -> None:
    """Print the figures."""
    options = arguments(str(__doc__).partition("\n")[0])
    simulate_train(pair(), duration=1e-3, settle=0.0)
    tables = {
        "order of convergence": orders(),
        "against the oracle": against_oracle(),
        "cost of a simulated second": costs(options.quick),
        "balances": balances(),
        "natural frequencies": frequencies(),
        "rolling elements against the rotor": against_rotor(),
    }
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()

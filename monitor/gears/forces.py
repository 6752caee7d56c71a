"""``spallwatch gear``: what the train of ``[gear]`` does to its meshes and bearings."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from models.gears.teeth.stiffness import iso_stiffness
from models.gears.train.linear import natural_frequencies
from models.gears.train.parts import GearTrain
from monitor.commands.common import InputError, finite, output_errors
from monitor.config.fields import LocatedError
from monitor.gears.config.train import TrainBuilder
from monitor.gears.kinematics import GearInput
from monitor.records.durable import replacing

if TYPE_CHECKING:
    from models.gears.train.motion import TrainMotion

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

HARMONICS = 6
"""Harmonics of each mesh of which the forces on the bearings are given."""
_SAME_LINE = 1e-6
_RATE, _MESH_SAMPLES = 51200.0, 20
"""Instants a second, and at least in a mesh period."""
_STEADY, _STILL = 0.02, 1e-6
"""A motion is settled where the forces of both halves agree to this share of their RMS about the mean, or hardly move
beside it."""


def build_train(given: GearInput, speed: float | None) -> TrainBuilder:
    """Return the builder of the train of ``[gear]``, which has built it.

    Args:
        given: the configuration.
        speed: of its ``speed_shaft``, Hz, or None where it is not known.

    Raises:
        InputError: the speed or a key is missing, or values do not fit, with one line for each problem.
    """
    if speed is None:
        raise InputError(f"{given.name}: forces need a speed; give --speed-hz or speed_hz of [operating]")
    builder = TrainBuilder(given.gear, speed, given.config)
    try:
        assert builder.train.meshes
    except LocatedError as error:
        raise given.refusal(error.problems) from None
    return builder


@dataclass(frozen=True, eq=False)
class GearRun:
    """The motion of a train at its operating point.

    Attributes:
        builder: of the train.
        train: that moved.
        motion: at equal instants after it has settled.
    """

    builder: TrainBuilder
    train: GearTrain
    motion: TrainMotion

    @cached_property
    def forces(self) -> dict[str, Array]:
        """Forces of the supports on the casing, N, by name: x and y, (N, 2)."""
        return self.motion.bearing_forces()

    @cached_property
    def lines_hz(self) -> Array:
        """Harmonics of the meshes, Hz, each frequency once, ascending."""
        meshes = np.array(list(self.train.mesh_frequencies().values()))
        lines = np.sort(np.multiply.outer(np.arange(1, HARMONICS + 1), meshes).ravel())
        lines = lines[lines < 0.5 * self.motion.rate]
        return lines[np.append(True, np.diff(lines) > _SAME_LINE * lines[1:])]

    @property
    def status(self) -> str:
        """``settled``, ``not_settled`` (the forces of both halves differ), or ``not_finite``."""
        if not self.motion.finite:
            return "not_finite"
        forces = np.concatenate([*self.forces.values(), self.motion.mesh_force], axis=1)
        half = len(forces) // 2
        first, second = (part.std(axis=0) for part in (forces[:half], forces[half : 2 * half]))
        steady = np.abs(first - second) <= _STEADY * np.maximum(first, second)
        still = np.maximum(first, second) <= _STILL * np.abs(forces).max()
        return "settled" if bool((steady | still).all()) else "not_settled"


def run_train(builder: TrainBuilder, duration: float, rate: float | None = None, lead: float = 0.0) -> GearRun:
    """Return the motion of the train of a builder over whole turns of its drive, at least one.

    Args:
        builder: that was checked.
        duration: wished for, s.
        rate: instants a second, Hz; by default 51200, doubled until it is high enough for the meshes.
        lead: that is added before, s.

    Raises:
        InputError: the torques do not press the flanks together that drive, or the rate is too low for a mesh.
    """
    from models.gears.train.motion import simulate_train

    train = builder.train
    needed = _MESH_SAMPLES * max(train.mesh_frequencies().values())
    if rate is None:
        rate = _RATE * 2.0 ** max(0, math.ceil(math.log2(needed / _RATE)))
    if rate < needed:
        raise InputError(
            f"--rate-hz {rate:g}: expected at least {_MESH_SAMPLES} times the mesh frequency, {needed:.6g} Hz, as "
            "there is no filter against aliasing"
        )
    turns = max(1, round((duration + lead) * train.speed))
    try:
        motion = simulate_train(train, duration=turns / train.speed, rate=rate)
    except ValueError as error:
        raise InputError(f"gear: {error}") from None
    return GearRun(builder, train, motion)


def amplitudes(signal: Array, rate: float, lines: Array) -> Complex:
    """Return the complex amplitudes, peak, of lines in a record, (lines, columns), by a Hann window.

    Args:
        signal: (N, columns).
        rate: Hz.
        lines: Hz.
    """
    window = np.hanning(len(signal) + 1)[:-1]
    weighted = (signal - signal.mean(axis=0)) * window[:, None]
    turn = np.exp(-2j * math.pi * np.outer(lines, np.arange(len(signal)) / rate))
    found: Complex = 2.0 / window.sum() * (turn @ weighted)
    return found


def force_values(run: GearRun) -> dict[str, Any]:
    """Return torque, modes, meshes and forces on the bearings."""
    modes = natural_frequencies(run.train)
    torque = run.train.drive_torque()
    return {
        "faults": [fault.words for fault in run.builder.gear.fault],
        "torque_newton_m": torque,
        "power_kw": 1e-3 * torque * 2.0 * math.pi * run.train.speed,
        "natural_frequencies_hz": [float(value) for value in modes.frequencies],
        "damping_ratios": [finite(value) for value in modes.damping_ratios],
        "meshes": [_mesh_values(run, index) for index in range(len(run.train.meshes))],
        "supports": [_support_values(run, name) for name in run.forces] if run.motion.finite else [],
        "duration_s": len(run.motion.displacement) / run.motion.rate,
        "rate_hz": run.motion.rate,
        "energy_residual": finite(run.motion.energy_residual()) if run.motion.finite else None,
        "status": run.status,
    }


def _mesh_values(run: GearRun, index: int) -> dict[str, Any]:
    mesh, model = run.train.meshes[index], run.builder.pairs[index]
    force, error = run.motion.mesh_force[:, index], run.motion.transmission_error[:, index]
    base, mean = mesh.stiffness.base, mesh.stiffness.mean
    return {
        "name": mesh.name,
        "stiffness_newton_per_m": mean,
        "stiffness_source": model.excitation_words(mesh.stiffness),
        "iso_6336_newton_per_m": None
        if (pair := model.geometry) is None
        else iso_stiffness(pair).mesh * pair.face_width,
        "stiffness_variation": float(np.ptp(base)) / mean,
        "contact_ratio": model.contact_ratio,
        "working_angle_deg": math.degrees(model.working_angle),
        "backlash_um": None if math.isinf(mesh.backlash) else 1e6 * mesh.backlash,
        "force_newton": finite(float(force.mean())),
        "force_rms_newton": finite(float(force.std())),
        "force_max_newton": finite(float(force.max())),
        "transmission_error_um": finite(1e6 * float(np.ptp(error))),
        "out_of_contact": finite(float(run.motion.out_of_contact[index])),
        "back_contact": finite(float(run.motion.back_contact[index])),
    }


def _support_values(run: GearRun, name: str) -> dict[str, Any]:
    force = run.forces[name]
    found = amplitudes(force, run.motion.rate, run.lines_hz)
    return {
        "name": name,
        "mean_newton": force.mean(axis=0).tolist(),
        "rms_newton": force.std(axis=0).tolist(),
        "lines": [
            {"hz": float(line), "amplitude_newton": np.abs(one).tolist()}
            for line, one in zip(run.lines_hz, found, strict=True)
        ],
    }


def force_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield what :func:`force_values` found, as text."""
    yield f"drive: {values['torque_newton_m']:.5g} N m, {values['power_kw']:.4g} kW"
    yield from (f"fault: {words}" for words in values["faults"])
    modes = ", ".join(f"{value:.5g}" for value in values["natural_frequencies_hz"])
    yield f"natural frequencies at mean stiffness: {modes} Hz"
    for mesh in values["meshes"]:
        yield (
            f"mesh {mesh['name']}: stiffness {mesh['stiffness_newton_per_m'] / 1e6:.4g} MN/m, "
            f"{mesh['stiffness_source']}, {100 * mesh['stiffness_variation']:.3g} % of it from least to most"
            + _said(
                mesh["iso_6336_newton_per_m"] and mesh["iso_6336_newton_per_m"] / 1e6,
                "; by ISO 6336 {:.4g} MN/m without tip relief",
            )
        )
        yield f"  working angle {mesh['working_angle_deg']:.4g}°" + (
            _said(mesh["contact_ratio"], ", contact ratio {:.4g}") + _said(mesh["backlash_um"], ", backlash {:.4g} µm")
        )
        yield (
            f"  force {_number(mesh['force_newton'])} N, at most {_number(mesh['force_max_newton'])} N; transmission "
            f"error {_number(mesh['transmission_error_um'])} µm from least to most"
        )
        if mesh["out_of_contact"]:
            yield f"  out of contact {100 * mesh['out_of_contact']:.3g} % of the time, on the other flanks " + (
                f"{100 * mesh['back_contact']:.3g} %"
            )
    for support in values["supports"]:
        (x, y), (dx, dy) = support["mean_newton"], support["rms_newton"]
        yield f"bearing {support['name']}: force {x:.5g}, {y:.5g} N along x, y; RMS about it {dx:.4g}, {dy:.4g} N"
        strongest = sorted(support["lines"], key=lambda line: -math.hypot(*line["amplitude_newton"]))[:3]
        listed = "; ".join(
            f"{line['hz']:.6g} Hz {line['amplitude_newton'][0]:.4g}, {line['amplitude_newton'][1]:.4g} N"
            for line in sorted(strongest, key=lambda line: line["hz"])
        )
        yield f"  highest mesh lines: {listed}"
    words = {
        "settled": "settled",
        "not_settled": "not settled: the forces of the first and the second half differ",
        "not_finite": "the motion grows without limit: more damping is needed",
    }
    yield f"over {values['duration_s']:.4g} s: {words[values['status']]}" + _said(
        values["energy_residual"], "; energy balance to {:.1e}"
    )


def _said(value: float | None, words: str, unit: float = 1.0) -> str:
    return "" if value is None else words.format(unit * value)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def write_forces(run: GearRun, path: Path, option: str = "--csv") -> None:
    """Write time, forces on the bearings and forces of the meshes as CSV."""
    columns = {"time_s": np.arange(len(run.motion.mesh_force)) / run.motion.rate}
    for name, force in run.forces.items():
        columns |= {f"{name}_{axis}_newton": force[:, side] for side, axis in enumerate("xy")}
    for index, mesh in enumerate(run.train.meshes):
        columns[f"mesh_{mesh.name}_newton"] = run.motion.mesh_force[:, index]
    head = io.StringIO()
    csv.writer(head, lineterminator="").writerow(columns)
    with output_errors(option, path), replacing(path) as temporary:
        np.savetxt(temporary, np.column_stack(list(columns.values())), "%.9g", ",", header=head.getvalue(), comments="")

"""What Thibault, Bourdon, Remond and Lecouvreur (Tribology International, 2022) print of two bearings, beside ours.

Table 1 prints raceways of 67.3 and 92.7 mm, which make balls of 12.7 mm on a pitch circle of 80 mm, 11 balls in the
left bearing, 10 in the right one, and E = 200 GPa. It prints neither groove radii nor clearance: 0.51 of the ball's
diameter and 35 um were chosen to meet four figures of the source. The shaft is rigid here, half of the radial load is
on each bearing.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from models.machine.ball_statics import BallStatics, RingState, equilibrium
from models.machine.bearing import Bearing
from models.machine.shaft_beam import Coupling, Disc, Shaft, torsion_frequencies
from models.published.acceptance import AcceptanceRow, Status

SOURCE = "Thibault et al. 2022"
BALL, PITCH = 0.5e-3 * (92.7 - 67.3), 0.5e-3 * (92.7 + 67.3)
LEFT, RIGHT = 11, 10
SLOW, FAST = 100.0, 20000.0 / 60.0
"""6000 and 20,000 rpm, Hz."""
CAGE_ANGLES = 12
# Not printed: inertia beyond each coupling, and polar inertia of the disc, kg m2.
END_INERTIA, DISC_INERTIA = 1.91e-3, 8.5e-6
_CHOSEN = "groove radii 0.51 D and clearance 35 um chosen; shaft rigid"


def statics(balls: int, groove: float = 0.51, clearance: float = 35e-6) -> BallStatics:
    """Return a bearing of Table 1 with groove radii, in ball diameters, and diametral clearance, m, that it lacks."""
    bearing = Bearing("", balls, BALL, PITCH, inner_groove_radius=groove * BALL, outer_groove_radius=groove * BALL)
    return BallStatics(bearing, clearance, modulus=200e9)


@cache
def passage(balls: int, axial: float, speed: float) -> tuple[RingState, ...]:
    """Return states under 300 N and an axial load while the cage turns by one spacing of the balls."""
    bearing, load = statics(balls), np.array([300.0, 0.0, axial, 0.0, 0.0])
    steps = 2.0 * math.pi / balls * np.arange(CAGE_ANGLES) / CAGE_ANGLES
    return tuple(equilibrium(bearing, load, speed, cage_angle=float(angle)) for angle in steps)


def bpfo(balls: int, axial: float, speed: float) -> float:
    """Return the mean passages of balls per turn of the shaft."""
    return float(np.mean([state.bpfo for state in passage(balls, axial, speed)]))


def interval(balls: int, axial: float, speed: float) -> float:
    """Return the turns of the shaft in which a ball touches the inner race, per turn of the cage."""
    states = passage(balls, axial, speed)
    return float(np.mean([state.inner_force > 0.0 for state in states]) / np.mean([state.ftf for state in states]))


def torsion(*, disc: bool = True) -> list[float]:
    """Return the natural frequencies of torsion of the shaft between its couplings, Hz, ascending."""
    couplings = (Coupling(0, 1300.0, END_INERTIA), Coupling(4, 1300.0, END_INERTIA))
    discs = (Disc(2, 0.0, DISC_INERTIA, 0.0),) if disc else ()
    return [float(value) for value in torsion_frequencies(Shaft(), discs, couplings)]


def acceptance_rows() -> list[AcceptanceRow]:
    """Return the rows T1 to T3 of the acceptance table."""
    reference = bpfo(RIGHT, 200.0, SLOW)
    faster = 100.0 * (bpfo(RIGHT, 200.0, FAST) / reference - 1.0)
    loaded = 100.0 * (bpfo(RIGHT, 1000.0, SLOW) / reference - 1.0)
    modes = torsion()
    second = min(modes, key=lambda value: abs(value - 25.44 * FAST))
    balls = f"{_CHOSEN}; 4.21 with contact angles of zero"
    fitted = "an inertia beyond each coupling fitted"
    disc = "polar inertia of the disc fitted, oddly small; consistent mass"
    return [
        row("T1", "II.1", "BPFO of the left bearing", "1/turn", "4.63", bpfo(LEFT, 0.0, SLOW), "EXACT", 1.1e-3),
        row("T1", "II.4", "second torsion at 6000 rpm", "1/turn", "85", 25.44 * FAST / SLOW, "EXACT", 6e-3),
        row("T1", "II.4", "main torsion at 20,000 rpm", "1/turn", "26", 25.44, "EXACT", 3e-2, "25.44 in II.2"),
        row("T1", "II.4", "length of the spall over a spacing", "%", "20", 700.0 * LEFT / 360.0, "EXACT", 0.1,
             "7 degrees, of which the text says about 20 %"),
        row("T2", "II.1", "BPFO of the right bearing", "1/turn", "4.26", reference, "CALIB", 2.5e-3, balls),
        row("T2", "II.2", "its change at 20,000 rpm", "%", "-0.4", faster, "CALIB", 0.25, _CHOSEN),
        row("T2", "II.3", "its change at 1000 N", "%", "0.4", loaded, "CALIB", 0.25, _CHOSEN),
        row("T2", "II.2", "contact interval, 6000 rpm", "turns", "0.6", interval(LEFT, 0.0, SLOW), "CALIB", 0.167),
        row("T2", "II.2", "contact interval, 20,000 rpm", "turns", "0.5", interval(LEFT, 0.0, FAST), "CALIB", 0.2),
        row("T2", "II.2", "torsion of the couplings", "1/turn", "0.39", modes[1] / FAST, "CALIB", 0.01, fitted),
        row("T2", "II.2", "second torsion", "1/turn", "25.44", second / FAST, "CALIB", 0.01, disc),
        *_own(),
    ]  # fmt: skip


def _own() -> list[AcceptanceRow]:
    """Return the study's own table of forces; tests/published/test_thibault.py has the rest of it."""
    note = "own reference: grooves 0.515 D, 30 um, the first ball in the load's line"
    rows: list[AcceptanceRow] = []
    for speed, force, (x, z, largest) in (
        ("6000 rpm", 23.3, ("3.640", "114.31", "144.5")),
        ("20,000 rpm", 258.9, ("7.251", "97.64", "134.4")),
    ):
        load = np.array([300.0, 0.0, 200.0, 0.0, 0.0])
        state = equilibrium(statics(RIGHT, 0.515, 30e-6), load, centrifugal=force)
        for quantity, unit, text, value in (
            ("radial displacement", "um", x, 1e6 * float(state.displacement[0])),
            ("axial displacement", "um", z, 1e6 * float(state.displacement[2])),
            ("largest inner force", "N", largest, float(np.max(state.inner_force))),
        ):
            place = "not in the source: prototype of this model"
            rows.append(AcceptanceRow("T3", place, f"{quantity}, {speed}", unit, text, value, "QUAL", 1e-3, note))
    return rows


def row(
    test: str,
    place: str,
    quantity: str,
    unit: str,
    printed: str,
    obtained: float,
    status: Status,
    tolerance: float,
    note: str = "",
) -> AcceptanceRow:
    """Return a row; what was chosen for all calibrated ones is their note, unless one is given."""
    chosen = _CHOSEN if status == "CALIB" and not note else note
    return AcceptanceRow(test, f"{SOURCE}, {place}", quantity, unit, printed, obtained, status, tolerance, chosen)

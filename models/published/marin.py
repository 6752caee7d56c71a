"""What Marin, Rubio, Garcia-Prada and Reinoso (JTE 42(1), 2014) print of their 6206 with three and nine balls.

Not printed: depth and length of the defect (here 20 um and 1 mm, rectangular), its angle, and the envelope's band (here
500 to 10,000 Hz). The first 0.2 s of each run are left out, as in the source.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import from_catalogue, kinematics
from models.machine.hertz import point_contact_stiffness, relative_radii
from models.machine.scene import Defect, Scene
from models.published.acceptance import AcceptanceRow, Status, highest_line
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.ball_inertia.solver import BallTrace, longest_stable_step, solve, trace
from models.solve.ring_impact.rig import STEEL_DENSITY
from models.words.request import Request

if TYPE_CHECKING:
    from models.machine.bearing import Bearing

SOURCE = "Marin 2014"
OWN = "not in the source: prototype of this model"
SPEED = 20.0
STEP = 5e-6
DURATION, DROPPED = 1.2, 0.2
INNER_GROOVE, OUTER_GROOVE = 0.5257, 0.5203
"""Radii of the grooves over the balls' diameter, chosen for C_in and C_out with a modulus of 200 GPa."""
MODULUS_SHARE = 200.0 / 210.0
"""The modulus over that of models.machine.hertz, which stiffness is proportional to."""
INNER = Defect(1.0 / 18.25, 20e-6, part="inner")


def bearing_of(balls: int) -> Bearing:
    """Return the 6206 of Table 2: balls of 9.5 mm on a pitch circle of 46 mm."""
    return replace(from_catalogue("6206"), n_elements=balls, element_diameter=9.5e-3, pitch_diameter=46e-3)


def scene_of(balls: int, speed: float = SPEED, *, defect: Defect | None = None, damping: float = 200.0) -> Scene:
    """Return a scene of Table 2 under 3000 N."""
    rig = BallInertiaRig(m_b=0.0035, c_ci=damping, c_co=damping)
    return Scene(speed, 3000.0, bearing=bearing_of(balls), rig=rig, defect=defect, clearance=1e-5, gravity=9.81)


@cache
def run(scene: Scene, step: float = STEP, duration: float = DURATION) -> BallTrace:
    """Return a run from the static deflection."""
    return trace(scene, duration, step)


def level(scene: Scene) -> float:
    """Return the standard deviation of the ring's acceleration after the dropped beginning, m/s2."""
    return float(np.std(run(scene).acceleration[round(DROPPED / STEP) :]))


def mean_deflection(step: float = STEP) -> float:
    """Return the mean place of the inner ring, nine balls, upwards, m."""
    return -float(np.mean(run(scene_of(9), step).ring[round(DROPPED / step) :, 0]))


def highest_line_of(scene: Scene, duration: float = 4.0, rate: float = 25600.0) -> float:
    """Return the frequency of the highest line of the envelope above 1 Hz, Hz."""
    found = solve(scene, Request(duration=duration, rate=rate, accuracy=2e-2))
    return highest_line(found.acceleration(rate, duration), rate)


def acceptance_rows() -> list[AcceptanceRow]:
    """Return the rows M1 to M3."""
    return [*_frequencies(), *_levels(), *_own()]


def _row(
    test: str, place: str, quantity: str, unit: str, printed: str, obtained: float, status: Status,
    tolerance: float | None, note: str = "",
) -> AcceptanceRow:  # fmt: skip
    return AcceptanceRow(test, place, quantity, unit, printed, obtained, status, tolerance, note)


def _frequencies() -> list[AcceptanceRow]:
    three, place = kinematics(bearing_of(3), SPEED).bpfi, f"{SOURCE}, Fig. 15(b)"
    values = (
        ("BPFI, 3 balls", "36.19", three, 3e-4, ""),
        ("BPFI - f_s", "16.2", three - SPEED, 1e-3, ""),
        ("BPFI + f_s", "56.2", three + SPEED, 1e-3, ""),
        ("2 BPFI - f_s", "52.4", 2.0 * three - SPEED, 1e-3, ""),
        ("2 BPFI + f_s", "92.0", 2.0 * three + SPEED, 5e-3, "92.39 by its own formula: a bin, or a misprint"),
    )
    return [
        *(_row("M1", place, name, "Hz", text, value, "EXACT", t, note) for name, text, value, t, note in values),
        *_table_2(),
    ]


def _table_2() -> list[AcceptanceRow]:
    """Return what some figures of Table 2 say of others."""
    place, r_in, r_out, r_b = f"{SOURCE}, Table 2", 18.25, 27.75, 4.75
    inner, outer = (
        MODULUS_SHARE * point_contact_stiffness(*radii, method="elliptic") / 1e3**1.5
        for radii in relative_radii(grooved())
    )
    steel = 1e-9 * STEEL_DENSITY * math.pi / 6.0 * (2.0 * r_b) ** 3
    return [
        _row("M1", place, "radius of the pitch circle", "mm", "23", 0.5 * (r_in + r_out), "EXACT", 1e-6),
        _row("M1", place, "mass of a ball", "kg", "0.0035", steel, "EXACT", 1e-3, "steel of 7800 kg/m3"),
        _row("M2", place, "C_in", "N/mm^1.5", "779180", inner, "CALIB", 1e-3, f"groove radius {INNER_GROOVE} D chosen"),
        _row("M2", place, "C_out", "N/mm^1.5", "897760", outer, "CALIB", 1e-3,
             f"groove radius {OUTER_GROOVE} D chosen"),
        _row("M3", place, "clearance h", "mm", "0.01", r_out - r_in - 2.0 * r_b, "NO", None,
             "the radii leave none; taken as printed, on top of them"),
    ]  # fmt: skip


def grooved() -> Bearing:
    """Return the 6206 of Table 2 with groove radii that it does not print."""
    return replace(
        bearing_of(9),
        inner_race_radius=18.25e-3,
        outer_race_radius=27.75e-3,
        inner_groove_radius=INNER_GROOVE * 9.5e-3,
        outer_groove_radius=OUTER_GROOVE * 9.5e-3,
    )


def _levels() -> list[AcceptanceRow]:
    place, name = f"{SOURCE}, Fig. 15(b)", "highest line of the envelope, 3 balls"
    printed, chosen = (highest_line_of(scene_of(3, defect=INNER, damping=damping)) for damping in (200.0, 1000.0))
    rows = [
        _row("M2", place, name, "Hz", "36.19", printed, "NO", None,
             "damping as printed: BPFI is among the six highest only; no defect is printed"),
        _row("M2", place, f"{name}, 1000 N s/m", "Hz", "36.19", chosen, "CALIB", 1e-2,
             "five times the printed damping, chosen for it"),
    ]  # fmt: skip
    # Three balls over a defect are chaotic: their level is no figure for a table.
    for words, text, scene in (
        ("3 balls, healthy", "286", scene_of(3)),
        ("9 balls, healthy", "0.1", scene_of(9)),
        ("9 balls, inner race", "156", scene_of(9, defect=INNER)),
    ):
        note = "Fig. 16 is a drawing: only its trends are compared with it"
        rows.append(_row("M2", OWN, f"SD of y'', {words}", "m/s2", text, level(scene), "QUAL", 0.1, note))
    return rows


def _own() -> list[AcceptanceRow]:
    limit = 1e6 * longest_stable_step(scene_of(9))
    return [
        _row("M3", OWN, "mean y, 9 balls", "um", "-41.09", 1e6 * mean_deflection(), "QUAL", 1e-3,
             "own reference; the source prints none"),
        _row("M3", f"{SOURCE}, section Simulation", "step of the integration", "us", "100", limit, "NO", None,
             "ours is the longest stable one: 0.1 ms can only be the period of the output"),
    ]  # fmt: skip

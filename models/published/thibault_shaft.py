"""What Thibault et al. (Tribology International, 2022) print of their shaft, beside ours: bent, and turning.

The axial load comes in one of two senses, which the source does not print: towards the bearing that carries it, where
the shaft's bend adds to its contact angles or takes from them. Here it presses from the left to the right bearing: so
the balls of the right one lose the inner race at 20,000 rpm, as the source says, and not the other way. Groove radii,
clearance, inertias, damping and torque are not printed; levels are therefore not compared.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from models.machine.ball_statics import RingState
from models.machine.bearing import Bearing
from models.machine.scene import Defect, Scene
from models.published.acceptance import AcceptanceRow
from models.published.thibault import BALL, CAGE_ANGLES, FAST, LEFT, PITCH, RIGHT, SLOW, row
from models.solve.angular.plan import assemble
from models.solve.angular.rig import AngularRig
from models.solve.angular.solver import AngularTrace, trace

REFERENCE = Scene(
    SLOW,
    600.0,
    bearing=Bearing("", LEFT, BALL, PITCH),
    second_bearing=Bearing("", RIGHT, BALL, PITCH),
    rig=AngularRig(),
    axial_load=-200.0,
)
SPALL = Defect(math.radians(7.0), 100e-6, width=math.radians(30.0))
BPFO_LEFT = 0.5 * LEFT * (1.0 - BALL / PITCH)
"""Of contact angles of zero, per turn."""
_STEP, _SETTLE, _TURNS = 8e-6, 0.3, 40.0
_BENT = "as T2 on the shaft as it bends, its load pressing towards the right bearing"


@cache
def passage(axial: float, speed: float) -> tuple[tuple[RingState, RingState], ...]:
    """Return both bearings on the bent shaft while their cages turn by one spacing of the balls."""
    states: list[tuple[RingState, RingState]] = []
    for share in np.arange(CAGE_ANGLES) / CAGE_ANGLES:
        angles = {f"cage_angle_{k}": 2.0 * math.pi / z * float(share) for k, z in (("a", LEFT), ("b", RIGHT))}
        rig = replace(REFERENCE.rig_as(AngularRig), **angles)
        states.append(assemble(replace(REFERENCE, rig=rig, speed=speed, axial_load=-axial)).rings)
    return tuple(states)


def bpfo(axial: float, speed: float) -> float:
    """Return the mean passages of balls of the right bearing per turn of the shaft."""
    return float(np.mean([right.bpfo for _, right in passage(axial, speed)]))


def interval(axial: float, speed: float) -> float:
    """Return ``models.published.thibault.interval`` of the left bearing."""
    lefts = [left for left, _ in passage(axial, speed)]
    return float(np.mean([left.inner_force > 0.0 for left in lefts]) / np.mean([left.ftf for left in lefts]))


@cache
def turning(scene: Scene) -> AngularTrace:
    """Return the last 40 turns of a run, in steps of equal angle, after 0.3 s to settle."""
    step = 2.0 * math.pi * scene.speed * _STEP
    found = trace(scene, _SETTLE * scene.speed + _TURNS, step)
    kept = slice(-round(2.0 * math.pi * _TURNS / step), None)
    return replace(
        found,
        time=found.time[kept],
        angle=found.angle[kept],
        ias=found.ias[kept],
        acceleration=found.acceleration[kept],
        carried=found.carried[kept],
    )


def order_spectrum(found: AngularTrace, signal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return events per turn and single-sided amplitudes of a signal over equal angles, through a Hann window."""
    window = np.hanning(len(signal) + 2)[1:-1]
    amplitude = np.abs(np.fft.rfft((signal - signal.mean()) * window)) * (2.0 / float(window.sum()))
    return np.arange(float(len(amplitude))) * (2.0 * math.pi / (len(signal) * found.step)), amplitude


def line(scene: Scene, order: float) -> float:
    """Return the amplitude of the angular speed at an order, rad/s: the highest within two lines of the window."""
    orders, amplitude = order_spectrum(turning(scene), turning(scene).ias)
    return float(amplitude[np.abs(orders - order) <= 2.0 / _TURNS].max())


def highest(scene: Scene, low: float, high: float) -> float:
    """Return the order of the highest line of the angular speed between two orders."""
    orders, amplitude = order_spectrum(turning(scene), turning(scene).ias)
    inside = np.flatnonzero((orders >= low) & (orders <= high))
    return float(orders[inside[np.argmax(amplitude[inside])]])


def acceptance_rows() -> list[AcceptanceRow]:
    """Return the rows T2 of the bent shaft, and T4 of the turning one."""
    reference = bpfo(200.0, SLOW)
    faster = 100.0 * (bpfo(200.0, FAST) / reference - 1.0)
    loaded = 100.0 * (bpfo(1000.0, SLOW) / reference - 1.0)
    damaged = replace(REFERENCE, defect=SPALL)
    raised = highest(damaged, 55.0, 115.0)
    fast = highest(replace(damaged, speed=FAST), 20.0, 31.0)
    apart = highest(REFERENCE, BPFO_LEFT + 0.2, BPFO_LEFT + 0.6) - BPFO_LEFT
    near = "highest line of the angular speed over a spall: a multiple of 4.63 next to the mode"
    sides = "distance of the upper side line of 4.63; the bearings' lines are the model's own"
    slow, quick = interval(200.0, SLOW), interval(200.0, FAST)
    return [
        row("T2", "II.1", "BPFO, right, bent shaft", "1/turn", "4.26", reference, "CALIB", 2.5e-3, _BENT),
        row("T2", "II.2", "its change at 20,000 rpm, bent", "%", "-0.4", faster, "CALIB", 0.25, _BENT),
        row("T2", "II.3", "its change at 1000 N, bent", "%", "0.4", loaded, "CALIB", 0.25, _BENT),
        row("T2", "II.2", "contact interval, 6000 rpm, bent", "turns", "0.6", slow, "CALIB", 0.167, _BENT),
        row("T2", "II.2", "contact interval, 20,000 rpm, bent", "turns", "0.5", quick, "CALIB", 0.2, _BENT),
        row("T4", "II.4", "line next to the second torsion", "1/turn", "85", raised, "QUAL", 0.03, near),
        row("T4", "II.4", "the same at 20,000 rpm", "1/turn", "26", fast, "QUAL", 0.12, near),
        row("T4", "II.1", "modulation, BPFO_r - BPFO_a", "1/turn", "0.37", apart, "QUAL", 0.07, sides),
    ]

"""Figures of the gallery from Thibault's two bearings: the statics of the balls (Figs. 5, 7 and 12), and all.

Groove radii and clearance are not printed; ``models.published.thibault`` says what is taken. The shaft is rigid here,
with half of the radial load on each bearing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from matplotlib.figure import FigureBase

from benchmarks import gallery_thibault_ias
from benchmarks.gallery_plate import Plate, letter, number, words
from benchmarks.gallery_spectra import Values
from models.machine.ball_statics import RingState, equilibrium, ring_state
from models.machine.hertz import point_contact_semi_axes
from models.machine.spall_contact import Spall, force_over_spall
from models.published.thibault import FAST, LEFT, RIGHT, SLOW, interval, statics
from monitor.report.figures.drawing import BLUE, INK, VERMILION

TILT = 3.5e-4
"""Of the shaft's ends under 600 N in its middle without couplings, rad."""
_SHALLOW = 4e-6
# Places of the cage within a spacing of the balls.
_STEPS = 48
_CHOSEN = "grooves of 0.51 D and a clearance of 35 µm are chosen, not printed"


def _ellipse(force: float) -> tuple[float, float]:
    """Return the semi-axes of the contact at the outer race, along and across it, m."""
    bearing = statics(LEFT)
    rolling, across = bearing.conforming_radii[1]
    wide, narrow = point_contact_semi_axes(rolling, across, force, "elliptic", modulus=bearing.effective_modulus)
    return narrow, wide


def _pressure(x: Values, y: Values, force: float) -> Values:
    """Return the Hertzian pressure of a force at places along and across the race, Pa."""
    if force <= 0.0:
        return np.zeros_like(x)
    along, across = _ellipse(force)
    rest = np.maximum(1.0 - (x / along) ** 2 - (y / across) ** 2, 0.0)
    return 1.5 * force / (math.pi * along * across) * np.sqrt(rest)


def figure_5() -> Plate:
    """Return the pressure of a ball that lies half over a shallow spall."""
    bearing, k_o = statics(LEFT), statics(LEFT).races().k_o
    deflection = 12e-6
    healthy, sunk = k_o * deflection**1.5, k_o * (deflection - _SHALLOW) ** 1.5
    along, across = _ellipse(healthy)
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 241) * along, np.linspace(-1.2, 1.2, 241) * across)
    inside = x > 0.0
    pressure = np.where(inside, _pressure(x, y, sunk), _pressure(x, y, healthy))
    cell = (x[0, 1] - x[0, 0]) * (y[1, 0] - y[0, 0])
    # Its edge goes through the middle of the contact, and it is wider than the contact.
    spall = Spall(_SHALLOW, 1.0, 1.5, position=0.5)
    closed = force_over_spall(bearing, spall, deflection, 0.0, 0.0)

    def draw(made: FigureBase) -> None:
        axes, line = made.subplots(1, 2)
        drawn = axes.pcolormesh(1e6 * x, 1e6 * y, 1e-9 * pressure, cmap="Blues", shading="auto", rasterized=True)
        axes.axvline(0.0, color=INK, lw=0.9, ls="--")
        axes.set(xlabel="along the race (µm)", ylabel="across it (µm)")
        axes.grid(visible=False)
        made.colorbar(drawn, ax=axes, label="pressure (GPa)")
        letter(axes, 0, "spall right of the dashed line")
        middle = len(y) // 2
        line.plot(1e6 * x[middle], 1e-9 * _pressure(x, y, healthy)[middle], color=INK, ls="--", lw=0.9, label="sound")
        line.plot(1e6 * x[middle], 1e-9 * pressure[middle], color=BLUE, label="with the spall")
        line.set(xlabel="along the race (µm)", ylabel="pressure (GPa)", ylim=(0.0, None))
        line.legend(loc="lower center", fontsize=8)
        letter(line, 1, "through the middle")

    caption = (
        f"Pressure of a ball on the outer race with half its contact over a pit {1e6 * _SHALLOW:g} µm deep, approach "
        f"12 µm: {closed:.0f} N of {healthy:.0f} N remain. Dimensions of the print's example are not given."
    )
    data = {"force_sound_newton": healthy, "force_newton": closed, "sum_of_the_drawing_newton": pressure.sum() * cell}
    return Plate(caption, "Pressure over the edge of a spall.", 3.0, draw, data, (), "depth and approach are chosen")


def _tilted() -> RingState:
    load = np.array([300.0, 0.0, 200.0, 0.0, 0.0])
    held = {"tilt_x": 0.0, "tilt_y": TILT}
    return ring_state(statics(LEFT), equilibrium(statics(LEFT), load, FAST, held=held).displacement, FAST)


def figure_7() -> Plate:
    """Return the forces and contact angles of each ball under radial and axial displacement and tilt."""
    state = _tilted()
    balls = np.arange(1, LEFT + 1)
    angles = np.degrees([state.inner_angle, state.outer_angle])
    touching = state.inner_force > 0.0
    lightest = int(np.argmin(np.where(touching, state.inner_force, np.inf)))

    def draw(made: FigureBase) -> None:
        forces, contact = made.subplots(1, 2)
        for axes, values in ((forces, (state.inner_force, state.outer_force)), (contact, angles)):
            axes.plot(balls, values[0], color=BLUE, marker="o", ms=5, lw=0.9, label="inner race")
            axes.plot(balls, values[1], color=VERMILION, marker="s", ms=5, lw=0.9, label="outer race")
            axes.set(xlabel="ball", xticks=balls)
        forces.set(ylabel="normal force (N)", ylim=(0.0, None))
        contact.set(ylabel="contact angle (degrees)")
        letter(forces, 0, "forces")
        letter(contact, 1, "contact angles")
        forces.legend(loc="best", fontsize=8)

    above = bool(np.all(state.outer_force > state.inner_force))
    steeper = bool(np.all((angles[0] > angles[1])[touching]))
    claims = [
        words("the outer force exceeds the inner one, as the ball is flung", [above]),
        words("the lightest loaded ball has the largest angle at the inner race", [np.argmax(angles[0]) == lightest]),
        words("under speed, angles at the inner race exceed those at the outer", [steeper]),
    ]
    caption = (
        "Normal forces and contact angles, 11 balls, 20,000 rpm, displaced as by 300 N radially and 200 N axially, "
        f"tilted by {1e3 * TILT:g} mrad; displacements of the print are not given."
    )
    data = {"inner_force_newton": state.inner_force, "outer_force_newton": state.outer_force}
    data |= {"inner_angle_deg": angles[0], "outer_angle_deg": angles[1]}
    return Plate(caption, "Forces and contact angles of each ball.", 3.0, draw, data, claims, _CHOSEN)


def _around(states: Sequence[RingState]) -> tuple[Values, Values]:
    """Return turns of the shaft and the inner force of one ball while the cage turns once."""
    turn = 2.0 * math.pi
    ftf = float(np.mean([state.ftf for state in states]))
    angle = np.concatenate([np.mod(state.angles + math.pi, turn) for state in states])
    force = np.concatenate([state.inner_force for state in states])
    order = np.argsort(angle)
    return angle[order] / (turn * ftf), force[order]


@cache
def _passage(balls: int, axial: float, speed: float) -> tuple[RingState, ...]:
    """Return what ``models.published.thibault.passage`` returns, in smaller steps."""
    bearing, load = statics(balls), np.array([300.0, 0.0, axial, 0.0, 0.0])
    angles = 2.0 * math.pi / balls * np.arange(_STEPS) / _STEPS
    return tuple(equilibrium(bearing, load, speed, cage_angle=float(angle)) for angle in angles)


def figure_12() -> Plate:
    """Return the inner force of a ball and of all balls over a turn of the cage, at both speeds."""
    cases = [(LEFT, 0.0, "radially loaded"), (RIGHT, 200.0, "axially loaded")]
    speeds = ((SLOW, BLUE, "6000 rpm"), (FAST, VERMILION, "20,000 rpm"))
    found = {(balls, speed): _passage(balls, axial, speed) for balls, axial, _ in cases for speed, _, _ in speeds}
    sums = {key: np.array([state.inner_force.sum() for state in states]) for key, states in found.items()}

    def draw(made: FigureBase) -> None:
        panels = made.subplots(2, 2, sharex="row")
        for place, (above, below, (balls, _, name)) in enumerate(zip(panels[0], panels[1], cases, strict=True)):
            for speed, color, label in speeds:
                above.plot(*_around(found[balls, speed]), color=color, label=label)
                total = np.tile(sums[balls, speed], 2)
                below.plot(2.0 * np.arange(total.size) / total.size, total, color=color)
            above.set(xlabel="turns of the shaft", ylabel="one ball (N)", ylim=(0.0, None))
            below.set(xlabel="spacings of the balls", ylabel="sum of the balls (N)")
            letter(above, place, name)
        panels[0, 0].legend(loc="upper left", fontsize=8)

    least = {key: min(float(state.inner_force.min()) for state in states) for key, states in found.items()}
    shape = {key: np.abs(np.fft.rfft(values))[1:] for key, values in sums.items()}
    rest = {key: float(np.sqrt(np.sum(lines[1:] ** 2)) / lines[0]) for key, lines in shape.items()}
    claims = [
        number(
            "contact of a ball of the radially loaded bearing, 6000 rpm", 0.6, interval(LEFT, 0.0, SLOW), "turns", 0.05
        ),
        number("the same at 20,000 rpm", 0.5, interval(LEFT, 0.0, FAST), "turns", 0.05),
        words("balls of the axially loaded bearing always touch at 6000 rpm", [least[RIGHT, SLOW] > 0.0]),
        words("and no longer at 20,000 rpm", [least[RIGHT, FAST] == 0.0]),
        words("the sum is less like a sine at 20,000 rpm", [rest[b, FAST] > rest[b, SLOW] for b in (LEFT, RIGHT)]),
    ]
    data = {}
    for (balls, speed), states in found.items():
        name = f"{'radial' if balls == LEFT else 'axial'}_{60 * speed:.0f}_rpm"
        turns, force = _around(states)
        data |= {f"turns_{name}": turns, f"force_{name}_newton": force, f"sum_{name}_newton": sums[balls, speed]}
    caption = (
        "Force of one ball on the inner race over a turn of the cage, and the sum over all balls while they move on by "
        "two spacings; balls in equilibrium at each place."
    )
    return Plate(caption, "Forces on the inner race over a turn of the cage.", 4.6, draw, data, claims, _CHOSEN)


FIGURES: dict[str, Callable[[], Plate]] = {
    "5": figure_5,
    "7": figure_7,
    "12": figure_12,
    **gallery_thibault_ias.FIGURES,
}

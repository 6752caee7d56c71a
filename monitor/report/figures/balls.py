"""Statics of a bearing ball by ball: forces and contact angles, and how they change while a ball goes round."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from models.machine.ball_statics import RingState
from models.machine.bearing import Bearing
from monitor.report.figures.drawing import AXIS, BLUE, GREY, SOFT, VERMILION, legend_above
from monitor.report.figures.sheet import Part, Sheet
from monitor.words.numbers import figure

Values = NDArray[np.float64]

_COLUMNS = ("inner_force", "outer_force", "inner_angle", "outer_angle")


def balls_sheet(bearing: Bearing, speed: float, states: Sequence[RingState], values: Mapping[str, Any]) -> Sheet:
    """Return the report of a bearing under load.

    Args:
        states: while the cage turns by one spacing of the balls, at even steps.
        values: what ``monitor.commands.bearing.statics`` prints of them.
    """
    lead = (
        f"{figure(values['radial_load_newton'])} N radial, {figure(values['axial_load_newton'])} N axial, tilt "
        f"{figure(values['tilt_mrad'], 2)} mrad, {figure(speed)} Hz: BPFO {values['bpfo_hz']:.2f} Hz, "
        f"{values['bpfo_change_percent']:+.2f} % from that of the nominal contact angle."
    )
    facts = [
        ("Bearing", f"{bearing.designation or 'as given'}, {bearing.n_elements} balls"),
        ("Play across", f"{figure(values['play_um'])} µm"),
        ("Estimated", ", ".join(values["estimated"]).replace("_", " ") or "nothing"),
        ("Centrifugal force", f"{figure(values['centrifugal_force_newton'])} N a ball"),
        ("Mean contact angle", f"{values['mean_contact_angle_deg']:.2f}°"),
        ("Contact interval", f"{values['contact_interval_turns']:.3f} turns of the shaft in one of the cage"),
        ("Inner ring", f"{_place(values)}, moment {figure(values['tilting_moment_newton_m'])} N m"),
        ("Rolling resistance", _resistance(values)),
    ]
    parts = [_round_part(states), _section_part(states[0])]
    return Sheet(f"Balls of a {bearing.designation or 'bearing'} under load", lead, parts, facts)


def _place(values: Mapping[str, Any]) -> str:
    moved = values["displacement_um"]
    return f"{figure(moved['along_load'])} µm along the load, {figure(moved['axial'])} µm axial"


def _resistance(values: Mapping[str, Any]) -> str:
    swing = figure(values["resistance_torque_swing_newton_mm"], 2)
    return f"{figure(values['resistance_torque_newton_mm'])} N mm, swing {swing} N mm"


def _around(states: Sequence[RingState]) -> tuple[Values, dict[str, Values]]:
    """Return the places of a ball around the race from the load, rad, -pi to pi, and what it bears there."""
    angles = np.concatenate([state.angles for state in states])
    order = np.argsort(wrapped := np.remainder(angles + math.pi, 2.0 * math.pi) - math.pi)
    columns = {name: np.concatenate([getattr(state, name) for state in states])[order] for name in _COLUMNS}
    for race in ("inner", "outer"):
        columns[f"{race}_angle"] = np.where(columns[f"{race}_force"] > 0.0, columns[f"{race}_angle"], math.nan)
    return wrapped[order], columns


def _round_part(states: Sequence[RingState]) -> Part:
    place, columns = _around(states)
    now_at, now = _around(states[:1])

    def draw(made: FigureBase) -> None:
        left, right = made.subplots(1, 2, sharex=True)
        for race, color in (("outer", VERMILION), ("inner", BLUE)):
            for axes, name, scale in ((left, f"{race}_force", 1.0), (right, f"{race}_angle", 180.0 / math.pi)):
                axes.plot(np.degrees(place), scale * columns[name], color=color, label=f"{race} race")
                axes.plot(np.degrees(now_at), scale * now[name], "o", color=color, ms=4.5)
        left.set(ylabel="normal force (N)", ylim=(0.0, None))
        right.set(ylabel="contact angle (degrees)")
        for axes in (left, right):
            axes.set(xlabel="place of a ball, from the load (degrees)", xlim=(-180.0, 180.0))
            axes.set_xticks(range(-180, 181, 60))
            legend_above(axes, 2)

    caption = (
        "Lines: as a ball goes round with the cage. Dots: all balls at the moment when one is under the load. A ball "
        "without contact at the inner race is pressed outwards by its centrifugal force alone; its angle there is not "
        "drawn."
    )
    data = {"place_deg": np.degrees(place)} | {
        f"{name}_newton" if name.endswith("force") else f"{name}_deg": (
            values if name.endswith("force") else np.degrees(values)
        )
        for name, values in columns.items()
    }
    label = "Normal forces and contact angles of the balls at both races, over their place around the bearing."
    return Part("Forces and contact angles", caption, label, 3.1, draw, data, "balls")


def _section_part(state: RingState) -> Part:
    share = state.inner_force / max(float(state.inner_force.max()), 1e-9)

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        _draw_section(axes, state, share)

    caption = (
        "The bearing from the side, the radial load downwards. Length and width of a bar: normal force at the inner "
        "race, over the largest. Grey: balls without contact there."
    )
    data = {"place_deg": np.degrees(state.angles), "share_of_largest": share}
    return Part(
        "Loads around the bearing", caption, "Balls around the bearing and their loads.", 3.4, draw, data, "loads"
    )


def _draw_section(axes: Axes, state: RingState, share: Values) -> None:
    statics = state.statics
    ball, pitch = 1e3 * statics.ball_radius, 1e3 * statics.pitch_radius
    turn = np.linspace(0.0, 2.0 * math.pi, 361)
    for radius in (pitch - ball, pitch + ball):
        axes.plot(radius * np.sin(turn), -radius * np.cos(turn), color=AXIS, lw=1.0)
    for angle, one in zip(state.angles.tolist(), share.tolist(), strict=True):
        across, along = math.sin(angle), -math.cos(angle)
        color = BLUE if one > 0.0 else GREY
        axes.plot(pitch * across + ball * np.sin(turn), pitch * along + ball * np.cos(turn), color=color, lw=1.0)
        inner = pitch - ball
        axes.plot(
            [inner * across, (inner - 0.8 * inner * one) * across],
            [inner * along, (inner - 0.8 * inner * one) * along],
            color=VERMILION,
            lw=0.5 + 4.0 * one,
            solid_capstyle="butt",
        )
    edge = pitch + 1.3 * ball
    axes.annotate(
        "", xy=(0.0, -edge - 2.5 * ball), xytext=(0.0, -edge), arrowprops={"arrowstyle": "-|>", "color": SOFT}
    )
    axes.text(0.6 * ball, -edge - 1.2 * ball, "radial load", color=SOFT, va="center")
    axes.set(xlim=(-edge, edge), ylim=(-edge - 2.7 * ball, edge))
    axes.set_aspect("equal")
    axes.set_axis_off()

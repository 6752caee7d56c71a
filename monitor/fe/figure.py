"""A bearing by finite elements beside the analytic answer: contact pressure, load zone, stiffness over a ball pass."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from monitor.report.figures.drawing import BLUE, GREY, VERMILION, legend_above
from monitor.report.figures.sheet import Part, Sheet
from monitor.words.numbers import figure

Values = NDArray[np.float64]

_RACES = (("inner", BLUE), ("outer", VERMILION))
_MARGIN = 1.3
"""What is drawn around the contact, by its width."""


@dataclass(frozen=True, eq=False)
class Pressure:
    """Pressure of a contact, symmetric about its middle, and Hertz's answer under the same force; SI.

    Attributes:
        x, z: edges of the cells from the middle on, along rolling and along the shaft, m, shapes (m + 1,), (n + 1,).
        pressure: Pa, shape (m, n).
        half_width, half_length: of Hertz, m, along rolling and along the shaft.
        peak: pressure in the middle by Hertz, Pa.
        line: whether it is a line contact, whose pressure by Hertz is even along the shaft.
    """

    x: Values
    z: Values
    pressure: Values
    half_width: float
    half_length: float
    peak: float
    line: bool

    def whole(self) -> tuple[Values, Values, Values]:
        """Return edges and pressure of all four quarters."""
        x, z = (np.concatenate([-edges[:0:-1], edges]) for edges in (self.x, self.z))
        half = np.concatenate([self.pressure[::-1], self.pressure])
        return x, z, np.concatenate([half[:, ::-1], half], axis=1)

    @property
    def shown(self) -> tuple[float, float]:
        """Return how far from the middle it is drawn, along rolling and along the shaft, m."""
        pressed = self.pressure > 0.0
        x = max(float(self.x[1:][pressed.any(axis=1)].max(initial=0.0)), self.half_width)
        z = max(float(self.z[1:][pressed.any(axis=0)].max(initial=0.0)), self.half_length)
        return min(_MARGIN * x, float(self.x[-1])), z if self.line else min(_MARGIN * z, float(self.z[-1]))

    def hertz(self, x: Values, z: Values) -> Values:
        """Return Hertz's pressure, Pa, at points."""
        along = np.where(np.abs(z) <= self.half_length, 0.0, 1.0) if self.line else (z / self.half_length) ** 2
        return self.peak * np.sqrt(np.maximum(0.0, 1.0 - (x / self.half_width) ** 2 - along))


@dataclass(frozen=True, eq=False)
class BearingPicture:
    """What is drawn of a bearing under a radial load; of a pair the first is analytic, None if unknown.

    Attributes:
        pressures: of the most loaded element, by race; none where contacts are not kept.
        element_loads: angles from the load, rad, and loads of the elements, N, shape (elements,).
        cage_angle: over one spacing, rad, shape (points,), with stiffness, N/m, shape (points, 2, 2), axis 0 along
            the load.
        loads: radial loads, N, shape (steps,), with mean stiffness, N/m, shape (steps, 2, 2).
    """

    title: str
    lead: str
    facts: Sequence[tuple[str, str]]
    pressures: Mapping[str, Pressure]
    element_loads: tuple[tuple[Values, Values] | None, tuple[Values, Values]]
    cage_angle: Values
    passage: tuple[Values | None, Values]
    loads: Values
    against_load: tuple[Values | None, Values]


def bearing_sheet(shown: BearingPicture) -> Sheet:
    """Return the report of a bearing by finite elements."""
    pressure = [_pressure_part(shown), _profile_part(shown)] if shown.pressures else []
    parts = [*pressure, _zone_part(shown), _passage_part(shown), _load_part(shown)]
    return Sheet(shown.title, shown.lead, parts, shown.facts)


def _pressure_part(shown: BearingPicture) -> Part:
    top = max(float(one.pressure.max()) for one in shown.pressures.values())

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, len(shown.pressures), squeeze=False)[0]
        image = None
        for axes, (race, one) in zip(panels, shown.pressures.items(), strict=True):
            x, z, pressure = one.whole()
            axes.grid(visible=False)
            image = axes.pcolormesh(
                1e3 * z, 1e6 * x, 1e-6 * pressure, cmap="viridis", vmin=0.0, vmax=1e-6 * top, rasterized=True
            )
            _outline(axes, one)
            width, length = 1e6 * one.shown[0], 1e3 * one.shown[1]
            axes.set(xlabel="along the shaft (mm)", ylabel="along rolling (µm)")
            axes.set(xlim=(-length, length), ylim=(-width, width))
            axes.set_title(f"{race} race", loc="left", fontsize=9.5)
        assert image is not None
        made.colorbar(image, ax=list(panels), pad=0.01).set_label("pressure (MPa)")

    caption = (
        "Pressure on the cells of the most loaded element's contacts, one element being under the load. Dashed: "
        "the contact of Hertz under the same force. The scales of both directions differ."
    )
    label = "Contact pressure over both contacts of the most loaded element."
    data = {
        race: {"along_rolling_m": one.x, "along_shaft_m": one.z, "pressure_pa": one.pressure}
        for race, one in shown.pressures.items()
    }
    return Part("Contact pressure", caption, label, 2.9, draw, data, "pressure")


def _outline(axes: Axes, one: Pressure) -> None:
    a, b = 1e3 * one.half_length, 1e6 * one.half_width
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    z, x = (a * np.cos(turn), b * np.sin(turn)) if not one.line else (
        a * np.array([-1.0, 1.0, 1.0, -1.0, -1.0]), b * np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
    )  # fmt: skip
    axes.plot(z, x, color="white", lw=1.2, ls="--")


def _profile_part(shown: BearingPicture) -> Part:
    def draw(made: FigureBase) -> None:
        across, along = made.subplots(1, 2, sharey=True)
        for race, color in _RACES:
            if race not in shown.pressures:
                continue
            one = shown.pressures[race]
            x, z, pressure = one.whole()
            middle = pressure.shape[0] // 2, pressure.shape[1] // 2
            across.stairs(1e-6 * pressure[:, middle[1]], 1e6 * x, color=color, label=f"{race} race")
            along.stairs(1e-6 * pressure[middle[0]], 1e3 * z, color=color)
            fine_x, fine_z = (np.linspace(edges[0], edges[-1], 401) for edges in (x, z))
            across.plot(1e6 * fine_x, 1e-6 * one.hertz(fine_x, 0.0 * fine_x), color=color, ls="--", lw=1.0)
            along.plot(1e3 * fine_z, 1e-6 * one.hertz(0.0 * fine_z, fine_z), color=color, ls="--", lw=1.0)
        ends = [one.shown for one in shown.pressures.values()]
        width, length = 1e6 * max(end[0] for end in ends), 1.02e3 * max(end[1] for end in ends)
        across.set_xlim(-width, width)
        along.set_xlim(-length, length)
        across.plot([], [], color=GREY, ls="--", lw=1.0, label="Hertz")
        across.set(xlabel="along rolling (µm)", ylabel="pressure (MPa)", ylim=(0.0, None))
        along.set(xlabel="along the shaft (mm)")
        legend_above(across, 3)

    caption = "Cuts through the middle of the contacts, each step a cell; dashed: Hertz under the same force."
    label = "Pressure through the middle of both contacts, along rolling and along the shaft, beside that of Hertz."
    return Part("Pressure through the middle", caption, label, 2.5, draw, {}, "profiles")


def _zone_part(shown: BearingPicture) -> Part:
    analytic, (angles, found) = shown.element_loads
    degrees = np.degrees(angles)

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        width = 140.0 / len(degrees)
        axes.bar(degrees, found, width=width, color=BLUE, label="finite elements")
        if analytic is not None:
            outline: Any = {"fill": False, "edgecolor": VERMILION, "lw": 1.4, "label": "analytic, rigid rings"}
            axes.bar(np.degrees(analytic[0]), analytic[1], width=width, **outline)
        axes.set(xlabel="place of an element, from the load (degrees)", ylabel="load (N)", xlim=(-180.0, 180.0))
        axes.set_xticks(range(-180, 181, 60))
        legend_above(axes, 2)

    caption = "The load of each element when one of them is under the radial load."
    data: dict[str, Any] = {"place_deg": degrees, "load_newton": found}
    if analytic is not None:
        data |= {"analytic_place_deg": np.degrees(analytic[0]), "analytic_load_newton": analytic[1]}
    return Part("Load zone", caption, "Loads of the elements around the bearing.", 2.5, draw, data, "zone")


def _passage_part(shown: BearingPicture) -> Part:
    degrees = np.degrees(shown.cage_angle)
    analytic, found = shown.passage

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, 2)
        for axes, place, name in zip(panels, (0, 1), ("along the load, k_yy", "across it, k_xx"), strict=True):
            axes.plot(degrees, 1e-6 * found[:, place, place], color=BLUE, label="finite elements")
            if analytic is not None:
                axes.plot(degrees, 1e-6 * analytic[:, place, place], color=VERMILION, ls="--", label="analytic")
            axes.set(xlabel="cage angle (degrees)", ylabel=f"{name} (MN/m)", xlim=(degrees[0], degrees[-1]))
            axes.ticklabel_format(useOffset=False)
        legend_above(panels[0], 2)

    caption = (
        "Radial stiffness while the cage turns by one spacing of the elements. At angle 0 an element is under the "
        "load, in the middle two are beside it."
    )
    data: dict[str, Any] = {"cage_angle_deg": degrees, "stiffness": found, "analytic_stiffness": analytic}
    return Part("Stiffness over a pass", caption, "Radial stiffness over the cage angle.", 2.7, draw, data, "passage")


def _load_part(shown: BearingPicture) -> Part:
    analytic, found = shown.against_load

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        for place, name, marker in ((0, "k_yy", "o"), (1, "k_xx", "s")):
            axes.plot(
                shown.loads, 1e-6 * found[:, place, place], color=BLUE, marker=marker, ms=4.5,
                label=f"{name}, finite elements",
            )  # fmt: skip
            if analytic is not None:
                axes.plot(
                    shown.loads, 1e-6 * analytic[:, place, place], color=VERMILION, ls="--", marker=marker, ms=4.5,
                    mfc="none", label=f"{name}, analytic",
                )  # fmt: skip
        axes.set_xscale("log")
        axes.set_xticks(shown.loads, [figure(load, 3) for load in shown.loads], minor=False)
        axes.set_xticks([], minor=True)
        axes.set(xlabel="radial load (N)", ylabel="mean stiffness (MN/m)")
        legend_above(axes, 4)

    caption = "Mean stiffness over a pass against the load: k_yy along it, k_xx across."
    data: dict[str, Any] = {"load_newton": shown.loads, "stiffness": found, "analytic_stiffness": analytic}
    return Part(
        "Stiffness against the load", caption, "Mean radial stiffness over the load.", 2.6, draw, data, "against-load"
    )

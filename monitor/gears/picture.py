"""``spallwatch gear --plot``: what is drawn of a train."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.patches import Circle
from numpy.typing import NDArray

from monitor.commands.common import output_errors
from monitor.gears.forces import GearRun
from monitor.report.figures.drawing import AXIS, BLUE, GREEN, INK, ORANGE, PURPLE, SKY, SOFT, VERMILION, legend_above
from monitor.report.figures.sheet import Part, Sheet

Array = NDArray[np.float64]

MAX_SHOWN = 6
"""Most shafts, or outputs, that are drawn."""
_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
_PERIODS, _HARMONICS = 4.0, 8.5
_DECADES, _RANGE_DB = 4.0, 80.0


@dataclass(frozen=True)
class DrawnWheel:
    """A wheel in the plane of its train: centre and pitch radius, m, and what is written beside it."""

    name: str
    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class DrawnForce:
    """A mean force on the bearings of a shaft: where, m, and how large, N."""

    x: float
    y: float
    force: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Levels:
    """Third-octave levels, dB, by name of an output; ``bands`` are the nominal frequencies, Hz."""

    heading: str
    unit: str
    bands: Sequence[float]
    levels: Mapping[str, Sequence[float | None]]


@dataclass(frozen=True, eq=False)
class GearPicture:
    """What is drawn of a train.

    Attributes:
        title, lead: of the sheet.
        wheels, forces: of the layout.
        stiffness: over one pitch, N/m, by name of the mesh.
        shafts: varying force of all its bearings along their mean force, N, (N,), by name of the shaft.
        rate: of the forces, Hz.
        meshes: mesh frequencies, Hz.
        modes: natural frequencies, Hz.
        levels: of the casing and of the air.
    """

    title: str
    lead: str
    wheels: Sequence[DrawnWheel]
    forces: Sequence[DrawnForce]
    stiffness: Mapping[str, Array]
    shafts: Mapping[str, Array]
    rate: float
    meshes: Sequence[float]
    modes: Sequence[float]
    levels: Sequence[Levels] = field(default=())

    @property
    def shown(self) -> dict[str, Array]:
        """The shafts that are drawn: those with the highest varying force."""
        loudest = sorted(self.shafts, key=lambda name: -float(self.shafts[name].std()))[:MAX_SHOWN]
        return {name: force for name, force in self.shafts.items() if name in loudest}


def gear_sheet(picture: GearPicture) -> Sheet:
    """Return the report of a train."""
    parts = [_layout(picture), _stiffness(picture), _forces(picture), _spectra(picture)]
    parts += [_levels(levels) for levels in picture.levels]
    modes = ", ".join(f"{value:.5g}" for value in picture.modes)
    meshes = ", ".join(f"{value:.5g}" for value in dict.fromkeys(picture.meshes))
    return Sheet(
        picture.title, picture.lead, parts, [("Mesh frequencies, Hz", meshes), ("Natural frequencies, Hz", modes)]
    )


def _layout(picture: GearPicture) -> Part:
    largest = max((math.hypot(*one.force) for one in picture.forces), default=0.0)
    width = max(wheel.x + wheel.radius for wheel in picture.wheels) - min(w.x - w.radius for w in picture.wheels)
    height = max(wheel.y + wheel.radius for wheel in picture.wheels) - min(w.y - w.radius for w in picture.wheels)

    def draw(made: FigureBase) -> None:
        axes: Axes = made.subplots()
        for colour, wheel in zip(_cycle(len(picture.wheels)), picture.wheels, strict=True):
            place = (1e3 * wheel.x, 1e3 * wheel.y)
            axes.add_patch(Circle(place, 1e3 * wheel.radius, fill=False, color=colour, lw=1.4))
            axes.plot(*place, "+", color=AXIS, ms=6)
            above = (place[0], place[1] + 1e3 * wheel.radius)
            axes.annotate(wheel.name, above, (0, 4), textcoords="offset points", ha="center", va="bottom", color=colour)
        for one in picture.forces if largest > 0.0 else ():
            scale = 0.8 * max(wheel.radius for wheel in picture.wheels) / largest
            tip = (one.x + scale * one.force[0], one.y + scale * one.force[1])
            axes.annotate(
                "",
                (1e3 * tip[0], 1e3 * tip[1]),
                (1e3 * one.x, 1e3 * one.y),
                arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.2},
            )
            axes.annotate(
                f"{math.hypot(*one.force):,.0f} N",
                (1e3 * tip[0], 1e3 * tip[1]),
                (0, -4 if one.force[1] < 0.0 else 4),
                textcoords="offset points",
                color=SOFT,
                fontsize=8,
                ha="center",
                va="top" if one.force[1] < 0.0 else "bottom",
            )
        axes.set_aspect("equal")
        axes.margins(0.12)
        axes.autoscale_view()
        axes.set(xlabel="x (mm)", ylabel="y (mm)")

    caption = "Circles through the pitch points. Arrows: mean force of each shaft on the casing, at one scale."
    label = f"Layout of {len(picture.wheels)} wheels with the mean forces of their shafts."
    data = {
        "wheel": [wheel.name for wheel in picture.wheels],
        "x_mm": [1e3 * wheel.x for wheel in picture.wheels],
        "y_mm": [1e3 * wheel.y for wheel in picture.wheels],
    }
    tall = float(np.clip(8.0 * height / max(width, 1e-9), 2.2, 3.4))
    return Part("The train", caption, label, tall, draw, data, "layout")


def _stiffness(picture: GearPicture) -> Part:
    def draw(made: FigureBase) -> None:
        axes: Axes = made.subplots()
        for colour, (name, course) in zip(_cycle(len(picture.stiffness)), picture.stiffness.items(), strict=True):
            whole = np.append(course, course[0])
            axes.plot(np.linspace(0.0, 1.0, whole.size), whole / 1e6, color=colour, label=name)
        axes.set(xlabel="pitch", ylabel="stiffness (MN/m)", xlim=(0.0, 1.0))
        axes.set_ylim(0.0, None)
        legend_above(axes)

    data = {f"stiffness_{name}_newton_per_m": course for name, course in picture.stiffness.items()}
    caption = "Along the line of action, of sound teeth over one pitch, from where a tooth begins its mesh."
    return Part("Mesh stiffness", caption, "Mesh stiffness over a pitch.", 1.9, draw, data, "stiffness")


def _forces(picture: GearPicture) -> Part:
    length = min(next(iter(picture.shafts.values())).size, math.ceil(_PERIODS * picture.rate / min(picture.meshes)) + 1)

    def draw(made: FigureBase) -> None:
        axes: Axes = made.subplots()
        time = 1e3 * np.arange(length) / picture.rate
        for colour, (name, force) in zip(_COLOURS, picture.shown.items(), strict=False):
            axes.plot(time, force[:length], color=colour, lw=1.0, label=name)
        axes.set(xlabel="time (ms)", ylabel="force about its mean (N)", xlim=(0.0, time[-1]))
        legend_above(axes)

    caption = (
        f"Of the bearings of a shaft on the casing, along their mean force; {_PERIODS:g} periods of the slowest mesh."
    )
    if len(picture.shafts) > MAX_SHOWN:
        caption += f" The {MAX_SHOWN} of {len(picture.shafts)} shafts with the highest."
    data = {f"force_{name}_newton": force[:length] for name, force in picture.shown.items()}
    return Part("Varying forces", caption, "Forces of the shafts over time.", 2.3, draw, data, "forces")


def _spectra(picture: GearPicture) -> Part:
    highest_hz = min(_HARMONICS * max(picture.meshes), 0.5 * picture.rate)
    spectra: dict[str, tuple[Array, Array]] = {}
    for name, force in picture.shown.items():
        window = np.hanning(force.size + 1)[:-1]
        amplitude = np.asarray(2.0 / window.sum() * np.abs(np.fft.rfft((force - force.mean()) * window)), np.float64)
        frequency = np.asarray(np.fft.rfftfreq(force.size, 1.0 / picture.rate), np.float64)
        seen = frequency <= highest_hz
        spectra[name] = (frequency[seen], amplitude[seen])
    top = max(float(amplitude.max(initial=0.0)) for _, amplitude in spectra.values())

    def draw(made: FigureBase) -> None:
        axes: Axes = made.subplots()
        for colour, (name, (frequency, amplitude)) in zip(_COLOURS, spectra.items(), strict=False):
            axes.plot(frequency, amplitude, color=colour, lw=0.9, label=name)
        for mode in picture.modes:
            if 0.0 < mode < highest_hz:
                axes.axvline(mode, color=AXIS, lw=0.7, ls=":", zorder=0)
        axes.set(xlabel="frequency (Hz)", ylabel="amplitude (N)", xlim=(0.0, highest_hz), yscale="log")
        if top > 0.0:
            axes.set_ylim(top * 10.0**-_DECADES, 2.0 * top)
        legend_above(axes)

    caption = "Spectra of the same forces over the whole time, Hann window. Dotted: natural frequencies."
    data: dict[str, Any] = {}
    for name, (frequency, amplitude) in spectra.items():
        data |= {f"frequency_{name}_hz": frequency, f"amplitude_{name}_newton": amplitude}
    return Part("Spectra of the forces", caption, "Spectra of the forces of the shafts.", 2.4, draw, data, "spectra")


def _levels(levels: Levels) -> Part:
    shown = dict(list(levels.levels.items())[:MAX_SHOWN])
    values = [value for row in shown.values() for value in row if value is not None]

    def draw(made: FigureBase) -> None:
        axes: Axes = made.subplots()
        places, width = np.arange(len(levels.bands)), 0.8 / max(len(shown), 1)
        floor = math.floor(max(min(values, default=0.0), max(values, default=0.0) - _RANGE_DB) / 10.0) * 10.0 - 5.0
        for number, (colour, (name, row)) in enumerate(zip(_COLOURS, shown.items(), strict=False)):
            heights = [0.0 if value is None else max(value - floor, 0.0) for value in row]
            axes.bar(places + (number + 0.5) * width - 0.4, heights, width, floor, color=colour, label=name)
        axes.set_xticks(places, [f"{band:g}" for band in levels.bands], rotation=45 if len(levels.bands) > 16 else 0)
        axes.set(xlabel="third octave (Hz)", ylabel=levels.unit)
        axes.set_ylim(floor, None)
        legend_above(axes)

    caption = f"Third octaves that lie within the responses, down to {_RANGE_DB:g} dB below the highest."
    if len(levels.levels) > MAX_SHOWN:
        caption += f" The first {MAX_SHOWN} of {len(levels.levels)}."
    data: dict[str, Any] = {"band_hz": list(levels.bands)}
    data |= {f"level_{name}_db": list(row) for name, row in shown.items()}
    name = levels.heading.lower().replace(" ", "_")
    return Part(levels.heading, caption, f"{levels.heading} in third octaves.", 2.2, draw, data, name)


def _cycle(count: int) -> list[str]:
    return [_COLOURS[number % len(_COLOURS)] for number in range(count)]


Array = NDArray[np.float64]

if TYPE_CHECKING:
    from monitor.gears.picture import GearPicture


def draw_gears(run: GearRun, values: dict[str, Any], name: str, path: Path) -> None:
    """Draw a train, its forces and its levels.

    Args:
        run: its motion.
        values: what the command prints.
        name: of the machine or the file.
        path: PNG, SVG or HTML.

    Raises:
        InputError: the file cannot be written.
    """
    from monitor.gears.picture import gear_sheet
    from monitor.report.figures.sheet import write_sheet

    with output_errors("--plot", path):
        write_sheet(gear_sheet(gear_picture(run, values, name)), path)


def gear_picture(run: GearRun, values: dict[str, Any], name: str) -> GearPicture:
    """Return what is drawn."""
    from monitor.gears.picture import DrawnForce, DrawnWheel, GearPicture, Levels

    centres = shaft_centres(run)
    at, radius = run.builder.gear.shaft_of, _pitch_radii(run)
    levels: list[Levels] = []
    if (casing := values["casing"]) is not None:
        rows = {one["name"]: one["bands_db"] for one in casing["outputs"]}
        levels.append(Levels("Acceleration of the casing", "level (dB re 1 µm/s²)", casing["bands_hz"], rows))
    if (sound := values["sound"]) is not None:
        rows = {one["name"]: one["bands_dba"] for one in sound["microphones"]}
        levels.append(Levels("Sound", "level (dB(A) re 20 µPa)", sound["bands_hz"], rows))
    train = values["train"]
    faults = "; ".join(train["faults"]) or "healthy"
    return GearPicture(
        title=f"{name}: gear train at {train['torque_newton_m']:.4g} N m, {train['power_kw']:.4g} kW",
        lead=f"{faults}; {train['status'].replace('_', ' ')}, {train['duration_s']:.3g} s.",
        wheels=[
            DrawnWheel(
                f"{wheel.name} ({wheel.teeth})",
                centres[at[wheel.name]].real,
                centres[at[wheel.name]].imag,
                radius[wheel.name],
            )
            for wheel in run.builder.gear.wheel
        ],
        forces=[
            DrawnForce(centre.real, centre.imag, (float(total[:, 0].mean()), float(total[:, 1].mean())))
            for shaft, centre in centres.items()
            if (total := _force_of(run, shaft)) is not None
        ],
        stiffness={mesh.name: mesh.stiffness.base for mesh in run.train.meshes},
        shafts={
            shaft: _along_mean(total)
            for shaft in run.builder.gear.shafts
            if (total := _force_of(run, shaft)) is not None
        },
        rate=run.motion.rate,
        meshes=list(run.train.mesh_frequencies().values()),
        modes=train["natural_frequencies_hz"],
        levels=levels,
    )


def shaft_centres(run: GearRun) -> dict[str, complex]:
    """Return the axes of the shafts with wheels in their plane, x + iy, m; the first at 0.

    Shafts that no mesh joins to those before begin beside the origin.
    """
    at = run.builder.gear.shaft_of
    found: dict[str, complex] = {at[run.builder.gear.pair[0].wheels[0]]: 0j}
    waiting = list(run.builder.pairs)
    while waiting:
        for model in waiting:
            first, second = (at[name] for name in model.section.wheels)
            arm = cmath.rect(model.distance, math.radians(model.section.direction_deg))
            if first in found or second in found:
                if first in found:
                    found.setdefault(second, found[first] + arm)
                else:
                    found[first] = found[second] - arm
                waiting.remove(model)
                break
        else:
            found[at[waiting[0].section.wheels[0]]] = 0j
    return found


def _pitch_radii(run: GearRun) -> dict[str, float]:
    return {
        name: radius / math.cos(model.working_angle)
        for model in run.builder.pairs
        for name, radius in zip(model.section.wheels, model.base_radii, strict=True)
    }


def _force_of(run: GearRun, shaft: str) -> Array | None:
    """Return the force of all bearings of a shaft on the casing, N, (N, 2), None where it has none."""
    forces = [run.forces[support.name] for support in run.builder.gear.support if support.shaft == shaft]
    return np.sum(forces, axis=0) if forces else None


def _along_mean(force: Array) -> Array:
    mean = force.mean(axis=0)
    size = float(np.linalg.norm(mean))
    unit = mean / size if size > 0.0 else np.array([1.0, 0.0])
    return np.asarray((force - mean) @ unit, dtype=np.float64)

"""A simulated scene as a report: the signal, the path of the element over the damage, and the spectrum."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from models.machine.hertz import mean_bearing_stiffness
from models.machine.rig import Rig, RigParameters, natural_frequencies
from models.machine.scene import EFFECTS, Defect, Floor, Scene
from models.path.contour import part_paths
from models.solve.engine.motion import Trajectories
from models.solve.response import Response, SignalRecord
from models.words.request import Sensor
from monitor.report.figures.drawing import AXIS, BLUE, GREY, INK, PURPLE, SHADE, SOFT, VERMILION, legend_above
from monitor.report.figures.sheet import Part, Sheet
from monitor.words.calibration import rig_words
from monitor.words.numbers import figure
from monitor.words.sensors import MEASURED, PLACES, data_name, unit_of_sensor

_MICROMETRES = 1e6
# Free space around an orbit, over its extent; largest clearance that is shown whole, over the extent.
_MARGIN, _WHOLE_CIRCLE = 0.08, 12.0
# Points of an orbit in the data of a page.
_DATA_POINTS = 1500


def orbit_part(speed: float, moved: Trajectories) -> Part:
    """Return the orbits of the points of a shaft that turns at ``speed``, Hz."""
    turns = moved.step * moved.place.shape[2] * speed

    def draw(made: FigureBase) -> None:
        panels = np.atleast_1d(made.subplots(1, len(moved.points)))
        for number, axes in enumerate(panels):
            draw_orbit(axes, moved, number, speed)
            axes.set_title(f"{moved.points[number].upper()}, {PLACES[moved.points[number]]}", loc="left", fontsize=9.5)
        panels[0].set_ylabel("along the load (µm)")

    travel = _MICROMETRES * moved.travel()
    named = zip(moved.points, travel, strict=True)
    words = "; ".join(f"{point.upper()} {figure(along)} x {figure(across)} µm" for point, (along, across) in named)
    caption = (
        f"{figure(turns, 2)} turns of the shaft, from the load (downwards) to the right; a dot for each turn. "
        f"Travel along and across the load: {words} (steps: {figure(100.0 * moved.error, 2)} % of the largest)."
    )
    if not all(math.isnan(free) for free in moved.clearance):
        caption += " Circle: the radial clearance, beyond which balls are pressed."
    every = max(1, moved.place.shape[2] // _DATA_POINTS)
    data: dict[str, Any] = {"clearance_um": [_MICROMETRES * free for free in moved.clearance]}
    for point, (along, across) in zip(moved.points, moved.place[:, :, ::every], strict=True):
        data |= {f"along_{point}_um": _MICROMETRES * along, f"across_{point}_um": _MICROMETRES * across}
    label = f"Orbits of {len(moved.points)} points of the shaft: {words}."
    return Part("Orbits", caption, label, 3.3, draw, data, "orbits")


def draw_orbit(axes: Axes, moved: Trajectories, number: int, speed: float) -> None:
    """Draw the orbit of a point, µm, with equal axes: the load points downwards, across it to the right."""
    along, across = _MICROMETRES * moved.place[number]
    free = _MICROMETRES * moved.clearance[number]
    axes.plot(across, along, color=BLUE, lw=0.6)
    turns = np.arange(0.0, moved.place.shape[2], 1.0 / (speed * moved.step)).astype(np.intp)
    axes.plot(across[turns], along[turns], ".", color=VERMILION, ms=4.0)
    reach = 0.5 * max(float(np.ptp(across)), float(np.ptp(along)), 1e-3)
    middle = np.array([0.5 * (across.max() + across.min()), 0.5 * (along.max() + along.min())])
    if 0.0 < free < _WHOLE_CIRCLE * reach:
        angle = np.linspace(0.0, 2.0 * math.pi, 361)
        axes.plot(free * np.cos(angle), free * np.sin(angle), color=GREY, lw=0.9, ls="--")
        low = np.minimum(middle - reach, -free)
        high = np.maximum(middle + reach, free)
        reach, middle = 0.5 * float(np.max(high - low)), 0.5 * (low + high)
        axes.plot(0.0, 0.0, "+", color=AXIS, ms=6)
    reach *= 1.0 + _MARGIN
    axes.set(
        xlim=(middle[0] - reach, middle[0] + reach),
        # Downwards, as the load.
        ylim=(middle[1] + reach, middle[1] - reach),
        xlabel="across it (µm)",
    )
    axes.set_aspect("equal", adjustable="box")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5))


Values = NDArray[np.float64]
_PASSAGES = 4
_RATE = 204800.0
_HIGHEST = 12000.0
_ZOOM = 2000.0
_PATH_POINTS = 1201
# Deeper than any ball sinks between two edges, m.
_NO_FLOOR = 1.0
# Lines below this share of the largest are invisible in a picture.
_UNSEEN = 2e-4


@dataclass(frozen=True, eq=False)
class SensorSignal:
    """What a sensor shows over time (s), m/s2 or rad/s, and the amplitudes of its spectrum up to 12 kHz.

    Attributes:
        periodic: whether the spectrum has lines at multiples of BPFO only.
        rms: from the model.
        status: of the simulation.
        model: which model answered, and how it was solved.
        band: of the RMS, Hz, None for full bandwidth.
    """

    time: Values
    signal: Values
    frequency: Values
    amplitude: Values
    periodic: bool
    rms: float
    status: str
    model: str
    band: tuple[float, float] | None = None


def signal_of(response: Response, sensor: Sensor, fundamental: float) -> SensorSignal:
    """Return four ball periods and the lines of a periodic motion; of any other four passages and the spectrum.

    ``fundamental`` is the passage frequency of the damage, Hz.
    """
    if response.record is not None:
        return _over_time(response, response.record, sensor, fundamental)
    signal = response.acceleration(_RATE, _PASSAGES / response.bpfo, sensor=sensor)
    return _sensed(response, sensor, np.arange(signal.size) / _RATE, signal, *response.all_lines(sensor))


def _over_time(response: Response, record: SignalRecord, sensor: Sensor, fundamental: float) -> SensorSignal:
    """Return four passages about the maximum and the spectrum (Hann window) of a motion that is not periodic."""
    whole = record.of(sensor)
    window = np.hanning(whole.size)
    amplitude = 2.0 * np.abs(np.fft.rfft(whole * window)) / np.sum(window)
    frequency = np.arange(amplitude.size, dtype=np.float64) * (record.rate / whole.size)
    # About the maximum: a damaged ball gives a signal only while it carries load.
    samples = min(whole.size, math.ceil(_PASSAGES * record.rate / fundamental))
    first = min(max(0, int(np.argmax(np.abs(whole))) - samples // 2), whole.size - samples)
    few = slice(first, first + samples)
    return _sensed(response, sensor, np.arange(whole.size)[few] / record.rate, whole[few], frequency, amplitude)


def _sensed(
    response: Response, sensor: Sensor, time: Values, signal: Values, frequency: Values, amplitude: Values
) -> SensorSignal:
    shown = (frequency > 0.0) & (frequency <= _HIGHEST)
    return SensorSignal(
        time,
        signal,
        frequency[shown],
        amplitude[shown],
        periodic=response.record is None,
        rms=response.levels_of(sensor)[0],
        status=response.status,
        model=f"{response.model}, {response.solver.replace('_', ' ')}",
        band=response.rms_band,
    )


def scene_sheet(
    scene: Scene, sensed: SensorSignal, *, sensor: Sensor, title: str, moved: Trajectories | None = None
) -> Sheet:
    """Return the report of a scene (thesis, Figs. 47, 48 and 53), with the orbits of its shaft where they are given."""
    place = PLACES[sensor]
    band = "over full bandwidth" if sensed.band is None else f"in {sensed.band[0]:g} to {sensed.band[1]:g} Hz"
    one, unit = unit_of_sensor(sensor, sensed.status)
    lead = f"RMS {figure(sensed.rms / one)} {unit} {band} on the {place} ({sensed.status.replace('_', ' ')})."
    parts = [_signal_part(scene, sensed, sensor)]
    # Only this model has its balls follow the contour of the defect.
    if isinstance(scene.rig, Rig):
        parts += [_path_part(scene, defect, number) for number, defect in enumerate(scene.defects)]
    parts.append(_spectrum_part(scene, sensed, sensor))
    parts += [] if moved is None else [orbit_part(scene.speed, moved)]
    return Sheet(title, lead, parts, _facts(scene, sensed))


def fundamental_of(scene: Scene) -> tuple[float, str]:
    """Return the passage frequency of the damage (Hz) and its name; for a healthy bearing BPFO."""
    lines = kinematics(scene.bearing, scene.speed)
    names = {"outer": (lines.bpfo, "BPFO"), "inner": (lines.bpfi, "BPFI"), "ball": (2.0 * lines.bsf, "twice BSF")}
    return names[scene.first_part]


def passages(scene: Scene, until: float) -> list[tuple[float, float]]:
    """Return begin and end (s) of each passage of a ball through the defect of the outer race until a time (s).

    At time zero a ball of the first row is at the load; the next rows are ahead by equal shares of the ball spacing.
    Empty for a motion that is not periodic, where the phase of the cage is unknown.
    """
    defect = scene.defect
    if defect is None or defect.part != "outer" or len(scene.defects) > 1 or not scene.repeats:
        return []
    lines = kinematics(scene.bearing, scene.speed)
    period, omega = 1.0 / lines.bpfo, 2.0 * math.pi * lines.ftf
    half = 0.5 * defect.dphi_d / omega
    found = []
    for row in range(defect.first_row, defect.first_row + defect.rows):
        first = defect.position / omega - row * period / scene.bearing.rows
        begin = math.floor((-half - first) / period)
        middles = [first + k * period for k in range(begin, begin + math.ceil((until + 2 * half) / period) + 2)]
        found += [(m - half, m + half) for m in middles if m + half > 0.0 and m - half < until]
    return sorted(found)


def resonances(scene: Scene) -> Values:
    """Return the natural frequencies of the rig along the load, Hz, with the mean stiffness of the healthy bearing.

    Empty for other models than the six-degree-of-freedom one.
    """
    if not isinstance(scene.rig, Rig):
        return np.empty(0)
    rig = scene.rig
    k_b = mean_bearing_stiffness(scene.bearing, scene.load, rig.k_c, clearance=scene.clearance)[0, 0]
    # Both directions are alike, so that every frequency appears twice.
    return natural_frequencies(rig, float(k_b), float(k_b))[::2]


def ways(scene: Scene, defect: Defect) -> dict[str, tuple[Values, Values]]:
    """Return the paths of an element over the damage by name: angles (degrees) and depths (µm).

    A rough floor comes with the smooth one; a defect of the ball has a path over each race.
    """
    found: dict[str, tuple[Values, Values]] = {}
    rough = defect.floor.kind == "rough"
    floors = {"rough floor": defect.floor, "smooth floor": Floor()} if rough else {"": defect.floor}
    races = ("outer race", "inner race") if defect.part == "ball" else ("",)
    for name, floor in floors.items():
        for race, path in zip(races, part_paths(scene.bearing, replace(defect, floor=floor)), strict=False):
            x = np.linspace(-0.6, 0.6, _PATH_POINTS) * defect.dphi_d
            centre = defect.position if race != "inner race" else defect.position + math.pi
            words = " on the ".join(word for word in (name, race) if word)
            found[words or "way of the ball"] = (np.degrees(x), 1e6 * path(x + centre)[0])
    return found


def _signal_part(scene: Scene, sensed: SensorSignal, sensor: Sensor) -> Part:
    one, unit = unit_of_sensor(sensor, sensed.status)
    quantity = MEASURED[sensor]
    since, until = float(sensed.time[0]), float(sensed.time[-1])
    # What was recorded begins after the motion settled, wherever the cage is then.
    marked = passages(scene, until) if sensed.periodic else []
    _, name = fundamental_of(scene)

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        for begin, end in marked:
            axes.axvspan(1e3 * max(begin, 0.0), 1e3 * min(end, until), color=SHADE, lw=0)
            for edge in (begin, end):
                axes.axvline(1e3 * edge, color=AXIS, lw=0.6)
        axes.plot(1e3 * sensed.time, sensed.signal / one, color=BLUE, lw=0.9)
        axes.set(xlabel="time (ms)", ylabel=f"{quantity} ({unit})", xlim=(1e3 * since, 1e3 * until))

    caption = f"The time of {_PASSAGES} passages ({name}){'' if sensed.periodic else ', about the loudest moment'}."
    if marked:
        caption += " Shaded: a ball is between the edges of the defect."
    data = {
        "time_ms": 1e3 * sensed.time[::4],
        data_name(quantity, unit): sensed.signal[::4] / one,
        "passage_begin_ms": [1e3 * begin for begin, _ in marked],
        "passage_end_ms": [1e3 * end for _, end in marked],
    }
    peak = float(np.max(np.abs(sensed.signal))) / one
    label = f"{quantity.capitalize()} over {_PASSAGES} passages, peak {figure(peak)} {unit}."
    return Part("Signal of the sensor", caption, label, 2.5, draw, data, "signal")


def _path_part(scene: Scene, defect: Defect, number: int) -> Part:
    drawn = ways(scene, defect)
    heading, name = ("The way over the damage", "way") if number == 0 else (f"Defect {number + 1}", f"way_{number + 1}")

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        for stroke, (name, (x, y)) in zip(("-", "-.", "--", ":"), drawn.items(), strict=False):
            axes.plot(x, y, color=INK if stroke == "-" else VERMILION, ls=stroke, label=name)
        axes.axhline(0.0, color=AXIS, lw=0.7)
        axes.set(xlabel="angle from the middle of the defect (degrees)", ylabel="sunk (µm)")
        axes.invert_yaxis()
        if len(drawn) > 1:
            legend_above(axes)

    deepest = _deepest(drawn)
    floorless = _deepest(ways(scene, replace(defect, h_d=_NO_FLOOR, floor=Floor())))
    reached = floorless > 1e6 * defect.h_d * math.cos(scene.bearing.contact_angle)
    caption = (
        f"How far the ball sinks over the damage, radially: {figure(deepest)} µm at most; its floor lies "
        f"{figure(1e6 * defect.h_d)} µm deep, which it {'touches' if reached else 'does not reach'}."
    )
    data: dict[str, Any] = {}
    for n, (way, (x, y)) in enumerate(drawn.items(), start=1):
        data |= {f"way_{n}": way, f"angle_{n}_deg": x[::4], f"sunk_{n}_um": y[::4]}
    label = f"Depth to which the ball sinks over the damage, {figure(deepest)} µm at most."
    return Part(heading, caption, label, 2.1, draw, data, name)


def _deepest(found: Mapping[str, tuple[Values, Values]]) -> float:
    """Return the largest depth of :func:`ways`, µm."""
    return max((float(y.max()) for _, y in found.values()), default=0.0)


def _spectrum_part(scene: Scene, sensed: SensorSignal, sensor: Sensor) -> Part:
    one, unit = unit_of_sensor(sensor, sensed.status)
    fundamental, name = fundamental_of(scene)
    modes = resonances(scene)

    def draw(made: FigureBase) -> None:
        panels = made.subplots(2, 1)
        for axes, top in zip(panels, (_HIGHEST, _ZOOM), strict=True):
            show_spectrum(axes, sensed, (0.0, top), modes, sensor)
        panels[-1].set_xlabel("frequency (Hz)")
        _mark_lines(panels[-1], fundamental, name)
        legend_above(panels[0])

    kind = f"lines at multiples of BPFO, {figure(fundamental)} Hz" if sensed.periodic else "amplitudes, Hann window"
    words = ", ".join(f"{mode:,.0f}" for mode in modes)
    dotted = f"; dotted: natural frequencies of the undamped rig along the load, {words} Hz" if len(modes) else ""
    caption = f"Above: {kind}{dotted}. Below: the same up to {_ZOOM:g} Hz; ticks at the top: multiples of {name}."
    seen = sensed.amplitude > _UNSEEN * max(float(sensed.amplitude.max(initial=0.0)), 1e-30)
    data = {
        "frequency_hz": sensed.frequency[seen],
        data_name("amplitude", unit): sensed.amplitude[seen] / one,
        "resonance_hz": modes,
        "fundamental_hz": fundamental,
    }
    label = f"Spectrum up to 12 kHz{f' with resonances at {words} Hz' if len(modes) else ''}."
    return Part("Spectrum", caption, label, 4.2, draw, data, "spectrum")


def show_spectrum(
    axes: Axes, sensed: SensorSignal, band: tuple[float, float], modes: Sequence[float] | Values, sensor: Sensor = "mo"
) -> None:
    """Draw the part of a spectrum within a band, Hz, in the unit of a sensor, with natural frequencies dotted."""
    one, unit = unit_of_sensor(sensor, sensed.status)
    inside = (sensed.frequency >= band[0]) & (sensed.frequency <= band[1])
    x, y = sensed.frequency[inside], sensed.amplitude[inside] / one
    if sensed.periodic:
        axes.vlines(x, 0.0, y, color=PURPLE, lw=1.3)
    else:
        axes.plot(x, y, color=PURPLE, lw=0.7)
    for number, mode in enumerate(mode for mode in modes if band[0] <= mode <= band[1]):
        axes.axvline(mode, color=GREY, lw=1.0, ls=":", label="" if number else "natural frequency")
    axes.set(xlim=band, ylim=(0.0, None), ylabel=f"amplitude ({unit})")


def _mark_lines(axes: Axes, fundamental: float, name: str) -> None:
    scales = (lambda frequency: frequency / fundamental, lambda multiple: multiple * fundamental)
    top = axes.secondary_xaxis("top", functions=scales)
    top.set_xticks(range(1, math.floor(_ZOOM / fundamental) + 1))
    top.tick_params(labelsize=7.5, colors=SOFT, length=2)
    top.set_xlabel(f"multiple of {name}", fontsize=8, color=SOFT)


def _rig_facts(rig: RigParameters) -> list[tuple[str, str]]:
    if not isinstance(rig, Rig):
        values = {name: value for name, value in rig.as_dict().items() if value is not None}
        words = (f"{n} {v:.6g}" if isinstance(v, float) else f"{n} {v}" for n, v in values.items())
        return [("Parameters, SI", ", ".join(words))]
    masses = ", ".join(f"m_{name} {getattr(rig, f'm_{name}'):g} kg" for name in ("i", "o", "r"))
    return [
        ("Rig", f"{rig_words(rig)}; {masses}"),
        ("Stiffness", f"k_i {rig.k_i:.3g} N/m, k_r {rig.k_r:.3g} N/m, k_c {rig.k_c:.4g} N/m^1.5"),
        ("Damping", f"c_i {rig.c_i:g} N s/m, c_r {rig.c_r:g} N s/m, α_c {rig.alpha_c:g} 1/s, β_c {rig.beta_c:g} s"),
    ]


def _facts(scene: Scene, sensed: SensorSignal) -> list[tuple[str, str]]:
    lines = kinematics(scene.bearing, scene.speed)
    named = (("BPFO", lines.bpfo), ("BPFI", lines.bpfi), ("BSF", lines.bsf), ("FTF", lines.ftf))
    return [
        ("Bearing", f"{scene.bearing.designation}, clearance {figure(1e6 * scene.clearance)} µm"),
        ("Lines", ", ".join(f"{name} {figure(value, 4)} Hz" for name, value in named)),
        *_rig_facts(scene.rig),
        ("Effects", ", ".join(EFFECTS[name] for name in scene.effects) or "none"),
        ("Model", sensed.model),
    ]

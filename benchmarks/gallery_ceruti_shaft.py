"""Figures of the gallery from Ceruti's rotor: statics, elastic shaft, unbalance, other faults, length of the shaft."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator

from benchmarks.gallery_ceruti_runs import (
    HALF,
    HIGH,
    LINES,
    SENSORS,
    UNIT,
    bent,
    draw_signals,
    envelopes,
    levels,
    lines_of,
    lumped,
    multiples,
    of,
    peak,
    signals,
)
from benchmarks.gallery_plate import Claim, Plate, letter, number, words
from benchmarks.gallery_spectra import is_multiple, kept_lines, panels_of_lines
from models.machine.bearing import from_catalogue
from models.machine.hertz import element_angles, static_equilibrium
from models.machine.load_distribution import ring_approach
from models.machine.scene import Scene
from models.published.ceruti import SPEED, damaged, rotor
from models.solve.rotor import elastic as rotor_elastic
from models.solve.rotor import solver as rigid_rotor
from models.solve.rotor.rig import RotorRig
from models.solve.trajectories import Trajectories
from models.words.request import Request
from monitor.report.figures.drawing import BLUE, GREEN, INK, VERMILION
from monitor.report.figures.scene import draw_orbit

ECCENTRICITIES = (0.0, 1e-5, 1e-4)
"""Of sections 6.5.1 and 6.5.2, m."""
_LENGTHS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8)


# Section 2.3: the contacts of one bearing.


def _displacements() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return loads, N, and the displacements beyond the clearance by the sum over balls and by the integral, m."""
    bearing, k_c, free = from_catalogue("6305"), RotorRig.k_c, HALF.clearance
    loads = np.concatenate(([1.0, 10.0], np.linspace(50.0, 2000.0, 40)))
    angles = element_angles(bearing)
    discrete = [static_equilibrium(angles, float(load), k_c, clearance=free)[0] - free for load in loads]
    integral = [ring_approach(bearing, float(load), k_c, free) - free for load in loads]
    return loads, np.array(discrete), np.array(integral)


def figure_27() -> Plate:
    """Return the load over the displacement of the ring, discrete and continuous."""
    loads, discrete, integral = _displacements()
    apart = np.abs(integral / discrete - 1.0)[loads >= 100.0]

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(1e6 * discrete, loads, color=BLUE, label="sum over the balls, one at the load")
        axes.plot(1e6 * integral, loads, color=VERMILION, ls="--", label="integral (Sjövall)")
        axes.set(xlabel="displacement beyond the clearance (µm)", ylabel="radial load (N)", ylim=(0.0, None))
        axes.legend(loc="upper left")

    claims = [words("both agree (within 5 % from 100 N on)", [bool(np.all(apart < 0.05))])]
    caption = "Radial load of the 6305 over the displacement of its ring, clearance 11.3 µm."
    data = {"load_newton": loads, "discrete_um": 1e6 * discrete, "integral_um": 1e6 * integral}
    return Plate(caption, "Load over displacement.", 2.8, draw, data, claims)


def figure_28() -> Plate:
    """Return the stiffness of the bearing over the displacement of its ring."""
    loads, discrete, _ = _displacements()
    stiffness = 1e-3 * np.diff(loads) / np.diff(discrete)
    middle = 0.5 * (discrete[1:] + discrete[:-1])

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(1e6 * middle, 1e-3 * stiffness, color=BLUE)
        axes.axhline(100.0, color=INK, ls="--", lw=0.9, label="taken by the source: 10⁵ N/mm")
        axes.set(xlabel="displacement beyond the clearance (µm)", ylabel="stiffness (kN/mm)", ylim=(0.0, None))
        axes.legend(loc="upper left")

    claims = [
        words("the stiffness rises with the displacement", [bool(np.all(np.diff(stiffness) > 0.0))]),
        words("it passes 10⁵ N/mm in this range", [bool(stiffness.min() < 1e5 < stiffness.max())]),
    ]
    caption = "Slope of the load over the displacement of the 6305, by the sum over the balls."
    data = {"displacement_um": 1e6 * middle, "stiffness_newton_per_mm": stiffness}
    return Plate(caption, "Stiffness over displacement.", 2.6, draw, data, claims)


# Section 6.1.2: the elastic shaft.


def figure_610() -> Plate:
    """Return the accelerations on an elastic shaft."""
    scene = lumped()
    higher = [peak(scene, sensor) > peak(HALF, sensor) for sensor in ("a", "b")]
    claims = [
        number("PV of C, ends without mass; two thirds is left of the beginning", 291.4, peak(bent(), "c"), UNIT, 0.05),
        words("C is lower than with a rigid shaft", [peak(scene, "c") < peak(HALF, "c")]),
        words("A and B are higher than with a rigid shaft", higher),
    ]
    return signals(scene, "Healthy bearings, elastic shaft of 0.8 m", claims, sensors=("c", "a", "b"))


def _moved(scene: Scene) -> Trajectories:
    solver = rotor_elastic if scene.physics else rigid_rotor
    found = solver.trajectories(scene, Request(duration=1.2))
    if found is None:
        raise ValueError("the motion of the rotor diverged")
    return found


def _orbits(
    found: Sequence[tuple[str, Trajectories, int]], caption: str, claims: Sequence[Claim], *, scale: bool
) -> Plate:
    """Return a plate of orbits by title; ``scale``: whether all have the extent of the largest."""

    def draw(made: FigureBase) -> None:
        shape = (len(found), 1) if scale else (1, len(found))
        panels = np.ravel(made.subplots(*shape))
        for place, (axes, (title, moved, point)) in enumerate(zip(panels, found, strict=True)):
            draw_orbit(axes, moved, point, SPEED)
            letter(axes, place, title)
        if scale:
            # Flat orbits: below each other, and no higher than they are.
            reach = max(0.5 * float(np.ptp(axes.get_xlim())) for axes in panels)
            high = 0.7e6 * max(float(moved.travel()[point, 0]) for _, moved, point in found)
            for axes in panels:
                x, y = (float(np.mean(limits)) for limits in (axes.get_xlim(), axes.get_ylim()))
                axes.set(xlim=(x - reach, x + reach), ylim=(y + high, y - high))
                axes.yaxis.set_major_locator(MaxNLocator(3))
        panels[len(found) // 2 if scale else 0].set_ylabel("along the load (µm)")

    data = {}
    for place, (_, moved, point) in enumerate(found):
        name = chr(ord("a") + place)
        every = max(1, moved.place.shape[2] // 1200)
        data |= {f"along_{name}_um": 1e6 * moved.place[point, 0, ::every]}
        data |= {f"across_{name}_um": 1e6 * moved.place[point, 1, ::every]}
        data |= {f"travel_{name}_um": 1e6 * moved.travel()[point]}
    text = f"{caption}. Twenty settled turns, the load points downwards; a dot for each turn"
    text += "; circle: radial clearance." if np.isfinite(found[0][1].clearance[found[0][2]]) else "."
    return Plate(text, "Orbits of points of the shaft.", 5.4 if scale else 3.2, draw, data, claims)


def figure_611() -> Plate:
    """Return the orbits of A, B and C on an elastic shaft."""
    moved = _moved(bent())
    travel = np.hypot(*moved.travel().T)
    smaller = [bool(travel[2] < each) for each in travel[:2]]
    claims = [words("the shaft takes up what the bearings do: C moves less than A and B", smaller)]
    found = [(f"{name.upper()}", moved, k) for k, name in enumerate(moved.points)]
    return _orbits(found, "Orbits on an elastic shaft without unbalance, ends without mass", claims, scale=False)


def figure_612() -> Plate:
    """Return the spectra of the envelopes of B and C on an elastic shaft."""
    scene = lumped()
    b, c = lines_of(scene, "b"), lines_of(scene, "c")
    order = [is_multiple(lines.highest(high=HIGH), LINES.bpfo, 2.0 * lines.resolution) for lines in (b, c)]
    claims = [
        words("the highest lines of B and C are multiples of BPFO", order),
        words("C is lower than B", [c.at(k * LINES.bpfo) < b.at(k * LINES.bpfo) for k in (1, 2, 3)]),
    ]
    caption = "Healthy bearings, elastic shaft of 0.8 m"
    return envelopes(scene, caption, claims, multiples(LINES.bpfo, "BPFO"), sensors=("b", "c"))


# Section 6.5: unbalance.


def _titles() -> list[str]:
    return [f"ε = {1e3 * value:g} mm" for value in ECCENTRICITIES]


def _unbalanced(*, elastic: bool) -> list[Scene]:
    return [bent(value) if elastic else rotor(eccentricity=value) for value in ECCENTRICITIES]


def _unbalance_signals(scenes: Sequence[Scene], printed: Sequence[float], note: str) -> Plate:
    drawn = [
        (title, of(scene).acceleration[:, -1], of(scene).step) for title, scene in zip(_titles(), scenes, strict=True)
    ]
    found = [peak(scene, "c") for scene in scenes]
    claims = [
        number(f"PV of C, {title}{note}", value, ours, UNIT, 0.05)
        for title, value, ours in zip(_titles(), printed, found, strict=True)
    ]
    claims.append(words("PV rises with the eccentricity", [found[0] < found[1], found[1] < found[2]]))

    def draw(made: FigureBase) -> None:
        draw_signals(made, drawn, share=False)

    shaft = "elastic" if scenes[0].physics else "rigid"
    caption = f"Acceleration of C along the load with three eccentricities, {shaft} shaft, a quarter of a second."
    return Plate(caption, "Acceleration of C.", 4.2, draw, {"pv_c_mm_s2": found}, claims)


def figure_627() -> Plate:
    """Return C with three eccentricities on a rigid shaft."""
    return _unbalance_signals(_unbalanced(elastic=False), (999.5, 1055.7, 1613.4), "")


def figure_628() -> Plate:
    """Return the orbits of C with three eccentricities on a rigid shaft."""
    return _orbit_growth(_unbalanced(elastic=False), "rigid", scale=True)


def _orbit_growth(scenes: Sequence[Scene], shaft: str, *, scale: bool) -> Plate:
    found = [(title, _moved(scene), 2) for title, scene in zip(_titles(), scenes, strict=True)]
    travel = [float(np.hypot(*moved.travel()[point])) for _, moved, point in found]
    claims = [words("the oscillation on the trajectory grows with ε", [a < b for a, b in pairwise(travel)])]
    return _orbits(found, f"Orbits of C with three eccentricities, {shaft} shaft", claims, scale=scale)


def _unbalance_spectra(scenes: Sequence[Scene], titles: Sequence[str]) -> Plate:
    drawn = {title: lines_of(scene, "c") for title, scene in zip(titles, scenes, strict=True)}
    levels_ = [lines.at(SPEED) for lines in drawn.values()]
    named = {"f_s": SPEED} | multiples(LINES.bpfo, "BPFO")
    claims = [
        words("multiples of BPFO stand out", [one.stands_out(2.0 * LINES.bpfo, HIGH) for one in drawn.values()]),
        words("f_s rises with the eccentricity", [a < b for a, b in pairwise(levels_)]),
        words("f_s stands out with the largest", [next(reversed(drawn.values())).stands_out(SPEED, HIGH)]),
    ]

    def draw(made: FigureBase) -> None:
        panels = np.atleast_1d(made.subplots(len(drawn), 1, sharex=True))
        panels_of_lines(list(panels), drawn, HIGH, named, share=False)

    shaft = "elastic" if scenes[0].physics else "rigid"
    caption = f"Spectra of the envelope of C, 500 to 10,000 Hz, {shaft} shaft, each on its own scale."
    data = kept_lines({f"c_{k}": lines for k, lines in enumerate(drawn.values())}, HIGH)
    return Plate(caption, "Spectra of the envelope of C.", 0.5 + 1.25 * len(drawn), draw, data, claims)


def figure_629() -> Plate:
    """Return the spectra of C's envelope with two eccentricities on a rigid shaft."""
    return _unbalance_spectra(_unbalanced(elastic=False)[1:], _titles()[1:])


def figure_630() -> Plate:
    """Return C with three eccentricities on an elastic shaft."""
    note = " (Table 6.1); with what is left of the beginning"
    return _unbalance_signals(_unbalanced(elastic=True), (291.4, 292.7, 745.8), note)


def figure_631() -> Plate:
    """Return the orbits of C with three eccentricities on an elastic shaft."""
    return _orbit_growth(_unbalanced(elastic=True), "elastic", scale=False)


def figure_632() -> Plate:
    """Return the spectra of C's envelope with three eccentricities on an elastic shaft."""
    return _unbalance_spectra(_unbalanced(elastic=True), _titles())


def figure_length() -> Plate:
    """Return peak value and RMS over the length of a rigid shaft, outer race."""
    found = [levels(damaged("outer", rotor(length=length))) for length in _LENGTHS]

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, 2)
        for place, (axes, kind) in enumerate(zip(panels, ("pv", "rms"), strict=True)):
            for sensor, color, marker in zip(SENSORS, (BLUE, GREEN, VERMILION), "osD", strict=True):
                values = [1e-3 * each[f"{kind}_{sensor}_mm_s2"] for each in found]
                axes.plot(_LENGTHS, values, color=color, marker=marker, ms=4, label=sensor.upper())
            letter(axes, place, "peak value" if kind == "pv" else "RMS")
            axes.set(xlabel="length of the shaft (m)", ylabel="m/s²", ylim=(0.0, None))
        panels[0].legend(loc="lower left")

    share = [each["pv_b_mm_s2"] / each["pv_a_mm_s2"] for each in found]
    claims = [words("the shorter the shaft, the more B is as A", [a > b for a, b in pairwise(share)])]
    caption = (
        "Peak value and RMS over the length of a rigid shaft, defect of the outer race of A; no figure of the print."
    )
    data = {"length_m": _LENGTHS} | {key: [each[key] for each in found] for key in found[0]}
    return Plate(caption, "Peak value and RMS over the length.", 3.0, draw, data, claims)


FIGURES: dict[str, Callable[[], Plate]] = {
    "2.7": figure_27,
    "2.8": figure_28,
    "6.10": figure_610,
    "6.11": figure_611,
    "6.12": figure_612,
    "6.27": figure_627,
    "6.28": figure_628,
    "6.29": figure_629,
    "6.30": figure_630,
    "6.31": figure_631,
    "6.32": figure_632,
    "L": figure_length,
}

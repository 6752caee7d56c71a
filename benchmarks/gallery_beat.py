"""Figures of the gallery from BEAT, the model of impacts on rings (Sassi, Badri and Thomas 2007).

Films, masses, level of the noise and sections of the rings are not printed: films of 100 N s/m are taken here, in which
an impact dies down before the next, as on the print's records. The 1210 has 17 balls a row here, which the printed BPFO
needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from matplotlib.figure import FigureBase

from benchmarks.gallery_plate import Claim, Plate, number, words
from benchmarks.gallery_spectra import (
    Lines,
    Values,
    envelope_spectrum,
    kept_lines,
    mark,
    named_panel,
    panels_of_lines,
    spectrum,
)
from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Defect, Part, Scene
from models.path.contour import part_radius
from models.published.beat import inner_race_scene
from models.solve.ring_impact.hits import hits_on
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.ring_impact.solver import natural_frequencies, noise_level, solve
from models.words.request import Request
from monitor.report.figures.drawing import BLUE, GREEN, PURPLE, VERMILION

BEARING = replace(from_catalogue("1210"), n_elements=17)
RIG = RingImpactRig(c_of=100.0, c_if=100.0)
RATE, SECONDS = 25600.0, 4.0
BAND = (2000.0, 10_000.0)
_SPANS = "films of 100 N s/m and sections of the rings are chosen"


def scene_of(part: Part, size: float, speed: float, *, turning: bool = True) -> Scene:
    """Return the 1210 with a defect of a size, m, under 450 N that turn with the shaft and 1150 N axially."""
    defect = Defect(size / part_radius(BEARING, part), 1e-3, part=part)
    return Scene(speed, 450.0, BEARING, RIG, defect, axial_load=1150.0, load_turns=turning)


@cache
def signal_of(scene: Scene) -> Values:
    """Return four seconds of the sensor on the outer ring, m/s2."""
    return solve(scene, Request(duration=SECONDS, rate=RATE, accuracy=2e-2)).acceleration(RATE, SECONDS)


def with_noise(scene: Scene, share: float) -> Scene:
    """Return a scene with noise of slip of so much of the RMS of its impacts (Eq. 32)."""
    wanted = share * float(np.std(signal_of(scene)))
    rig = scene.rig_as(RingImpactRig)
    return replace(scene, rig=replace(rig, slip_noise=wanted / noise_level(scene, 1.0)))


def kurtosis(signal: Values) -> float:
    """Return the fourth moment over the square of the second."""
    centred = signal - np.mean(signal)
    return float(np.mean(centred**4) / np.mean(centred**2) ** 2)


def _forces(part: Part, *, turning: bool) -> tuple[Values, Values]:
    """Return times, s, and forces, N, of the hits on the first row over three turns of the shaft."""
    scene = scene_of(part, 1e-3, 696.0 / 60.0, turning=turning)
    hits = hits_on(scene, 0, 0.0, 3.0 / scene.speed)
    return hits.start, hits.force


def figure_5() -> Plate:
    """Return the pulses of a defect of each part under a load that turns."""
    speed = 696.0 / 60.0
    parts: tuple[Part, ...] = ("inner", "outer", "ball")
    found = {part: _forces(part, turning=True) for part in parts}

    def draw(made: FigureBase) -> None:
        panels = made.subplots(3, 1, sharex=True)
        for axes, (part, (time, force)), color in zip(panels, found.items(), (BLUE, VERMILION, GREEN), strict=True):
            axes.vlines(1e3 * time, 0.0, force, color=color, lw=1.2)
            axes.set(xlim=(0.0, 3e3 / speed), ylim=(0.0, None), ylabel="force (N)")
            named_panel(axes, "ball" if part == "ball" else f"{part} race")
        panels[-1].set_xlabel("time (ms)")

    def swing(part: Part, *, turning: bool) -> float:
        force = _forces(part, turning=turning)[1]
        return float(np.ptp(force) / force.max())

    even, uneven = 1e-6, 0.05
    claims = [
        words("the load turns: hits on the inner race are even", [swing("inner", turning=True) < even]),
        words("and modulated on the outer race", [swing("outer", turning=True) > uneven]),
        words("the load is fixed: hits on the outer race are even", [swing("outer", turning=False) < even]),
        words("and modulated on the inner race", [swing("inner", turning=False) > uneven]),
        words("hits of a ball are modulated", [swing("ball", turning=True) > uneven]),
    ]
    caption = (
        "Forces of the hits on a defect of 1 mm, first row of a 1210 at 696 rpm, 450 N that turn and 1150 N axially."
    )
    data = {
        f"{kind}_{part}": values
        for part, both in found.items()
        for kind, values in zip(("time_s", "force_newton"), both, strict=True)
    }
    return Plate(caption, "Pulses of a defect of each part.", 3.6, draw, data, claims)


def figure_8() -> Plate:
    """Return time responses without and with noise, outer and inner race."""
    parts: tuple[Part, ...] = ("outer", "inner")
    scenes = {part: scene_of(part, 0.55e-3, 12.0) for part in parts}
    noisy = {part: with_noise(scene, 0.5) for part, scene in scenes.items()}
    few = slice(0, round(0.25 * RATE))
    time = 1e3 * np.arange(few.stop) / RATE

    def draw(made: FigureBase) -> None:
        panels = made.subplots(2, 2, sharex=True, sharey="row")
        for row, part in zip(panels, parts, strict=True):
            for axes, scene, name in zip(row, (scenes[part], noisy[part]), ("impacts", "with noise"), strict=True):
                axes.plot(time, signal_of(scene)[few], color=BLUE, lw=0.5)
                axes.set(xlim=(0.0, 250.0))
                named_panel(axes, f"{part} race, {name}")
            row[0].set_ylabel("m/s²")
        for axes in panels[-1]:
            axes.set_xlabel("time (ms)")

    lower = [kurtosis(signal_of(noisy[part])) < kurtosis(signal_of(scenes[part])) for part in parts]
    alone = signal_of(noisy["outer"]) - signal_of(scenes["outer"])
    claims = [
        words("noise lowers the kurtosis of the impacts", lower),
        number("kurtosis of the noise alone", 3.0, kurtosis(alone), "", 0.1),
    ]
    caption = "Defect of 0.55 mm, 720 rpm, without and with noise of half its RMS; the level of the print is not given."
    data = {f"kurtosis_{part}": [kurtosis(signal_of(s[part])) for s in (scenes, noisy)] for part in parts}
    return Plate(caption, "Responses without and with noise.", 3.8, draw, data, claims, _SPANS)


def figure_9() -> Plate:
    """Return half a second of the outer race at 695 rpm."""
    speed = 695.0 / 60.0
    scene = with_noise(scene_of("outer", 0.55e-3, speed), 0.3)
    signal, bpfo = signal_of(scene)[: round(0.5 * RATE)], kinematics(BEARING, speed).bpfo

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(1e3 * np.arange(signal.size) / RATE, signal, color=BLUE, lw=0.5)
        axes.set(xlim=(0.0, 500.0), xlabel="time (ms)", ylabel="m/s²")

    lines = envelope_spectrum(signal_of(scene), RATE, BAND)
    claims = [
        number("one turn", 86.4, 1e3 / speed, "ms", 0.1),
        number("BPFO, 17 balls a row", 86.0, bpfo, "Hz", 0.5),
        number("one ball pass", 11.6, 1e3 / bpfo, "ms", 0.05),
        words("impacts swing with the shaft", [lines.stands_out(speed, 300.0)]),
    ]
    caption = "Defect of 0.55 mm on the outer race, 695 rpm, a load that turns, noise of 0.3 of the RMS, half a second."
    data = {"rms_m_s2": float(np.std(signal)), "kurtosis": kurtosis(signal)}
    return Plate(caption, "Response of the outer race.", 2.4, draw, data, claims, _SPANS)


def figure_10() -> Plate:
    """Return the spectrum of a defect of 1 mm on the outer race."""
    scene = scene_of("outer", 1e-3, 11.6)
    lines, bpfo = spectrum(signal_of(scene), RATE), kinematics(BEARING, 11.6).bpfo
    top, first = lines.highest(), float(natural_frequencies(scene)[0])
    around = [lines.at(round(top / bpfo) * bpfo + k * bpfo) > 0.02 * lines.at(top) for k in (-3, -2, -1, 1, 2, 3)]

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(*lines.below(10_000.0), color=PURPLE, lw=0.6)
        axes.set(xlim=(0.0, 10_000.0), ylim=(0.0, None), xlabel="frequency (Hz)", ylabel="m/s²")
        mark(axes, {f"{first:,.0f} Hz": first})

    claims = [
        number("resonance; rings of the 1210 are not printed", 2000.0, top, "Hz", 50.0),
        words("the highest lines surround it, BPFO apart", around),
    ]
    caption = "Defect of 1 mm on the outer race, 11.6 Hz, a load that turns; dotted: lowest mode of the default rings."
    return Plate(
        caption, "Spectrum of the outer race.", 2.6, draw, kept_lines({"casing": lines}, 10_000.0, 25.0), claims, _SPANS
    )


def figure_11() -> Plate:
    """Return the envelope spectrum of a defect of 1.27 mm on the outer race."""
    speed = 11.6
    scene = with_noise(scene_of("outer", 1.27e-3, speed), 0.5)
    lines, bpfo = envelope_spectrum(signal_of(scene), RATE, BAND), kinematics(BEARING, speed).bpfo
    sides = [k * bpfo + m * speed for k in (1, 2, 3) for m in (-1.0, 1.0)]
    claims = [
        words("harmonics of BPFO stand out", [lines.stands_out(k * bpfo, 400.0) for k in (1, 2, 3)]),
        words("so do lines of the shaft on either side", [lines.stands_out(side, 400.0) for side in sides]),
    ]
    named = {"f_s": speed} | {f"{k} BPFO" if k > 1 else "BPFO": k * bpfo for k in (1, 2, 3, 4)}
    caption = (
        "Spectrum of the envelope, 2 to 10 kHz, of a defect of 1.27 mm on the outer race, 11.6 Hz, a load that turns"
    )
    return _one_envelope(lines, f"{caption}, noise of half the RMS.", claims, named)


def _one_envelope(lines: Lines, caption: str, claims: list[Claim], named: dict[str, float]) -> Plate:
    def draw(made: FigureBase) -> None:
        panels_of_lines([made.subplots(1, 1)], {"envelope": lines}, 400.0, named)

    return Plate(
        caption, "Spectrum of the envelope.", 2.6, draw, kept_lines({"envelope": lines}, 400.0), claims, _SPANS
    )


def figure_12() -> Plate:
    """Return the envelope spectrum of a 6205 with 0.72 mm on the inner race at 1750 rpm."""
    scene = with_noise(replace(inner_race_scene(), rig=RIG), 0.5)
    lines, speed = envelope_spectrum(signal_of(scene), RATE, BAND), scene.speed
    bpfi = kinematics(scene.bearing, speed).bpfi
    sides = [k * bpfi + m * speed for k in (1, 2) for m in (-1.0, 1.0)]
    printed = 0.5 * 9.0 * speed * (1.0 + 1.0 / 4.9)
    claims = [
        number("BPFI, from the printed ratio of diameters of 4.9", printed, bpfi, "Hz", 0.5),
        words("harmonics of BPFI stand out", [lines.stands_out(k * bpfi, 400.0) for k in (1, 2)]),
        words("so do lines of the shaft on either side", [lines.stands_out(side, 400.0) for side in sides]),
        words("f_s stands out", [lines.stands_out(speed, 400.0)]),
    ]
    named = {"f_s": speed, "-f_s": bpfi - speed, "BPFI": bpfi, "+f_s": bpfi + speed, "2 BPFI": 2.0 * bpfi}
    caption = "Spectrum of the envelope, 2 to 10 kHz, of a 6205 with 0.72 mm on the inner race, 1750 rpm, fixed load"
    return _one_envelope(lines, f"{caption}, noise of half the RMS.", claims, named)


FIGURES: dict[str, Callable[[], Plate]] = {
    "5": figure_5,
    "8": figure_8,
    "9": figure_9,
    "10": figure_10,
    "11": figure_11,
    "12": figure_12,
}

"""Figures of the gallery from Thibault's shaft that turns: its angular speed over the angle, and per turn.

The last 40 turns of each run, in steps of equal angle (``models.published.thibault_shaft``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from matplotlib.figure import FigureBase

from benchmarks.gallery_plate import Claim, Plate, letter, number, words
from benchmarks.gallery_spectra import Lines, Values, kept_lines, mark
from models.machine.scene import Scene
from models.published.thibault import BALL, FAST, SLOW
from models.published.thibault_shaft import BPFO_LEFT, REFERENCE, SPALL, bpfo, order_spectrum, turning
from models.solve.angular.kernels.ball_ring import CARRIED, F_Z, carry
from models.solve.angular.plan import assemble, ring_of
from monitor.report.figures.drawing import BLUE, PURPLE, VERMILION, legend_above

LOADED = replace(REFERENCE, axial_load=-1000.0)
QUICK = replace(REFERENCE, speed=FAST)
DAMAGED = replace(REFERENCE, defect=SPALL)
QUICK_DAMAGED = replace(DAMAGED, speed=FAST)
AXIALLY_DAMAGED = replace(REFERENCE, defect=replace(SPALL, support="b"))
COUPLINGS, TORSION = 0.39, 25.44
"""Modes of torsion at 20,000 rpm, per turn."""
_CHOSEN = "inertias, torque, damping, grooves and clearance are chosen, not printed"
_TURNS = 2.0
_STEP = 0.05


@cache
def lines_of(scene: Scene) -> Lines:
    """Return the spectrum of the angular speed, rad/s, over events per turn."""
    found = turning(scene)
    return Lines(*order_spectrum(found, found.ias))


def _over_angle(scene: Scene) -> tuple[Values, Values]:
    """Return turns and the variation of the angular speed, mrad/s."""
    found = turning(scene)
    count = round(2.0 * math.pi * _TURNS / found.step)
    return np.arange(count, dtype=np.float64) * (found.step / (2.0 * math.pi)), 1e3 * (found.ias - found.ias.mean())[
        :count
    ]


def two_domains(
    scenes: Mapping[str, Scene], high: float, named: Mapping[str, float], caption: str, claims: Sequence[Claim]
) -> Plate:
    """Return a plate of the angular speed of some scenes over the angle and per turn, up to ``high`` events."""
    colours = dict(zip(scenes, (BLUE, VERMILION), strict=False))
    spectra = {name: lines_of(scene) for name, scene in scenes.items()}
    highest = max(float(one.below(high)[1].max()) for one in spectra.values())

    def draw(made: FigureBase) -> None:
        over, per = made.subplots(2, 1)
        # The larger is drawn first, so that it does not hide the other.
        for name in sorted(scenes, key=lambda name: -_spread(scenes[name])):
            color = colours[name]
            over.plot(*_over_angle(scenes[name]), color=color, lw=0.8, label=name)
            frequency, amplitude = spectra[name].below(high)
            per.plot(frequency, 1e3 * amplitude, color=color, lw=0.8)
        over.set(xlim=(0.0, _TURNS), xlabel="turns", ylabel="speed (mrad/s)")
        per.set(xlim=(0.0, high), xlabel="events per turn", ylabel="amplitude (mrad/s)")
        per.set(yscale="log", ylim=(3e2 * highest * 1e-6, 3e3 * highest))
        mark(per, named)
        if len(scenes) > 1:
            legend_above(over)

    data: dict[str, Any] = {}
    for k, (name, scene) in enumerate(scenes.items(), start=1):
        data |= {f"scene_{k}": name, f"sd_{k}_rad_s": _spread(scene)}
    data |= kept_lines(dict(zip("12", spectra.values(), strict=False)), high, _STEP, ("per_turn", "rad_s"))
    label = f"Angular speed of {' and '.join(scenes)}."
    return Plate(caption, label, 4.4, draw, data, claims, _CHOSEN)


def _spread(scene: Scene) -> float:
    """Return the standard deviation of the angular speed, rad/s."""
    return float(np.std(turning(scene).ias))


def _at(scene: Scene, order: float) -> float:
    return lines_of(scene).at(order)


def _out(scene: Scene, orders: Sequence[float], times: float = 5.0) -> list[bool]:
    return [lines_of(scene).stands_out(order, 30.0, times) for order in orders]


def _marks(right: float) -> dict[str, float]:
    left = {f"{k} r" if k > 1 else "r": k * BPFO_LEFT for k in range(1, 6)}
    return {"a": right} | left


def figure_9() -> Plate:
    """Return the whole spectra of acceleration and angular speed."""
    found = turning(REFERENCE)
    acceleration = Lines(*order_spectrum(found, found.acceleration[:, 2]))
    speed = lines_of(REFERENCE)

    def draw(made: FigureBase) -> None:
        panels = made.subplots(2, 1, sharex=True)
        for place, (axes, lines, name) in enumerate(
            zip(panels, (acceleration, speed), ("disc (m/s²)", "speed (rad/s)"), strict=True)
        ):
            axes.plot(*lines.below(200.0), color=PURPLE, lw=0.7)
            axes.set(xlim=(0.0, 200.0), yscale="log", ylabel=name)
            axes.set_ylim(1e-6 * lines.below(200.0)[1].max(), 3.0 * lines.below(200.0)[1].max())
            letter(axes, place, "acceleration of the disc" if place == 0 else "angular speed")
        panels[-1].set_xlabel("events per turn")

    caption = "Spectra of the reference run: 6000 rpm, 600 N radially, 200 N axially, no spall. No value is printed."
    data = kept_lines({"disc": acceleration}, 200.0, 0.5, ("per_turn", "m_s2"))
    data |= kept_lines({"speed": speed}, 200.0, 0.5, ("per_turn", "rad_s"))
    return Plate(caption, "Spectra of acceleration and angular speed.", 3.6, draw, data, (), _CHOSEN)


def figure_10() -> Plate:
    """Return the angular speed of the reference run."""
    right = bpfo(200.0, SLOW)
    apart = BPFO_LEFT - right
    claims = [
        number("BPFO of the radially loaded bearing", 4.63, lines_of(REFERENCE).highest(0.5, 30.0), "per turn", 0.025),
        number("BPFO of the axially loaded bearing", 4.26, right, "per turn", 0.005),
        words("the radially loaded bearing is the stronger", [_at(REFERENCE, BPFO_LEFT) > 3.0 * _at(REFERENCE, right)]),
        words("and has more harmonics", _out(REFERENCE, [k * BPFO_LEFT for k in (2, 3, 4)])),
        words("side lines stand BPFO_r - BPFO_a away", _out(REFERENCE, [k * BPFO_LEFT + apart for k in (1, 2, 3)])),
    ]
    caption = (
        "Angular speed of the reference run (6000 rpm, 600 N radially, 200 N axially, no spall) over the angle and per "
        "turn; r: BPFO of the radially, a: of the axially loaded bearing."
    )
    return two_domains({"reference": REFERENCE}, 25.0, _marks(right), caption, claims)


def figure_11() -> Plate:
    """Return the angular speed at two speeds."""
    slow, quick = bpfo(200.0, SLOW), bpfo(200.0, FAST)
    lower = [_at(QUICK, BPFO_LEFT) < _at(REFERENCE, BPFO_LEFT), _at(QUICK, quick) < _at(REFERENCE, slow)]
    share = [[_at(scene, k * BPFO_LEFT) / _at(scene, BPFO_LEFT) for k in (2, 3)] for scene in (REFERENCE, QUICK)]
    claims = [
        words("fundamentals of both bearings fall at 20,000 rpm", lower),
        words("harmonics gain beside them", [high > low for low, high in zip(*share, strict=True)]),
        words("the modes at 0.39 and 25.44 appear", _out(QUICK, [COUPLINGS, TORSION], 2.0)),
        number("change of the axially loaded BPFO", -0.4, 100.0 * (quick / slow - 1.0), "%", 0.05),
        number("BPFO of the radially loaded bearing", 4.63, lines_of(QUICK).highest(4.4, 4.9), "per turn", 0.025),
    ]
    caption = "Angular speed at 6000 and 20,000 rpm, 600 N radially, 200 N axially, over the angle and per turn."
    named = _marks(slow) | {"torsion": TORSION}
    return two_domains({"6000 rpm": REFERENCE, "20,000 rpm": QUICK}, 30.0, named, caption, claims)


def figure_13() -> Plate:
    """Return the angular speed under two axial loads."""
    light, heavy = bpfo(200.0, SLOW), bpfo(1000.0, SLOW)
    weaker = [_at(LOADED, k * heavy) < 0.1 * _at(REFERENCE, k * light) for k in (1, 2)]
    sides = [(k + 1) * BPFO_LEFT for k in (2, 3)]
    vanish = [_at(LOADED, order - heavy) < 0.1 * _at(REFERENCE, order - light) for order in sides]
    claims = [
        words("BPFO and 2 BPFO of the axially loaded bearing are not seen (a tenth)", weaker),
        words("the modulations vanish (a tenth)", vanish),
        number("change of its BPFO", 0.4, 100.0 * (heavy / light - 1.0), "%", 0.05),
    ]
    caption = "Angular speed under 200 N and 1000 N axially, 6000 rpm, 600 N radially, over the angle and per turn."
    return two_domains({"200 N": REFERENCE, "1000 N": LOADED}, 25.0, _marks(light), caption, claims)


def figure_14() -> Plate:
    """Return the angular speed without and with a spall of the radially loaded bearing."""
    lines, hidden = lines_of(DAMAGED), _at(DAMAGED, bpfo(200.0, SLOW)) < 0.1 * _at(DAMAGED, BPFO_LEFT)
    claims = [
        words("the spall raises the variation of the speed", [_spread(DAMAGED) > _spread(REFERENCE)]),
        words("the axially loaded bearing is negligible (a tenth)", [hidden]),
        number("second torsion: highest line about it", 85.0, lines.highest(55.0, 115.0), "per turn", 0.5 * BPFO_LEFT),
    ]
    caption = "Angular speed without and with a spall of the radially loaded outer race (7° by 30°, 100 µm), 6000 rpm."
    return two_domains(
        {"reference": REFERENCE, "spall": DAMAGED}, 110.0, {"torsion": TORSION * FAST / SLOW}, caption, claims
    )


def figure_15() -> Plate:
    """Return the angular speed over a spall at two speeds."""
    slow, quick = lines_of(DAMAGED), lines_of(QUICK_DAMAGED)
    claims = [
        number("6000 rpm: highest line about the mode", 85.0, slow.highest(55.0, 115.0), "per turn", 0.5 * BPFO_LEFT),
        number("20,000 rpm: highest line about the mode", 26.0, quick.highest(20.0, 31.0), "per turn", 0.5 * BPFO_LEFT),
    ]
    caption = "Angular speed over the spall at 6000 and 20,000 rpm; its lines next to the torsion rise."
    named = {"25.4": TORSION, "84.8": TORSION * FAST / SLOW}
    return two_domains({"6000 rpm": DAMAGED, "20,000 rpm": QUICK_DAMAGED}, 110.0, named, caption, claims)


def _over_spall(speed: float, grooves: tuple[float, float], angles: Values) -> Values:
    """Return the force of a ball on the inner race, N, at angles about the spall, rad; the ring is held.

    ``grooves``: radii of the inner and outer groove over the diameter of the balls.
    """
    inner, outer = (ratio * BALL for ratio in grooves)
    bearing = replace(REFERENCE.bearing, inner_groove_radius=inner, outer_groove_radius=outer)
    scene = replace(DAMAGED, speed=speed, bearing=bearing)
    held = assemble(scene).rings[0]
    ring = ring_of(held.statics, scene, "a")
    alone = ring._replace(angles=ring.angles[:1], slots=np.ascontiguousarray(ring.slots[:, :1]))
    found = np.empty(len(angles))
    for k, angle in enumerate(angles):
        out = np.zeros(CARRIED)
        carry(held.displacement, float(angle), held.centrifugal, 0.0, alone, np.zeros((1, 2)), out)
        found[k] = math.sqrt(float(np.sum(out[: F_Z + 1] ** 2)))
    return found


def figure_16() -> Plate:
    """Return the force of one ball on the inner race while it passes the spall, at two speeds."""
    angles = np.radians(np.linspace(-20.0, 20.0, 401))
    grooves = {"0.51": (0.51, 0.51), "0.515 and 0.505": (0.515, 0.505)}
    speeds = {"6000 rpm": SLOW, "20,000 rpm": FAST}
    found = {(g, v): _over_spall(speeds[v], grooves[g], angles) for g in grooves for v in speeds}

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, 2, sharey=True)
        for place, (axes, name) in enumerate(zip(panels, grooves, strict=True)):
            for speed, color in zip(speeds, (BLUE, VERMILION), strict=True):
                axes.plot(np.degrees(angles), found[name, speed], color=color, label=speed)
            letter(axes, place, f"grooves of {name} D")
            axes.set(xlabel="angle from the middle of the spall (degrees)", xlim=(-20.0, 20.0), ylim=(0.0, None))
        panels[0].set_ylabel("force on the inner race (N)")
        panels[0].legend(loc="lower right", fontsize=8)

    lost = {key: bool(np.min(forces) < 1e-3) for key, forces in found.items()}
    claims = [
        words("at 20,000 rpm the load is lost", [lost[name, "20,000 rpm"] for name in grooves]),
        words("at 6000 rpm not all of it (grooves of 0.51 D)", [not lost["0.51", "6000 rpm"]]),
        words("the same, inner groove of 0.515 D, outer of 0.505 D", [not lost["0.515 and 0.505", "6000 rpm"]]),
    ]
    data: dict[str, Any] = {"angle_deg": np.degrees(angles[::4])}
    for (name, speed), forces in found.items():
        data[f"force_{name.replace(' ', '_')}_{speed.split()[0].replace(',', '')}_rpm_newton"] = forces[::4]
    caption = (
        "Force of one ball of the radially loaded bearing on the inner race while it passes the spall, the inner ring "
        "held where it stands without one; the print has it move. Both pairs of grooves meet the printed BPFO."
    )
    return Plate(caption, "Force of a ball over a spall.", 2.9, draw, data, claims, _CHOSEN)


def figure_17() -> Plate:
    """Return the angular speed over a spall of the axially loaded bearing."""
    right = bpfo(200.0, SLOW)
    apart = BPFO_LEFT - right
    less = _spread(AXIALLY_DAMAGED) < _spread(DAMAGED)
    share = _at(AXIALLY_DAMAGED, right) / _at(AXIALLY_DAMAGED, BPFO_LEFT)
    sides = [k * right - apart for k in (1, 2)]
    more = [_at(AXIALLY_DAMAGED, order) > 2.0 * _at(REFERENCE, order) for order in sides]
    claims = [
        words("the variation of the speed rises less than with the other bearing", [less]),
        words("both BPFO are alike (within a factor of three)", [1.0 / 3.0 < share < 3.0]),
        words("modulations are more than without a spall", more),
    ]
    caption = (
        "Angular speed with the same spall on the axially loaded outer race, 6000 rpm, over the angle and per turn."
    )
    scenes = {"reference": REFERENCE, "spall, axially loaded bearing": AXIALLY_DAMAGED}
    return two_domains(scenes, 25.0, _marks(right), caption, claims)


FIGURES: dict[str, Callable[[], Plate]] = {
    "9": figure_9,
    "10": figure_10,
    "11": figure_11,
    "13": figure_13,
    "14": figure_14,
    "15": figure_15,
    "16": figure_16,
    "17": figure_17,
}

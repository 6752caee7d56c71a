"""Figures of the gallery from Ceruti's rotor: a defect of bearing A (sections 6.2 to 6.4)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.gallery_ceruti_runs import (
    HALF,
    HIGH,
    LINES,
    MM,
    SENSORS,
    UNIT,
    across,
    envelopes,
    lines_of,
    lumped,
    multiples,
    of,
    peak,
    rigid,
    signals,
)
from benchmarks.gallery_plate import Claim, Plate, number, words
from benchmarks.gallery_spectra import is_multiple
from models.machine.scene import Part, Scene
from models.published.ceruti import SPEED, STEP
from models.solve.rotor.rig import RotorRig

_PRINTED: dict[Part, tuple[float, float, float]] = {
    "outer": (13360.0, 7020.1, 2093.7),
    "inner": (13627.0, 8425.6, 4065.6),
    "ball": (7905.2, 5312.8, 2814.8),
}
_NAMES = {"outer": "outer race", "inner": "inner race", "ball": "first ball"}


def _falls(scene: Scene) -> Claim:
    a, c, b = (peak(scene, sensor) for sensor in SENSORS)
    return words("the shock falls from A over C to B", [a > c, c > b])


def _peaks(part: Part) -> list[Claim]:
    scene = rigid(part=part)
    values = zip(SENSORS, _PRINTED[part], strict=True)
    return [number(f"PV of {s.upper()}", printed, peak(scene, s), UNIT, 0.5) for s, printed in values] + [_falls(scene)]


def _caption(part: Part, shaft: str, length: float) -> str:
    return f"Defect of the {_NAMES[part]} of A, {shaft} shaft of {length:g} m"


def _defect_signals(part: Part, length: float, *, elastic: bool, claims: Callable[[Scene], list[Claim]]) -> Plate:
    scene = (lumped if elastic else rigid)(length, part)
    return signals(scene, _caption(part, "elastic" if elastic else "rigid", length), claims(scene))


def _defect_spectra(part: Part, length: float, *, elastic: bool, claims: Callable[[Scene], list[Claim]]) -> Plate:
    scene = (lumped if elastic else rigid)(length, part)
    named = {
        "outer": multiples(LINES.bpfo, "BPFO"),
        "inner": {"f_s": SPEED, "-f_s": LINES.bpfi - SPEED, "BPFI": LINES.bpfi, "+f_s": LINES.bpfi + SPEED}
        | {"2 BPFI": 2.0 * LINES.bpfi, "3 BPFI": 3.0 * LINES.bpfi},
        "ball": {"FTF": LINES.ftf, "BPFO": LINES.bpfo, "2 BSF": 2.0 * LINES.bsf, "4 BSF": 4.0 * LINES.bsf}
        | {"6 BSF": 6.0 * LINES.bsf},
    }[part]
    return envelopes(scene, _caption(part, "elastic" if elastic else "rigid", length), claims(scene), named)


def _multiples_first(scene: Scene, of_: float, name: str) -> Claim:
    found = [lines_of(scene, sensor) for sensor in SENSORS]
    cases = [is_multiple(lines.highest(high=HIGH), of_, 2.0 * lines.resolution) for lines in found]
    return words(f"the highest line of A, C and B is a multiple of {name}", cases)


def _seen(scene: Scene, frequency: float, what: str) -> Claim:
    return words(what, [lines_of(scene, sensor).stands_out(frequency, HIGH) for sensor in SENSORS])


def _ordered(scene: Scene, frequency: float, what: str) -> Claim:
    a, c, b = (lines_of(scene, sensor).at(frequency) for sensor in SENSORS)
    return words(what, [a > c, c > b])


def _of_outer(scene: Scene) -> list[Claim]:
    healthy, found = lines_of(HALF, "a"), lines_of(scene, "a")
    decay = [lines.at(5.0 * LINES.bpfo) / lines.at(LINES.bpfo) for lines in (healthy, found)]
    higher = [lines_of(scene, s).at(LINES.bpfo) > lines_of(HALF, s).at(LINES.bpfo) for s in SENSORS]
    return [
        _multiples_first(scene, LINES.bpfo, "BPFO"),
        _ordered(scene, LINES.bpfo, "BPFO is higher at A than at C, and there than at B"),
        words("higher at A, C and B than with healthy bearings", higher),
        words("multiples fall later than with healthy bearings", [decay[1] > decay[0]]),
    ]


def _outer_long(scene: Scene) -> list[Claim]:
    rms = MM * float(np.std(of(scene).acceleration[round(1.0 / LINES.ftf / STEP) :, 0]))
    sides = [float(np.std(across(each)[:, 0])) for each in (scene, HALF)]
    return [
        *_peaks("outer"),
        number("RMS of A", 1437.1, rms, UNIT, 0.05),
        number('PV of A over its RMS ("about 10")', 10.0, peak(scene, "a") / rms, "", 1.0),
        words("across the load practically unchanged (RMS of A within 20 %)", [abs(sides[0] / sides[1] - 1.0) < 0.2]),
    ]


def _shares(scene: Scene) -> tuple[float, float]:
    """Return PV of B over that of A, of a scene and of the same with a rigid shaft."""
    part = "outer" if scene.defect is None else scene.defect.part
    stiff = rigid(scene.rig_as(RotorRig).length, part)
    return peak(scene, "b") / peak(scene, "a"), peak(stiff, "b") / peak(stiff, "a")


def _outer_elastic(scene: Scene) -> list[Claim]:
    bent, stiff = _shares(scene)
    return [
        words("A is higher than with healthy bearings", [peak(scene, "a") > 2.0 * peak(lumped(0.2), "a")]),
        words("B is hardly hit: a smaller share of A than with a rigid shaft", [bent < 0.5 * stiff]),
    ]


def _outer_short(scene: Scene) -> list[Claim]:
    at_b = peak(scene, "b") / peak(lumped(0.1), "b")
    longer = _shares(lumped(0.2, "outer"))[0]
    return [words("the defect is seen at B too, more than with 0.2 m", [at_b > 1.5, _shares(scene)[0] > longer])]


def _of_inner(scene: Scene) -> list[Claim]:
    found = lines_of(scene, "a")
    sides = [found.at(LINES.bpfi + k * SPEED) / found.at(LINES.bpfi) for k in (-2.0, -1.0, 1.0, 2.0)]
    return [
        number("highest line of A (f_s)", SPEED, found.highest(high=HIGH), "Hz", 0.939),
        _seen(scene, LINES.bpfi, "BPFI stands out at A, C and B"),
        words("BPFI has sidebands f_s and 2 f_s away (a tenth of it at least)", [share > 0.1 for share in sides]),
        _ordered(scene, SPEED, "lines fall from A over C to B"),
    ]


def _inner_elastic(scene: Scene) -> list[Claim]:
    found, other = lines_of(scene, "a"), lines_of(scene, "b")
    bpfi, low, high = (found.at(LINES.bpfi + k * SPEED) for k in (0.0, -1.0, 1.0))
    tops = [lines_of(scene, sensor).highest(high=HIGH) for sensor in ("c", "b")]
    shaft = [found.at(k * SPEED) > found.at((k + 1) * SPEED) for k in (1, 2)]
    share = [lines.at(LINES.bpfo) / lines.at(LINES.bpfi) for lines in (found, other)]
    return [
        words("multiples of f_s stand at A and fall", shaft),
        words("BPFI and BPFI - f_s are alike at A (within 30 %)", [abs(low / bpfi - 1.0) < 0.3]),
        words("BPFI + f_s is lower", [high < bpfi]),
        words("at C and B, f_s is highest", [abs(top - SPEED) < 0.939 for top in tops]),
        words("at B, BPFO matters more beside BPFI than at A", [share[1] > 1.2 * share[0]]),
    ]


def _of_ball(scene: Scene) -> list[Claim]:
    double = 2.0 * LINES.bsf
    return [
        _multiples_first(scene, LINES.bpfo, "BPFO"),
        _seen(scene, double, "2 BSF stands out at A, C and B"),
        _seen(scene, 2.0 * double, "4 BSF stands out at A, C and B"),
    ]


def _ball_elastic(scene: Scene) -> list[Claim]:
    double, found, other = 2.0 * LINES.bsf, lines_of(scene, "a"), lines_of(scene, "b")
    sides = [found.at(double + k * LINES.ftf) > 0.1 * found.at(double) for k in (-1.0, 1.0)]
    return [
        words("2 BSF has sidebands FTF away at A (a tenth of it at least)", sides),
        words("2 BSF is much lower at B than at A (half at most)", [other.at(double) < 0.5 * found.at(double)]),
        words("multiples of BPFO stand out at B", [other.stands_out(k * LINES.bpfo, HIGH) for k in (1, 2)]),
    ]


FIGURES: dict[str, Callable[[], Plate]] = {
    "6.13": partial(
        _defect_signals,
        "outer",
        0.2,
        elastic=False,
        claims=lambda scene: [words("peaks are a bit lower at B", [0.5 < _shares(scene)[0] < 1.0])],
    ),
    "6.14": partial(_defect_signals, "outer", 0.8, elastic=False, claims=_outer_long),
    "6.15": partial(_defect_spectra, "outer", 0.8, elastic=False, claims=_of_outer),
    "6.16": partial(_defect_signals, "outer", 0.2, elastic=True, claims=_outer_elastic),
    "6.17": partial(_defect_signals, "outer", 0.1, elastic=True, claims=_outer_short),
    "6.18": partial(
        _defect_spectra,
        "outer",
        0.1,
        elastic=True,
        claims=lambda scene: [_multiples_first(scene, LINES.bpfo, "BPFO")],
    ),
    "6.19": partial(_defect_signals, "inner", 0.8, elastic=False, claims=lambda _: _peaks("inner")),
    "6.20": partial(_defect_spectra, "inner", 0.8, elastic=False, claims=_of_inner),
    "6.21": partial(_defect_signals, "inner", 0.1, elastic=True, claims=lambda scene: [_falls(scene)]),
    "6.22": partial(_defect_spectra, "inner", 0.1, elastic=True, claims=_inner_elastic),
    "6.23": partial(_defect_signals, "ball", 0.8, elastic=False, claims=lambda _: _peaks("ball")),
    "6.24": partial(_defect_spectra, "ball", 0.8, elastic=False, claims=_of_ball),
    "6.25": partial(_defect_signals, "ball", 0.1, elastic=True, claims=lambda scene: [_falls(scene)]),
    "6.26": partial(_defect_spectra, "ball", 0.1, elastic=True, claims=_ball_elastic),
}

"""Slip in the stationary conditions of the thesis (section 4.4.5, Figs. 49 and 51); run by
benchmarks.published.stationary.

Eq. 82 does not say how often sigma is redrawn, and the result hangs on it. Two rules are held against the words of the
thesis: the mean-force limit (sigma redrawn ever faster; nothing random is left) and one sigma for each passage of a
ball. The smeared spectra of Fig. 49 can be compared with the second only: in the first the motion repeats with BPFO.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.machine.scene import Scene, Slip
from models.solve.six_dof.lanes import LaneOptions, simulate_lanes
from models.solve.six_dof.time_domain import simulate_time
from streams.types.block import STANDARD_GRAVITY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.common import Row

Rule = Literal["mean_force", "per_passage"]

ANGLES = (0.005, 0.01, 0.02)
"""Largest slip of the thesis, rad; Fig. 51 draws the first and the last."""
RULES: tuple[Rule, ...] = ("mean_force", "per_passage")
BLOCKS = 60
"""Blocks of seven ball periods that are measured where slip is random."""
_RATE = 25600.0
Key = tuple[str, float, float]
"""Defect, load, N, and speed, Hz."""


@dataclass(frozen=True)
class SlipLevel:
    """RMS, its standard error and A* of one condition, g."""

    rms: float
    rms_se: float
    a_star: float


Levels = dict[tuple[Rule, float], dict[Key, SlipLevel]]


def slip_levels(scenes: dict[Key, Scene], band: tuple[float, float], angles: tuple[float, ...] = ANGLES) -> Levels:
    """Return the levels of all conditions by rule and largest angle; the angle 0 is no slip (the same for both)."""
    found: Levels = {}
    options = LaneOptions(band=band, slip_blocks=BLOCKS, tolerance=1e-4)
    for rule in RULES:
        for angle in (0.0, *angles):
            if angle == 0.0 and found:
                found[rule, angle] = found[RULES[0], angle]
                continue
            levels = found.setdefault((rule, angle), {})
            for speed in sorted({speed for _, _, speed in scenes}):
                keys = [key for key in scenes if key[2] == speed]
                slip = Slip(angle, rule) if angle > 0.0 else None
                response = simulate_lanes([replace(scenes[key], slip=slip) for key in keys], options)
                a_star = np.sqrt(np.sum(response.harmonics[:, :5] ** 2, axis=1))
                for n, key in enumerate(keys):
                    values = (response.rms[n], response.rms_se[n], a_star[n])
                    levels[key] = SlipLevel(*(float(value) / STANDARD_GRAVITY for value in values))
    return found


def slip_rows(found: Levels) -> list[Row]:
    """Return the ratios to the level without slip, for each defect, over its six conditions."""
    rows: list[Row] = []
    for rule in RULES:
        still = found[rule, 0.0]
        for angle in ANGLES:
            for defect in sorted({defect for defect, _, _ in still}):
                keys = [key for key in still if key[0] == defect]
                levels = found[rule, angle]
                rms = [levels[key].rms / still[key].rms for key in keys]
                a_star = [levels[key].a_star / still[key].a_star for key in keys]
                rows.append(
                    {
                        "rule": rule,
                        "phi_slip rad": angle,
                        "defect": defect,
                        "RMS ratio, mean": float(np.mean(rms)),
                        "RMS ratio, least": min(rms),
                        "RMS ratio, largest": max(rms),
                        "A* ratio, mean": float(np.mean(a_star)),
                        "standard error of RMS, largest": max(levels[key].rms_se / levels[key].rms for key in keys),
                    }
                )
    return rows


def slip_statements(found: Levels) -> list[Row]:
    """Return what section 4.4.5 says of Fig. 51, and in how many of our conditions it is so."""

    def ratio(rule: Rule, angle: float, key: Key, name: str) -> float:
        return getattr(found[rule, angle][key], name) / getattr(found[rule, 0.0][key], name)

    def narrowest_loses_most(rule: Rule, key: Key) -> bool:
        others = [ratio(rule, 0.02, (defect, *key[1:]), "rms") for defect in ("D2", "D3")]
        return ratio(rule, 0.02, ("D1", *key[1:]), "rms") < min(others)

    tests: dict[str, Callable[[Rule, Key], bool]] = {
        "RMS falls from no slip to 0.005 rad": lambda rule, key: ratio(rule, 0.005, key, "rms") < 1.0,
        "RMS falls from 0.005 to 0.02 rad": lambda rule, key: (
            ratio(rule, 0.02, key, "rms") < ratio(rule, 0.005, key, "rms")
        ),
        "at 0.02 rad, A* changes less than RMS": lambda rule, key: (
            abs(ratio(rule, 0.02, key, "a_star") - 1.0) < abs(ratio(rule, 0.02, key, "rms") - 1.0)
        ),
        "at 0.02 rad, D1 loses most RMS of the three": narrowest_loses_most,
    }
    rows: list[Row] = []
    for text, test in tests.items():
        keys = [key for key in found[RULES[0], 0.0] if test is not narrowest_loses_most or key[0] == "D1"]
        row: Row = {"text": text}
        for rule in RULES:
            row[rule] = f"{sum(test(rule, key) for key in keys)} of {len(keys)}"
        rows.append(row)
    return rows


def slip_spectra(scene: Scene) -> dict[float, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return frequency, Hz, and amplitude, g, of one second of a scene by largest slip, one sigma for each passage."""
    found = {}
    for angle in (0.0, *ANGLES):
        response = simulate_time(replace(scene, slip=Slip(angle) if angle > 0.0 else None), 1.0, _RATE)
        signal = response.acceleration(_RATE, 1.0) / STANDARD_GRAVITY
        found[angle] = np.fft.rfftfreq(len(signal), 1.0 / _RATE), 2.0 * np.abs(np.fft.rfft(signal)) / len(signal)
    return found


def slip_spectrum_rows(spectra: dict[float, tuple[NDArray[np.float64], NDArray[np.float64]]]) -> list[Row]:
    """Return the largest line in each group of Fig. 49, by largest slip."""
    rows: list[Row] = []
    for angle, (frequency, amplitude) in spectra.items():
        row: Row = {"phi_slip rad": angle}
        for low, high in ((0.0, 800.0), (800.0, 3000.0), (6000.0, 9000.0)):
            row[f"{low:g} to {high:g} Hz, g"] = float(np.max(amplitude[(frequency >= low) & (frequency <= high)]))
        rows.append(row)
    return rows

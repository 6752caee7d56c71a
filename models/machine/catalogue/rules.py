"""Rules of design from which the internal geometry follows where only boundary dimensions are known.

The constants are means and standard deviations over the bearings of even bore code of each series whose geometry
follows from published load ratings (models/machine/catalogue/*.csv); those of odd bore code were held out and measure
the error (docs/evidence/catalogue.md). ``python -m benchmarks.catalogue_ratings`` prints them; no spread is taken below
2 %. The series without ratings (64, 160) have rules that are not fitted: those of their neighbours with a wider spread.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Rule:
    """Proportions of a series; spreads are relative standard deviations.

    Attributes:
        share: element diameter over half the difference of outside and bore diameter.
        room: distance of neighbouring elements along the pitch circle over their diameter.
        pitch: pitch diameter over the mean of bore and outside diameter.
        length: effective length of a roller over the width.
        least_width: least width of the bearing over the diameter of a ball.
    """

    share: float
    share_spread: float
    room: float
    room_spread: float
    pitch: float = 1.0
    length: float | None = None
    least_width: float = 0.0


RULES = {
    "60": Rule(0.586, 0.026, 1.71, 0.02),
    "62": Rule(0.605, 0.078, 1.716, 0.032),
    "63": Rule(0.612, 0.046, 1.682, 0.02),
    "64": Rule(0.620, 0.06, 1.68, 0.04),
    "160": Rule(0.570, 0.08, 1.75, 0.04, least_width=1.5),
    "618": Rule(0.566, 0.051, 1.891, 0.028),
    "619": Rule(0.592, 0.056, 1.765, 0.033),
    "72": Rule(0.621, 0.034, 1.13, 0.022),
    "73": Rule(0.619, 0.041, 1.135, 0.022),
    "12": Rule(0.464, 0.082, 1.315, 0.055),
    "13": Rule(0.459, 0.026, 1.281, 0.066),
    "22": Rule(0.501, 0.063, 1.24, 0.026),
    "23": Rule(0.557, 0.05, 1.208, 0.021),
    "NU2": Rule(0.486, 0.028, 1.456, 0.02, 1.002, 0.457),
    "NU3": Rule(0.494, 0.027, 1.389, 0.048, 1.006, 0.495),
    "NU22": Rule(0.486, 0.028, 1.495, 0.056, 1.002, 0.559),
    "NU23": Rule(0.494, 0.027, 1.389, 0.048, 1.006, 0.523),
    "NU2E": Rule(0.551, 0.02, 1.239, 0.025, 1.011, 0.574),
    "NU3E": Rule(0.547, 0.026, 1.231, 0.02, 1.011, 0.6),
    "NU22E": Rule(0.551, 0.02, 1.239, 0.025, 1.011, 0.627),
    "NU23E": Rule(0.547, 0.026, 1.231, 0.02, 1.011, 0.636),
    "302": Rule(0.497, 0.048, 1.105, 0.02, 1.0, 0.621),
    "303": Rule(0.499, 0.035, 1.095, 0.03, 1.0, 0.67),
    "222": Rule(0.565, 0.035, 1.141, 0.02, 1.02, 0.371),
    "223": Rule(0.557, 0.025, 1.135, 0.024, 1.02, 0.375),
}

_LEAST_PROBABILITY = 0.02


@dataclass(frozen=True)
class Estimate:
    """Internal geometry by a rule: lengths in the unit of the dimensions.

    Attributes:
        counts: numbers of elements and their probabilities, the likeliest first; they sum to 1.
        size_spread: relative standard uncertainty of the element diameter.
    """

    counts: tuple[tuple[int, float], ...]
    element_diameter: float
    pitch_diameter: float
    effective_length: float | None
    size_spread: float


def estimate(series: str, bore: float, outside: float, width: float) -> Estimate:
    """Return the internal geometry that the rule of a series gives for boundary dimensions.

    The count is a discrete alternative: its probabilities are those of a normal distribution about the room that is
    left, integrated over each whole number.

    Raises:
        KeyError: if the series has no rule.
    """
    rule = RULES[series]
    pitch = rule.pitch * 0.5 * (bore + outside)
    size = rule.share * 0.5 * (outside - bore)
    if rule.least_width:
        size = min(size, width / rule.least_width)
    fitting = math.pi * pitch / (size * rule.room)
    counts = count_probabilities(fitting, fitting * math.hypot(rule.share_spread, rule.room_spread))
    size = min(size, 0.98 * pitch * math.sin(math.pi / counts[0][0]))
    return Estimate(counts, size, pitch, None if rule.length is None else rule.length * width, rule.share_spread)


def count_probabilities(mean: float, spread: float) -> tuple[tuple[int, float], ...]:
    """Return whole numbers and their probabilities under a normal distribution, the likeliest first.

    Numbers of a probability below 2 % are left out, and the rest normalised.
    """

    def below(edge: float) -> float:
        return 0.5 * (1.0 + math.erf((edge - mean) / (spread * math.sqrt(2.0))))

    centre = round(mean)
    weights = {n: below(n + 0.5) - below(n - 0.5) for n in range(max(3, centre - 5), centre + 6)}
    kept = {n: weight for n, weight in weights.items() if weight >= _LEAST_PROBABILITY}
    total = sum(kept.values())
    return tuple(sorted(((n, weight / total) for n, weight in kept.items()), key=lambda item: -item[1]))

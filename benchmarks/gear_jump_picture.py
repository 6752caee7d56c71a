"""Picture of the branches of the harmonic balance and the sweeps in time (benchmarks.gear_jump)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from tests.oracles.gear_harmonic_balance import root_mean_square

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.gear_jump import Outcome

BLUE, RED, ORANGE, GREEN = "#0072b2", "#7b3f72", "#b84a00", "#007a5e"


def draw(outcomes: list[Outcome], path: Path) -> None:
    """Draw branches and sweeps."""
    figure = Figure(figsize=(14, 7.5), layout="constrained")
    axes = np.asarray(figure.subplots(2, 3))
    for ax, outcome in zip(axes.flat, outcomes, strict=False):
        frequency = np.array([motion.frequency for motion in outcome.branch])
        level = np.array([root_mean_square(motion) for motion in outcome.branch])
        stable = np.array([motion.stable for motion in outcome.branch])
        # Each piece between two motions is stable where both are.
        joined = np.append(stable[:-1] & stable[1:], stable[-1])
        ax.plot(
            frequency, np.where(joined | np.roll(joined, 1), level, np.nan), "-", color=BLUE, label="balance, stable"
        )
        ax.plot(frequency, np.where(~stable | ~joined, level, np.nan), ":", color=RED, label="balance, unstable")
        for _, branch in outcome.doubled:
            places = [motion.frequency for motion in branch], [root_mean_square(motion) for motion in branch]
            ax.plot(*places, "-", color=GREEN, label="balance, twice the period")
        for name, points, mark in (("up", outcome.up, "^"), ("down", outcome.down, "v")):
            places = [point.frequency for point in points[::4]], [point.rms for point in points[::4]]
            ax.plot(*places, mark, color=ORANGE, mfc="none", ms=4, mew=0.8, lw=0, label=f"in time, sweep {name}")
        for fold in outcome.folds:
            ax.plot(fold.frequency, root_mean_square(fold), "o", color="black", ms=4)
        case = outcome.case
        ax.set(title=case.name, xlabel="mesh frequency / natural frequency", xlim=case.sweep, ylim=(0, None))
        ax.set_ylabel("RMS of the deflection / half the backlash")
        ax.grid(alpha=0.25)
    axes[1, 2].axis("off")
    axes[1, 2].legend(*axes[1, 1].get_legend_handles_labels(), loc="center")
    figure.savefig(path, dpi=80)

"""A scene of a model that is integrated over time, with what else could integrate it, and how both are judged.

Errors: RMS of the difference of a signal from that with the reference's steps, over the RMS of its swing. Times:
processor seconds of a simulated second, the least of three. scipy's best is the fastest of its settings whose error is
at most the model's; it calls the model's own compiled equations from Python. Plain Python is the same setting of scipy
on equations that are written for the tests, without a compiler.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.common import Row

Floats = NDArray[np.float64]
Rate = Callable[[float, Floats], Floats]
ROUNDS = 3


class Setting(NamedTuple):
    """A method of ``solve_ivp`` with its relative tolerance."""

    method: str
    tolerance: float

    def __str__(self) -> str:
        """Return both, as in a table."""
        return f"{self.method}, {self.tolerance:g}"


class Run(NamedTuple):
    """What a kernel gave: the compared signal at every step, (steps, columns), and the acceleration, (steps,)."""

    signal: Floats
    acceleration: Floats


class Motion(NamedTuple):
    """Equations of motion, their state at the beginning, and the size of its entries."""

    rate: Rate
    start: Floats
    scale: Floats


class Problem(ABC):
    """One scene of one model from a known beginning.

    Attributes:
        model, scene: names.
        steps: of the kernel, s; with the first it begins.
        reference: step of the reference, s.
        grid: distance of the samples that are compared, a multiple of all steps, s.
        span, short: time that is compared, and that scipy is compared over, s.
        skipped: beginning of either that is not compared, s.
        plain_span: simulated time of plain Python, s.
        settings: of scipy.
        prototype: processor seconds of a simulated second of a prototype that was not part of the project, or None.
    """

    model: str
    scene: str
    steps: tuple[float, ...]
    reference: float
    grid: float
    span: float
    short: float
    skipped: float = 0.0
    plain_span: float = 0.01
    settings: tuple[Setting, ...] = ()
    prototype: float | None = None

    @abstractmethod
    def work(self, step: float, seconds: float, *, signal: bool) -> Callable[[], Run]:
        """Return a run of the kernel from the beginning; without ``signal`` that is empty, as in ``simulate``."""

    @abstractmethod
    def rate(self) -> Rate | None:
        """Return the compiled time derivative, or None where there is no equation of motion."""

    @abstractmethod
    def start(self) -> Floats:
        """Return the state at the beginning."""

    @abstractmethod
    def scale(self) -> Floats:
        """Return the size of each entry of the state."""

    @abstractmethod
    def read(self, times: Floats, states: Floats) -> Floats:
        """Return the compared signal, (times, columns), from states in columns."""

    @abstractmethod
    def plain(self) -> Motion:
        """Return the equations in plain Python."""


def seconds_of(work: Callable[[], object], rounds: int = ROUNDS) -> float:
    """Return the least processor time of some calls, s."""
    times: list[float] = []
    for _ in range(rounds):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def solved(setting: Setting, motion: Motion, grid: float, span: float) -> tuple[float, Floats, Floats]:
    """Return processor seconds of a simulated second of scipy, times and states on a grid, s."""
    begin = time.process_time()
    found = solve_ivp(
        motion.rate,
        (0.0, span),
        motion.start,
        method=cast("Any", setting.method),
        t_eval=grid * np.arange(round(span / grid)),
        rtol=setting.tolerance,
        atol=setting.tolerance * motion.scale,
        # A ball is on a defect for about this time.
        max_step=1e-4,
    )
    return (time.process_time() - begin) / span, found.t, found.y


class Judge:
    """A problem with its reference."""

    def __init__(self, problem: Problem) -> None:
        """Integrate the reference."""
        self.problem = problem
        self._exact, self._peak = self._sampled(problem.reference)

    def _sampled(self, step: float) -> tuple[Floats, float]:
        problem = self.problem
        run = problem.work(step, problem.span, signal=True)()
        every = round(problem.grid / step)
        kept = run.acceleration[round(problem.skipped / step) :]
        return run.signal[::every].copy(), 0.5 * float(np.max(kept) - np.min(kept))

    def error(self, signal: Floats, span: float) -> float:
        """Return the error of a signal on the grid over the first of the time; infinite where it ended too soon."""
        first, last = round(self.problem.skipped / self.problem.grid), round(span / self.problem.grid)
        if len(signal) < last:
            return math.inf
        exact, found = self._exact[first:last], signal[first:last]
        swing = exact - np.mean(exact, axis=0)
        return float(np.sqrt(np.mean((found - exact) ** 2) / np.mean(swing**2)))

    def cost(self, step: float) -> Row:
        """Return time and errors with a step."""
        problem = self.problem
        work = problem.work(step, problem.span, signal=False)
        work()
        signal, peak = self._sampled(step)
        return {
            "model": problem.model,
            "scene": problem.scene,
            "step us": 1e6 * step,
            "error": self.error(signal, problem.span),
            "peak error": abs(peak / self._peak - 1.0),
            "ms per s": 1e3 * seconds_of(work) / problem.span,
        }

    def against(self) -> Row:
        """Return the first step's cost beside those of scipy, plain Python and the prototype."""
        problem = self.problem
        row = dict(self.cost(problem.steps[0]))
        mine = cast("float", row["ms per s"])
        wanted = self.error(self._sampled(problem.steps[0])[0], problem.short)
        best = self._scipy(wanted)
        plain = None if best is None else self._plain(best[0])
        prototype = None if problem.prototype is None else 1e3 * problem.prototype
        return {
            **row,
            "scipy": None if best is None else str(best[0]),
            "scipy error": None if best is None else best[1],
            "error there": wanted,
            "scipy ms per s": None if best is None else best[2],
            "times scipy": None if best is None else best[2] / mine,
            "plain ms per s": plain,
            "times plain": None if plain is None else plain / mine,
            "prototype ms per s": prototype,
            "share of prototype": None if prototype is None else mine / prototype,
        }

    def _scipy(self, wanted: float) -> tuple[Setting, float, float] | None:
        """Return scipy's fastest setting that is at least so good, its error and ms of a simulated second."""
        problem, rate = self.problem, self.problem.rate()
        if rate is None:
            return None
        motion = Motion(rate, problem.start(), problem.scale())
        rate(0.0, motion.start)
        best: tuple[Setting, float, float] | None = None
        for setting in problem.settings:
            took, times, states = solved(setting, motion, problem.grid, problem.short)
            error = self.error(problem.read(times, states), problem.short)
            if error <= wanted and (best is None or 1e3 * took < best[2]):
                best = setting, error, 1e3 * took
        return best

    def _plain(self, setting: Setting) -> float:
        """Return ms of a simulated second of scipy on equations in plain Python."""
        problem = self.problem
        return 1e3 * solved(setting, problem.plain(), problem.grid, problem.plain_span)[0]

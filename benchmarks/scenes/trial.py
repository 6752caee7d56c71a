"""One random scene of ``benchmarks.scenes.judged``: what ``auto`` takes, what every model costs and misses."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes.draws import Drawn
from models.machine.bearing import kinematics
from models.machine.scene import Scene
from models.solve.ball_inertia import period as ball_period
from models.solve.ball_inertia import solver as ball_inertia
from models.solve.mappings.table import Mapping
from models.solve.registry import Solver
from models.solve.response import Response
from models.solve.rotor import elastic as rotor_elastic
from models.solve.rotor.solver import Rigid
from models.solve.simulate import choose, simulate, stand_ins, volume_slope
from models.solve.six_dof import periodic, time_domain
from models.words.request import Request

FINER = 8
"""Steps of the truth over those that the reference begins with."""
FINER_ACCURACY = 1e-3
"""Accuracy of the truth where one ball period is solved, over that which is asked for."""
TIMED = 3
TURNS = 5
"""Warm calls of each model whose median is taken."""
TIMED_BELOW_S = 0.1
"""A call is repeated unless it takes longer."""
_PHASES = 4096


@dataclass(frozen=True)
class Answer:
    """What one model gave.

    Attributes:
        name: of model and solver.
        true, predicted: error of what is asked, relative, and the bound of that of the exchange.
        seconds: processor time.
        stated: error that the response states, of steps, averaging and model.
    """

    name: str
    true: float
    predicted: float
    seconds: float
    stated: float = math.nan


@dataclass(frozen=True)
class Trial:
    """A scene: what ``auto`` took, the reference and what could stand for it, the reference first."""

    drawn: Drawn
    taken: Answer
    answers: tuple[Answer, ...]

    @property
    def cheapest(self) -> float:
        """Processor time of the cheapest that met the accuracy, s; the reference counts as one that does."""
        met = [a.seconds for a in self.answers[1:] if a.true <= self.drawn.request.accuracy]
        return min([*met, self.answers[0].seconds])


def timed(function: Callable[[], Response]) -> tuple[Response, float]:
    """Return a response and the least processor time of several calls, s."""
    begin = time.process_time()
    found = function()
    times = [time.process_time() - begin]
    # The first may have loaded kernels.
    while len(times) < 2 or (len(times) < TIMED and times[-1] < TIMED_BELOW_S):
        begin = time.process_time()
        found = function()
        times.append(time.process_time() - begin)
    return found, min(times)


def first_step(scene: Scene, solver: Solver) -> float:
    """Return the step with which a solver over time begins, s."""
    if solver.model == "ball_inertia":
        return ball_inertia.SHARE_OF_STABLE * ball_inertia.longest_stable_step(scene)
    if solver.name == "rigid":
        return Rigid(scene, 0.0).longest_step()
    if solver.name == "elastic":
        return rotor_elastic.shaft_of(scene).longest_step()
    return time_domain.longest_step(scene, kinematics(scene.bearing, scene.speed))


def truth_of(scene: Scene, request: Request, solver: Solver) -> Response:
    """Return the response of the reference with steps far finer than its own."""
    if solver.solve is ball_period.solve:
        solver = ball_inertia.SOLVER
    if solver.solve is periodic.solve:
        return solver.solve(scene, replace(request, accuracy=max(FINER_ACCURACY * request.accuracy, 1e-7)))
    step = first_step(scene, solver)
    a_sample = max(2, math.ceil(1.0 / (request.rate * step) - 1e-9))
    steps = math.ceil(FINER * a_sample * request.rate / kinematics(scene.bearing, scene.speed).bpfo)
    return solver.solve(scene, replace(request, steps_per_period=steps))


def error_of(found: Response, truth: Response, request: Request, slope: float) -> float:
    """Return the true error of what is asked, relative. The phase of the ball passage is free."""
    rms = abs(found.rms / truth.rms - 1.0)
    if request.quantity == "rms":
        return rms
    if request.quantity == "v_eq":
        return rms / slope
    one, two = truth.coefficients[0, 1:], found.coefficients[0, 1:]
    if request.quantity == "lines":
        return float(np.max(np.abs(np.abs(one[:6]) - np.abs(two[:6]))) / np.max(np.abs(one[:6])))
    count = min(len(one), len(two))
    return _least_difference(one[:count], two[:count])


def _least_difference(one: NDArray[np.complex128], two: NDArray[np.complex128]) -> float:
    """Return the relative difference of two waveforms from their lines, at the shift where it is least."""
    size = max(_PHASES, 8 * len(one))
    cross = np.fft.ifft(np.concatenate(([0.0], one * np.conj(two))), size) * size
    best = 2.0 * math.pi * int(np.argmax(cross.real)) / size
    order = np.arange(1, len(one) + 1)
    fine = best + np.linspace(-1.0, 1.0, 401) * 2.0 * math.pi / size
    shifted = [np.sum(np.abs(one - two * np.exp(-1j * order * phase)) ** 2) for phase in fine]
    shifted += [np.sum(np.abs(one - two * np.exp(1j * order * phase)) ** 2) for phase in fine]
    return math.sqrt(float(min(shifted)) / float(np.sum(np.abs(one) ** 2)))


def run(drawn: Drawn, turns: int = TURNS) -> Trial:
    """Return what a scene gives; the calls are timed in turns."""
    scene, request = drawn.scene, drawn.request
    reference = choose(scene, request)[0]
    own = replace(request, quantity="rms") if request.quantity == "v_eq" else request
    slope = 1.0
    if request.quantity == "v_eq":
        slope = max(abs(volume_slope(replace(scene, model=reference.model), request)), 1e-9)
        own = replace(own, accuracy=max(request.accuracy * slope, 1e-6))
    truth = truth_of(scene, own, reference)
    calls: list[Callable[[], Response]] = [lambda: _auto(scene, own), lambda: reference.solve(scene, own)]
    names, bounds = [f"{reference.model} {reference.name}"], [0.0]
    for one in stand_ins(scene, own, reference)[0]:
        half = replace(one.request, accuracy=max(0.5 * own.accuracy, one.solver.error))
        calls.append(lambda one=one, half=half: one.mapped.back(one.solver.solve(one.mapped.scene, half)))
        names.append(f"{one.solver.model} {one.solver.name}")
        bounds.append(bound_of(one.mapping, scene, own) / slope)
    found, seconds = timed_in_turns(calls, turns)
    answers = tuple(
        Answer(name, error_of(response, truth, request, slope), bound, spent)
        for name, bound, response, spent in zip(names, bounds, found[1:], seconds[1:], strict=True)
    )
    taken = found[0]
    error = error_of(taken, truth, request, slope)
    auto = Answer(f"{taken.model} {taken.solver}", error, taken.model_error / slope, seconds[0], taken.error / slope)
    return Trial(drawn, auto, answers)


def bound_of(mapping: Mapping, scene: Scene, request: Request) -> float:
    """Return the bound of the error of a mapping, infinite where none is known."""
    try:
        return mapping.error(scene, request)
    except ValueError:
        return math.inf


def timed_in_turns(calls: Sequence[Callable[[], Response]], turns: int) -> tuple[list[Response], list[float]]:
    """Return the responses of calls and the median of the processor times of each, s, warm and one after the other."""
    found = [call() for call in calls]
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(turns):
        for spent, call in zip(times, calls, strict=True):
            begin = time.process_time()
            call()
            spent.append(time.process_time() - begin)
    return found, [median(spent) for spent in times]


def _auto(scene: Scene, request: Request) -> Response:
    return simulate(
        scene, accuracy=request.accuracy, quantity=request.quantity, duration=request.duration, rate=request.rate
    )

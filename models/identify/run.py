"""An identification from tests to parameters, their intervals and its hash.

Candidates that were simulated are kept in a file: a run that was stopped takes them from there and repeats the rest.
The search depends on its seed and on what the candidates gave, nothing else, so that a resumed run ends with the same
result as one that was not stopped.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.identify.evaluate import CandidateLevel, Evaluator, Key
from models.identify.evidence import Evidence
from models.identify.intervals import ParameterInterval, Threshold, profile_intervals, threshold, valley_choice
from models.identify.posterior import draw_posterior, planned_candidates
from models.identify.problem import Fit, Problem
from models.identify.search import lowest, nsga2, planned_evaluations, search, simulated_front
from models.identify.trials import FEATURES, Trials
from models.machine.rig import RigPosterior, rounded
from models.words.errors import WrongInputError
from models.work.program import program
from models.work.runner import SERIAL

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.space import Space
    from models.work.runner import Runner

SAVE_EVERY_S = 20.0


class StateFile:
    """The state file of one identification."""

    def __init__(self, path: Path, problem: str) -> None:
        """``problem`` is a hash of all that the result depends on: a file of another problem is refused."""
        self._path, self._problem = path, problem
        self._part = path.with_name(path.name + ".part")
        self._saved = time.monotonic()

    def load(self) -> dict[Key, CandidateLevel]:
        """Return what an earlier run found, nothing where there is no file.

        Raises:
            WrongInputError: the file is of another problem, or damaged; the message names it.
        """
        if not self._path.exists():
            return {}
        try:
            with np.load(self._path, allow_pickle=False) as file:
                problem = str(file["problem"])
                arrays = [np.asarray(file[name], dtype=np.float64) for name in ("keys", "features", "doubt")]
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise WrongInputError(f"{self._path}: is no state of an identification ({error}); delete it") from None
        if problem != self._problem:
            raise WrongInputError(
                f"{self._path}: is the state of another identification: tests, configuration, options or the "
                "program have changed; delete it, or leave --resume out"
            )
        keys, features, doubt = arrays
        return {tuple(key): CandidateLevel(f, d) for key, f, d in zip(keys.tolist(), features, doubt, strict=True)}

    def save_sometimes(self, evaluator: Evaluator) -> None:
        """Save what an evaluator has found, if the last time is long ago."""
        if time.monotonic() - self._saved >= SAVE_EVERY_S:
            self.save(evaluator)

    def save(self, evaluator: Evaluator) -> None:
        """Replace the file in one step by what an evaluator has found."""
        keys: NDArray[np.float64] = np.array(list(evaluator.kept))
        with self._part.open("wb") as file:
            np.savez(
                file,
                problem=np.array(self._problem),
                keys=keys,
                features=np.array([level.features for level in evaluator.kept.values()]),
                doubt=np.array([level.doubt for level in evaluator.kept.values()]),
            )
            file.flush()
            os.fsync(file.fileno())
        self._part.replace(self._path)
        self._saved = time.monotonic()

    def remove(self) -> None:
        """Remove the file, and what a killed process left half written."""
        self._path.unlink(missing_ok=True)
        self._part.unlink(missing_ok=True)


Method = Literal["search", "nsga2"]
Progress = Callable[[str, int, int, float], None]
"""Called with the stage, candidates so far, about how many in all, and the seconds that are left."""
# Candidates of a profile per parameter, on average.
_PROFILE_CANDIDATES = 45
# Members of the front from which least squares begin.
_FRONT_STARTS = 6
# Rounds of profiles, iterations of a fit between them, and the share of what is added to the threshold by which a fit
# must be better for another round.
_ROUNDS, _FINAL_CALLS, _SAME = 3, 25, 0.01
# Significant digits of numbers in the hash.
_DIGITS = 12


@dataclass(frozen=True)
class IdentifyOptions:
    """How tests are compared with the model.

    Attributes:
        objectives: features that are compared, of ``FEATURES``.
        band: in which the RMS is taken, Hz, or None.
        seed: of all random draws.
        level: of the intervals.
        method: "search" (a design, least squares and a scan along the resonance) or "nsga2" (the front first, by
            pymoo, then least squares from it and the same scan).
        population, generations: of NSGA-II.
    """

    objectives: tuple[str, ...] = FEATURES
    band: tuple[float, float] | None = None
    seed: int = 0
    level: float = 0.95
    method: Method = "search"
    population: int = 40
    generations: int = 25

    def __post_init__(self) -> None:
        """Raise a WrongInputError that names an option of no use."""
        wrong = [name for name in self.objectives if name not in FEATURES]
        if wrong or not self.objectives or len(set(self.objectives)) < len(self.objectives):
            raise WrongInputError(f"objectives: expected some of {', '.join(FEATURES)}, got {self.objectives!r}")
        if not 0.5 <= self.level < 1.0:
            raise WrongInputError(f"the level of the intervals must be from 0.5 to below 1, got {self.level!r}")


@dataclass(frozen=True, eq=False)
class Identification:
    """What tests say about a rig, SI.

    Attributes:
        space: that was searched.
        best: the fit of least cost.
        intervals: of the free parameters.
        front: parameters and objectives (%) of the candidates that no other dominates.
        deviations: objectives of the best fit, %.
        features: RMS and A* of the best fit, m/s2, shape (conditions, features).
        noise: relative standard deviation of the tests about the best fit; NaN without tests.
        evaluations: candidates simulated.
        seconds: wall time.
        resonances: highest natural frequency at each load, across and along it, Hz.
        not_periodic: conditions in which the motion of the best fit does not repeat.
        problem: the tests, all candidates that were simulated (``problem.evaluator.kept``) and all fits.
        limit: cost up to which a fit is within its intervals.
        posterior: draws of the free parameters, which maps and libraries take.
    """

    space: Space
    best: Fit
    intervals: dict[str, ParameterInterval]
    front: list[tuple[dict[str, float], dict[str, float]]]
    deviations: dict[str, float]
    features: np.ndarray[tuple[int, int], np.dtype[np.float64]]
    noise: float
    evaluations: int
    seconds: float
    resonances: tuple[float, ...]
    not_periodic: int
    problem: Problem
    limit: Threshold
    posterior: RigPosterior

    @property
    def hash(self) -> str:
        """SHA-256 of tests, space, result and posterior, hexadecimal."""
        return self.posterior.identification

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that the tests do not determine."""
        return tuple(name for name, interval in self.intervals.items() if interval.reason)


def identify(
    trials: Trials,
    space: Space,
    options: IdentifyOptions | None = None,
    evidence: Evidence | None = None,
    *,
    state: Path | None = None,
    resume: bool = False,
    runner: Runner = SERIAL,
    near: Runner | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Return the parameters of a rig that tests tell, and how well.

    Args:
        trials: the tests.
        space: the free parameters and their limits.
        options: default ``IdentifyOptions()``.
        evidence: peaks and priors that enter the likelihood beside the tests.
        state: file in which candidates are kept while it runs; removed at the end.
        resume: take what the file holds.
        runner: simulates candidates, and ``near`` batches too small to be sent; default ``runner``. The result does
            not depend on them.
        progress: called after each batch of candidates.

    Raises:
        WrongInputError: the tests cannot determine so many parameters, nothing is admissible, or the file is of
            another problem.
    """
    options, evidence = options or IdentifyOptions(), evidence or Evidence()
    if not space.free:
        raise WrongInputError("no parameter is free")
    began = time.perf_counter()
    evaluator = Evaluator(space, trials.conditions, options.band, runner, near or runner)
    problem = Problem(trials, evaluator, options.objectives, evidence)
    _check_known(problem)
    threshold(problem, 1.0, options.level)
    facts = _problem_facts(trials, space, options, evidence)
    file = None if state is None else StateFile(state, _hash(facts | {"program": program()}))
    if file is not None and resume:
        evaluator.kept.update(file.load())
    stage = _Stage(evaluator, file, progress, _planned(space, options))
    evaluator.notify = stage.note
    try:
        stage.name = "search"
        best = _searched(problem, options)
        stage.name = "intervals"
        best, limit, intervals = _profiled(problem, best, options.level, options.seed)
        stage.name = "posterior"
        drawn = draw_posterior(problem, best, limit, seed=options.seed)
    except BaseException:
        # What was simulated is worth keeping, whatever ended the run.
        if file is not None and evaluator.kept:
            file.save(evaluator)
        raise
    if file is not None:
        file.remove()
    # The result holds neither the caller's callback nor its runner.
    evaluator.notify, evaluator.runner, evaluator.near = None, SERIAL, SERIAL
    posterior = RigPosterior(
        best=tuple((name, rounded(value)) for name, value in best.values.items()),
        names=space.free,
        rows=tuple(tuple(row) for row in drawn.rows.tolist()),
        result=_hash({**facts, "result": _result_facts(best, intervals)}),
        effective=drawn.effective,
        candidates=drawn.candidates,
    )
    return _identification(problem, best, limit, intervals, posterior, began)


def _identification(
    problem: Problem,
    best: Fit,
    limit: Threshold,
    intervals: dict[str, ParameterInterval],
    posterior: RigPosterior,
    began: float,
) -> Identification:
    """Return what was found; ``began``: reading of ``time.perf_counter`` at the beginning."""
    evaluator, space = problem.evaluator, problem.evaluator.space
    level = evaluator.levels([best.values])[0]
    return Identification(
        space=space,
        best=best,
        intervals=intervals,
        front=simulated_front(problem) if np.any(problem.trials.damaged) else [],
        deviations=problem.deviations(level),
        features=level.features,
        noise=float(np.sqrt(limit.variance) * np.mean(problem.deviation)) if problem.deviation.size else math.nan,
        evaluations=len(evaluator.kept),
        seconds=time.perf_counter() - began,
        resonances=space.resonances(best.values),
        not_periodic=int(np.count_nonzero(np.any(level.doubt > 0.0, axis=1))),
        problem=problem,
        limit=limit,
        posterior=posterior,
    )


def _check_known(problem: Problem) -> None:
    """Raise a WrongInputError that names an objective which no test has."""
    damaged = problem.trials.damaged
    for column, name in enumerate(problem.objectives):
        if np.any(damaged) and not np.any(problem.known[damaged, column]):
            raise WrongInputError(f"no test has a usable {name}; leave it out of the objectives")


def _profiled(
    problem: Problem, best: Fit, level: float, seed: int
) -> tuple[Fit, Threshold, dict[str, ParameterInterval]]:
    """Return the best fit with its intervals; where their profiles meet a better one, once more from there."""
    rounds = 0
    while True:
        limit = threshold(problem, best.cost, level, valley_choice(problem, best, seed))
        intervals, rounds = profile_intervals(problem, best, limit), rounds + 1
        better = lowest(problem)
        if rounds == _ROUNDS or better.cost > best.cost - _SAME * limit.added:
            return best, limit, intervals
        fitted = problem.fit(problem.evaluator.space, better.point, calls=_FINAL_CALLS)
        best = better if fitted is None or fitted.cost > better.cost else fitted
        problem.fits.append(best)


def _searched(problem: Problem, options: IdentifyOptions) -> Fit:
    starts: list[Fit] = []
    if options.method == "nsga2":
        if not np.any(problem.trials.damaged):
            raise WrongInputError("nsga2 needs tests with known defects: without them there are no objectives")
        front = nsga2(problem, population=options.population, generations=options.generations, seed=options.seed)
        starts = sorted(front, key=lambda fit: fit.cost)[:_FRONT_STARTS]
    return search(problem, options.seed, starts)[0]


def _planned(space: Space, options: IdentifyOptions) -> int:
    free = len(space.free)
    front = options.population * options.generations if options.method == "nsga2" else 0
    profiles = _PROFILE_CANDIDATES * free * (free + 1)
    return front + planned_evaluations(free) + profiles + planned_candidates(free)


class _Stage:
    """Says how far a run is, and lets its file be saved."""

    def __init__(self, evaluator: Evaluator, file: StateFile | None, progress: Progress | None, planned: int) -> None:
        self.name = ""
        self._evaluator, self._file, self._progress, self._planned = evaluator, file, progress, planned
        self._began, self._before = time.monotonic(), len(evaluator.kept)

    def note(self) -> None:
        """Note that a batch was simulated."""
        if self._file is not None:
            self._file.save_sometimes(self._evaluator)
        if self._progress is not None:
            done = len(self._evaluator.kept)
            rate = (time.monotonic() - self._began) / max(1, done - self._before)
            planned = max(self._planned, done)
            self._progress(self.name, done, planned, rate * (planned - done))


def _problem_facts(trials: Trials, space: Space, options: IdentifyOptions, evidence: Evidence) -> dict[str, object]:
    """Return all that the result depends on, as JSON has it."""
    facts = {"evidence": evidence.facts()} if evidence.size else {}
    return {
        **facts,
        "conditions": [asdict(condition) for condition in trials.conditions],
        "features": [[_rounded(v) for v in row] for row in trials.mean.tolist()],
        "count": trials.count.tolist(),
        "rig": {**space.known, "element": space.rig.element},
        "bearing": asdict(space.bearing),
        "loads": space.loads,
        "free": space.free,
        "limits": {name: str(value) for name, value in asdict(space.limits).items()},
        "options": asdict(options),
    }


def _result_facts(best: Fit, intervals: dict[str, ParameterInterval]) -> dict[str, object]:
    return {
        "best": {name: _rounded(value) for name, value in best.values.items()},
        "intervals": {name: [_rounded(i.low), _rounded(i.high)] for name, i in intervals.items()},
        "undetermined": [name for name, interval in intervals.items() if interval.reason],
    }


def _rounded(value: float) -> str:
    return f"{value:.{_DIGITS}g}"


def _hash(facts: dict[str, object]) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()

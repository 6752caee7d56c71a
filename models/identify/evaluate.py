"""The features that a candidate has at the conditions of the tests, several candidates at a time, each once."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from models.identify.trials import FEATURES, Condition, a_star
from models.machine.bearing import kinematics
from models.machine.scene import Defect, Scene
from models.work.runner import SERIAL
from models.work.task import Work

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.space import Space
    from models.work.runner import Runner

# Relative error of the RMS due to the steps (1e-3 was found); it changes smoothly with the parameters.
ACCURACY = 5e-3
# Ball periods that a motion is simulated for which does not repeat.
_MAX_PERIODS = 400
# Bytes of a row of a candidate beside the program, at most.
_MEMORY = 64_000_000
# Seconds of a condition of a candidate, roughly; of a chunk; and of a batch that is worth sending.
_SECONDS, _CHUNK_SECONDS, _SENT_SECONDS = 1e-3, 0.5, 1.0
# Relative uncertainty of a level that drifts or left the finite numbers.
_UNKNOWN = 1.0
# A smaller level counts as this one, m/s2: logarithms are taken of levels.
_LEAST_LEVEL = 1e-9

Values = Mapping[str, float]
Key = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class CandidateLevel:
    """What one candidate does at all conditions.

    Attributes:
        features: RMS and A*, m/s2, shape (conditions, features).
        doubt: relative standard deviation of each, shape (conditions, features): zero where the motion repeats with
            the ball passage, that from period to period where it does not, 1 where the level is unknown.
    """

    features: NDArray[np.float64]
    doubt: NDArray[np.float64]


@dataclass(frozen=True)
class _Row:
    """Conditions that differ in the extent of their defect only, by their numbers."""

    condition: Condition
    numbers: tuple[int, ...]
    extents: tuple[float, ...]


@dataclass(frozen=True)
class _Bench:
    """What the simulations of all candidates share; fields as of Evaluator."""

    space: Space
    conditions: tuple[Condition, ...]
    band: tuple[float, float] | None

    def scene(self, values: Values, condition: Condition) -> Scene:
        """Return the scene of a candidate at a condition."""
        defect = Defect(condition.dphi_d, condition.h_d, part=condition.part)
        rig, clearance = self.space.rig_of(values), values["clearance"]
        return Scene(condition.speed, condition.load, self.space.bearing, rig, defect, clearance)

    def a_star(self, scene: Scene, harmonics: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return A* of amplitudes, shape (..., lines), of the lines in the band."""
        if self.band is None or scene.defect is None:
            return a_star(harmonics)
        lines = kinematics(scene.bearing, scene.speed)
        first = {"outer": lines.bpfo, "inner": lines.bpfi, "ball": 2.0 * lines.bsf}[scene.defect.part]
        places = first * np.arange(1.0, harmonics.shape[-1] + 1.0, dtype=np.float64)
        return a_star(harmonics * ((places >= self.band[0]) & (places <= self.band[1])))


_Task = tuple[Values, _Row]
_Found = tuple["NDArray[np.float64]", "NDArray[np.float64]"]


def _row_levels(bench: _Bench, task: _Task) -> _Found:
    """Return features and doubt of a candidate in a row, both (extents, features)."""
    values, row = task
    scene = bench.scene(values, row.condition)
    if row.condition.part != "outer":
        found = [_turning(bench, bench.scene(values, bench.conditions[n])) for n in row.numbers]
        return np.array([f for f, _ in found]), np.array([d for _, d in found])
    from models.solve.six_dof.rows import simulate_row

    settled = simulate_row(scene, np.array(row.extents), accuracy=ACCURACY, band=bench.band)
    features = np.column_stack([settled.rms, bench.a_star(scene, settled.harmonics)])
    doubt = np.zeros_like(features)
    for i in np.flatnonzero(~settled.settled):
        features[i], doubt[i] = _simulated_on(bench, bench.scene(values, bench.conditions[row.numbers[i]]))
    return np.maximum(features, _LEAST_LEVEL), doubt


def _simulated_on(bench: _Bench, scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return features and doubt, both (features,), of a motion that was not found to repeat."""
    from models.solve.simulate import simulate

    highest = 0.0 if bench.band is None else bench.band[1]
    response = simulate(scene, accuracy=ACCURACY, max_periods=_MAX_PERIODS, band=bench.band, lines_to=highest)
    if response.status == "not_converged" or not math.isfinite(response.rms):
        return np.full(len(FEATURES), _LEAST_LEVEL), np.full(len(FEATURES), _UNKNOWN)
    features = np.array([response.rms, float(bench.a_star(scene, response.harmonics))])
    doubt = min(_UNKNOWN, response.spread / max(response.rms, _LEAST_LEVEL))
    return features, np.full(len(FEATURES), doubt)


def _turning(bench: _Bench, scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return features and doubt, both (features,), of a defect that turns: means over its turns."""
    from models.solve.six_dof.stationary import stationary_level

    level = stationary_level(scene, accuracy=ACCURACY, band=bench.band)
    if level.status == "not_converged":
        return np.full(len(FEATURES), _LEAST_LEVEL), np.full(len(FEATURES), _UNKNOWN)
    amplitude = max(float(bench.a_star(scene, level.harmonics)), _LEAST_LEVEL)
    error = float(bench.a_star(scene, level.harmonics * level.harmonics_se)) / amplitude**2
    rms = max(level.rms, _LEAST_LEVEL)
    return np.array([rms, amplitude]), np.array([level.rms_se / rms, error])


CANDIDATES = Work("candidates of the identification", _row_levels, memory=_MEMORY, threads=True)


@dataclass(eq=False)
class Evaluator:
    """Simulates candidates; keeps what it found, so that no candidate is simulated twice.

    Attributes:
        space: of which all candidates are.
        conditions: of the tests.
        band: in which RMS and A* are taken, Hz, or None for the full bandwidth.
        runner: simulates the rows of candidates, and ``near`` those of few. The results do not depend on them.
        kept: what was found, by the values of the parameters; that of an earlier run may be given.
        simulated: candidates simulated here.
        notify: called after each batch.
    """

    space: Space
    conditions: Sequence[Condition]
    band: tuple[float, float] | None = None
    runner: Runner = SERIAL
    near: Runner = SERIAL
    kept: dict[Key, CandidateLevel] = field(default_factory=dict[Key, CandidateLevel])
    simulated: int = 0
    notify: Callable[[], None] | None = None

    def __post_init__(self) -> None:
        """Group the conditions into rows."""
        self._bench = _Bench(self.space, tuple(self.conditions), self.band)

        def common(number: int) -> tuple[object, ...]:
            c = self.conditions[number]
            return c.part, c.speed, c.load, c.h_d

        numbers = sorted(range(len(self.conditions)), key=lambda n: (*common(n), self.conditions[n].dphi_d))
        self._rows: list[_Row] = []
        for _, group in groupby(numbers, key=common):
            members = tuple(group)
            extents = tuple(self.conditions[n].dphi_d for n in members)
            self._rows.append(_Row(self.conditions[members[0]], members, extents))

    def levels(self, candidates: Sequence[Values]) -> list[CandidateLevel]:
        """Return the levels of candidates.

        Raises:
            ValueError: if one is outside Eq. 80; nothing is simulated then.
        """
        keys = [tuple(values.values()) for values in candidates]
        missing = {key: values for key, values in zip(keys, candidates, strict=True) if key not in self.kept}
        for values in missing.values():
            if violations := self.space.violations(values):
                raise ValueError(f"a candidate is outside the constraints: {'; '.join(violations)}")
        tasks = [(dict(values), row) for values in missing.values() for row in self._rows]
        found = iter(self._simulate(tasks))
        shape = len(self.conditions), len(FEATURES)
        for key in missing:
            level = CandidateLevel(np.empty(shape), np.empty(shape))
            for row in self._rows:
                features, doubt = next(found)
                level.features[list(row.numbers)], level.doubt[list(row.numbers)] = features, doubt
            self.kept[key] = level
        self.simulated += len(missing)
        if self.notify is not None and missing:
            self.notify()
        return [self.kept[key] for key in keys]

    def _simulate(self, tasks: Sequence[_Task]) -> list[_Found]:
        seconds = _SECONDS * len(self.conditions) / max(1, len(self._rows))
        # Most batches are those of a step of least squares: sooner done here than sent.
        runner = self.near if len(tasks) * seconds < _SENT_SECONDS else self.runner
        return list(runner.run(CANDIDATES.sized(seconds, chunk=_CHUNK_SECONDS), self._bench, tasks))

    def scene(self, values: Values, condition: Condition) -> Scene:
        """Return the scene of a candidate at a condition."""
        return self._bench.scene(values, condition)

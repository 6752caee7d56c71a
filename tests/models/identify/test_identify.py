"""Identifications from end to end: with the model, small, and with a stand-in for it where only the search matters."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.identify import evaluate
from models.identify import run as state_module
from models.identify.evaluate import Evaluator
from models.identify.limits import AdmissibleLimits
from models.identify.problem import Problem
from models.identify.run import Identification, IdentifyOptions, identify
from models.identify.search import non_dominated
from models.identify.space import Space
from models.identify.trials import Condition, Trial, Trials, gather
from models.machine.rig import Rig
from models.machine.scene import Scene
from models.solve.six_dof.stationary import StationaryLevel
from models.words.errors import WrongInputError
from models.work.choose import local_runner
from tests.models.identify.cases import BAND, CONDITIONS, TRUTH, simulated_trials, space_of
from tests.support.identify import stand_in
from tests.support.space import broken

OPTIONS = IdentifyOptions(band=BAND)
MANY = tuple(Condition(load, 40.0, 0.02 * n, 5e-4) for load in (1000.0, 2000.0) for n in range(1, 6))


def of(found: Identification, name: str) -> tuple[float, float, float]:
    interval = found.intervals[name]
    return interval.low, found.best.values[name], interval.high


def test_a_mass_is_found_with_the_model() -> None:
    found = identify(simulated_trials(0.01), space_of("m_r", rig=Rig()), OPTIONS)
    low, best, high = of(found, "m_r")
    # 1 % of m_r is 0.3 % of f_r, which moves the features by several percent.
    assert best == pytest.approx(TRUTH.m_r, rel=0.01)
    assert low < TRUTH.m_r < high
    assert high - low < 0.1
    assert found.undetermined == ()
    assert found.noise < 0.03
    assert 0.0 < found.deviations["rms"] < 3.0
    assert found.evaluations < 1000


def test_what_the_tests_do_not_tell_is_said() -> None:
    found = identify(simulated_trials(0.01), space_of("m_r", "alpha_c", rig=TRUTH), OPTIONS)
    # alpha_c from 0 to 600 1/s moves the RMS by less than 0.1 %.
    assert found.undetermined == ("alpha_c",)
    low, _, high = of(found, "alpha_c")
    assert high - low > 300.0
    assert found.intervals["alpha_c"].at_limit == (True, True)
    low, best, high = of(found, "m_r")
    assert low < TRUTH.m_r < high
    assert best == pytest.approx(TRUTH.m_r, rel=0.02)


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, float]]:
    """Replace the simulation by the stand-in; what is simulated is listed."""
    asked: list[dict[str, float]] = []

    def simulate(bench: Any, task: Any) -> tuple[np.ndarray, np.ndarray]:
        values, row = task
        asked.append(dict(values))
        features = stand_in(bench.space.rig_of(values), values["clearance"], np.array(row.extents))
        return features * math.sqrt(row.condition.load / 1000.0), np.zeros_like(features)

    monkeypatch.setattr(evaluate, "CANDIDATES", replace(evaluate.CANDIDATES, function=simulate))
    return asked


def stand_in_trials(noise: float = 0.01, seed: int = 1) -> Trials:
    space = space_of("m_r", rig=Rig())
    level = Evaluator(space, MANY, BAND).levels([space.known])[0]
    noisy = level.features * np.exp(noise * np.random.default_rng(seed).standard_normal(level.features.shape))
    return gather([Trial(c, rms, a) for c, (rms, a) in zip(MANY, noisy.tolist(), strict=True)])


def stand_in_space(*free: str, limits: AdmissibleLimits | None = None) -> Space:
    return space_of(*(free or ("k_r", "c_i")), rig=Rig(), limits=limits, loads=(1000.0, 2000.0))


@pytest.mark.parametrize(
    ("method", "free"),
    [
        ("search", ("m_r", "k_r", "c_r")),
        ("search", ("alpha_c", "beta_c")),
        ("nsga2", ("m_o", "m_r")),
        ("search", ("k_c",)),
    ],
)
def test_no_candidate_outside_eq_80_is_ever_simulated(
    simulated: list[dict[str, float]], method: Any, free: tuple[str, ...]
) -> None:
    trials = stand_in_trials()
    simulated.clear()
    # Narrow, so that much of the space is outside.
    space = stand_in_space(*free, limits=AdmissibleLimits(f_r=(7000.0, 7600.0), zeta_2=(0.05, 0.14)))
    identify(trials, space, replace(OPTIONS, method=method, population=12, generations=4))
    assert len(simulated) > 50
    assert [values for values in simulated[::20] if broken(space, values)] == []


def test_neither_workers_nor_resuming_change_the_result(
    simulated: list[dict[str, float]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials, space, kept = stand_in_trials(), stand_in_space(), tmp_path / "rig.toml.state"
    whole = identify(trials, space, OPTIONS)
    with local_runner(3) as runner:
        assert identify(trials, space, OPTIONS, runner=runner).hash == whole.hash

    class StoppedError(Exception):
        pass

    def stop(stage: str, done: int, planned: int, left: float) -> None:
        assert left >= 0.0
        assert done <= planned
        if done > whole.evaluations // 2:
            raise StoppedError

    monkeypatch.setattr(state_module, "SAVE_EVERY_S", 0.0)
    with pytest.raises(StoppedError):
        identify(trials, space, OPTIONS, state=kept, progress=stop)
    assert kept.exists()
    simulated.clear()
    again = identify(trials, space, OPTIONS, state=kept, resume=True)
    rows = len({condition.load for condition in MANY})
    assert len(simulated) < 0.6 * whole.evaluations * rows
    assert again.hash == whole.hash
    assert again.evaluations == whole.evaluations
    assert not kept.exists()


def test_a_state_of_other_tests_is_refused(
    simulated: list[dict[str, float]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "a.state"

    def stop(*progress: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        identify(stand_in_trials(), stand_in_space(), OPTIONS, state=kept, progress=stop)
    with pytest.raises(WrongInputError, match="state of another identification"):
        identify(stand_in_trials(seed=2), stand_in_space(), OPTIONS, state=kept, resume=True)
    with pytest.raises(WrongInputError, match="state of another identification"):
        identify(
            stand_in_trials(), stand_in_space(limits=AdmissibleLimits(k_r=(1e9, 9e9))), OPTIONS, state=kept, resume=True
        )
    with monkeypatch.context() as patch:
        patch.setattr("models.identify.run.program", lambda: "another")
        with pytest.raises(WrongInputError, match="or the program have changed"):
            identify(stand_in_trials(), stand_in_space(), OPTIONS, state=kept, resume=True)
    kept.write_bytes(b"PK damaged")
    with pytest.raises(WrongInputError, match="is no state of an identification"):
        identify(stand_in_trials(), stand_in_space(), OPTIONS, state=kept, resume=True)


def test_another_seed_another_way_the_same_result(simulated: list[dict[str, float]]) -> None:
    trials = stand_in_trials()
    first, second = (identify(trials, stand_in_space(), replace(OPTIONS, seed=seed)) for seed in (0, 7))
    assert first.hash != second.hash
    assert second.best.cost == pytest.approx(first.best.cost, rel=0.02)
    assert second.resonances[0] == pytest.approx(first.resonances[0], rel=0.005)


def test_objectives_choose_what_is_compared(simulated: list[dict[str, float]]) -> None:
    trials, space = stand_in_trials(), stand_in_space("m_r", "c_i")
    found = identify(trials, space, replace(OPTIONS, objectives=("a_star",)))
    assert set(found.deviations) == {"a_star"}
    assert len(found.front) == 1
    assert found.front[0][1]["a_star"] <= found.deviations["a_star"] + 1e-9
    # The RMS of the stand-in alone says nothing about c_i.
    assert identify(trials, space, replace(OPTIONS, objectives=("rms",))).undetermined == ("c_i",)


def test_motions_that_do_not_repeat_count_less_but_count(monkeypatch: pytest.MonkeyPatch) -> None:
    trials = simulated_trials(0.01)
    evaluator = Evaluator(space_of("m_r"), CONDITIONS, BAND)
    level = evaluator.levels([evaluator.space.known])[0]
    problem = Problem(trials, evaluator)
    sharp = problem.residuals(level, evaluator.space.known)
    level.features[0] *= 1.5
    off = problem.cost(level, evaluator.space.known)
    level.doubt[0] = 0.3
    doubted = problem.residuals(level, evaluator.space.known)
    assert len(doubted) == len(sharp) == 2 * problem.observations
    assert np.all(sharp[problem.observations :] == 0.0)
    # The deviation costs less than if the level were sharp, and more than none at all.
    assert float(np.sum(sharp**2)) < float(np.sum(doubted**2)) < off


def test_a_motion_that_does_not_repeat_is_simulated_on(monkeypatch: pytest.MonkeyPatch) -> None:
    from models.solve.six_dof import rows

    settled = rows.simulate_row

    def unsettled(*args: Any, **options: Any) -> Any:
        return replace(settled(*args, **options), settled=np.array([True, False, True]))

    evaluator = Evaluator(space_of("m_r"), CONDITIONS, BAND)
    expected = evaluator.levels([evaluator.space.known])[0]
    monkeypatch.setattr(rows, "simulate_row", unsettled)
    found = Evaluator(space_of("m_r"), CONDITIONS, BAND).levels([evaluator.space.known])[0]
    assert found.features == pytest.approx(expected.features, rel=5e-3)


def test_too_few_features_are_refused() -> None:
    trials = gather([Trial(CONDITIONS[0], 5.0, 2.0)])
    with pytest.raises(WrongInputError, match=r"2 features .* cannot determine 2 parameters; at least 3 are needed"):
        identify(trials, space_of("m_r", "c_i"), OPTIONS)
    with pytest.raises(WrongInputError, match="no parameter is free"):
        identify(trials, space_of(), OPTIONS)


def test_an_objective_that_no_test_has_is_named() -> None:
    trials = gather([Trial(condition, 5.0, math.nan) for condition in CONDITIONS])
    with pytest.raises(WrongInputError, match="no test has a usable a_star"):
        identify(trials, space_of("m_r"), OPTIONS)


def test_a_defect_that_turns_has_a_mean_level_with_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = np.array([3.0, 0.0, 4.0, 0.0, 0.0, 9.0])
    level = StationaryLevel(
        rms=5.0,
        rms_se=0.1,
        rms_error=1e-3,
        spread=0.4,
        harmonics=lines,
        harmonics_std=0.1 * lines,
        harmonics_se=np.array([0.5, 0.0, 0.0, 0.0, 0.0, 1.0]),
        status="not_periodic",
        turns=24,
    )
    asked: list[Scene] = []

    def stationary(scene: Scene, **options: Any) -> StationaryLevel:
        asked.append(scene)
        return level if scene.speed < 41.0 else replace(level, status="not_converged")

    monkeypatch.setattr("models.solve.six_dof.stationary.stationary_level", stationary)
    conditions = tuple(replace(CONDITIONS[1], part="inner", speed=speed) for speed in (40.0, 42.0))
    evaluator = Evaluator(space_of("m_r"), conditions, BAND)
    found = evaluator.levels([evaluator.space.known])[0]
    assert [(scene.speed, scene.defect.part) for scene in asked if scene.defect] == [(40.0, "inner"), (42.0, "inner")]
    assert found.features[0].tolist() == [5.0, 5.0]
    # 0.1 / 5 of the RMS; of A*, 3 x 0.5 / 5 / 5.
    assert found.doubt[0] == pytest.approx([0.02, 0.06])
    # A level that is unknown says nothing: its doubt is as large as it is itself.
    assert found.doubt[1].tolist() == [1.0, 1.0]


def test_options_are_checked() -> None:
    with pytest.raises(WrongInputError, match="expected some of rms, a_star"):
        IdentifyOptions(objectives=("peak",))
    with pytest.raises(WrongInputError, match="level of the intervals"):
        IdentifyOptions(level=1.0)


def test_candidates_on_the_front_are_not_dominated() -> None:
    objectives = np.array([[3.0, 1.0], [1.0, 3.0], [2.0, 2.0], [2.0, 3.0], [3.0, 3.0], [2.0, 2.0]])
    assert non_dominated(objectives).tolist() == [1, 2, 0]


def test_without_pymoo_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, simulated: list[dict[str, float]]) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pymoo.core.problem", None)
    with pytest.raises(WrongInputError, match=r"install spallwatch\[identify\]"):
        identify(stand_in_trials(), stand_in_space(), replace(OPTIONS, method="nsga2"))

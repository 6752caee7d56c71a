"""The contract of every bearing model: what it declares holds, and the same scene gives the same bits.

Solvers are found in ``models.solve.registry``; ``test_every_solver_is_registered`` finds those that a file declares and
the registry misses. A new effect needs a scene in ``with_each_effect``, a model with parameters of its own a scene in
SCENES, a new function ``simulate...`` of several scenes an entry in RUN.
"""

from __future__ import annotations

import copy
import importlib
import inspect
import math
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import models.gears
import models.solve.simulate
from models.machine.rig import Rig, RigParameters
from models.machine.scene import EFFECTS, Floor, Scene, Slip
from models.solve.registry import AUTO, MODELS, Solver, solvers
from models.solve.response import HARMONICS, STATUSES, Response
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.simulate import choose, simulate
from models.solve.six_dof.lanes import simulate_lanes
from models.solve.six_dof.rows import simulate_row
from models.solve.six_dof.time_domain import simulate_time
from models.words.request import Request
from tests.support.models import OUTER, REQUEST, SCENE, SCENES, SHORT, base

HEALTHY = replace(SCENE, defect=None)
EXTENTS = np.radians([2.0, 6.0])


WITH = SCENES[Rig]


def reference(solver: Solver, effect: str) -> Scene:
    """Return the scene of an effect without it."""
    scene, plain = SCENES[solver.rig][effect], base(solver)
    if solver.rig is not RingImpactRig or effect == "outer_defect":
        return replace(plain, defect=None, bearing=scene.bearing, rig=scene.rig, load=scene.load)
    axial = scene.axial_load if effect == "first_row" else 0.0
    return replace(plain, bearing=replace(scene.bearing, rotating_ring="inner"), rig=scene.rig, axial_load=axial)


SOLVERS = solvers()
each_solver = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: f"{s.model}-{s.name}")
each_effect = pytest.mark.parametrize("effect", list(EFFECTS))

RUN: dict[str, Callable[[Scene], Any]] = {
    "simulate": lambda scene: simulate(scene, **SHORT),
    "simulate_lanes": lambda scene: simulate_lanes([scene]),
    "simulate_row": lambda scene: simulate_row(scene, EXTENTS, steps_per_period=256, tolerance=1e-4, band=None),
    "simulate_time": lambda scene: simulate_time(scene, 0.05, 25600.0),
    **{f"{s.model} {s.name}": lambda scene, solver=s: solver.solve(scene, REQUEST) for s in SOLVERS},
}
SCENE_OF = {f"{s.model} {s.name}": base(s) for s in SOLVERS}


def modules() -> Iterator[Any]:
    """Yield all modules that may hold a model."""
    for package in (models.solve, models.gears):
        for place in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            yield importlib.import_module(place.name)


def functions() -> Iterator[str]:
    """Yield the names of public functions that simulate scenes."""
    for module in modules():
        for name, value in vars(module).items():
            if not name.startswith("simulate") or getattr(value, "__module__", None) != module.__name__:
                continue
            if {"scene", "scenes"} & set(inspect.signature(value).parameters):
                yield name


def bits(answer: Any) -> list[Any]:
    """Return the values of an answer, arrays as their bytes."""
    values = [getattr(answer, field.name) for field in fields(answer) if field.name != "record"]
    record = getattr(answer, "record", None)
    values += [] if record is None else [record.rate, record.signal]
    return [value.tobytes() if isinstance(value, np.ndarray) else repr(value) for value in values]


def test_every_solver_is_registered() -> None:
    declared = {module.__name__ for module in modules() if isinstance(getattr(module, "SOLVER", None), Solver)}
    registered = [name for entry in MODELS.values() for name in entry.solvers]
    assert sorted(declared) == sorted(registered)
    for model, entry in MODELS.items():
        named = entry.solvers
        assert {importlib.import_module(name).SOLVER.model for name in named} == {model}
        assert len({solver.name for solver in solvers(model)}) == len(named)


def test_all_functions_that_simulate_are_found_and_can_be_run() -> None:
    assert set(functions()) == {name for name in RUN if name.startswith("simulate")}


def test_every_effect_has_a_scene_that_has_it() -> None:
    assert set(WITH) == set(EFFECTS)
    for scenes in SCENES.values():
        for effect, scene in scenes.items():
            assert effect in scene.effects
    assert HEALTHY.effects == ()
    assert {solver.rig for solver in SOLVERS} == set(SCENES)


@cache
def solved(solver: Solver, scene: Scene, request: Request = REQUEST) -> Response:
    """Return what several tests look at; that the same scene gives the same bits is a test of its own."""
    return solver.solve(scene, request)


def expected_status(found: Response) -> str:
    """Return the status by what else a response says of itself."""
    if found.model == "ring_impact":
        return "uncalibrated"
    good = "converged" if found.repeats else "not_periodic"
    return good if found.error <= REQUEST.accuracy else "inaccurate"


@each_effect
@each_solver
def test_a_declared_effect_is_honoured_and_any_other_refused(solver: Solver, effect: str) -> None:
    scene = SCENES[solver.rig][effect]
    if not set(scene.effects) <= solver.effects:
        with pytest.raises(ValueError, match=rf"\b{effect}\b"):
            solver.solve(scene, REQUEST)
        return
    found = solved(solver, scene)
    assert found.status == expected_status(found)
    without = reference(solver, effect)
    if effect == "roller" or effect.startswith("with_"):
        # What a ball with the same stiffness per approach would do is tests/models/machine/test_rollers.py; what a
        # model always contains it cannot leave out.
        assert found.rms > 0.0
    else:
        # What happens at one support of a soft shaft is hardly felt at the other.
        plain = solved(solver, without)
        pairs = [(ours[0], other[0]) for ours, other in zip(found.levels, plain.levels, strict=True)]
        assert max(abs(a - b) / max(a, b) for a, b in pairs) > 5.0 * REQUEST.accuracy


@each_solver
def test_its_response_has_the_shapes_and_units(solver: Solver) -> None:
    found = solved(solver, base(solver))
    assert (found.model, found.solver) == (solver.model, solver.name)
    assert found.status == ("uncalibrated" if solver.model == "ring_impact" else "converged")
    assert found.harmonics.shape == found.harmonics_error.shape == (HARMONICS,)
    assert found.coefficients.shape[0] == len(found.sensors) == len(found.levels)
    assert found.coefficients.shape[1] > HARMONICS
    assert found.harmonics == pytest.approx(2.0 * np.abs(found.coefficients[0, 1 : HARMONICS + 1]))
    for value in (*(value for levels in found.levels for value in levels), found.bpfo):
        assert math.isfinite(value)
        assert value > 0.0
    assert found.peak > found.rms
    assert found.periods > 0
    for error in (found.rms_error, found.peak_error, found.waveform_error, found.spread, found.rms_se):
        assert math.isfinite(error)
        assert error >= 0.0
    for sensor, (rms, _) in zip(found.sensors, found.levels, strict=True):
        signal = found.acceleration(REQUEST.rate, SHORT["duration"], sensor=sensor)
        assert signal.shape == (round(REQUEST.rate * SHORT["duration"]),)
        level = float(np.sqrt(np.mean(signal**2)))
        assert level == pytest.approx(rms, rel=0.1)
        # The level leaves out the last, broken block of a record.
        assert found.rms_in_band(100.0, 8000.0, sensor) < 1.01 * max(rms, level)
    banded = solver.solve(base(solver), replace(REQUEST, band=(100.0, 8000.0)))
    assert banded.rms_band == (100.0, 8000.0)
    assert banded.rms == pytest.approx(found.rms_in_band(100.0, 8000.0), rel=1e-2)


@each_solver
def test_its_error_is_what_it_says(solver: Solver) -> None:
    """Against the most that it can be asked for, at three times the estimate."""
    coarse = solved(solver, base(solver))
    fine = solver.solve(base(solver), replace(REQUEST, accuracy=max(solver.error, 2e-4), duration=0.2))
    assert abs(coarse.rms / fine.rms - 1.0) <= 3.0 * coarse.rms_error + fine.rms_error
    assert abs(coarse.peak / fine.peak - 1.0) <= 3.0 * coarse.peak_error + fine.peak_error
    assert fine.rms_error < coarse.rms_error or coarse.rms_error < 1e-4


@each_solver
def test_its_cost_and_error_are_declared(solver: Solver) -> None:
    cost = solver.cost(base(solver), REQUEST)
    assert math.isfinite(cost)
    assert cost > 0.0
    assert solver.cost(base(solver), replace(REQUEST, accuracy=1e-5)) >= cost
    assert 0.0 < solver.error <= 1e-3
    assert solver.effects <= set(EFFECTS)
    assert solver.reason


@each_solver
@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"lines_to": 1e9}, "lines_to is 1000000000.0 Hz"),
        ({"band": (0.0, 1e9)}, "the band ends at 1000000000.0 Hz"),
        ({"band": (0.0, math.inf)}, "the band ends at inf Hz"),
    ],
)
def test_it_refuses_frequencies_that_it_does_not_resolve(solver: Solver, change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        solver.solve(base(solver), replace(REQUEST, **change))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *((name, value) for name in ("accuracy", "tolerance", "duration", "rate") for value in (0.0, -1.0, math.nan)),
        ("steps_per_period", 7),
        ("max_periods", 19),
        ("band", (5.0, 5.0)),
        *(("lines_to", value) for value in (-1.0, math.nan, math.inf)),
        ("direction", math.inf),
    ],
)
def test_a_senseless_request_is_refused_by_name(field: str, value: object) -> None:
    changed: dict[str, Any] = {field: value}
    with pytest.raises(ValueError, match=field):
        simulate(SCENE, **changed)


@pytest.mark.parametrize("rig", list(SCENES), ids=lambda rig: rig.model)
@each_effect
def test_what_no_model_has_is_refused_and_else_the_cheapest_is_taken(rig: type[RigParameters], effect: str) -> None:
    scene = SCENES[rig][effect]
    able = [solver for solver in SOLVERS if set(scene.effects) <= solver.effects]
    if not able:
        with pytest.raises(ValueError, match=rf"^{effect}: no model describes this"):
            simulate(scene, **SHORT)
        return
    able = [solver for solver in able if solver.rig is rig]
    # Where a shaft's ends have a mass, the elastic one leaves out nothing.
    able = [solver for solver in able if solver.whole is None or solver.whole(scene)]
    if not able:
        with pytest.raises(
            ValueError, match=rf"{rig.model}, whose parameters these are, does not describe this; models"
        ):
            simulate(scene, **SHORT)
        return
    chosen, why, _ = choose(scene, REQUEST)
    assert chosen.cost(scene, REQUEST) == min(solver.cost(scene, REQUEST) for solver in able)
    assert why is not None
    assert chosen.model in why
    assert EFFECTS[effect] in why
    named, silent, _ = choose(replace(scene, model=chosen.model), REQUEST)
    assert (named, silent) == (chosen, None)


def test_a_scene_without_effects_has_a_reason_too() -> None:
    solver, why, _ = choose(HEALTHY, REQUEST)
    assert why == f"{solver.model} is the only model of these parameters; {solver.reason}"


def test_a_named_model_is_the_one_that_answers_or_refuses() -> None:
    for model in MODELS:
        scenes = SCENES[solvers(model)[0].rig]
        found = simulate(replace(scenes["outer_defect"], model=model), **SHORT)
        assert (found.model, found.why) == (model, None)
        lacking = [e for e in EFFECTS if not any(e in solver.effects for solver in solvers(model))]
        for effect in lacking:
            with pytest.raises(ValueError, match=rf"^{effect}: {model} does not describe this.* models that describe"):
                simulate(replace(scenes[effect], model=model), **SHORT)
    with pytest.raises(ValueError, match=rf"unknown model 'none'; known are: {AUTO}, {', '.join(MODELS)}"):
        simulate(replace(SCENE, model="none"))
    with pytest.raises(ValueError, match=r"effects of a b: rust is none of"):
        replace(SOLVERS[0], model="a", name="b", effects=frozenset({"rust"}))


@pytest.mark.parametrize("name", list(RUN))
def test_the_same_scene_gives_the_same_bits(name: str) -> None:
    given = SCENE_OF.get(name, SCENE)
    scene = copy.deepcopy(given)
    assert bits(RUN[name](scene)) == bits(RUN[name](scene))
    assert scene == given


@each_solver
def test_a_seed_is_a_scene(solver: Solver) -> None:
    """The same seed gives the same bits, another one another answer, for all that is drawn."""
    scene = base(solver)
    rough = [replace(scene, defect=replace(OUTER, floor=Floor("rough", seed=s))) for s in (1, 1, 2)]
    slipping = [replace(scene, slip=Slip(0.01, seed=s)) for s in (1, 1, 2)]
    for scenes in (rough, slipping):
        if not set(scenes[0].effects) <= solver.effects:
            continue
        first, again, other = (bits(solver.solve(scene, REQUEST)) for scene in scenes)
        assert first == again
        assert first != other


@pytest.mark.parametrize("name", list(RUN))
@pytest.mark.parametrize(("field", "value"), [("speed", 0.0), ("speed", math.nan), ("load", -1.0), ("load", math.inf)])
def test_a_wrong_scene_is_refused_by_name(name: str, field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        RUN[name](replace(SCENE_OF.get(name, SCENE), **{field: value}))


def test_one_type_answers_for_all() -> None:
    assert {type(solved(solver, base(solver))) for solver in SOLVERS} == {Response}
    assert {solved(solver, base(solver)).status for solver in SOLVERS} <= set(STATUSES)

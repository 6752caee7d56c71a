"""Which models there are, what each can do, and which of them answers for a scene.

A model joins with a folder and an entry in MODELS, or by an entry point (``models.words.extras``). It may have several
solvers, for different effects; none is imported before a scene is simulated.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from models.machine.rig import Rig, RigParameters
from models.machine.scene import EFFECTS
from models.words.extras import Model, brought

if TYPE_CHECKING:
    from models.machine.scene import Scene
    from models.solve.engine.motion import Trajectories
    from models.solve.response import Response
    from models.words.request import Request


MODELS: dict[str, Model] = {
    "six_dof": Model(
        "models.machine.rig:Rig",
        ("models.solve.six_dof.periodic", "models.solve.six_dof.mean_force", "models.solve.six_dof.time_domain"),
        (
            ("many scenes at once", "models.solve.six_dof.lanes:warm"),
            ("over time", "models.solve.six_dof.time_domain:warm"),
        ),
    ),
    "ball_inertia": Model(
        "models.solve.ball_inertia.rig:BallInertiaRig",
        ("models.solve.ball_inertia.period", "models.solve.ball_inertia.solver"),
        (("balls with inertia", "models.solve.ball_inertia.solver:warm"),),
    ),
    "ring_impact": Model(
        "models.solve.ring_impact.rig:RingImpactRig",
        ("models.solve.ring_impact.solver",),
        (("impacts on rings", "models.solve.ring_impact.solver:warm"),),
    ),
    "rotor": Model(
        "models.solve.rotor.rig:RotorRig",
        ("models.solve.rotor.solver", "models.solve.rotor.elastic"),
        (("rotor", "models.solve.rotor.elastic:warm"),),
    ),
    "angular": Model(
        "models.solve.angular.rig:AngularRig",
        ("models.solve.angular.solver",),
        (("angular speed", "models.solve.angular.solver:warm"),),
    ),
    **{name: point.load() for name, point in brought("models").items()},
}
"""By name; a model is a folder and an entry here."""
AUTO = "auto"


@dataclass(frozen=True)
class Solver:
    """One way to answer for a scene.

    Attributes:
        model: the model that it solves, a key of MODELS.
        name: of the way, unique within the model.
        effects: the names in ``models.machine.scene.EFFECTS`` that it has; it refuses any other.
        error: least relative error of the RMS that its steps can be asked for.
        cost: expected processor time on one core, s; may raise a ValueError that names what would take too long.
        solve: returns the response; raises a ValueError that names what it does not describe.
        reason: why it is taken where it is the cheapest, a clause for people.
        rig: the type of the parameters of the machine that it takes.
        trajectories: returns where the points of a shaft move, None where the motion diverged; None where the model has
            no shaft that moves.
        whole: whether it leaves out nothing of a machine that the parameters of a scene describe; None where it never
            does. Such a solver is a reference; any other only stands for one (``models.solve.simulate``).
    """

    model: str
    name: str
    effects: frozenset[str]
    error: float
    cost: Callable[[Scene, Request], float]
    solve: Callable[[Scene, Request], Response]
    reason: str
    rig: type[RigParameters]
    whole: Callable[[Scene], bool] | None = None
    trajectories: Callable[[Scene, Request], Trajectories | None] | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which the registry could not use."""
        unknown = sorted(self.effects - set(EFFECTS))
        if unknown:
            raise ValueError(
                f"effects of {self.model} {self.name}: {', '.join(unknown)} is none of {', '.join(EFFECTS)}"
            )
        if not (math.isfinite(self.error) and self.error > 0.0):
            raise ValueError(f"error of {self.model} {self.name} must be positive and finite, got {self.error!r}")


def load(place: str) -> Any:
    """Return what "module:name" names."""
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)


RIGS: dict[str, type[RigParameters]] = {
    name: load(MODELS[name].rig) for name in sorted(MODELS, key=lambda name: (name != Rig.model, name))
}
"""The types of the parameters by the model that takes them, the default first."""

IGNORES_DEPTH: dict[str, str] = {name: kind.ignores_depth for name, kind in RIGS.items() if kind.ignores_depth}
"""Models whose vibration is the same for any depth of a defect, and why: no volume can be told from it."""


def solvers(model: str = AUTO) -> tuple[Solver, ...]:
    """Return the solvers of a model, or of all.

    Raises:
        ValueError: if there is no such model; the message names it and those that there are.
    """
    if model != AUTO and model not in MODELS:
        raise ValueError(f"unknown model {model!r}; known are: {', '.join((AUTO, *MODELS))}")
    modules = [module for name, entry in MODELS.items() if model in (AUTO, name) for module in entry.solvers]
    return tuple(importlib.import_module(module).SOLVER for module in modules)


def choose(scene: Scene, request: Request) -> tuple[Solver, str | None]:
    """Return the cheapest solver that has all effects of a scene, its parameters and the accuracy asked for, and why.

    It is a reference: what stands for it with parameters of another model is chosen in ``models.solve.simulate``.

    The reason is None where the scene names its model and that has one way only. If none reaches the accuracy, the
    most accurate is taken, and the status of its response says so.

    Raises:
        ValueError: if no solver has all the effects, or none of those that have takes the parameters of the machine;
            the message names those that lack, and who has them.
    """
    return choose_priced(scene, request)[:2]


def choose_priced(scene: Scene, request: Request) -> tuple[Solver, str | None, float | None]:
    """Return what ``choose`` does, and the expected cost of the solver, s, None where it had no need to be known."""
    known = solvers(scene.model)
    needed = frozenset(scene.effects)
    able = [s for s in known if needed <= s.effects]
    if not able:
        raise ValueError(_refusal(scene, known))
    able = _of_the_rig(scene, able)
    able = [s for s in able if s.whole is None or s.whole(scene)] or able
    accurate = [s for s in able if s.error <= request.accuracy]
    cost: float | None = None
    if len(accurate) > 1:
        costs = [s.cost(scene, request) for s in accurate]
        cost = min(costs)
        best = accurate[costs.index(cost)]
    else:
        best = accurate[0] if accurate else min(able, key=lambda s: s.error)
    if scene.model != AUTO:
        return best, None, cost
    return best, _reason(best, scene, len({s.model for s in able})), cost


def _reason(best: Solver, scene: Scene, models: int) -> str:
    named = " with " + ", ".join(words(scene.effects)) if scene.effects else ""
    rank = "the only model" if models == 1 else f"the cheapest of {models} models"
    return f"{best.model} is {rank}{named}; {best.reason}"


def _of_the_rig(scene: Scene, able: list[Solver]) -> list[Solver]:
    """Return the solvers that take the parameters of a scene; raise the first refusal where none does."""
    found: list[Solver] = []
    refusals: list[ValueError] = []
    for solver in able:
        try:
            adapted(scene, solver)
        except ValueError as error:
            refusals.append(error)
        else:
            found.append(solver)
    if not found:
        if scene.model != AUTO:
            raise refusals[0]
        models = sorted({f"{solver.model} ({solver.rig.__name__})" for solver in able})
        named = ", ".join(scene.effects) or "rig"
        raise ValueError(
            f"{named}: {scene.rig.model}, whose parameters these are, does not describe this; models that do, "
            f"with parameters of their own: {', '.join(models)}"
        )
    return found


def check_effects(scene: Scene, able: frozenset[str], model: str, how: str = "") -> None:
    """Raise a ValueError that names the effects of a scene which a model, solved as ``how`` says, does not describe."""
    missing = [name for name in scene.effects if name not in able]
    if missing:
        raise ValueError(f"{', '.join(missing)}: {model} does not describe this{' ' + how if how else ''}")


def adapted(scene: Scene, solver: Solver) -> Scene:
    """Return a scene whose parameters a solver takes; raise a ValueError where they are those of another model."""
    scene.rig_as(solver.rig)
    return scene


def trajectories(scene: Scene, request: Request, response: Response) -> Trajectories | None:
    """Return where the points of a shaft move, by the solver that gave a response; None where it describes none.

    They are of the last turns (MOST_TURNS at most) of a run that lasts as long as the request says. A solver that stood
    for another model describes none of that model's.
    """
    for solver in solvers(response.model):
        own = solver.name == response.solver and isinstance(scene.rig, solver.rig)
        if own and solver.trajectories is not None:
            return solver.trajectories(adapted(scene, solver), request)
    return None


def words(effects: tuple[str, ...]) -> list[str]:
    """Return the names of effects for people."""
    return [EFFECTS[name] for name in effects]


def _refusal(scene: Scene, known: tuple[Solver, ...]) -> str:
    """Return why a scene is refused: what the closest solver lacks, and which models have all of it."""
    needed = frozenset(scene.effects)
    closest = min(known, key=lambda s: len(needed - s.effects))
    missing = [name for name in scene.effects if name not in closest.effects]
    rest = [name for name in scene.effects if name in closest.effects]
    together = f" together with {', '.join(rest)}" if rest else ""
    model = "no model" if scene.model == AUTO else scene.model
    able = sorted({s.model for s in solvers() if needed <= s.effects})
    others = "" if scene.model == AUTO else f"; models that describe it: {', '.join(able) or 'none'}"
    verb = "describes" if scene.model == AUTO else "does not describe"
    return f"{', '.join(missing)}: {model} {verb} this{together}{others}"

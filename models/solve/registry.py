"""Which models there are, and what each can do.

A model joins with a folder, whose package declares it, and its name here, or by an entry point
(``models.words.extras``). It may have several solvers, for different effects; none is imported before a scene is
simulated.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from models.machine.rig import Rig, RigParameters
from models.machine.scene import EFFECTS
from models.words.extras import Model, brought

if TYPE_CHECKING:
    from models.machine.scene import Scene
    from models.solve.engine.motion import Trajectories
    from models.solve.response import Response
    from models.words.request import Request


_OWN = ("six_dof", "ball_inertia", "ring_impact", "rotor", "angular")
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
        derivatives: parameters by which it gives derivatives of what repeats.
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
    derivatives: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which the registry could not use."""
        unknown = sorted(self.effects - set(EFFECTS))
        if unknown:
            raise ValueError(
                f"effects of {self.model} {self.name}: {', '.join(unknown)} is none of {', '.join(EFFECTS)}"
            )
        if not (math.isfinite(self.error) and self.error > 0.0):
            raise ValueError(f"error of {self.model} {self.name} must be positive and finite, got {self.error!r}")


class EffectBound(NamedTuple):
    """What an effect can change at most, relative to the RMS of the acceleration at the first sensor.

    ``wave``: RMS of the change of the acceleration; ``rms``: change of its RMS, no more than that.
    """

    wave: float
    rms: float


@dataclass(frozen=True)
class WeakEffects:
    """Effects of a model that may be too small to be worth another way of solving.

    Attributes:
        names: of the effects, in ``models.machine.scene.EFFECTS``.
        without: returns a scene without them; raises a ValueError that names what the model does not describe.
        bounds: returns, of a scene and the response without them, the bound of each that the scene has, by name;
            infinite where none is known.
        add: returns, of a scene, the one without them and its response, what a request allows them as an error and the
            names of some, the response with these; None where it is not known so well.
    """

    names: frozenset[str]
    without: Callable[[Scene], Scene]
    bounds: Callable[[Scene, Response], dict[str, EffectBound]]
    add: Callable[[Scene, Scene, Response, Request, Collection[str]], Response | None]


def load(place: str) -> Any:
    """Return what "module:name" names."""
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)


MODELS: dict[str, Model] = {
    **{name: load(f"models.solve.{name}:MODEL") for name in _OWN},
    **{name: point.load() for name, point in brought("models").items()},
}
"""By name."""

RIGS: dict[str, type[RigParameters]] = {
    name: load(MODELS[name].rig) for name in sorted(MODELS, key=lambda name: (name != Rig.model, name))
}
"""The types of the parameters by the model that takes them, the default first."""

IGNORES_DEPTH: dict[str, str] = {name: kind.ignores_depth for name, kind in RIGS.items() if kind.ignores_depth}
"""Models whose vibration is the same for any depth of a defect, and why: no volume can be told from it."""


@cache
def solvers(model: str = AUTO) -> tuple[Solver, ...]:
    """Return the solvers of a model, or of all.

    Raises:
        ValueError: if there is no such model; the message names it and those that there are.
    """
    if model != AUTO and model not in MODELS:
        raise ValueError(f"unknown model {model!r}; known are: {', '.join((AUTO, *MODELS))}")
    modules = [module for name, entry in MODELS.items() if model in (AUTO, name) for module in entry.solvers]
    return tuple(importlib.import_module(module).SOLVER for module in modules)


@cache
def weak_effects(model: str) -> WeakEffects | None:
    """Return what bounds effects of a model that may be too small to matter, None where nothing does."""
    place = MODELS[model].weak
    return load(place) if place else None


def check_effects(scene: Scene, able: frozenset[str], model: str, how: str = "") -> None:
    """Raise a ValueError that names the effects of a scene which a model, solved as ``how`` says, does not describe."""
    missing = [name for name in scene.effects if name not in able]
    if missing:
        raise ValueError(f"{', '.join(missing)}: {model} does not describe this{' ' + how if how else ''}")


def trajectories(scene: Scene, request: Request, response: Response) -> Trajectories | None:
    """Return where the points of a shaft move, by the solver that gave a response; None where it describes none.

    They are of the last turns (MOST_TURNS at most) of a run that lasts as long as the request says. A solver that stood
    for another model describes none of that model's.
    """
    for solver in solvers(response.model):
        own = solver.name == response.solver and isinstance(scene.rig, solver.rig)
        if own and solver.trajectories is not None:
            return solver.trajectories(scene, request)
    return None


def words(effects: tuple[str, ...]) -> list[str]:
    """Return the names of effects for people."""
    return [EFFECTS[name] for name in effects]

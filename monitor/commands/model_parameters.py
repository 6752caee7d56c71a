"""Which model answers for a scene on the command line, and its parameters: from the configuration, and as given."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import click

from models.machine.rig import Rig, RigParameters
from models.machine.scene import PHYSICS
from models.solve.registry import AUTO, MODELS, solvers, words
from monitor.commands import option

if TYPE_CHECKING:
    from models.machine.bearing import CatalogueEntry
    from models.machine.scene import Scene
    from monitor.config.load import Config

# Fields of parameters that say what vouches for them.
_CLAIMS = ("calibrated", "identification")
F = TypeVar("F", bound=Callable[..., Any])


def further_effects(function: F) -> F:
    """Add the options of what other models than that of the casing describe."""
    added = (
        click.option("--second-bearing", help="Bearing of the other support, B: a name or a designation."),
        click.option("--support", type=click.Choice(["a", "b"]), default="a", help="The bearing with the defect."),
        click.option("--width-deg", type=click.FloatRange(0, 180, min_open=True), help="Of the defect, in the groove."),
        click.option("--axial-load-newton", type=float, default=0.0, help="Positive towards support A."),
        click.option("--couple-unbalance-kg-m2", type=option.NOT_NEGATIVE, default=0.0, help="Of the rotor."),
        click.option("--bow-um", type=option.NOT_NEGATIVE, default=0.0, help="Deflection of the shaft at rest."),
        click.option("--rotating-load", is_flag=True, help="The load turns with the shaft."),
        click.option("--speed-slope-hz-per-s", type=float, default=0.0, help="Change of the speed."),
        click.option("--physics", multiple=True, type=click.Choice(list(PHYSICS)), help="Must be in; repeatable."),
        click.option("--parameter", "parameters", multiple=True, type=_Assignment(), help="Of the model; repeatable."),
    )
    for add in reversed(added):
        function = add(function)
    return function


class _Assignment(click.ParamType):
    """NAME=VALUE."""

    name = "NAME=VALUE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return name and value as text."""
        if isinstance(value, tuple):
            return value
        name, sign, text = str(value).partition("=")
        if not (name and sign and text):
            self.fail(f"{value!r} is not NAME=VALUE, such as end_mass=0.2 (SI)", param, ctx)
        return name.strip(), text.strip()


def able_models(scene: Scene) -> list[str]:
    """Return the models that have all effects of a scene, whatever parameters they take."""
    needed = frozenset(scene.effects)
    return [name for name in MODELS if any(needed <= solver.effects for solver in solvers(name))]


def missing_effects(scene: Scene, model: str) -> list[str]:
    """Return the effects of a scene, in words, that the solver of a model which lacks fewest of them lacks."""
    lacking = ([name for name in scene.effects if name not in solver.effects] for solver in solvers(model))
    return words(tuple(min(lacking, key=len)))


def with_parameters(
    scene: Scene, config: Config, entry: CatalogueEntry, given: Iterable[tuple[str, str]], *, model: str | None = None
) -> Scene:
    """Return a scene with the parameters of the model that is to answer for it.

    A scene of ``auto`` keeps the six-degree-of-freedom model's where that has all its effects, and else takes those of
    the first model that has.

    Args:
        scene: with the six-degree-of-freedom model's parameters.
        config: of the machine.
        entry: its bearing.
        given: names and values of parameters, SI, that are set.
        model: to take instead of that which the scene names.

    Raises:
        ValueError: if there is no such parameter, or a value is not one of it.
    """
    named = scene.model if model is None else model
    if named == AUTO:
        able = able_models(scene)
        named = able[0] if able and Rig.model not in able else Rig.model
    kind = solvers(named)[0].rig
    rig = scene.rig if isinstance(scene.rig, kind) else config.parameters_of(kind, entry)
    values = {name: _value(kind, name, text) for name, text in given}
    return replace(scene, rig=replace(rig, **values) if values else rig, model=scene.model if model is None else model)


def effects_of(model: str) -> frozenset[str]:
    """Return what a model takes of the machine, names in ``models.machine.scene.EFFECTS``.

    None for the model of the casing: it describes a bearing, not the shaft.
    """
    return frozenset() if model == Rig.model else frozenset().union(*(solver.effects for solver in solvers(model)))


def with_machine(scene: Scene, config: Config) -> tuple[Scene, list[str]]:
    """Return a scene with what ``[shaft]`` and ``[operating]`` add to it, and the keys that its model leaves out.

    The model is that of the scene's parameters. What the scene has already, stays.
    """
    able = effects_of(scene.rig.model)
    values: dict[str, Any] = {}
    left_out: list[str] = []
    for name, (key, value) in config.scene_values().items():
        if getattr(scene, name):
            continue
        if name in able:
            values[name] = value
        else:
            left_out.append(key)
    return replace(scene, **values), left_out


def _value(kind: type[RigParameters], name: str, text: str) -> Any:
    """Return the value of a parameter from its text, by the type of its default."""
    known: Mapping[str, Field[Any]] = {f.name: f for f in fields(kind) if f.name not in _CLAIMS}
    if name not in known:
        raise ValueError(f"--parameter {name}: {kind.model} has {', '.join(known)}")
    default = known[name].default
    try:
        if isinstance(default, bool):
            return {"true": True, "false": False}[text.lower()]
        if isinstance(default, str):
            return text
        if isinstance(default, tuple):
            return tuple(float(part) for part in text.split(","))
        if isinstance(default, int):
            return int(text)
        return float(text)
    except (ValueError, KeyError):
        wanted = "a number" if default is None or default is MISSING else f"such as {default!r}"
        raise ValueError(f"--parameter {name}: expected {wanted}, got {text!r}") from None

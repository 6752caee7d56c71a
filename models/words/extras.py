"""What extras bring: the entry points of this installation, read once and loaded when they are used.

A group is ``spallwatch.`` and one of the names below; the core names no extra.

- ``commands``: a command of ``spallwatch``, as a ``Command``.
- ``sections``: a section of the configuration, by its key.
- ``bearing``: options and an answer of ``spallwatch bearing``, as a module of ``options``, ``answer`` and ``lines``.
- ``simulate``: a function that ``spallwatch simulate --model NAME`` calls.
- ``models``: a ``Model``; its module and that of its rig do not import the registry of models, which reads them.
- ``rig``: what runs beside the bearing of a simulated rig, as a module of ``OPTIONS``, ``gears_of``, ``gear_sound``.
- ``work``: executors of chunks on clusters, and stores of chunks in object storage.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, distributions
from typing import Any, NamedTuple

from models.words.errors import WrongInputError

_PREFIX = "spallwatch."


class Command(NamedTuple):
    """Where a command is found, what ``--help`` says of it, and the command that it follows there."""

    place: str
    words: str
    after: str = ""


class Model(NamedTuple):
    """Where a model of a machine is found.

    Attributes:
        rig: "module:class" of its parameters.
        solvers: modules, each with a ``SOLVER``.
        warm: what is compiled ahead, in words for people, and "module:function" of what does it.
        weak: "module:object" of what bounds effects that may be too small to matter, a
            ``models.solve.registry.WeakEffects``; "" for none.
    """

    rig: str
    solvers: tuple[str, ...]
    warm: tuple[tuple[str, str], ...] = ()
    weak: str = ""


def brought(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name, none of them imported."""
    return _by_group().get(group, {})


def load(group: str, name: str) -> Any:
    """Import what an extra brings.

    Raises:
        WrongInputError: this installation has no such entry point.
    """
    point = brought(group).get(name)
    if point is None:
        raise WrongInputError(
            f"{name}: the entry point {_PREFIX}{group} of this name is not installed; install spallwatch again"
        )
    return point.load()


@cache
def _by_group() -> dict[str, dict[str, EntryPoint]]:
    found: dict[str, dict[str, EntryPoint]] = {}
    for point in (point for distribution in distributions() for point in distribution.entry_points):
        if point.group.startswith(_PREFIX):
            # The first place on the path wins, as for modules.
            found.setdefault(point.group.removeprefix(_PREFIX), {}).setdefault(point.name, point)
    return found

"""The contract of every bearing model: the same scene gives the same bits, a wrong one is refused by the field's name.

Models are found, not listed: each public function ``simulate...`` of ``models.simulate`` and ``models.dynamics`` that
takes a scene or several. A new model needs an entry in RUN.
"""

from __future__ import annotations

import copy
import importlib
import inspect
import math
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

import models.dynamics
import models.simulate
from models.dynamics.lanes import simulate_lanes
from models.dynamics.rows import simulate_row
from models.dynamics.time_domain import simulate_time
from models.scene import Defect, Scene
from models.simulate import simulate

SCENE = Scene(40.0, 4000.0, defect=Defect(math.radians(6.0), 10e-6))
EXTENTS = np.radians([2.0, 6.0])

RUN: dict[str, Callable[[Scene], Any]] = {
    "simulate": simulate,
    "simulate_lanes": lambda scene: simulate_lanes([scene]),
    "simulate_row": lambda scene: simulate_row(scene, EXTENTS, steps_per_period=256, tolerance=1e-4, band=None),
    "simulate_time": lambda scene: simulate_time(scene, 0.05, 25600.0),
}


def found_models() -> Iterator[str]:
    places = pkgutil.walk_packages(models.dynamics.__path__, "models.dynamics.")
    for module in (models.simulate, *(importlib.import_module(place.name) for place in places)):
        for name, value in vars(module).items():
            if not name.startswith("simulate") or getattr(value, "__module__", None) != module.__name__:
                continue
            if {"scene", "scenes"} & set(inspect.signature(value).parameters):
                yield name


MODELS = sorted(found_models())
each_model = pytest.mark.parametrize("name", MODELS)


def bits(answer: Any) -> list[Any]:
    """Return the values of an answer, arrays as their bytes."""
    values = [getattr(answer, field.name) for field in fields(answer)]
    return [value.tobytes() if isinstance(value, np.ndarray) else repr(value) for value in values]


def test_all_models_are_found_and_can_be_run() -> None:
    assert set(MODELS) == set(RUN)


@each_model
def test_the_same_scene_gives_the_same_bits(name: str) -> None:
    scene = copy.deepcopy(SCENE)
    assert bits(RUN[name](scene)) == bits(RUN[name](scene))
    assert scene == SCENE


@each_model
@pytest.mark.parametrize(("field", "value"), [("speed", 0.0), ("speed", math.nan), ("load", -1.0), ("load", math.inf)])
def test_a_wrong_scene_is_refused_by_name(name: str, field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        RUN[name](replace(SCENE, **{field: value}))

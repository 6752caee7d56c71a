"""Compile in advance the kernels of each model (``spallwatch warmup``).

Each part runs a model for a moment, which compiles its kernels or loads them from disk. Parts go to two processes where
there are two cores, because numba compiles one function at a time in a process.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import partial

from models.machine.scene import Defect, Scene
from models.solve.registry import MODELS, load

_SCENE = Scene(40.0, 4000.0, defect=Defect(dphi_d=0.1, h_d=1e-5))
_LONGEST = "angular speed"


@dataclass(frozen=True)
class CompiledPart:
    """Time to prepare one part.

    ``elapsed`` is wall time, imports and loading included, s; ``kernels`` are the processor seconds of the compiler by
    function, as of ``models.platform.jit.compiling``, empty if all were loaded.
    """

    name: str
    elapsed: float
    kernels: dict[str, float] = field(default_factory=dict)


def _one_scene() -> None:
    from models.solve.simulate import simulate

    simulate(_SCENE)


def _call(place: str) -> None:
    load(place)()


_OF_MODELS = [part for model in MODELS.values() for part in model.warm]
PARTS: dict[str, Callable[[], None]] = {
    "one settled scene": _one_scene,
    **{words: partial(_call, place) for words, place in sorted(_OF_MODELS, key=lambda part: part[0] != _LONGEST)},
}
"""The longest first, so that two processes end together."""


def compile_part(name: str) -> CompiledPart:
    """Compile or load one of PARTS in this process.

    Raises:
        KeyError: if there is no part of that name.
    """
    began = time.perf_counter()
    from models.platform.jit import compiling

    with compiling() as kernels:
        PARTS[name]()
    return CompiledPart(name, time.perf_counter() - began, kernels)


def compile_parts(workers: int) -> Iterator[CompiledPart]:
    """Compile or load all of PARTS and yield each when it is done.

    ``workers`` is the number of processes: 1 is this one, 0 one per core; at most two are used.

    Raises:
        ValueError: if workers is negative.
    """
    if workers < 0:
        raise ValueError(f"workers must not be negative, got {workers!r}")
    workers = min(workers or os.cpu_count() or 1, 2)
    if workers == 1:
        yield from map(compile_part, PARTS)
        return
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for done in as_completed([pool.submit(compile_part, name) for name in PARTS]):
            yield done.result()

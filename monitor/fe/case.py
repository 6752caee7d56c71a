"""A bearing under a radial load, computed by finite elements for ``spallwatch bearing --fe``."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from models.fe.bearings.rings import Support
from models.fe.meshes.geometry import fe_geometry
from models.fe.meshes.sizing import NAMED_RULES, MeshName
from models.machine.bearing import CatalogueEntry
from models.machine.contact_estimates import estimate_stiffness
from models.machine.hertz import contact_exponent
from monitor.commands.bearing.statics import LOAD_STEPS
from monitor.commands.common import PROGRESS_AFTER_S, InputError, say

if TYPE_CHECKING:
    from models.fe.bearings.assembly import FeBearing, FePassage, FeState
    from models.fe.bearings.element import Progress
    from models.fe.cache import FeCache


@dataclass(frozen=True)
class FeOptions:
    """The options that ``--fe`` reads; ``rig_name`` is that of the bearing in the configuration, for ``[rig]``."""

    support: Support
    mesh: MeshName
    memory_gb: float | None
    use_cache: bool
    shaft: Path | None = None
    write_rig: Path | None = None
    plot: Path | None = None
    rig_name: str = ""
    quiet: bool = True


@dataclass(frozen=True, eq=False)
class FeCase:
    """A bearing under a radial load (N) with a radial clearance (m), computed.

    Attributes:
        entry: unknown dimensions filled in.
        estimated: names of the dimensions that are estimates.
        passage: over one spacing of the elements; the first state has one under the load.
        loads: N, with displacement along the load, m, (loads,), and stiffness, N/m, (loads, 2, 2), of each: means over
            a spacing.
        seconds: of wall time.
    """

    entry: CatalogueEntry
    bearing: FeBearing
    load: float
    clearance: float
    exponent: float
    estimated: tuple[str, ...]
    passage: FePassage
    loads: tuple[float, ...]
    displacement: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    options: FeOptions
    seconds: float
    from_cache: bool

    @property
    def first(self) -> FeState:
        """The state with an element under the load."""
        return self.passage.states[0]


def fe_case(entry: CatalogueEntry, load: float, clearance: float, options: FeOptions) -> FeCase:
    """Compute a bearing by finite elements; loads in N, radial clearance in m. Progress goes to standard error.

    Raises:
        WrongInputError: the extra is missing, a dimension unknown, the kind of bearing not modelled, or the memory too
            small.
    """
    from models.fe.cache import FeCache, default_folder
    from models.fe.extra import require_skfem
    from models.fe.solid.cost import memory_bound

    require_skfem()
    entry, estimated = _with_estimates(entry)
    began = time.perf_counter()
    kept = FeCache(default_folder() if options.use_cache else None, report=lambda text: say(text, quiet=options.quiet))
    bound = None if options.memory_gb is None else 1e9 * options.memory_gb
    with memory_bound(bound), _progress(quiet=options.quiet) as progress:
        if entry.bearing.contact_angle == 0.0:
            bearing = _symmetric(entry, load, clearance, options, kept, progress)
        else:
            bearing = _oblique(entry, load, clearance, options, kept, progress)
    passage = bearing.assembled.stiffness_over_passage(load)
    loads = tuple(share * load for share in LOAD_STEPS)
    displacement, stiffness = bearing.assembled.stiffness_against_load(loads)
    return FeCase(
        entry,
        bearing,
        load,
        clearance,
        contact_exponent(entry.bearing),
        estimated,
        passage,
        loads,
        displacement,
        stiffness,
        options,
        time.perf_counter() - began,
        kept.made == 0 and kept.found > 0,
    )


def _symmetric(
    entry: CatalogueEntry, load: float, clearance: float, options: FeOptions, kept: FeCache, progress: Progress
) -> FeBearing:
    from models.fe.bearings.bearing import fe_bearing

    return fe_bearing(
        fe_geometry(entry),
        load,
        clearance=clearance,
        support=options.support,
        rule=NAMED_RULES[options.mesh],
        cache=kept,
        progress=progress,
    )


def _oblique(
    entry: CatalogueEntry, load: float, clearance: float, options: FeOptions, kept: FeCache, progress: Progress
) -> FeBearing:
    from models.fe.bearings.oblique import oblique_geometry
    from models.fe.bearings.self_aligning import self_aligning_bearing

    geometry = oblique_geometry(entry)
    if options.support != "rigid-shaft" or options.mesh != "default":
        raise InputError(
            f"{entry.bearing.designation}: a self-aligning bearing takes --fe-support rigid-shaft and --fe-mesh default"
        )
    return self_aligning_bearing(geometry, load, clearance=clearance, cache=kept, progress=progress)


def _with_estimates(entry: CatalogueEntry) -> tuple[CatalogueEntry, tuple[str, ...]]:
    """Return a bearing whose unknown groove radii or roller length are estimates, and their names."""
    bearing = entry.bearing
    unknown = (
        bearing.effective_length is None
        if bearing.element == "roller"
        else bearing.inner_groove_radius is None or bearing.outer_groove_radius is None
    )
    if not unknown:
        return entry, ()
    try:
        found = estimate_stiffness(entry)
    except ValueError:
        return entry, ()
    names = tuple(name for name in found.estimated if hasattr(found.bearing, name))
    return replace(entry, bearing=found.bearing), names


@contextmanager
def _progress(*, quiet: bool) -> Generator[Callable[[str, int, int], None]]:
    """Give a callback (what is done now, steps done, steps in all) that shows progress on a terminal."""
    from tqdm import tqdm

    hidden = quiet or not sys.stderr.isatty()
    with tqdm(delay=PROGRESS_AFTER_S, file=sys.stderr, unit="step", leave=False, disable=hidden) as bar:

        def show(what: str, done: int, total: int) -> None:
            bar.total = total
            bar.set_description(what, refresh=False)
            bar.update(done - bar.n)

        yield show

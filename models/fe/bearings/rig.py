"""The contact stiffness k_c of a lumped model that stands for a bearing of finite elements, and its uncertainty.

The lumped models know one law Q = k_c delta^n of all elements and rigid rings. The k_c that serves them best depends on
what is asked of it: the displacement under the load, the stiffness along or across it, at this load or at another one.
The value is that of the mean stiffness along the load, which sets the natural frequencies; the others are its spread.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.elastic import NotConvergedError
from models.machine.hertz import contact_exponent
from models.machine.load_distribution import stiffness_against_load
from models.words.checks import check_numbers
from models.words.errors import WrongInputError
from models.words.numerics import find_root

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.fe.bearings.assembly import PassingElements
    from models.machine.bearing import Bearing

POINTS = 16
"""Cage angles of a mean over the passage of an element."""
_WIDEST = 30.0


@dataclass(frozen=True)
class EffectiveStiffness:
    """k_c of one element between both rings, N/m^n, from the answer of finite elements.

    Attributes:
        value: of the mean stiffness along the load, at the load.
        load: radial load of the bearing, N.
        exponent: n, fixed: 1.5 for balls, 10/9 for rollers.
        matched: what was matched at which load, N, and the k_c that does it: "k_yy", "displacement" and, without
            clearance, "k_xx".
        low, high: bounds of all of them, widened by the error of the mesh.
        spread: relative standard deviation: of what was matched about the value, and of the mesh.
        mesh_error: of k_c, relative; NaN where it is unknown.
    """

    value: float
    load: float
    exponent: float
    matched: tuple[tuple[str, float, float], ...]
    low: float
    high: float
    spread: float
    mesh_error: float


@dataclass(frozen=True)
class BearingAnswer:
    """Mean answer of a bearing over the passage of an element under one load, by any method, SI.

    Attributes:
        load: N.
        displacement: along the load, m.
        k_yy, k_xx: along and across the load, N/m.
    """

    load: float
    displacement: float
    k_yy: float
    k_xx: float

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable field."""
        check_numbers(self, "answer.", "positive", "load", "displacement", "k_yy", "k_xx")


def bearing_answers(
    loads: Sequence[float], displacement: NDArray[np.float64], stiffness: NDArray[np.float64]
) -> tuple[BearingAnswer, ...]:
    """Return answers from what ``stiffness_against_load`` gives: (loads,) m and (loads, 2, 2) N/m.

    Raises:
        NotConvergedError: at a load there is no answer (NaN).
    """
    found = np.isfinite(displacement) & np.isfinite(stiffness).all(axis=(1, 2))
    missing = [load for load, known in zip(loads, found, strict=True) if not known]
    if missing:
        raise NotConvergedError(
            f"no state of the bearing converged under {', '.join(f'{load:g}' for load in missing)} N"
        )
    return tuple(
        BearingAnswer(float(load), float(u), float(k[0, 0]), float(k[1, 1]))
        for load, u, k in zip(loads, displacement, stiffness, strict=True)
    )


LOAD_STEPS = (0.5, 1.0, 2.0)
"""Multiples of the load at which k_c is matched."""


def rig_stiffness(
    computed: PassingElements, bearing: Bearing, load: float, *, clearance: float = 0.0, mesh_error: float = math.nan
) -> EffectiveStiffness:
    """Return the k_c of a bearing of finite elements for ``[rig]``, matched at half the load, the load and twice it.

    Half and twice the load are left out where the bearing has no converged state there.

    Arguments and errors as of :func:`effective_stiffness`.
    """
    loads = [step * load for step in LOAD_STEPS]
    displacement, stiffness = computed.stiffness_against_load(loads, points=POINTS)
    # Half and twice the load widen the spread; beyond the law of the elements there is nothing to match.
    found = np.isfinite(displacement) & np.isfinite(stiffness).all(axis=(1, 2))
    kept = [i for i, one in enumerate(loads) if found[i] or one == load]
    answers = bearing_answers([loads[i] for i in kept], displacement[kept], stiffness[kept])
    return effective_stiffness(bearing, answers, load, clearance=clearance, mesh_error=mesh_error)


def effective_stiffness(
    bearing: Bearing,
    answers: Sequence[BearingAnswer],
    load: float,
    *,
    clearance: float = 0.0,
    mesh_error: float = math.nan,
) -> EffectiveStiffness:
    """Return the k_c with which the lumped bearing answers as finite elements do.

    Args:
        bearing: as the lumped models see it: all contacts in the plane of the load.
        answers: of finite elements, one of them at the load; others about it widen the spread.
        clearance: radial, m, the same in both.
        mesh_error: of the approach of an element, relative; of k_c it is n times as much.

    Raises:
        WrongInputError: there is no answer at the load.
    """
    if not any(math.isclose(answer.load, load, rel_tol=1e-9) for answer in answers):
        loads = ", ".join(f"{answer.load:g}" for answer in answers) or "none"
        raise WrongInputError(f"the effective k_c at {load:g} N needs an answer there, got {loads} N")
    exponent = contact_exponent(bearing)
    # With clearance stiffer contacts load fewer elements, so that two k_c can have one stiffness across the load.
    names = ("k_yy", "displacement") if clearance > 0.0 else ("k_yy", "k_xx", "displacement")
    matched: list[tuple[str, float, float]] = []
    for answer in answers:
        fit = _Fit(bearing, answer, clearance, exponent)
        matched += [(name, answer.load, fit.matching(name)) for name in names]
    value = next(k for name, at, k in matched if name == "k_yy" and math.isclose(at, load, rel_tol=1e-9))
    logarithms = np.log([k / value for _, _, k in matched])
    mesh = exponent * mesh_error
    known = 0.0 if math.isnan(mesh) else mesh
    return EffectiveStiffness(
        value=value,
        load=load,
        exponent=exponent,
        matched=tuple(matched),
        low=value * math.exp(min(0.0, float(logarithms.min())) - known),
        high=value * math.exp(max(0.0, float(logarithms.max())) + known),
        spread=math.hypot(math.sqrt(float(np.mean(logarithms**2))), known),
        mesh_error=mesh,
    )


@dataclass(frozen=True)
class _Fit:
    """The lumped bearing under the load of one answer, over its k_c."""

    bearing: Bearing
    answer: BearingAnswer
    clearance: float
    exponent: float

    def matching(self, name: str) -> float:
        """Return the k_c with which a quantity is that of the answer, N/m^n."""
        wanted = float(getattr(self.answer, name))
        pressed = self.answer.displacement - self.clearance
        if pressed <= 0.0:
            raise WrongInputError(
                f"under {self.answer.load:g} N the displacement {self.answer.displacement!r} m is not beyond "
                f"the clearance {self.clearance!r} m"
            )
        first = self.answer.load / (self.bearing.n_elements * self.bearing.rows * pressed**self.exponent)
        if self.clearance == 0.0:
            # Without clearance stiffness grows with k_c^(1/n), displacement falls with it.
            ratio = wanted / self._lumped(name, first)
            return first * ratio ** (-self.exponent if name == "displacement" else self.exponent)
        found = find_root(
            lambda log: math.log(self._lumped(name, first * math.exp(log)) / wanted),
            -math.log(_WIDEST),
            math.log(_WIDEST),
            rtol=1e-9,
        )
        return first * math.exp(found)

    def _lumped(self, name: str, k_c: float) -> float:
        u, k = stiffness_against_load(self.bearing, [self.answer.load], k_c, clearance=self.clearance, points=POINTS)
        return {"displacement": float(u[0]), "k_yy": float(k[0, 0, 0]), "k_xx": float(k[0, 1, 1])}[name]

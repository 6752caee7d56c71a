"""The branch of motions that repeat over a parameter of their scene: pseudo-arclength continuation of the period map.

A point is a state x at the start of the period with a value of the parameter. The next one is predicted along the
tangent of the branch and corrected on the plane across it by Newton's method, so that folds are passed, behind which
the motion goes on as an unstable one. The step follows the turn of the tangent, in units of the state at its beginning.
All points of a family are on one grid of steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.machine.rig import Rig
from models.solve.six_dof.kernels.orbit import STATE_SCALE, jacobian
from models.solve.six_dof.kernels.period import ball_period, blank_trace, mean_square
from models.solve.six_dof.kernels.period_setup import set_up
from models.solve.six_dof.kernels.step import P_CLEARANCE, P_U_1, STATUS_OK
from models.solve.six_dof.kernels.tangent import tangent_jacobian
from models.solve.six_dof.periodic import effort_for
from models.solve.six_dof.setup import (
    LEAST_IN_SEGMENT,
    OF_RIG,
    check_scene,
    defect_arrays,
    operating_point,
    steps_for,
)
from models.words.errors import SpallwatchError
from models.words.numerics import find_root

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.six_dof.kernels.period import Period
    from models.words.request import Request

    Floats = NDArray[np.float64]

Ended = Literal["reached", "returned", "points", "lost", "no_orbit"]

_OF_SCENE, _OF_DEFECT = ("speed", "load", "clearance"), ("dphi_d", "h_d")
PARAMETERS = (*_OF_SCENE, *_OF_DEFECT, *OF_RIG)
"""Names of the parameters that a motion is followed along."""

# Size of the state over its unit of length along the branch: so many points are spent on a motion that grows e-fold.
_STATE_UNIT = 4.0
# Newton's method: iterations, change that ends it (over the size of the state), and reduction that keeps a Jacobian.
_ITERATIONS, _DONE, _GOOD = 12, 1e-9, 0.2
# A change that rounding may leave, one that leads nowhere; iterations by tangents.
_ROUNDED, _FAR, _BY_TANGENTS = 1e-7, 1e2, 6
# Cosine of the turn of the tangent in a step, at least; a last step may be longer by this factor.
_TURNED, _STRETCHED = 0.7, 1.2
# Difference of the parameter in its derivative over the range that is swept.
_DIFFERENCE = 1e-5
# Size of the differences of the state, in scaled coordinates, at most and over the static approach of the contacts.
_SIZE, _OF_APPROACH = 1e-3, 1e-3
# Largest multiplier up to which the tangents of the period map are its Jacobian.
_DOUBTFUL = 0.8
# Direction of the parameter alone.
ALONG = np.append(np.zeros(12), 1.0)


class MotionLostError(SpallwatchError):
    """No motion that repeats was found near where one was expected."""


class PeriodFamily:
    """The period maps of a scene over the range of a parameter, on one grid of steps."""

    def __init__(self, scene: Scene, parameter: str, ends: tuple[float, float], request: Request) -> None:
        """Raise a ValueError where the scene at an end does not repeat, or cannot be simulated."""
        self.scene, self.parameter, self.ends, self.request = scene, parameter, ends, request
        self.fold = 1
        for value in ends:
            check_scene(self.at(value))
            effort_for(self.at(value), request)
        self.steps = max(steps_for(self.at(value)) for value in ends)

    def at(self, value: float) -> Scene:
        """Return the scene at a value of the parameter; raise a ValueError where there is none."""
        if self.parameter in _OF_SCENE:
            return replace(self.scene, **{self.parameter: value})
        if self.parameter not in _OF_DEFECT:
            return replace(self.scene, rig=replace(self.scene.rig_as(Rig), **{self.parameter: value}))
        if self.scene.defect is None:
            raise ValueError(f"parameter {self.parameter!r} is that of a defect, the scene has none")
        return replace(self.scene, defect=replace(self.scene.defect, **{self.parameter: value}))

    def value(self, share: float) -> float:
        """Return the value of the parameter at a share of the way."""
        return self.ends[0] + share * (self.ends[1] - self.ends[0])

    def refined(self) -> PeriodFamily:
        """Return the same on half the steps."""
        finer = PeriodFamily(self.scene, self.parameter, self.ends, self.request)
        finer.fold = 2 * self.fold
        return finer

    def period(self, share: float) -> Period:
        """Return the ball period at a share of the way."""
        try:
            scene = self.at(self.value(share))
        except ValueError as error:
            raise MotionLostError from error
        paths, profile = defect_arrays(scene.bearing, scene.defects)
        return set_up(paths, profile, operating_point(scene.healthy), self.steps, LEAST_IN_SEGMENT, self.fold)

    def correct(self, z: Floats, row: Floats, near: BranchPoint | None = None) -> BranchPoint:
        """Return the point of the branch on the plane through ``z``, as of ``BranchPoint``, across ``row``, (13,).

        The derivatives of the map are those of ``near`` for as long as they do, then anew.

        Raises:
            MotionLostError: none is found.
        """
        place, size, before = BranchPoint(self, z), 1.0 + float(np.linalg.norm(z[:12])), math.inf
        near = place if near is None else near
        for iteration in range(1, _ITERATIONS + 1):
            # Tangents do at first; they are off where contacts are lost.
            matrix = near.matrix if iteration > _BY_TANGENTS or near.differs else near.carried
            system = np.vstack([np.column_stack([matrix - np.eye(12), near.slope]), row])
            try:
                change = np.linalg.solve(system, np.append(place.z[:12] - place.image, 0.0))
            except np.linalg.LinAlgError:
                raise MotionLostError from None
            moved = max(float(np.linalg.norm(change[:12])) / size, abs(float(change[12])))
            if not moved < _FAR:
                raise MotionLostError
            place = BranchPoint(self, place.z + change, iteration)
            if moved <= _DONE or (moved <= _ROUNDED and moved > _GOOD * before):
                return place
            if moved > _GOOD * before:
                near = place
            before = moved
        raise MotionLostError


class BranchPoint:
    """A point of the branch, or near it, on the grid of a family.

    Attributes:
        z: scaled state (12,), then the share of the way from the first value to the last.
        iterations: that found it.
    """

    def __init__(self, family: PeriodFamily, z: Floats, iterations: int = 0) -> None:
        """Take a point as it is, corrected or not."""
        self.z, self.iterations, self.share, self._family = z, iterations, float(z[12]), family
        self.state = _state(z)
        # What lengths along the branch are measured in here: the size of the state, and the range.
        self.units = np.append(np.full(12, _STATE_UNIT * (1.0 + float(np.linalg.norm(z[:12])))), 1.0)

    @cached_property
    def period(self) -> Period:
        """The ball period of its value."""
        return self._family.period(self.share)

    @cached_property
    def image(self) -> Floats:
        """The scaled state one period later, (12,)."""
        return _image(self.state, self.period)

    @cached_property
    def _tangents(self) -> tuple[Floats, bool]:
        found, parted = tangent_jacobian(self.state, self.period)
        if not np.all(np.isfinite(found)):
            raise MotionLostError
        return found, bool(parted)

    @property
    def carried(self) -> Floats:
        """The Jacobian of the scaled period map by tangents, (12, 12)."""
        return self._tangents[0]

    @property
    def parted(self) -> bool:
        """Whether the rings part for a moment."""
        return self._tangents[1]

    @property
    def differs(self) -> bool:
        """Whether ``matrix`` is known."""
        return "matrix" in self.__dict__

    @cached_property
    def matrix(self) -> Floats:
        """The Jacobian of the scaled period map, (12, 12): by tangents, or differences where stability is in doubt."""
        if not self.parted and np.max(np.abs(np.linalg.eigvals(self.carried))) < _DOUBTFUL:
            return self.carried
        p = self.period.parameter
        approach = _OF_APPROACH * (abs(float(p[P_U_1])) - float(p[P_CLEARANCE])) / float(STATE_SCALE[0])
        # Half as large on half the steps: where both agree, neither matters.
        size = (min(_SIZE, approach) if approach > 0.0 else _SIZE) / self._family.fold
        found = jacobian(self.state, self.period, size)
        if not np.all(np.isfinite(found)):
            raise MotionLostError
        return found

    @cached_property
    def slope(self) -> Floats:
        """The derivative of the image by the share, (12,); to one side where there is no other."""
        images: list[Floats] = []
        shares = [self.share - _DIFFERENCE, self.share, self.share + _DIFFERENCE]
        for share in (shares[0], shares[2], shares[1]):
            try:
                images.append(_image(self.state, self._family.period(share)))
            except MotionLostError:
                shares.remove(share)
            if len(images) == 2:
                break
        else:
            raise MotionLostError
        return (images[1] - images[0]) / (shares[-1] - shares[0])

    @cached_property
    def tangent(self) -> Floats:
        """Direction of the branch, as of ``z``, of unit length in ``units``, towards either end."""
        rows = np.column_stack([self.matrix - np.eye(12), self.slope]) * self.units
        return np.linalg.svd(rows)[2][-1] * self.units

    @cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """The Floquet multipliers, the largest first."""
        found = np.linalg.eigvals(self.matrix).astype(np.complex128)
        return found[np.argsort(-np.abs(found))]

    @cached_property
    def seen(self) -> tuple[int, float]:
        """How many times a contact opens or closes, and the full-bandwidth RMS of the casing, m/s2."""
        trace = blank_trace(self.period)
        ball_period(self.state, np.empty((2, 6)), trace, self.period)
        return int(np.sum(trace.instants)), math.sqrt(mean_square(trace, 0))


def _state(z: Floats) -> Floats:
    return z[:12].reshape(2, 6) * STATE_SCALE


def _image(state: Floats, period: Period) -> Floats:
    """Return the scaled state one period later, (12,); raise a MotionLostError where it is not finite."""
    after = np.empty((2, 6))
    if ball_period(state, after, blank_trace(period), period) != STATUS_OK:
        raise MotionLostError
    return (after / STATE_SCALE).ravel()


@dataclass(frozen=True, eq=False)
class BranchStep:
    """A step along the branch from one point to the next.

    Attributes:
        begin, end: of it.
        heading: direction of the branch at its beginning, as of ``BranchPoint.tangent``.
        turned: that at its end.
    """

    begin: BranchPoint
    end: BranchPoint
    heading: Floats
    turned: Floats

    @property
    def cosine(self) -> float:
        """Cosine of the turn of the branch."""
        units = self.begin.units
        return float(_unit(self.heading / units) @ _unit(self.turned / units))

    def across(self) -> Floats:
        """Return the row of the plane across the branch at the beginning."""
        return self.heading / self.begin.units**2

    def between(self, family: PeriodFamily, length: float, known: dict[float, BranchPoint]) -> BranchPoint:
        """Return the point at a length from the beginning, on the grid of a family; ``known`` are others, by length."""
        z = self.begin.z + length / self.length * (self.end.z - self.begin.z)
        near = known[min(known, key=lambda other: abs(other - length))]
        found = known[length] = family.correct(z, self.across(), near)
        return found

    @property
    def length(self) -> float:
        """Distance of the planes across its beginning through both points."""
        return float(self.across() @ (self.end.z - self.begin.z))


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)


def ahead(place: BranchPoint, way: Floats) -> Floats:
    """Return the direction of the branch at a point, in the sense of a way."""
    tangent = place.tangent
    return tangent if float((tangent / place.units) @ (way / place.units)) >= 0.0 else -tangent


def stepped(
    family: PeriodFamily, begin: BranchPoint, heading: Floats, length: float
) -> tuple[BranchStep, Ended | None]:
    """Return a step and why the sweep ends with it; raise a MotionLostError where it should be shorter."""
    along, z = float(heading[12]), begin.z + length * heading
    limit = 1.0 if along > 0.0 else 0.0
    ended: Ended | None = None
    if abs(begin.share - limit) <= _STRETCHED * abs(length * along):
        z, ended = begin.z + (limit - begin.share) / along * heading, "reached" if limit == 1.0 else "returned"
        z[12] = limit
    end = family.correct(z, ALONG if ended else heading / begin.units**2, begin)
    if not -_DIFFERENCE <= end.share <= 1.0 + _DIFFERENCE:
        raise MotionLostError
    step = BranchStep(begin, end, heading, ahead(end, heading))
    if step.cosine < _TURNED or not 0.0 < step.length <= 2.0 * length:
        raise MotionLostError
    return step, ended


def located(
    step: BranchStep,
    family: PeriodFamily,
    finer: PeriodFamily,
    measure: Callable[[BranchPoint], float],
    resolution: float,
) -> tuple[BranchPoint, float]:
    """Return where a measure changes its sign in a step, and the error of the value there.

    It is that of the finer grid where that shows it between the same two points.
    """
    span = abs(family.ends[1] - family.ends[0])
    known, places = {0.0: step.begin, step.length: step.end}, list[BranchPoint]()

    def root(grid: PeriodFamily) -> BranchPoint:
        found = dict[float, BranchPoint]()

        def at(length: float) -> float:
            found[length] = place = step.between(grid, length, known)
            return measure(place)

        return found[find_root(at, 0.0, step.length, xtol=resolution * step.length, rtol=1e-12)]

    for grid in (family, finer):
        try:
            places.append(root(grid))
        except (MotionLostError, ValueError):
            continue
    if len(places) < 2:
        return places[0] if places else step.end, span * abs(step.end.share - step.begin.share)
    left = resolution * step.length * abs(float(ahead(places[1], step.heading)[12]))
    return places[1], span * (abs(places[1].share - places[0].share) + left)

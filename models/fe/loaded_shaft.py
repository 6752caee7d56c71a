"""The inner ring on a loaded solid shaft: which pressure the shaft exerts on the bore, and the loads of the elements.

Shaft and bore touch without clearance and without friction, and may part. Both are rotationally symmetric, so that a
pressure cos(n angle) moves either by c_n cos(n angle): the compliances c_n of a few harmonics, from half a ring and
half a shaft of the ring's width, are all that is needed. Elements move the bore, and the bore's pressure the race, by
coefficients that reciprocity ties together. The first harmonic is the rigid motion; its pressure carries the load,
wherever within the shaft that is applied.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from models.errors import WrongInputError
from models.fe.ring_bodies import INFLUENCE_RULE, BalancedRing, RingBody, bore_traction, influence_load
from models.fe.rings import RingInfluence
from models.load_distribution import LoadDistribution

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.fe.assembled import AssembledBearing
    from models.fe.geometry import FeGeometry
    from models.fe.sizing import MeshRule

# Harmonics from finite elements; from there on compliances fall as 1/n, as those of a half space do.
COMPUTED_HARMONICS = 12
# Points around the bore at which it presses or parts: every 5 degrees.
POINTS = 72
# Radius of the hole that the mesh of the solid shaft has, by its own.
_HOLE = 0.05
_MAX_ROUNDS = 200
_PATIENCE = 20


@dataclass(frozen=True, eq=False)
class BoreHarmonics:
    """Compliances of bore and shaft by harmonic n from 0 to half the points; the first is zero: a rigid motion.

    Attributes:
        contact: what bore and shaft yield together per pressure, m/Pa, shape (n,).
        element: how far the bore moves outwards per newton on an element, m/N, shape (n,).
        race: how far the race moves inwards per pressure on the bore, m/Pa, shape (n,).
        area: of the bore per radian, m^2.
    """

    contact: NDArray[np.float64]
    element: NDArray[np.float64]
    race: NDArray[np.float64]
    area: float


@dataclass(frozen=True, eq=False)
class ShaftState:
    """Loads of the elements, and the pressure of the shaft on the bore, Pa, at angles from the load, rad.

    ``converged``: whether no point changes sides any more, and the bearing's own state converged.
    """

    distribution: LoadDistribution
    angle: NDArray[np.float64]
    pressure: NDArray[np.float64]
    rounds: int
    converged: bool


def bore_harmonics(geometry: FeGeometry, rule: MeshRule | None = None) -> BoreHarmonics:
    """Return the compliances of inner ring and solid shaft, both of the ring's width and of its material."""
    rule = rule or INFLUENCE_RULE
    half = RingBody.of(geometry, "inner", influence_load(geometry), rule)
    ring = BalancedRing.of(half.free())
    under = ring.solve(half.element_load(ring.body))
    # The shaft is a ring with hardly a hole, its race in the bore.
    solid = replace(
        geometry, inner_race_radius=geometry.bore_radius, bore_radius=_HOLE * geometry.bore_radius,
        element="roller", inner_groove_radius=None, outer_groove_radius=None, shoulder_height=0.0,
        effective_length=0.8 * geometry.width, roller_length=0.8 * geometry.width, edge_radius=0.0,
    )  # fmt: skip
    shaft_half = RingBody.of(solid, "inner", influence_load(solid), rule)
    shaft = BalancedRing.of(shaft_half.free())
    count = POINTS // 2 + 1
    contact, element, race = np.zeros(count), np.zeros(count), np.zeros(count)
    surface = geometry.bore_radius * geometry.width
    for n in (n for n in range(COMPUTED_HARMONICS + 1) if n != 1):
        wave = _wave(n)
        # Integral of cos^2 over the quarter of the bore that is meshed.
        size = 0.5 * surface * (math.pi if n == 0 else 0.5 * math.pi)
        on_ring = bore_traction(ring.body, wave)
        on_shaft = sum(bore_traction(shaft.body, wave, surface=name) for name in ("race", "contact"))
        contact[n] = float(on_ring @ ring.body.solve(on_ring) + on_shaft @ shaft.body.solve(on_shaft)) / size
        element[n] = float(on_ring @ under) / size
        race[n] = 4.0 * size * element[n]
    beyond = np.arange(COMPUTED_HARMONICS + 1, count)
    contact[beyond] = contact[COMPUTED_HARMONICS] * COMPUTED_HARMONICS / beyond
    return BoreHarmonics(contact, element, race, surface)


def on_loaded_shaft(
    bearing: AssembledBearing, harmonics: BoreHarmonics, load: float, *, cage_angle: float = 0.0
) -> ShaftState:
    """Return the loads of the elements where a shaft under a radial load, N, fills the bore.

    An active set of the points that press; the pressure there follows the loads of the elements within each state.

    Args:
        bearing: its inner ring free ("sinusoidal"); its own load on the bore is not used.

    Raises:
        WrongInputError: the inner ring is held, or there is no load.
    """
    if bearing.inner is None or bearing.inner.support != "sinusoidal":
        raise WrongInputError("expected an inner ring on support 'sinusoidal', which the shaft replaces")
    if not (math.isfinite(load) and load > 0.0):
        raise WrongInputError(f"expected a load that is finite and positive, got {load!r} N")
    angles = bearing.angles(cage_angle)
    around: NDArray[np.float64] = np.linspace(0.0, 2.0 * math.pi, POINTS, endpoint=False)
    touch = _Touch(
        _series(harmonics.contact, around, around),
        _kernel(harmonics.element, around, angles),
        _series(harmonics.race, angles, around),
        np.stack((np.cos(around), np.sin(around)), axis=1),
        load * POINTS / (2.0 * math.pi * harmonics.area),
    )
    active, settled, rounds = touch.motion[:, 0] > -1e-9, False, 0
    while True:
        rounds += 1
        given, by_loads = touch.pressure(active)
        ring = _OnShaft(
            bearing.inner.angle, bearing.inner.race, bearing.inner.own, bearing.inner.support, touch.race @ by_loads
        )
        held = replace(bearing, inner=ring, bore_load=None)
        state = held.state(load, cage_angle=cage_angle, gaps=touch.race @ given)
        pressure = given + by_loads @ state.loads
        wrong = touch.presses(pressure, state.loads, active) != active
        settled = not np.any(wrong)
        if settled or rounds >= _MAX_ROUNDS:
            break
        if rounds > _PATIENCE:
            # Ends cycles: one point changes sides at a time.
            wrong[: int(np.nonzero(wrong)[0][-1])] = False
        active = active ^ wrong
    distribution = LoadDistribution(state.angles, state.loads, state.displacement)
    return ShaftState(distribution, around, np.maximum(pressure, 0.0), rounds, settled and state.converged)


@dataclass(frozen=True, eq=False)
class _OnShaft(RingInfluence):
    """Ring on a shaft that touches it at given points: the shaft's pressure follows the loads of the elements."""

    followed: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def matrix(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        return super().matrix(angles) + self.followed


@dataclass(frozen=True, eq=False)
class _Touch:
    """Conditions of contact at the points: w = C p + B Q - M u, p >= 0, w >= 0, one of them 0; M' p = (force, 0)."""

    contact: NDArray[np.float64]
    element: NDArray[np.float64]
    race: NDArray[np.float64]
    motion: NDArray[np.float64]
    force: float

    def pressure(self, active: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the pressure without loads of elements, and per newton on each, (points,), (points, elements)."""
        held = np.nonzero(active)[0]
        block = np.zeros((len(held) + 2, len(held) + 2))
        block[:-2, :-2] = self.contact[np.ix_(held, held)] / self._scale
        block[:-2, -2:], block[-2:, :-2] = -self.motion[held], -self.motion[held].T
        known = np.zeros((len(held) + 2, 1 + self.element.shape[1]))
        known[:-2, 1:] = -self.element[held] / self._scale
        known[-2, 0] = -self.force
        both = np.zeros((len(active), known.shape[1]))
        both[held] = np.linalg.solve(block, known)[:-2]
        return both[:, 0], both[:, 1:]

    def presses(
        self, pressure: NDArray[np.float64], loads: NDArray[np.float64], active: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Return which points press, by pressure where they touch and by the opening elsewhere."""
        moved = (self.contact @ pressure + self.element @ loads) / self._scale
        shift = np.linalg.lstsq(self.motion[active], moved[active], rcond=None)[0]
        return np.where(active, pressure > 0.0, moved - self.motion @ shift < 0.0)

    @property
    def _scale(self) -> float:
        return float(np.diag(self.contact).mean())


def _wave(n: int) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    def wave(angle: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.cos(n * angle)

    return wave


def _kernel(coefficients: NDArray[np.float64], at: NDArray[np.float64], of: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sum over n of c_n cos(n (at - of)), shape (at, of)."""
    apart = at[:, None] - of[None, :]
    return np.asarray(np.cos(apart[:, :, None] * np.arange(len(coefficients))) @ coefficients)


def _series(coefficients: NDArray[np.float64], at: NDArray[np.float64], of: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what values at evenly spaced points ``of`` cause at other angles, harmonic by harmonic, (at, of)."""
    share = np.full(len(coefficients), 2.0 / len(of))
    share[0] = share[-1] = 1.0 / len(of)
    return _kernel(coefficients * share, at, of)

"""The motion of a scene that the turning shaft drives as well as the ball passages, without time to settle.

At the beginning of a ball period the settled state is a function of the angle of the shaft, X(a), and one ball period
later it is X(a + s), s being the turn of the shaft meanwhile. X is a Fourier series in the multiples of a that effects
drive; it is searched from the orbit without them: what a ball period leaves of X(a + s) is taken back order by order,
by the linear response of that orbit, (exp(i m s) - M) d_m = r_m, M being its tangent. The first correction is the
linear response to an effect, the next ones what is of higher order.

Levels and lines are those of the orbit without the effects and what these change on a grid with and without them.
Everything is done on two grids of steps; what they differ by is an error, as is what is left to correct and what orders
that are left out would bring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.machine.bearing import kinematics
from models.solve.response import CASING, HARMONICS, Added, lines_error
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.orbit import STATE_SCALE
from models.solve.six_dof.kernels.step import (
    P_CLEARANCE,
    P_DIRECTION_1,
    P_DIRECTION_2,
    P_SHARE_R,
    P_U_1,
    P_U_2,
    STATUS_OK,
)
from models.solve.six_dof.kernels.tangent import tangent_jacobian
from models.solve.six_dof.periodic import LINES_TO, search, steps_to_resolve
from models.solve.six_dof.setup import DEFAULT_STEP, steps_for
from models.solve.six_dof.time_domain import prepare_plan

if TYPE_CHECKING:
    from collections.abc import Collection

    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Response
    from models.words.request import Request

    Values = NDArray[np.float64]
    Lines = NDArray[np.complex128]

# Effects of a scene that are solved for here.
ADDABLE = frozenset({"unbalance", "inner_waviness"})
# Orders solved for over the highest one that is driven, and angles of the shaft at most.
_ORDERS, _MOST_ANGLES = 2, 65
# The orbit only begins the search: its accuracy, and what its lines on the grid may be off from those of the response.
_ORBIT_ACCURACY, _SAME_ORBIT = 1e-2, 5e-2
# Corrections on a grid, each of which must leave less than a share, and what they may leave over the accuracy.
_CORRECTIONS, _SHRINKS, _SETTLED = 12, 0.5, 0.1
# Steps of the first grid over those of the second, and number of grids.
_COARSE, _GRIDS = 0.55, 3
# Error over what two grids differ by, and over what falling on like the last orders leaves.
_STEPS, _BEYOND = 3.0, 2.0
# Highest line over the number of steps that is weighed where the force jumps.
_SLOW = 0.05
# A line of the shaft nearer than this, in turns a ball period, to one of the ball passage is not told from it.
_APART = 1e-3
# Multiplier, and displacement over the static approach, up to which the motion is as stable as the orbit. Beyond, it is
# simulated on for some decay times, in which its distance from the orbit without effects must shrink.
_STABLE, _MOVED, _MOST_MOVED, _MOST_RADIUS = 0.8, 0.05, 0.5, 0.97
_DECAYS, _LEFT = 2.0, 0.5
# Angles at which the largest value is looked for.
_PEAKS = 24
_TINY = 1e-30


def add(scene: Scene, plain: Scene, found: Response, request: Request, names: Collection[str]) -> Response | None:
    """Return the response to a scene with some of its effects, None where it is not known to an accuracy.

    Args:
        plain: the scene without any of them, whose response is ``found``.
        request: whose accuracy is what they may add to the error of ``found``.
        names: of the effects.
    """
    if not ADDABLE.issuperset(names) or not found.multiplier < _MOST_RADIUS:
        return None
    kept = _with(scene, plain, names)
    order, highest = _driven(kept)
    count = 1 + 2 * _ORDERS * highest
    turns = order * scene.speed / found.bpfo * np.arange(1, count // 2 + 1)
    if count > _MOST_ANGLES or np.any(np.abs(turns - np.round(turns)) < _APART):
        return None
    searched = _Search.of(kept, plain, request, (order, count))
    if searched is None:
        return None
    resolved = max(LINES_TO, request.highest(math.inf, ""))
    steps = max(steps_for(kept), math.ceil(1.0 / (found.bpfo * DEFAULT_STEP)))
    steps = max(steps, steps_to_resolve(resolved, 1.0 / found.bpfo))
    tolerance = _SETTLED * request.accuracy * found.rms
    before = searched.on_grid(math.ceil(_COARSE * steps), tolerance, None)
    for grid in range(_GRIDS):
        now = None if before is None else searched.on_grid(steps << grid, tolerance, before)
        if before is None or now is None or not _same(found, now):
            return None
        response = _response(found, now, before, request, frequency=order * scene.speed, names=tuple(names))
        if response.error_of(request.quantity) - found.error_of(request.quantity) <= request.accuracy:
            return response if searched.attracts(now) else None
        before = now
    return None


def _orders(count: int) -> Values:
    """Return the orders of a Fourier series of so many values, as numpy has them."""
    return np.round(np.fft.fftfreq(count, 1.0 / count)).astype(np.float64)


def _with(scene: Scene, plain: Scene, names: Collection[str]) -> Scene:
    """Return the plain scene with some effects of a scene."""
    kept = plain
    if "unbalance" in names:
        kept = replace(kept, unbalance=scene.unbalance)
    if "inner_waviness" in names:
        kept = replace(kept, waviness=scene.waviness)
    return kept


def _driven(scene: Scene) -> tuple[int, int]:
    """Return the largest order of the shaft of which all that effects drive are multiples, and the highest over it."""
    orders = [wave.order for wave in scene.waviness if wave.race == "inner" and wave.amplitude != 0.0]
    orders += [1] if scene.unbalance != 0.0 else []
    order = math.gcd(*orders)
    return (order, max(orders) // order) if orders else (1, 0)


class _Motion(NamedTuple):
    """A settled motion on one grid: A angles of the shaft at the beginning of a ball period of n steps.

    Attributes:
        states: scaled, (A, 12).
        waves: accelerations, (A, n, 2).
        left: RMS of what is left to correct of them, m/s2.
        gain: RMS of a change of the accelerations over that of the states.
    """

    states: Values
    waves: Values
    left: float
    gain: float


@dataclass(frozen=True, eq=False)
class _Torus:
    """The motion with and without the effects on one grid.

    Attributes:
        moving, plain: with and without.
        lines: Fourier coefficients c_mk of the accelerations in orders m of the shaft and k of the ball passage, m/s2,
            in numpy's order of frequencies, (A, n, 2); plain_lines: without the effects, (n, 2).
        power: what the effects change of the mean squares, m2/s4, (2,).
        moved: largest displacement of the rings by them over the static approach.
    """

    moving: _Motion
    plain: _Motion
    lines: Lines
    plain_lines: Lines
    power: Values
    moved: float

    @property
    def changes(self) -> Lines:
        """What the effects change of the coefficients, (A, n, 2)."""
        changes = self.lines.copy()
        changes[0] -= self.plain_lines
        return changes

    def levels(self, frequency: float, bpfo: float, band: tuple[float, float] | None) -> tuple[Values, Values]:
        """Return what the effects change of the mean squares, m2/s4, and of the largest values, m/s2, (2,) each.

        ``frequency``: of the first order of the shaft, Hz.
        """
        if band is None:
            power, lines = self.power, np.fft.fft(self.moving.waves, axis=0) / len(self.lines)
            without = self.plain.waves[0]
        else:
            m, k = (_orders(size) for size in self.lines.shape[:2])
            at = np.abs(m[:, None] * frequency + k * bpfo)
            inside = ((at >= band[0]) & (at <= band[1]))[:, :, None]
            lines, plain = np.where(inside, self.lines, 0.0), np.where(inside[0], self.plain_lines, 0.0)
            power = np.sum(np.abs(lines) ** 2, axis=(0, 1)) - np.sum(np.abs(plain) ** 2, axis=0)
            lines, without = np.fft.ifft(lines, axis=1) * lines.shape[1], np.fft.ifft(plain, axis=0) * len(plain)
        half = len(lines) // 2
        padded = np.zeros((max(_PEAKS, len(lines)), *without.shape), dtype=np.complex128)
        padded[: half + 1], padded[len(padded) - half :] = lines[: half + 1], lines[len(lines) - half :]
        wave: Values = np.real(np.fft.ifft(padded, axis=0)) * len(padded)
        alone: Values = np.real(without)
        return power, np.max(np.abs(wave), axis=(0, 1)) - np.max(np.abs(alone), axis=0)

    def beyond(self, row: int) -> float:
        """Return the RMS of the accelerations of orders that are left out, m/s2, were they to fall as the last do."""
        power = np.sum(np.abs(self.changes[:, :, row]) ** 2, axis=1)
        orders, highest = np.abs(_orders(len(power))), len(power) // (2 * _ORDERS)
        first = math.sqrt(float(np.sum(power[(orders > 0) & (orders <= highest)])))
        second = math.sqrt(float(np.sum(power[orders > highest])))
        return _BEYOND * second * min(second / max(first, _TINY), 1.0)


@dataclass(frozen=True, eq=False)
class _Search:
    """Searches the motion of one scene on any grid.

    Attributes:
        plans: of one ball period with and without the effects.
        period: s.
        order, count: the lowest order of the shaft, and number of its angles.
        turn: of the shaft in a ball period, times that order, rad.
        inner: order of each wave of the plan, 0 of the outer race, (waves,).
        begin, tangent: state of the orbit, scaled, (12,), and tangent of its period map, (12, 12).
        multiplier: of the orbit.
    """

    plans: tuple[kernels.TimePlan, kernels.TimePlan]
    period: float
    order: int
    count: int
    turn: float
    inner: Values
    begin: Values
    tangent: Values
    multiplier: float

    @classmethod
    def of(cls, scene: Scene, plain: Scene, request: Request, orders: tuple[int, int]) -> _Search | None:
        """Return what searches a scene, in a lowest order and a number of angles; None without an orbit to begin at."""
        accuracy = max(request.accuracy, _ORBIT_ACCURACY)
        orbit = search(plain, replace(request, accuracy=accuracy, band=None, lines_to=None, quantity="rms"))
        if orbit.doubted or not orbit.stable:
            return None
        period = 1.0 / kinematics(scene.bearing, scene.speed).bpfo
        plans = prepare_plan(scene, period), prepare_plan(plain, period)
        for plan in plans:
            plan.parameter[P_DIRECTION_1] = math.cos(request.direction)
            plan.parameter[P_DIRECTION_2] = math.sin(request.direction)
        waves = [wave for wave in scene.waviness if wave.amplitude != 0.0]
        return cls(
            plans=plans,
            period=period,
            order=orders[0],
            count=orders[1],
            turn=2.0 * math.pi * orders[0] * scene.speed * period,
            inner=np.array([float(wave.order) if wave.race == "inner" else 0.0 for wave in waves]),
            begin=(orbit.state / STATE_SCALE).ravel(),
            tangent=tangent_jacobian(orbit.state, orbit.period)[0],
            multiplier=orbit.multiplier,
        )

    def on_grid(self, steps: int, tolerance: float, before: _Torus | None) -> _Torus | None:
        """Return the motion on a grid, None where it is not found.

        Args:
            steps: in a ball period.
            tolerance: RMS of what may be left to correct of the accelerations, m/s2.
            before: what was found on another grid.
        """
        begin, gain, off = self.begin[None], math.nan, np.zeros((1, 12))
        if before is not None:
            begin, gain, off = before.plain.states, before.plain.gain, before.moving.states - before.plain.states
        plain = self._settled(1, begin, steps, tolerance, gain)
        if plain is None:
            return None
        gain = math.nan if before is None else before.moving.gain
        moving = self._settled(0, plain.states + np.broadcast_to(off, (self.count, 12)), steps, tolerance, gain)
        if moving is None:
            return None
        weights = [_weights(plan.bounds, self.period, steps)[:, None] for plan in self.plans]
        lines = self._lines(moving.waves, weights[0]), self._lines(plain.waves, weights[1])[0]
        squares = [
            np.mean(w * motion.waves**2, axis=(0, 1)) for w, motion in zip(weights, (moving, plain), strict=True)
        ]
        return _Torus(moving, plain, *lines, squares[0] - squares[1], self._moved(moving.states - plain.states))

    def _settled(self, number: int, begin: Values, steps: int, tolerance: float, gain: float) -> _Motion | None:
        """Return the motion by the plan of a number from states at the angles; see ``on_grid``."""
        angles = 2.0 * math.pi * np.arange(len(begin)) / len(begin)
        later = np.exp(1j * self.turn * _orders(len(begin)))
        inverse = np.linalg.inv(later[:, None, None] * np.eye(12) - self.tangent)
        states, waves, size = begin.copy(), np.empty(0), math.nan
        for k in range(_CORRECTIONS):
            run = [self._period_of(number, state, angle, steps) for state, angle in zip(states, angles, strict=True)]
            ends, waves_before = np.array([end for end, _ in run]), waves
            waves = np.array([wave for _, wave in run])
            if not np.all(np.isfinite(ends)):
                return None
            there = np.real(np.fft.ifft(np.fft.fft(states, axis=0) * later[:, None], axis=0))
            missed = np.fft.fft(ends - there, axis=0)
            correction = np.real(np.fft.ifft(np.einsum("mij,mj->mi", inverse, missed), axis=0))
            size_before, size = size, math.sqrt(float(np.mean(correction**2)))
            if k > 0:
                if size > _SHRINKS * size_before and gain * size > tolerance:
                    return None
                gain = math.sqrt(float(np.mean((waves - waves_before) ** 2))) / max(size_before, _TINY)
            if gain * size <= tolerance:
                return _Motion(states, waves, gain * size, gain)
            states = states + correction
        return None

    def _period_of(self, number: int, state: Values, angle: float, steps: int) -> tuple[Values, Values]:
        """Return the state a ball period later, not a number where it diverges, and the accelerations, (steps, 2)."""
        plan, now, wave = self.plans[number], state.reshape(2, 6) * STATE_SCALE, np.empty((steps, 2))
        push, waves = plan.push, plan.waves
        if push is not None:
            push = push + np.array([0.0, 0.0, angle / self.order, 0.0])
        if number == 0 and np.any(self.inner):
            waves = waves.copy()
            waves[:, 3] -= self.inner * angle / self.order
        status = kernels.run(now, wave, self.period / steps, plan._replace(push=push, waves=waves))
        return (now / STATE_SCALE).ravel() if status == STATUS_OK else np.full(12, math.nan), wave

    def _lines(self, waves: Values, weights: Values) -> Lines:
        """Return the Fourier coefficients of accelerations at the angles and times, (A, n, 2) as they are."""
        turned = np.exp(-1j * self.turn * np.outer(_orders(len(waves)), np.linspace(0.0, 1.0, len(weights), False)))
        # High lines turn too fast for what the weights continue.
        low = np.abs(_orders(len(weights)))[:, None] <= _SLOW * len(weights)
        orders = np.fft.fft(waves, axis=0) * turned[:, :, None]
        plain, weighed = np.fft.fft(orders, axis=1), np.fft.fft(weights * orders, axis=1)
        return np.where(low, weighed, plain) / (waves.shape[0] * waves.shape[1])

    def _moved(self, states: Values) -> float:
        """Return the largest displacement of the rings against each other over the static approach."""
        p = self.plans[1].parameter
        axes = states.reshape(-1, 2, 6) * STATE_SCALE
        moved = axes[:, :, 0] - axes[:, :, 2] - p[P_SHARE_R] * axes[:, :, 4]
        approach = math.hypot(p[P_U_1], p[P_U_2]) - p[P_CLEARANCE]
        return float(np.max(np.hypot(*moved.T))) / approach if approach > 0.0 else math.inf

    def attracts(self, torus: _Torus) -> bool:
        """Whether what is near the motion comes to it."""
        if self.multiplier <= _STABLE and torus.moved <= _MOVED:
            return True
        if torus.moved > _MOST_MOVED:
            return False
        state, steps, orders = (
            torus.plain.states[0],
            torus.moving.waves.shape[1],
            np.fft.fft(torus.moving.states, axis=0),
        )
        order = _orders(self.count)
        begin = float(np.linalg.norm(state - torus.moving.states[0]))
        periods = math.ceil(_DECAYS / (1.0 - max(self.multiplier, 0.0)))
        for k in range(periods):
            state, _ = self._period_of(0, state, k * self.turn, steps)
        there = np.real(np.exp(1j * order * periods * self.turn) @ orders) / self.count
        return float(np.linalg.norm(state - there)) <= _LEFT * begin


def _weights(events: Values, period: float, steps: int) -> Values:
    """Return the weights of equally spaced values of a period in a mean, (steps,).

    Where a signal may jump, at ``events``, s, either side is continued to the event from its two last values.
    """
    weights, place = np.ones(steps), events[(events > 0.0) & (events < period)] * (steps / period)
    before = np.floor(place).astype(np.int64)
    for side, first, inwards in ((place - before, before, -1), (before + 1.0 - place, before + 1, 1)):
        np.add.at(weights, first % steps, side + 0.5 * side**2 - 0.5)
        np.add.at(weights, (first + inwards) % steps, -0.5 * side**2)
    return weights


def _same(found: Response, torus: _Torus) -> bool:
    """Whether the orbit on a grid is that of a response, at the same time."""
    count = min(found.coefficients.shape[1] - 1, torus.plain_lines.shape[0] // 4)
    rows = [CASING.index(sensor) for sensor in found.sensors]
    ours, theirs = found.coefficients[:, 1 : count + 1], torus.plain_lines[1 : count + 1, rows].T
    return float(np.linalg.norm(theirs - ours)) <= _SAME_ORBIT * float(np.linalg.norm(ours))


def _response(
    found: Response, now: _Torus, before: _Torus, request: Request, *, frequency: float, names: tuple[str, ...]
) -> Response:
    """Return the response with what the effects change; errors contain what two grids differ by."""
    rows, count = [CASING.index(sensor) for sensor in found.sensors], found.coefficients.shape[1] - 1
    row, changes, coarse = rows[0], now.changes, before.changes
    power, peak = now.levels(frequency, found.bpfo, request.band)
    levels = [
        (math.sqrt(max(rms * rms + float(power[r]), 0.0)), max(highest + float(peak[r]), 0.0))
        for (rms, highest), r in zip(found.levels, rows, strict=True)
    ]
    level, highest = (max(value, _TINY) for value in levels[0])
    off_power, off_peak = (
        _STEPS * abs(float(one[row] - two[row]))
        for one, two in zip((power, peak), before.levels(frequency, found.bpfo, request.band), strict=True)
    )
    # Beyond the lines that both grids have, all is error.
    half = coarse.shape[1] // 2
    both = np.arange(1 - half, half, dtype=np.int64)
    ours, theirs = changes[:, both, row], coarse[:, both, row]
    outside = float(np.sum(np.abs(changes[:, :, row]) ** 2) - np.sum(np.abs(ours) ** 2))
    off_wave = _STEPS * math.sqrt(float(np.sum(np.abs(ours - theirs) ** 2)) + max(outside, 0.0))
    left = now.moving.left + now.plain.left + now.beyond(row)
    coefficients = found.coefficients + changes[0, : count + 1][:, rows].T
    harmonics, first = 2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1]), slice(1, HARMONICS + 1)
    errors = found.harmonics_error + 2.0 * _STEPS * np.abs(changes[0, first, row] - coarse[0, first, row])
    errors = errors + math.sqrt(2.0) * left
    waves = now.moving.waves[:, :, row]
    peak_spread = float(np.std(np.max(np.abs(waves), axis=1)))
    beside = changes[1 : len(changes) // 2 + 1][:, np.arange(-count, count + 1)]
    return replace(
        found,
        levels=tuple(levels),
        coefficients=coefficients,
        harmonics=harmonics,
        harmonics_error=errors,
        lines_error=lines_error(harmonics, errors),
        rms_error=found.rms_error + (0.5 * off_power / level + left) / level,
        waveform_error=found.waveform_error + (off_wave + left) / level,
        peak_error=found.peak_error + (off_peak + 2.0 * left + peak_spread) / highest,
        spread=float(np.std(np.sqrt(np.mean(waves**2, axis=1)))),
        added=Added(names, frequency, np.ascontiguousarray(np.moveaxis(beside, 2, 0)[rows])),
    )

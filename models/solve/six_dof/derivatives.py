"""Derivatives of a motion that repeats, of its RMS and its lines, by the parameters of rig, scene and defect.

The orbit is a fixed point of the period map, x = P(x, p): its derivative by a parameter is (I - M)^-1 dP/dp, with the
Jacobian M of the map. M, dP/dp and what they change of the waveform are carried along one period
(models.solve.six_dof.kernels.varied_period); how the arrays change that the period is made of is known in closed form,
or taken from differences of closed forms where those are smooth.

Each derivative is computed on two grids of steps that share nothing but the ends of the segments, and on finer ones
until they agree; what the last two differ by is its error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import contact_exponent, contact_forces, element_angles
from models.machine.rig import Rig
from models.solve.response import HARMONICS, Derivative, band_lines
from models.solve.six_dof.kernels import step as at
from models.solve.six_dof.kernels.orbit import SILENCE, STATE_SCALE
from models.solve.six_dof.kernels.path import fill_path, segment_bounds
from models.solve.six_dof.kernels.period import ball_period, blank_trace
from models.solve.six_dof.kernels.period_setup import add_waves, set_up, split_positions
from models.solve.six_dof.kernels.settled import lines
from models.solve.six_dof.kernels.step import STATUS_OK, StepNodes
from models.solve.six_dof.kernels.varied_period import varied_period
from models.solve.six_dof.kernels.varied_step import Varied
from models.solve.six_dof.kernels.varied_sums import S_LINES, S_POWER, Shown
from models.solve.six_dof.setup import (
    DERIVATIVES,
    OF_DEFECT,
    OF_RIG,
    defect_arrays,
    operating_point,
    rig_parameters,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.six_dof.kernels.period import Period, PeriodTrace
    from models.solve.six_dof.kernels.period_setup import OperatingPoint
    from models.words.request import Request

    Values = NDArray[np.float64]

# Places in the kernels' ``parameter``: those by which the contact force changes, what a sensor sees of it, and what
# carries the state or is moved by a force.
_PRESSING = (
    *(at.P_K_C, at.P_ALPHA, at.P_BETA, at.P_CLEARANCE, at.P_TURN, at.P_SHARE_R),
    *(at.P_LOAD_1, at.P_LOAD_2, at.P_U_1, at.P_U_2),
)
_SEEN = (at.P_DIRECTION_1, at.P_DIRECTION_2, at.P_K_R, at.P_C_R, at.P_INV_M_O, at.P_INV_M_R)
_CARRYING = (
    *(at.P_SQUARE_I, at.P_DAMPING_I, at.P_SQUARE_R, at.P_DAMPING_R, at.P_OMEGA),
    *(at.P_INV_M_I, at.P_INV_M, at.P_INV_M_O),
)

# Relative size of differences of closed forms.
_SIZE = 1e-5
# Steps of the grids over those of the grid that answered; the first two are always taken.
_GRIDS = (0.73, 1.0, 1.37, 1.93, 2.71, 3.83)
_CORRECTIONS = 4
# Of the state in its scale, between the ends of a period that repeats.
_REPEATED = 1e-10
_WORST_CONDITION = 1e12


def check_derivatives(scene: Scene, names: Sequence[str]) -> None:
    """Raise a ValueError for a name that is none of DERIVATIVES, or needs a defect that the scene does not have."""
    for name in names:
        if name not in DERIVATIVES:
            raise ValueError(f"derivatives: unknown parameter {name!r}; known are: {', '.join(DERIVATIVES)}")
        if name in OF_DEFECT and (scene.defect is None or not scene.defect.moves_balls):
            raise ValueError(f"derivatives: {name} belongs to a defect of the outer race, and there is none")


def withheld(names: Sequence[str], why: str) -> dict[str, Derivative]:
    """Return derivatives that are not known, with the reason."""
    none = np.full(HARMONICS, math.nan)
    return {name: Derivative(math.nan, none, math.nan, none, "withheld", why) for name in names}


def of_orbit(
    scene: Scene, request: Request, period: Period, state: Values, names: Sequence[str]
) -> dict[str, Derivative]:
    """Return the derivatives of an orbit, by name.

    Args:
        period, state: the grid that answered and the state at its start, (2, 6).
        names: some of DERIVATIVES.
    """
    point = operating_point(scene.healthy)._replace(parameter=period.parameter)
    grid = _Grids(scene, request, point, names)
    fewest = int(np.min(np.diff(period.first)))
    before: _Found | None = None
    found: dict[str, Derivative] = {}
    count = len(period.nodes.turn)
    for share in _GRIDS:
        now = grid.solve(period if share == 1.0 else grid.period(share * count, share * fewest), state)
        if now is None:
            return withheld(names, "the motion near the orbit leaves it on another grid of steps")
        if before is not None:
            found = {name: grid.compared(name, k, now, before) for k, name in enumerate(names)}
            if all(one.status != "inaccurate" for one in found.values()):
                break
        before, state = now, now.state
    return found


@dataclass(frozen=True, eq=False)
class _Found:
    """Derivatives on one grid.

    Attributes:
        state: of the orbit there, (2, 6).
        rms: the RMS, m/s2; harmonics: the amplitudes of lines, (HARMONICS,).
        rms_change, harmonics_change: by each parameter, (N,) and (HARMONICS, N).
        reasons: why one is not known, by its number.
    """

    state: Values
    rms: float
    harmonics: Values
    rms_change: Values
    harmonics_change: Values
    reasons: dict[int, str]


class _Grids:
    """The derivatives of one scene on grids of any number of steps."""

    def __init__(self, scene: Scene, request: Request, point: OperatingPoint, names: Sequence[str]) -> None:
        self._scene, self._request, self._point, self._names = scene, request, point, names
        self._arrays = defect_arrays(scene.bearing, scene.defects)
        self._starts, self._rows, self._touched, _ = split_positions(self._arrays[0], point)
        self._bounds = self._bounds_of(*self._arrays)
        changes = [_change_of(scene, request, point, name) for name in names]
        self._reasons = {k: one for k, one in enumerate(changes) if isinstance(one, str)}
        none = np.zeros(at.PARAMETERS)
        self._parameter = np.stack([none if isinstance(one, str) else one for one in changes] + [none], axis=1)
        self._begin: Values | None = None

    def period(self, steps: float, least: float) -> Period:
        """Return a grid of about so many steps, and so many in each segment at least."""
        return set_up(*self._arrays, self._point, math.ceil(steps) | 1, math.ceil(least) | 1, 1)

    def solve(self, period: Period, state: Values) -> _Found | None:
        """Return the derivatives on a grid, from a state near its orbit; None where the orbit is lost."""
        request, trace, after = self._request, blank_trace(period), np.empty((2, 6))
        for _ in range(_CORRECTIONS):
            if ball_period(state, after, trace, period) != STATUS_OK:
                return None
            residual = ((after - state) / STATE_SCALE).ravel()
            if self._begin is None or float(np.max(np.abs(residual))) <= _REPEATED:
                break
            state = state + (self._begin @ residual).reshape(2, 6) * STATE_SCALE
        reasons = dict(self._reasons)
        varied, shown = self._varied(period, reasons), self._shown(period, trace)
        end, columns = varied_period(state, trace, period, self._bounds, varied, shown)
        scale = np.tile(STATE_SCALE, 2)
        matrix, forced = columns[:12].T / scale[:, None], columns[12:].T / scale[:, None]
        if not (np.all(np.isfinite(columns)) and np.linalg.cond(np.eye(12) - matrix) < _WORST_CONDITION):
            return None
        self._begin = newton = np.asarray(np.linalg.inv(np.eye(12) - matrix), dtype=np.float64)
        orbit = newton @ np.column_stack((forced, (end.reshape(2, 6) - state).ravel() / scale))
        change = shown.change[:12].T @ orbit
        moved, change = change[:, -1], change[:, :-1] + shown.change[12:-1].T
        # What is left to settle is added to the state, and to what is shown.
        state = state + (orbit[:, -1] * scale).reshape(2, 6)
        value = shown.value + moved
        c = value[S_LINES:-1:2] + 1j * value[S_LINES + 1 : -1 : 2]
        dc = change[S_LINES:-1:2] + 1j * change[S_LINES + 1 : -1 : 2]
        power, power_change = value[S_POWER], change[S_POWER]
        if request.band is not None:
            power, power_change = 2.0 * float(np.sum(shown.band**2)), 4.0 * change[-1]
        rms, size = math.sqrt(max(power, 0.0)), np.abs(c)
        with np.errstate(divide="ignore", invalid="ignore"):
            lines_change = np.where(
                size[:, None] > SILENCE, 2.0 * np.real(np.conj(c)[:, None] * dc) / size[:, None], np.nan
            )
        return _Found(
            state=state,
            rms=rms,
            harmonics=2.0 * size,
            rms_change=power_change / (2.0 * rms) if rms > SILENCE else np.full(len(self._names), np.nan),
            harmonics_change=lines_change,
            reasons=reasons,
        )

    def compared(self, name: str, k: int, now: _Found, before: _Found) -> Derivative:
        """Return a derivative by what is found on two grids."""
        if k in now.reasons:
            return withheld((name,), now.reasons[k])[name]
        rms, harmonics = float(now.rms_change[k]), now.harmonics_change[:, k].copy()
        error = abs(rms - float(before.rms_change[k]))
        errors = np.abs(harmonics - before.harmonics_change[:, k])
        size = _size_of(self._scene, self._point, name)
        good = error <= self._request.accuracy * max(abs(rms), now.rms / size)
        return Derivative(rms, harmonics, error, errors, "checked" if good else "inaccurate", "")

    def _bounds_of(self, paths: Values, profile: Values) -> Values:
        paths = paths if self._touched > 0 else paths[:0]
        return segment_bounds(paths, profile, self._point.offsets, self._point.parameter[at.P_PITCH])

    def _tables(
        self, period: Period, arrays: tuple[Values, Values], bounds: Values, starts: Values
    ) -> tuple[Values, Values]:
        """Return depth and rate at the nodes, (steps, 3, D) each."""
        omega, shape = self._point.parameter[at.P_OMEGA], period.nodes.depth.shape
        nodes = StepNodes(period.nodes.turn, np.zeros(shape), np.zeros(shape), None)
        touched = self._starts[: self._touched]
        for path in arrays[0]:
            fill_path(path, arrays[1], touched, self._rows, bounds, period.first, omega, nodes.depth, nodes.rate)
        if len(self._point.waves):
            add_waves(self._point.waves, starts, bounds, period.first, omega, nodes)
        return nodes.depth, nodes.rate

    def _varied(self, period: Period, reasons: dict[int, str]) -> Varied:
        """Return how a grid changes; write why one is not known to ``reasons``."""
        count, moved = len(self._names), period.nodes.depth.shape[2]
        bounds, start = np.zeros((len(self._bounds), count + 1)), np.zeros(count + 1)
        table = np.full(count + 1, -1)
        depths: list[Values] = []
        rates: list[Values] = []
        for k, name in enumerate(self._names):
            if name == "position":
                start[k] = 1.0
            if k in reasons or moved == 0 or name not in ("speed", *OF_DEFECT):
                continue
            found = self._path_change(period, name)
            if isinstance(found, str):
                reasons[k] = found
            elif found is not None:
                bounds[:, k] = found[0]
                table[k] = len(depths)
                depths.append(found[1])
                rates.append(found[2])
        table[count] = len(depths)
        shape = (len(depths), *period.nodes.depth.shape)
        parameter, path = self._parameter, _any(bounds != 0.0)
        return Varied(
            parameter=parameter,
            presses=_any(parameter[_PRESSING, :] != 0.0) | path | (start != 0.0) | (table >= 0),
            seen=_any(parameter[_SEEN, :] != 0.0),
            carries=_any(parameter[_CARRYING, :] != 0.0) | path,
            bounds=bounds,
            start=start,
            table=table,
            depth=np.array(depths).reshape(shape),
            rate=np.array(rates).reshape(shape),
        )

    def _path_change(self, period: Period, name: str) -> tuple[Values, Values, Values] | str | None:
        """Return the change of bounds, depths and rates, why it is not known, or None where nothing changes."""
        nodes, scene, still = period.nodes, self._scene, np.zeros(len(self._bounds))
        if name == "speed":
            return still, np.zeros_like(nodes.depth), nodes.rate / scene.speed
        assert scene.defect is not None
        value, starts = float(getattr(scene.defect, name)), self._starts
        if not math.isfinite(value):
            return None
        if name == "position":
            if scene.more_defects:
                return "one of several defects moves against the others, so that the segments between them change"
            # The balls are turned instead of the defect, so that no segment moves.
            if self._arrays[1].shape[1] > 0:
                return (
                    "a rough floor lies at its place of the race, and a defect that moves uncovers another part of it"
                )
            if len(self._point.waves) == 0:
                return None
            tables = [self._tables(period, self._arrays, self._bounds, starts + side) for side in (-_SIZE, _SIZE)]
            return still, *((above - below) / (2.0 * _SIZE) for below, above in zip(*tables, strict=True))
        size = _SIZE * value
        ends: list[Values] = []
        sides: list[tuple[Values, Values]] = []
        for side in (-size, size):
            changed = replace(scene.defect, **{name: value + side})
            arrays = defect_arrays(scene.bearing, (changed, *scene.more_defects))
            ends.append(self._bounds_of(*arrays))
            if len(ends[-1]) != len(self._bounds):
                return (
                    f"kinks of the path over the defect coincide, or the floor is just reached: {name} has two slopes"
                )
            sides.append(self._tables(period, arrays, ends[-1], starts))
        below, above = sides
        return (
            (ends[1] - ends[0]) / (2.0 * size),
            (above[0] - below[0]) / (2.0 * size),
            (above[1] - below[1]) / (2.0 * size),
        )

    def _shown(self, period: Period, trace: PeriodTrace) -> Shown:
        request, sensor = self._request, 1 if self._request.sensor == "mr" else 0
        band, low = np.zeros((2, 0)), 1
        if request.band is not None:
            low, high = band_lines(kinematics(self._scene.bearing, self._scene.speed).bpfo, request.band)
            band = lines(trace, period.time, period.first, high, sensor + 1)[sensor, :, low : high + 1].copy()
            band[1] *= -1.0
        sums = S_LINES + 2 * HARMONICS + 1
        change = np.zeros((13 + len(self._names), sums))
        return Shown(sensor, HARMONICS, band, low, np.zeros(sums), change, np.zeros((2, sums)))


def _any(values: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.asarray(np.any(values, axis=0), dtype=np.bool_)


def _size_of(scene: Scene, point: OperatingPoint, name: str) -> float:
    """Return the size of a parameter, in its unit, whose change is one of the whole."""
    if name in ("position", "direction", "gravity_angle"):
        return 1.0
    if name == "clearance":
        return max(scene.clearance, math.hypot(point.parameter[at.P_U_1], point.parameter[at.P_U_2]))
    if name in ("load", "gravity"):
        rig, force = scene.rig_as(Rig), math.hypot(point.parameter[at.P_LOAD_1], point.parameter[at.P_LOAD_2])
        return force / (1.0 if name == "load" else rig.m_o + rig.m_r)
    value = _value_of(scene, name)
    return value if value > 0.0 and math.isfinite(value) else 1.0


def _value_of(scene: Scene, name: str) -> float:
    owner: object = scene.rig if name in OF_RIG else scene.defect if name in OF_DEFECT else scene
    return float(getattr(owner, name))


def _change_of(scene: Scene, request: Request, point: OperatingPoint, name: str) -> Values | str:
    """Return the derivative of the kernels' ``parameter`` array by a parameter, or why there is none."""
    parameter, rig = point.parameter, scene.rig_as(Rig)
    change, force, stiffer, wider = np.zeros(at.PARAMETERS), np.zeros(2), 0.0, 0.0
    along = np.array([math.cos(scene.gravity_angle), math.sin(scene.gravity_angle)])
    mass = rig.m_o + rig.m_r
    if name in OF_RIG:
        change = _rig_change(rig, scene.clearance, float(parameter[at.P_OMEGA]), name)
        stiffer = 1.0 if name == "k_c" else 0.0
        force = scene.gravity * along if name in ("m_o", "m_r") else force
    elif name == "load":
        force = np.array([1.0, 0.0])
    elif name == "speed":
        change[at.P_OMEGA], change[at.P_TURN] = parameter[at.P_OMEGA] / scene.speed, parameter[at.P_TURN] / scene.speed
    elif name == "clearance":
        change[at.P_CLEARANCE] = wider = 1.0
    elif name == "gravity":
        force = mass * along
    elif name == "gravity_angle":
        force = mass * scene.gravity * np.array([-along[1], along[0]])
    elif name == "direction":
        change[at.P_DIRECTION_1], change[at.P_DIRECTION_2] = -math.sin(request.direction), math.cos(request.direction)
    if force.any() or stiffer or wider:
        moved = _equilibrium_change(scene, point, force, stiffer, wider)
        if moved is None:
            return "the rings have no equilibrium under a load that holds them in both directions"
        change[at.P_LOAD_1], change[at.P_LOAD_2] = force
        change[at.P_U_1], change[at.P_U_2] = moved
    return change


def _rig_change(rig: Rig, clearance: float, omega: float, name: str) -> Values:
    values: dict[str, Any] = {field: getattr(rig, field) for field in (*OF_RIG, "cage_in_rate")}
    value = float(values[name])
    size = _SIZE * value if value > 0.0 else 1.0

    def at_value(moved: float) -> Values:
        made: Any = SimpleNamespace(**{**values, name: moved})
        return rig_parameters(made, clearance, omega)

    return (at_value(value + size) - at_value(value - size)) / (2.0 * size)


def _equilibrium_change(
    scene: Scene, point: OperatingPoint, force: Values, stiffer: float, wider: float
) -> Values | None:
    """Return the change of the static displacement, m, by a force, N, a contact stiffness and a clearance, m."""
    k_c, exponent = float(point.parameter[at.P_K_C]), contact_exponent(scene.bearing)
    u, angles = np.array([point.parameter[at.P_U_1], point.parameter[at.P_U_2]]), element_angles(scene.bearing)
    held, stiffness = contact_forces(u, angles, k_c, scene.clearance, exponent)
    normals = np.stack((np.cos(angles), np.sin(angles)))
    pressed = np.maximum(u @ normals - scene.clearance, 0.0)
    loosened = normals @ (exponent * k_c * pressed ** (exponent - 1.0))
    if not (np.trace(stiffness) > 0.0 and np.linalg.cond(stiffness) < _WORST_CONDITION):
        return None
    moved = np.linalg.solve(stiffness, force - stiffer * held / k_c + wider * loosened)
    return np.asarray(moved, dtype=np.float64)

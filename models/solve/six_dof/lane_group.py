"""Groups of scenes set up for the lane kernels: what they share (Grid) and what each of them is (Group)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import element_angles, static_equilibrium
from models.machine.rig import Rig
from models.path.defect import FloorProfile, ball_path, floor_angle, race_radius, wrap
from models.solve.six_dof.kernels import lane_paths as paths
from models.solve.six_dof.kernels import lanes as kernels
from models.solve.six_dof.kernels.lane_instants import LANES, LaneTables, Splitting
from models.solve.six_dof.kernels.lane_means import mean_squares, weigh
from models.solve.six_dof.kernels.parts import SUMS
from models.solve.six_dof.kernels.path import D_HALF, D_ROW, D_ROWS_END, DEFECT, path_kinks
from models.solve.six_dof.kernels.period import REACH
from models.solve.six_dof.kernels.step import NEAR_SLOPE
from models.solve.six_dof.setup import LANE_STEP, MIN_LANE_STEPS, defect_arrays, rig_parameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.scene import Scene, Slip

PERIODS = 7
# Places of each ball over which the mean-force rule averages.
_MEAN_FORCE_POINTS = 24
# Numbers of a step and lane for the wave, its transform, their copies and parts; bytes of all that is small.
_WAVES, _LITTLE = 36, 20_000_000
_REACH = 1.0 - 1e-9
# Kinks of a path that steps are divided at, at most.
_KINKS = 64
# Numbers in a cache line.
_LINE = 8


@dataclass(frozen=True, eq=False)
class Grid:
    """The steps of a block and everything that scenes of one bearing, rig, clearance and speed share."""

    pitch: float
    bpfo: float
    steps: int
    step: float
    cage: NDArray[np.float64]
    turn: NDArray[np.float64]
    bounds: NDArray[np.int64]
    ring: NDArray[np.float64]
    row: NDArray[np.int64]
    flow: NDArray[np.float64]
    parameter: NDArray[np.float64]
    geometry: NDArray[np.float64]

    @property
    def step_angle(self) -> float:
        """Turn of the cage in one step, rad."""
        return float(self.geometry[paths.G_OMEGA]) * self.step


def block_steps(bpfo: float, steps_per_period: int | None) -> int:
    """Return the steps of a block: at least as many as asked for, with no divisor of PERIODS, quick to transform."""
    if steps_per_period is None:
        steps_per_period = max(MIN_LANE_STEPS, math.ceil(1.0 / (bpfo * LANE_STEP)))
    steps = PERIODS * steps_per_period + 1
    while steps % PERIODS == 0 or not _is_smooth(steps):
        steps += 1
    return steps


def _is_smooth(number: int) -> bool:
    """Say whether a number has no prime factor beyond five, so that its Fourier transform is quick."""
    for factor in (2, 3, 5):
        while number % factor == 0:
            number //= factor
    return number == 1


@lru_cache(maxsize=16)
def grid_of(bearing: Bearing, rig: Rig, clearance: float, speed: float, steps_per_period: int | None) -> Grid:
    """Return the grid of one condition."""
    bpfo = kinematics(bearing, speed).bpfo
    pitch = 2.0 * math.pi / bearing.n_elements
    omega = pitch * bpfo
    steps = block_steps(bpfo, steps_per_period)
    step = PERIODS / bpfo / steps
    # Whole numbers, so that no rounding puts a step into the wrong period.
    count = PERIODS * np.arange(steps, dtype=np.int64)
    cage = np.asarray((count % steps) * (pitch / steps), dtype=np.float64)
    bounds = np.searchsorted(count // steps, np.arange(PERIODS + 1)).astype(np.int64)
    angles = cage[:, None] + omega * step * np.array([0.0, 0.5, 1.0])
    slots = bearing.rows * bearing.n_elements
    number = np.arange(slots)
    first = -(slots // 2)
    r_o, r_b = race_radius(bearing), 0.5 * bearing.element_diameter
    geometry = np.zeros(paths.GEOMETRY)
    geometry[paths.G_R_O], geometry[paths.G_R_B] = r_o, r_b
    geometry[paths.G_COS_ALPHA] = math.cos(bearing.contact_angle)
    geometry[paths.G_REACH] = math.asin(r_b / r_o) * _REACH
    geometry[paths.G_OMEGA], geometry[paths.G_STEP] = omega, step
    return Grid(
        pitch,
        bpfo,
        steps,
        step,
        cage,
        np.stack((np.cos(angles), np.sin(angles)), axis=-1),
        bounds,
        np.asarray((first + number) * (pitch / bearing.rows), dtype=np.float64),
        (first + number) % bearing.rows,
        _half_step(rig, step),
        rig_parameters(rig, clearance, omega),
        geometry,
    )


def _half_step(rig: Rig, step: float) -> NDArray[np.float64]:
    """Return the kernel's ``flow``: the step and the propagators over half of it."""
    reduced = rig.m_o * rig.m_r / (rig.m_o + rig.m_r)
    inner = _oscillator(rig.k_i / rig.m_i, rig.c_i / rig.m_i, 0.5 * step)
    resonator = _oscillator(rig.k_r / reduced, rig.c_r / reduced, 0.5 * step)
    return np.concatenate(([step], inner, [0.5 * step], resonator))


def _oscillator(omega_squared: float, damping: float, h: float) -> NDArray[np.float64]:
    """Return the propagator over a time h of x'' + damping x' + omega_squared x = 0, row by row of (x, x').

    ``kernels.step.propagators`` differs from it by rounding, which lanes of a mean force enlarge to 3e-12.
    """
    half = 0.5 * damping
    root = np.emath.sqrt(half * half - omega_squared)
    c = np.real(np.cosh(root * h))
    s = h if root == 0.0 else np.real(np.sinh(root * h) / root)
    return math.exp(-half * h) * np.array([c + half * s, s, -omega_squared * s, c - half * s])


@lru_cache(maxsize=4096)
def _equilibrium(bearing: Bearing, load: float, k_c: float, clearance: float) -> tuple[float, float]:
    u = static_equilibrium(element_angles(bearing), load, k_c, clearance=clearance)
    return float(u[0]), float(u[1])


@lru_cache(maxsize=8)
def _stacked(profiles: tuple[FloorProfile, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pieces of rough floors, shape (profiles, pieces, 4), and (profiles, 4, pieces)."""
    pieces = np.zeros((1, 4, 0))
    if len({p.coefficients.shape for p in profiles}) > 1:
        raise ValueError("rough floors that are simulated side by side need the same pitch")
    if profiles:
        pieces = np.stack([p.coefficients for p in profiles])
    # As models.solve.six_dof.kernels.path takes them: another type of array would be another kernel.
    pieces.flags.writeable = False
    return np.ascontiguousarray(pieces.transpose(0, 2, 1)) if profiles else np.zeros((1, 1, 4)), pieces


def _path_rows(scenes: Sequence[Scene], grid: Grid) -> tuple[NDArray[np.float64], tuple[FloorProfile, ...]]:
    """Return the kernel's ``path`` and the rough floors that it names."""
    rows = np.zeros((paths.PATH_ROWS, LANES))
    known: dict[FloorProfile, int] = {}
    r_o, r_b = float(grid.geometry[paths.G_R_O]), float(grid.geometry[paths.G_R_B])
    for i, scene in enumerate(scenes):
        path = ball_path(scene.bearing, scene.defect)
        if path is None:
            continue
        deepest = path.h_d
        if path.profile is not None and path.roughness > 0.0:
            rows[paths.D_ROUGHNESS, i] = path.roughness
            rows[paths.D_PROFILE, i] = known.setdefault(path.profile, len(known))
            deepest += path.roughness * path.profile.highest
        beyond = floor_angle(deepest, r_o, r_b)
        rows[paths.D_HALF, i], rows[paths.D_DEPTH, i] = path.half_width, path.h_d
        rows[paths.D_POSITION, i] = path.position
        # A floor that is never reached is never the path; a little more than the angle covers its rounding.
        rows[paths.D_BEYOND, i] = math.inf if beyond is None else beyond * (1.0 + 1e-9)
    return rows, tuple(known)


class Group:
    """LANES scenes ready to run; ``run_block`` carries all of them over PERIODS ball periods.

    ``state`` is that at the end of the last block, shape (2, 6, LANES) (models.solve.six_dof.kernels.step), ``wave``
    the acceleration of outer ring and resonator in it, shape (steps, 2, LANES), m/s2.
    """

    def __init__(
        self, grid: Grid, scenes: Sequence[Scene], slip: Slip | None, workspace: Workspace, *, instants: bool = False
    ) -> None:
        """Begin at the static equilibrium at rest, every ball in its place; one group at a time uses the workspace.

        Args:
            grid, scenes, slip, workspace: of the group.
            instants: whether steps in which contacts change, or paths have kinks, are taken in parts. Never where a
                force is averaged: contacts then change in small shares.

        Raises:
            ValueError: if the scenes damage different numbers of rows or their rough floors differ in pitch.
        """
        self.grid = grid
        self._slip_angle = 0.0 if slip is None else slip.phi_slip
        self._path, self._profiles = _path_rows(scenes, grid)
        at = self._damaged_slots(scenes)
        self._damaged_at, self._plain_at = np.flatnonzero(at), np.flatnonzero(~at)
        offsets = np.zeros(1)
        averaged = slip is not None and slip.rule == "mean_force" and slip.phi_slip > 0.0
        if slip is not None and averaged:
            offsets = slip.phi_slip * ((2.0 * np.arange(_MEAN_FORCE_POINTS) + 1.0) / _MEAN_FORCE_POINTS - 1.0)
        angles = (grid.ring[self._damaged_at][:, None] + offsets).ravel()
        self.start = np.repeat(angles[:, None], LANES, axis=1)
        share = np.full_like(self.start, 1.0 / len(offsets))
        self.damaged = aligned(np.stack((np.cos(self.start), np.sin(self.start), share), axis=1))
        plain = np.repeat(grid.ring[self._plain_at][:, None], LANES, axis=1)
        self.plain = aligned(np.stack((np.cos(plain), np.sin(plain)), axis=1))
        self.near = _near(grid, tuple(self._plain_at.tolist()), self._slip_angle)
        rest = [_equilibrium(s.bearing, s.load, s.rig_as(Rig).k_c, s.clearance) for s in scenes]
        lane = np.array([[s.load for s in scenes], [u[0] for u in rest], [u[1] for u in rest]])
        self.depth, self.rate, self.wave = workspace.arrays(grid.steps, len(angles))
        self._terms = workspace.terms
        self.tables = LaneTables(grid.turn, self.damaged, self.plain, self.depth, self.rate, lane)
        self.split = self._splitting(scenes, REACH / grid.bpfo if instants and not averaged else 0.0, workspace)
        self._slip = np.zeros((len(grid.ring), LANES))
        self.state = np.zeros((2, 6, LANES))
        self._filled = False

    def _damaged_slots(self, scenes: Sequence[Scene]) -> NDArray[np.bool_]:
        """Return which slots of the ring the defect of any lane can touch."""
        rows = {s.defect.rows for s in scenes if s.defect is not None}
        if len(rows) > 1:
            raise ValueError(f"scenes side by side must damage the same number of rows, got {sorted(rows)}")
        length = self.grid.pitch + self.grid.step_angle + 2.0 * self._slip_angle
        middle = self.grid.ring - self._slip_angle + 0.5 * length
        off = np.abs(wrap(middle[:, None] - self._path[paths.D_POSITION]))
        touches = (off - 0.5 * length < self._path[paths.D_HALF]) & (self._path[paths.D_HALF] > 0.0)
        return np.any(touches, axis=1) & (self.grid.row < max(rows, default=0))

    def _splitting(self, scenes: Sequence[Scene], reach: float, workspace: Workspace) -> Splitting:
        """Return what the kernel needs to take steps again."""
        grid = self.grid
        path, kinks = np.zeros((LANES, DEFECT)), np.full((LANES, _KINKS), np.nan)
        profiles = _stacked(self._profiles)[1]
        for i, scene in enumerate(scenes):
            array, profile = defect_arrays(scene.bearing, scene.defects)
            path[i] = array[0] if len(array) else 0.0
            # Lanes name the balls that a defect can touch: they count as those of the first row.
            path[i, D_ROW], path[i, D_ROWS_END] = 0.0, 1.0
            if reach > 0.0 and path[i, D_HALF] > 0.0:
                found = path_kinks(path[i], profile)[:_KINKS]
                kinks[i, : len(found)] = found
        # By the distance from the load of the arc that a ball passes while the angles hold.
        limit, begin = 0.5 * math.pi + math.atan(NEAR_SLOPE), grid.ring[self._plain_at] - self._slip_angle
        length = grid.pitch + grid.step_angle + 2.0 * self._slip_angle
        off = np.maximum(np.abs(wrap(begin + 0.5 * length)) - 0.5 * length, 0.0)
        return Splitting(
            reach,
            grid.cage,
            self.start,
            np.argsort(off, kind="stable"),
            int(np.count_nonzero(off <= limit)),
            path,
            profiles,
            self._path[paths.D_PROFILE].astype(np.int64),
            kinks,
            np.zeros(grid.steps, dtype=np.int64),
            workspace.changed,
            workspace.parts,
            workspace.slopes,
        )

    def mean_squares(self) -> NDArray[np.float64]:
        """Return those of ``wave`` in the last block, steps in parts included, (m/s2)^2, shape (2, LANES)."""
        out = np.empty((2, LANES))
        if self.split.reach > 0.0:
            weigh(self.wave, self.split, self.grid.step, self._terms, out)
        else:
            mean_squares(self.wave, out)
        return out

    def spectrum(self, sensor: int) -> NDArray[np.complex128]:
        """Return the Fourier sums over the steps of the last block, after ``mean_squares``, (steps // 2 + 1, LANES)."""
        if not self.split.reach > 0.0:
            return np.fft.rfft(self.wave[:, sensor], axis=0)
        values, means, moments, slopes = np.fft.rfft(self._terms[:, :, sensor], axis=1)
        # By half of which angle each line turns in a step. Within it a part is taken for a line.
        x = math.pi * np.arange(len(values))[:, None] / self.grid.steps
        even, odd = np.ones_like(x), np.ones_like(x)
        even[1:] = np.sin(x[1:]) / x[1:]
        odd[1:] = 3.0 * (even[1:] - np.cos(x[1:])) / x[1:] ** 2
        turn = 2j * x / self.grid.step
        return values + np.exp(-1j * x) * (even * means - turn * odd * moments) + turn * slopes

    def run_block(self, draws: NDArray[np.float64] | None = None) -> int:
        """Simulate PERIODS ball periods; return the kernel's status.

        ``draws`` are the slip angles of the balls that pass the point opposite to the load, rad, shape (PERIODS, rows
        of the bearing, LANES), or None without slip.
        """
        if draws is None:
            if not self._filled:
                self._fill(0, self.grid.steps)
                self._filled = True
            return self._advance(0, self.grid.steps)
        status = 0
        for period, angles in enumerate(draws):
            paths.redraw(
                np.ascontiguousarray(angles),
                self._slip,
                self.grid.ring,
                self._damaged_at,
                self._plain_at,
                self.start,
                self.damaged,
                self.plain,
            )
            begin, end = int(self.grid.bounds[period]), int(self.grid.bounds[period + 1])
            self._fill(begin, end)
            status = max(status, self._advance(begin, end))
        return status

    def _fill(self, begin: int, end: int) -> None:
        g = self.grid
        profiles = _stacked(self._profiles)[0]
        paths.fill(begin, end, g.cage, self.start, self._path, profiles, g.geometry, self.depth, self.rate)
        if self.split.reach > 0.0:
            paths.mark_kinks(begin, end, g.bounds, g.step_angle, self.split)

    def _advance(self, begin: int, end: int) -> int:
        g = self.grid
        return kernels.advance(
            begin,
            end,
            self.near,
            g.flow,
            g.parameter,
            self.tables,
            self.split,
            self.state.reshape(12, LANES),
            self.wave,
        )


def aligned_empty(size: int) -> NDArray[np.float64]:
    """Return an array that begins on a cache line, so that no vector is spread over two of them."""
    raw = np.empty(size + _LINE)
    offset = -(raw.ctypes.data // raw.itemsize) % _LINE
    return raw[offset : offset + size]


def aligned(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a copy that begins on a cache line."""
    copy = aligned_empty(values.size).reshape(values.shape)
    copy[...] = values
    return copy


class Workspace:
    """The large arrays of a group, reused from group to group: fresh memory costs more than a block."""

    def __init__(self) -> None:
        """Allocate nothing yet; see ``arrays``, and models.solve.six_dof.kernels.lane_instants."""
        self._tables = np.empty(0)
        self._wave = np.empty(0)
        self.terms = np.empty(0)
        self.changed = np.empty((0, LANES), dtype=np.bool_)
        self.parts, self.slopes = np.empty(0), np.empty(0)

    def arrays(self, steps: int, slots: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return ``depth`` and ``rate`` of shape (steps, 3, slots, LANES) and ``wave`` of shape (steps, 2, LANES)."""
        size = steps * 3 * slots * LANES
        if self._tables.size < 2 * size:
            self._tables = aligned_empty(2 * size)
        if self._wave.size != steps * 2 * LANES:
            self._wave = aligned_empty(steps * 2 * LANES)
            self.terms = np.empty((4, steps, 2, LANES))
            self.changed = np.zeros((steps, LANES), dtype=np.bool_)
            self.parts, self.slopes = np.empty((steps, LANES, SUMS)), np.empty((steps, LANES, 2, 2))
        shape = (steps, 3, slots, LANES)
        depth, rate = self._tables[:size].reshape(shape), self._tables[size : 2 * size].reshape(shape)
        return depth, rate, self._wave.reshape(steps, 2, LANES)


def group_bytes(
    bearing: Bearing, speed: float, damage: tuple[float, int], slip: Slip | None, steps_per_period: int | None
) -> int:
    """Return the bytes that a group of scenes needs at most, beside the program.

    Args:
        bearing: of all scenes.
        speed: Hz.
        damage: extent of the widest defect, rad, and the damaged rows.
        slip: of the balls.
        steps_per_period: as in ``grid_of``.
    """
    extent, rows = damage
    pitch, angle = 2.0 * math.pi / bearing.n_elements, 0.0 if slip is None else slip.phi_slip
    touched = rows * min(bearing.n_elements, int((extent + 2.0 * angle) / pitch) + 3)
    slots = touched * (_MEAN_FORCE_POINTS if slip is not None and slip.rule == "mean_force" else 1)
    numbers = block_steps(kinematics(bearing, speed).bpfo, steps_per_period) * LANES * (6 * slots + _WAVES)
    return 8 * numbers + _LITTLE


@lru_cache(maxsize=64)
def _near(grid: Grid, plain_at: tuple[int, ...], slip_angle: float) -> NDArray[np.int64]:
    """Return the kernel's ``near``: the range of plain slots that lie close enough to the load, for every step."""
    limit = 0.5 * math.pi + kernels.NEAR_ANGLE + slip_angle
    plain = grid.ring[list(plain_at)]
    if grid.pitch + grid.step_angle + limit > math.pi:
        # A ball could come round to the near side within a period.
        return np.repeat(np.array([[0, len(plain)]]), grid.steps, axis=0)
    first = np.searchsorted(plain, -limit - grid.cage - grid.step_angle, side="left")
    last = np.searchsorted(plain, limit - grid.cage, side="right")
    return np.ascontiguousarray(np.stack((first, np.maximum(first, last)), axis=1).astype(np.int64))

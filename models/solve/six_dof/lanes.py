"""Many scenes at once, with or without slip: the six-degree-of-freedom model simulated in time, one scene per lane.

Scenes of one bearing, rig, clearance and speed that differ in load and damage are integrated side by side in groups
of LANES (models/solve/six_dof/kernels/lanes.py). Time is cut into blocks of PERIODS ball periods, each of the same
number of equal steps, which is no multiple of PERIODS: so every kink of the path is met at PERIODS places within a step
and the errors of the steps average out. Without slip, blocks are simulated until the RMS no longer changes from block
to block; with slip, a fixed number of blocks, whose scatter gives a standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.rig import Rig
from models.solve.response import HARMONICS
from models.solve.six_dof.kernels.lanes import LANES
from models.solve.six_dof.lane_group import PERIODS, Grid, Group, Workspace, block_steps, grid_of, group_bytes
from models.solve.six_dof.setup import LANE_EFFECTS, check_scene
from models.words.request import check_band
from models.work.runner import SERIAL
from models.work.task import Work

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene, Slip
    from models.work.runner import Runner

DEFAULT_TOLERANCE = 1e-3

# Of a scene, for each step of a block; blocks that motions take to settle; roughly.
STEP_SECONDS, _USUAL_BLOCKS = 1.6e-7, 10
# Steps in a ball period from which on instants are found: the errors of RMS and of lines (over the largest) are then
# 2e-4; in whole steps 6e-4 and 1e-3 (benchmarks/six_dof.py).
INSTANTS_FROM = 256
# With slip: blocks before the measurement begins.
_SETTLING_BLOCKS = 2
# A smaller vibration counts as zero, m/s2.
_SILENCE = 1e-9


@dataclass(frozen=True)
class LaneOptions:
    """Settings of the simulation of a batch.

    Attributes:
        steps_per_period: minimum number of steps in a ball period; by default 256, and steps of at most 20 us.
        tolerance: relative change of the RMS from block to block at which the motion counts as settled.
        max_blocks: limit of simulated blocks where the motion repeats, at least 3.
        slip_blocks: blocks that are measured where it does not, at least 2.
        band: frequencies (lo, hi), Hz, in which the RMS is taken; None is the full bandwidth.
        instants: whether a step is taken in parts in the lanes whose contacts change in it, or whose path has a kink
            there: of fourth order, at three to five times the cost of a step. None stands for grids on which that is
            cheaper than smaller steps, of at least INSTANTS_FROM in a ball period; on coarser ones the error is that of
            the smooth motion.
    """

    steps_per_period: int | None = None
    tolerance: float = DEFAULT_TOLERANCE
    max_blocks: int = 40
    slip_blocks: int = 10
    band: tuple[float, float] | None = None
    instants: bool | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        if self.steps_per_period is not None and self.steps_per_period < 8:
            raise ValueError(f"steps_per_period must be at least 8, got {self.steps_per_period!r}")
        if not self.tolerance > 0.0:
            raise ValueError(f"tolerance must be positive, got {self.tolerance!r}")
        if self.max_blocks < 3 or self.slip_blocks < 2:
            raise ValueError(
                f"max_blocks must be at least 3 and slip_blocks 2, got {self.max_blocks!r} and {self.slip_blocks!r}"
            )
        if self.band is not None:
            check_band(self.band)

    def takes_instants(self, grid: Grid) -> bool:
        """Return whether steps are taken in parts on a grid."""
        return grid.steps >= PERIODS * INSTANTS_FROM if self.instants is None else self.instants


@dataclass(frozen=True, eq=False)
class LaneResponse:
    """The vibration of n scenes along the load, SI units.

    Attributes:
        rms, rms_resonator: RMS of a_o and of a_r in the band of the options, m/s2, shape (n,).
        rms_se: standard error of ``rms``, m/s2: zero where the motion repeats, else from the scatter of the blocks.
        harmonics: single-sided amplitudes of the lines 1..6 of BPFO in spectra of PERIODS periods of a_o, m/s2, shape
            (n, 6); of several blocks the powers are averaged.
        block_change: relative change of the full-bandwidth RMS between the last two blocks, shape (n,).
        status: index into STATUSES, int8, shape (n,): whether blocks no longer change. It says nothing of the error of
            the steps (models.maps.ensemble.step_error measures it); with slip the motion is "not_periodic" by its
            nature.
        periods: ball periods simulated for each scene, shape (n,).
        bpfo: Hz.
    """

    rms: NDArray[np.float64]
    rms_se: NDArray[np.float64]
    rms_resonator: NDArray[np.float64]
    harmonics: NDArray[np.float64]
    block_change: NDArray[np.float64]
    status: NDArray[np.int8]
    periods: NDArray[np.int64]
    bpfo: float


@dataclass(frozen=True, eq=False)
class _Block:
    """Mean squares of one block: full bandwidth of a_o (n,), in the band (2, n), and of the lines (HARMONICS, n)."""

    full: NDArray[np.float64]
    power: NDArray[np.float64]
    lines: NDArray[np.float64]


def _measure(group: Group, band: tuple[float, float] | None) -> _Block:
    """Return the mean squares of a block."""
    grid, count, full = group.grid, group.grid.steps, group.mean_squares()
    # Coefficients at multiples of bpfo / PERIODS; every seventh is a line.
    spectrum = group.spectrum(0)
    # A real sine of amplitude a has |c| = a count / 2 and the mean square a^2 / 2.
    lines = 2.0 * np.abs(spectrum[PERIODS : PERIODS * HARMONICS + 1 : PERIODS]) ** 2 / count**2
    if band is None:
        return _Block(full[0], full, lines)
    low = max(1, int(np.ceil(band[0] / grid.bpfo * PERIODS - 1e-9)))
    high = int(np.floor(band[1] / grid.bpfo * PERIODS + 1e-9))
    both = (spectrum, group.spectrum(1))
    power = [2.0 * np.sum(np.abs(s[low : high + 1]) ** 2, axis=0) / count**2 for s in both]
    return _Block(full[0], np.array(power), lines)


class LaneRunner:
    """Simulates groups of scenes one after the other in this process and reuses its memory."""

    def __init__(self, options: LaneOptions | None = None) -> None:
        """Take the options that hold for all groups."""
        self.options = LaneOptions() if options is None else options
        self._workspace = Workspace()

    def run(self, scenes: Sequence[Scene], number: int = 0) -> LaneResponse:
        """Return the vibration of up to LANES scenes.

        Args:
            scenes: they share bearing, rig, clearance, speed, slip and the number of damaged rows.
            number: number of the group; with slip, groups of different numbers draw different angles.

        Raises:
            ValueError: if there are none or too many, or they differ in a field that must be equal.
        """
        if not 1 <= len(scenes) <= LANES:
            raise ValueError(f"a group holds 1 to {LANES} scenes, got {len(scenes)}")
        grid = shared_grid(scenes, self.options)
        # Unused lanes repeat the last scene.
        padded = [*scenes, *[scenes[-1]] * (LANES - len(scenes))]
        slip = scenes[0].slip
        group = Group(grid, padded, slip, self._workspace, instants=self.options.takes_instants(grid))
        if slip is not None and slip.redraws:
            blocks, settled = self._random(group, slip, number), False
        else:
            blocks, settled = self._periodic(group), True
        return _response(blocks, grid, self.options, len(scenes), settled=settled)

    def _periodic(self, group: Group) -> list[_Block]:
        """Return blocks until none of the lanes changes any more; what they passed through is left out."""
        blocks: list[_Block] = []
        for _ in range(self.options.max_blocks):
            group.run_block()
            blocks.append(_measure(group, self.options.band))
            if len(blocks) >= 3 and np.all(_change(blocks) < self.options.tolerance):
                break
        return blocks

    def _random(self, group: Group, slip: Slip, number: int) -> list[_Block]:
        rng = np.random.default_rng([slip.seed, number])
        shape = (PERIODS, int(group.grid.row.max()) + 1, LANES)
        blocks: list[_Block] = []
        for n in range(_SETTLING_BLOCKS + self.options.slip_blocks):
            group.run_block(rng.uniform(-slip.phi_slip, slip.phi_slip, shape))
            if n >= _SETTLING_BLOCKS:
                blocks.append(_measure(group, self.options.band))
        return blocks


def _change(blocks: list[_Block]) -> NDArray[np.float64]:
    """Return the relative change of the RMS between the last two blocks."""
    now, before = np.sqrt(blocks[-1].full), np.sqrt(blocks[-2].full)
    return np.where(np.maximum(now, before) <= _SILENCE, 0.0, np.abs(now - before) / np.maximum(now, _SILENCE))


def _response(blocks: list[_Block], grid: Grid, options: LaneOptions, lanes: int, *, settled: bool) -> LaneResponse:
    """Return the response of the first ``lanes`` lanes."""
    change = _change(blocks)
    finite = np.isfinite(blocks[-1].full)
    converged = finite & (change < options.tolerance) & settled
    # Where the motion does not repeat, the later half of the blocks is averaged: the earlier one may still settle.
    kept = blocks if not settled else blocks[len(blocks) // 2 :]
    power = np.array([b.power for b in kept])
    mean = np.where(converged, blocks[-1].power, power.mean(axis=0))
    lines = np.where(converged, blocks[-1].lines, np.mean([b.lines for b in kept], axis=0))
    error = np.std(power[:, 0], axis=0, ddof=1) / np.sqrt(len(kept)) if len(kept) > 1 else np.zeros(LANES)
    rms = np.sqrt(mean)
    # The error of a root is half that of its square, relatively.
    rms_se = np.where(converged, 0.0, 0.5 * error / np.maximum(rms[0], _SILENCE))
    status = np.where(converged, 0, np.where(finite, 1, 2)).astype(np.int8)
    simulated = PERIODS * (len(blocks) + (0 if settled else _SETTLING_BLOCKS))
    return LaneResponse(
        rms=rms[0, :lanes],
        rms_se=rms_se[:lanes],
        rms_resonator=rms[1, :lanes],
        harmonics=np.ascontiguousarray(np.sqrt(2.0 * lines).T[:lanes]),
        block_change=change[:lanes],
        status=status[:lanes],
        periods=np.full(lanes, simulated, dtype=np.int64),
        bpfo=grid.bpfo,
    )


def shared_grid(scenes: Sequence[Scene], options: LaneOptions) -> Grid:
    """Return the grid of scenes, once it is certain that they can share one.

    Raises:
        ValueError: naming what they do not share, or what the lanes do not model.
    """
    first = scenes[0]
    for scene in scenes:
        check_scene(scene, LANE_EFFECTS)
        for name in ("bearing", "rig", "clearance", "speed", "slip"):
            if getattr(scene, name) != getattr(first, name):
                raise ValueError(
                    f"scenes side by side must share {name}, got {getattr(first, name)!r} and {getattr(scene, name)!r}"
                )
    grid = grid_of(first.bearing, first.rig_as(Rig), first.clearance, first.speed, options.steps_per_period)
    nyquist = 0.5 / grid.step
    if options.band is not None and options.band[1] > nyquist:
        raise ValueError(f"the band ends at {options.band[1]!r} Hz, the steps resolve up to {nyquist:.0f} Hz")
    return grid


_Scenes = tuple[int, tuple["Scene", ...]]


def _run(options: LaneOptions, group: _Scenes) -> LaneResponse:
    number, scenes = group
    return LaneRunner(options).run(scenes, number)


_GROUPS = Work("groups of scenes", _run, memory=0)


def _work(scenes: Sequence[Scene], options: LaneOptions, groups: int) -> Work[LaneOptions, _Scenes, LaneResponse]:
    first = scenes[0]
    defects = [scene.defect for scene in scenes if scene.defect is not None]
    damage = max((d.dphi_d for d in defects), default=0.0), max((d.rows for d in defects), default=1)
    memory = group_bytes(first.bearing, first.speed, damage, first.slip, options.steps_per_period)
    blocks = _SETTLING_BLOCKS + options.slip_blocks if first.slip is not None else _USUAL_BLOCKS
    steps = blocks * block_steps(kinematics(first.bearing, first.speed).bpfo, options.steps_per_period)
    return replace(_GROUPS, memory=memory).sized(STEP_SECONDS * LANES * steps, groups)


def simulate_lanes(
    scenes: Sequence[Scene], options: LaneOptions | None = None, *, runner: Runner = SERIAL
) -> LaneResponse:
    """Return the vibration of any number of scenes of one bearing, rig, clearance, speed and slip.

    Args:
        scenes: at least one; they may differ in load and defect. Scenes of similar extent beside each other are
            fastest, because the kernel's tables span the widest defect of a group.
        runner: runs groups of LANES scenes. The result does not depend on it.

    Raises:
        ValueError: if a scene is outside the model or differs in a field that must be equal; the message names it.
    """
    options = LaneOptions() if options is None else options
    if len(scenes) == 0:
        raise ValueError("simulate_lanes needs at least one scene")
    groups = [(i // LANES, tuple(scenes[i : i + LANES])) for i in range(0, len(scenes), LANES)]
    found = list(runner.run(_work(scenes, options, len(groups)), options, groups))
    names = ("rms", "rms_se", "rms_resonator", "harmonics", "block_change", "status", "periods")
    merged = {name: np.concatenate([getattr(r, name) for r in found]) for name in names}
    return LaneResponse(**merged, bpfo=found[0].bpfo)


def warm() -> None:
    """Compile the kernels: one scene with slip, with steps in parts and without."""
    from models.machine.scene import Defect, Scene, Slip

    scene = Scene(40.0, 4000.0, defect=Defect(dphi_d=0.1, h_d=1e-5), slip=Slip(0.01))
    for instants in (True, False):
        simulate_lanes([scene], LaneOptions(slip_blocks=2, instants=instants))

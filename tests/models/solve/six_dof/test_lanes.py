"""The lane kernel against the one-scene solver and independent integrations; its vectors, its shortcuts, and slip."""

from __future__ import annotations

import math
import platform
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, cast

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Slip
from models.path.defect import ball_path
from models.solve.response import STATUSES
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.lane_instants import LANES
from models.solve.six_dof.kernels.lanes import advance
from models.solve.six_dof.kernels.period import Period, blank_trace
from models.solve.six_dof.kernels.step import P_CLEARANCE, P_LOAD_1, P_U_1, P_U_2, Balls, StepNodes
from models.solve.six_dof.lane_group import PERIODS, Group, Workspace, block_steps, grid_of
from models.solve.six_dof.lanes import LaneOptions, LaneRunner, simulate_lanes
from reference.periodic.settle import simulate_oracle
from reference.periods import period_of, run
from tests.oracles.lanes_oracle import SlipOracle
from tests.oracles.six_dof_oracle import Case
from tests.support.effort import effort_count
from tests.support.orders import OPENING, relative, slope
from tests.support.periodic_oracle import thesis_scene

SEED = 17
SCENE = Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6))


def map_scenes(count: int, seed: int = SEED) -> list[Scene]:
    """Return scenes over the range of a map: half of them localised, half of them rough, 1 to 5 kN."""
    rng = np.random.default_rng(seed)
    scenes = []
    for i in range(count):
        extent = rng.uniform(1.0, 50.0) if i % 2 else rng.uniform(1.0, 15.0)
        floor = Floor("rough" if i % 4 > 1 else "smooth", seed=i)
        scenes.append(
            Scene(
                40.0, rng.uniform(1000.0, 5000.0), defect=Defect(math.radians(extent), rng.uniform(1e-6, 32e-6), floor)
            )
        )
    return scenes


def new_group(
    scenes: list[Scene], steps_per_period: int, slip: Slip | None = None, *, clearance: float | None = None
) -> Group:
    """Return a group that finds instants; another clearance holds for contacts, not for the equilibrium."""
    first = scenes[0]
    grid = grid_of(first.bearing, first.rig_as(Rig), first.clearance, first.speed, steps_per_period)
    if clearance is not None:
        parameter = grid.parameter.copy()
        parameter[P_CLEARANCE] = clearance
        grid = replace(grid, parameter=parameter)
    return Group(grid, [*scenes, *[scenes[-1]] * (LANES - len(scenes))], slip, Workspace(), instants=True)


def test_against_the_one_scene_solver() -> None:
    scenes = map_scenes(effort_count(quick=16, full=256))
    fine = [simulate(s, steps_per_period=2048, tolerance=1e-7) for s in scenes]
    truth = np.array([r.rms for r in fine])
    found = simulate_lanes(scenes)
    error = found.rms / truth - 1.0
    assert np.sqrt(np.mean(error**2)) < 5e-4
    assert np.abs(error).max() < 1e-3
    lines = np.array([r.harmonics for r in fine])
    assert np.abs(found.harmonics - lines).max() < 1e-3 * truth.max()
    resonator = np.array([r.levels_of("mr")[0] for r in fine])
    assert np.abs(found.rms_resonator / resonator - 1.0).max() < 2e-3
    assert all(STATUSES[s] == "converged" for s in found.status)
    assert np.all(found.rms_se == 0.0)


@pytest.mark.parametrize("rows", [1, 2])
def test_against_the_oracle(rows: int) -> None:
    defect = replace(SCENE.defect or Defect(0.0, 0.0), rows=rows)
    truth = simulate_oracle(replace(thesis_scene(40.0, 4000.0, 20.0, defect.h_d), rows=rows), estimate=False)
    assert truth.status == "settled"
    found = simulate_lanes([replace(SCENE, defect=defect)]).rms[0]
    assert found == pytest.approx(truth.rms, rel=2e-3)


def test_smaller_steps_are_more_accurate() -> None:
    scenes = map_scenes(LANES)
    truth = simulate_lanes(scenes, LaneOptions(steps_per_period=2048, tolerance=1e-6)).rms
    errors = []
    for steps in (128, 256, 512):
        rms = simulate_lanes(scenes, LaneOptions(steps_per_period=steps, tolerance=1e-6)).rms
        errors.append(np.sqrt(np.mean((rms / truth - 1.0) ** 2)))
    assert errors[0] > 2.0 * errors[1] > 2.0 * errors[2]


def test_the_middle_slope_that_keeps_the_change_of_depth_pays() -> None:
    scenes = map_scenes(LANES)
    truth = simulate_lanes(scenes, LaneOptions(steps_per_period=2048)).rms
    errors = {}
    for mended in (True, False):
        group = new_group(scenes, 192)
        group.split = group.split._replace(reach=0.0)
        group.run_block()
        if not mended:
            path = [ball_path(s.bearing, s.defect) for s in scenes]
            angles = group.grid.cage[:, None] + 0.5 * group.grid.step_angle + group.start[:, 0]
            for i, p in enumerate(path):
                assert p is not None
                group.rate[:, 1, :, i] = 2.0 * math.pi / 12 * group.grid.bpfo * p(angles)[1]
        for _ in range(4):
            group.run_block()
        errors[mended] = np.sqrt(np.mean((np.sqrt(np.mean(group.wave[:, 0] ** 2, axis=0)) / truth - 1.0) ** 2))
    assert errors[True] < 0.5 * errors[False]


@pytest.mark.parametrize("kind", ["smooth", "rough"])
def test_tables_hold_the_path(kind: Literal["smooth", "rough"]) -> None:
    scenes = [replace(s, defect=replace(s.defect or Defect(0, 0), floor=Floor(kind))) for s in map_scenes(LANES)]
    group = new_group(scenes, 64)
    group.run_block()
    grid = group.grid
    omega = 2.0 * math.pi / 12 * grid.bpfo
    angles = grid.cage[:, None, None] + grid.step_angle * np.array([0.0, 0.5, 1.0])[:, None] + group.start[:, 0]
    for i, scene in enumerate(scenes):
        path = ball_path(scene.bearing, scene.defect)
        assert path is not None
        depth, slope = path(angles)
        assert group.depth[..., i] == pytest.approx(depth, abs=1e-13)
        ends = group.rate[..., i][:, [0, 2]]
        # At a kink one of both slopes is as good as the other; a few places may fall on one to rounding.
        assert np.mean(np.abs(ends - omega * slope[:, [0, 2]]) > 1e-7) < 5e-3
    change = (group.rate[:, 0] + 4.0 * group.rate[:, 1] + group.rate[:, 2]) * grid.step / 6.0
    assert change == pytest.approx(group.depth[:, 2] - group.depth[:, 0], abs=1e-15)


@settings(max_examples=effort_count(quick=4, full=20))
@given(st.integers(0, 10_000), st.integers(0, LANES - 1))
def test_a_lane_does_not_depend_on_its_neighbours(seed: int, place: int) -> None:
    options = LaneOptions(steps_per_period=96)
    scenes = map_scenes(LANES, seed)
    alone, among = (LaneRunner(options).run(s) for s in ([scenes[place]], scenes))
    # They may stop after different numbers of blocks; what is left of the settling is below the tolerance.
    assert alone.rms[0] == pytest.approx(among.rms[place], rel=1e-3)


def test_balls_left_out_could_not_have_touched() -> None:
    waves = []
    for everywhere in (False, True):
        group = new_group(map_scenes(LANES), 128)
        if everywhere:
            group.near = np.repeat(np.array([[0, len(group.plain)]]), group.grid.steps, axis=0)
        group.run_block()
        waves.append(group.wave.copy())
    assert waves[0] == pytest.approx(waves[1], rel=1e-9, abs=1e-9)


def compiled_code() -> str:
    dispatcher: Any = advance
    anew = numba.njit(nogil=True, fastmath=dispatcher.targetoptions["fastmath"])(dispatcher.py_func)
    group, vector, number = new_group([SCENE], 32), numba.float64[::1], numba.int64
    tables, split = (numba.typeof(x) for x in (group.tables, group.split))
    matrix, wave = numba.float64[:, ::1], numba.float64[:, :, ::1]
    anew.compile((number, number, numba.int64[:, ::1], vector, vector, tables, split, matrix, wave))
    return "\n".join(anew.inspect_asm().values())


def test_vector_instructions() -> None:
    flags = Path("/proc/cpuinfo")
    if platform.machine() != "x86_64" or not flags.exists() or " avx2 " not in flags.read_text(encoding="utf-8"):
        pytest.skip("no AVX2 on this machine")
    if effort_count(quick=0, full=1) == 0:
        pytest.skip("compiles a kernel for four seconds; SPALLWATCH_EFFORT=full runs it")
    # The machine code of a kernel that came from the cache cannot be read: compile it anew.
    code = compiled_code()
    assert len(re.findall(r"vsqrtpd\s[^\n]*[yz]mm", code)) > len(re.findall(r"vsqrtsd", code))


@pytest.mark.parametrize("scene", [Scene(40.0, 0.0), Scene(40.0, 0.0, clearance=10e-6), Scene(40.0, 2000.0)])
def test_healthy_scenes_are_as_quiet_as_they_are(scene: Scene) -> None:
    found = simulate_lanes([scene])
    assert STATUSES[found.status[0]] == "converged"
    assert found.rms[0] == pytest.approx(simulate(scene).rms, rel=1e-3, abs=1e-9)


def test_clearance_and_light_load() -> None:
    scenes = [replace(SCENE, load=load, clearance=10e-6) for load in (20.0, 100.0, 400.0, 4000.0)]
    found = simulate_lanes(scenes, LaneOptions(tolerance=1e-4))
    for scene, rms, status in zip(scenes, found.rms, found.status, strict=True):
        other = simulate(scene)
        assert STATUSES[status] in ("converged", "not_periodic")
        if other.status == "converged" and STATUSES[status] == "converged":
            assert rms == pytest.approx(other.rms, rel=5e-3)


def test_band_limits_the_rms() -> None:
    band = (0.0, 9500.0)
    found = simulate_lanes([SCENE], LaneOptions(band=band))
    assert found.rms[0] == pytest.approx(simulate(SCENE, band=band).rms, rel=3e-3)


def as_one_scene(group: Group, lane: int) -> Period:
    """Return the block of a lane as a period of the kernels of one scene, on the same steps and tables."""
    grid, tables, steps = group.grid, group.tables, group.grid.steps
    parameter = grid.parameter.copy()
    parameter[[P_LOAD_1, P_U_1, P_U_2]] = tables.lane[:, lane]
    bits = 2.0 ** np.arange(len(grid.ring))
    count = len(tables.damaged)
    moved, plain = (
        np.array((x[:, 0, lane], x[:, 1, lane], b), dtype=np.float64)
        for x, b in ((tables.damaged, bits[:count]), (tables.plain, bits[count:]))
    )
    nodes = StepNodes(
        *(grid.turn, np.ascontiguousarray(tables.depth[..., lane]), np.ascontiguousarray(tables.rate[..., lane])), None
    )
    # The last time is the ball period's, of which the reach of an instant is a share.
    time = np.linspace(0.0, 1.0 / grid.bpfo, steps + 1)
    balls = Balls(moved, plain, count, plain.shape[1], 0.5)
    return Period(parameter, balls, nodes, np.array([0, steps]), grid.flow[None], time, np.ones(steps + 1) / steps)


def test_a_lane_is_as_the_kernels_of_one_scene() -> None:
    """Two blocks from rest on the same steps; kinks are no ends of steps there, and so are left out here.

    There, steps that are left alone between two in parts are taken in parts as well.
    """
    rng = np.random.default_rng(SEED)
    loads, extents = np.exp(rng.uniform(4.0, 8.0, LANES)), np.radians(rng.uniform(1.0, 20.0, LANES))
    scenes = [
        Scene(40.0, load, clearance=5e-6, defect=Defect(extent, 50e-6))
        for load, extent in zip(loads.tolist(), extents.tolist(), strict=True)
    ]
    group = new_group(scenes, 128)
    group.split.kinks[:] = np.nan
    states = [np.zeros((2, 6))] * LANES
    for _ in range(2):
        group.run_block()
        for i in range(LANES):
            period = as_one_scene(group, i)
            trace = blank_trace(period)
            states[i] = run(period, states[i], trace)
            changed = group.split.changed[:, i]
            alone = trace.changed & ~changed
            assert np.any(changed)
            assert np.all(trace.changed[changed])
            assert np.all(changed[np.flatnonzero(alone[1:-1]) + 2])
            wave = group.wave[:, :, i]
            assert wave == pytest.approx(trace.wave[:-1], rel=1e-9, abs=1e-9 * np.abs(trace.wave).max())
            # Shares of a period there.
            parts, true = group.split.parts[changed, i] * group.grid.bpfo, trace.parts[changed]
            for k in range(6):
                assert parts[:, k] == pytest.approx(true[:, k], rel=1e-9, abs=1e-9 * np.abs(true[:, k]).max())
            assert group.state[:, :, i] == pytest.approx(states[i], rel=1e-9, abs=1e-15)


ORDERS = {
    "none": (Scene(40.0, 4000.0, from_catalogue("6205")), -2e-5, 192),
    "two": (Scene(40.0, 4000.0, from_catalogue("6205")), None, 192),
    "six": (OPENING["pit"], None, 256),
}


@pytest.mark.parametrize("name", list(ORDERS))
def test_order_whatever_the_number_of_instants(name: str) -> None:
    """Velocities after seven periods from rest against the kernels of one scene."""
    scene, clearance, coarsest = ORDERS[name]
    period = period_of(scene, 32 * coarsest)
    if clearance is not None:
        # All balls touch.
        parameter, balls = period.parameter.copy(), period.balls
        parameter[P_CLEARANCE] = clearance
        period = period._replace(parameter=parameter, balls=balls._replace(near=balls.plain.shape[1]))
    state, trace = np.zeros((2, 6)), blank_trace(period)
    for _ in range(PERIODS):
        state = run(period, state, trace)
    errors = []
    for fold in (1, 2, 4):
        group = new_group([scene], fold * coarsest, clearance=clearance)
        if clearance is not None:
            group.near = np.repeat(np.array([[0, len(group.plain)]]), group.grid.steps, axis=0)
            group.split = group.split._replace(near=len(group.plain))
        group.run_block()
        errors.append(relative(group.state[:, 1::2, 0], state[:, 1::2]))
    assert 3.4 < slope(errors) < 6.0
    assert errors[-1] < 5e-6


@pytest.mark.parametrize("name", ["pit", "spall"])
def test_levels_and_lines_of_settled_lanes(name: str) -> None:
    """Against the solver of one scene; the order of both is in test_order.py."""
    scene = OPENING[name]
    true = simulate(scene, accuracy=1e-7, quantity="lines")
    found = simulate_lanes([scene], LaneOptions(steps_per_period=512, tolerance=1e-9))
    assert found.rms[0] == pytest.approx(true.rms, rel=5e-5)
    assert found.harmonics[0] == pytest.approx(true.harmonics, abs=5e-5 * true.harmonics.max())


def test_order_of_forty_instants_a_period() -> None:
    """Velocities after a quarter of a block, in which small differences do not grow as much as in a whole one."""
    slack = replace(Rig(), alpha_c=0.01 * Rig().alpha_c, beta_c=0.01 * Rig().beta_c)
    scene = Scene(3.0, 10.0, rig=slack, defect=OPENING["pit"].defect, clearance=20e-6)
    period = period_of(scene, 16384)
    state, trace = np.zeros((2, 6)), blank_trace(period)
    for _ in range(2):
        state = run(period, state, trace)
    assert 40 <= trace.instants.sum() <= 50
    found = []
    for steps in (1024, 2048, 4096, 16384):
        group = new_group([scene], steps)
        group._fill(0, int(group.grid.bounds[2]))
        group._advance(0, group.grid.steps // 4)
        found.append(group.state[:, 1::2, 0].copy())
    assert 3.1 < slope([relative(f, found[-1]) for f in found[:-1]]) < 6.0


def test_slip_against_the_oracle() -> None:
    rng = np.random.default_rng(SEED)
    slip = Slip(0.02)
    draws = rng.uniform(-slip.phi_slip, slip.phi_slip, (PERIODS, 2, LANES))
    defect = Defect(math.radians(4.0), 15e-6, rows=2)
    group = new_group([replace(SCENE, defect=defect)], 384, slip)
    group.run_block(draws)
    oracle = SlipOracle(Case(40.0, 4000.0, defect.dphi_d, defect.h_d, rows=2), draws[:, :, 0])
    factor = effort_count(quick=2, full=4)
    truth = oracle.acceleration(factor * group.grid.steps)[::factor]
    assert np.sqrt(np.mean((group.wave[:, 0, 0] - truth) ** 2) / np.mean(truth**2)) < 0.03
    assert np.sqrt(np.mean(group.wave[:, 0, 0] ** 2) / np.mean(truth**2)) == pytest.approx(1.0, abs=5e-3)


def test_slip_that_vanishes_is_none() -> None:
    scenes = map_scenes(4)
    none = simulate_lanes(scenes).rms
    tiny = simulate_lanes([replace(s, slip=Slip(1e-9)) for s in scenes], LaneOptions(slip_blocks=2))
    assert tiny.rms == pytest.approx(none, rel=2e-3)
    for rule in ("per_passage", "mean_force"):
        still = simulate_lanes([replace(s, slip=Slip(0.0, rule)) for s in scenes])
        assert still.rms == pytest.approx(none, rel=1e-9)


def test_slip_per_passage_is_random_and_says_how_much() -> None:
    scene = replace(SCENE, slip=Slip(0.02, seed=3))
    options = LaneOptions(slip_blocks=effort_count(quick=12, full=60))
    copies = simulate_lanes([scene] * LANES, options)
    assert np.all(copies.status == STATUSES.index("not_periodic"))
    assert np.unique(copies.rms).size == LANES
    # The scatter between independent records is what each of them says of itself.
    assert np.std(copies.rms) == pytest.approx(np.sqrt(np.mean(copies.rms_se**2)), rel=0.5)
    again = simulate_lanes([scene] * LANES, options)
    assert np.array_equal(copies.rms, again.rms)
    other = simulate_lanes([replace(SCENE, slip=Slip(0.02, seed=4))], options)
    assert other.rms[0] != copies.rms[0]


def test_mean_force_lowers_the_rms_most_where_slip_is_large_and_the_defect_small() -> None:
    """The trend of Fig. 51: RMS falls with the slip angle, for the smallest defect fastest."""
    ratios = {}
    for name, degrees, load, speed in (("D1", 2.362, 1000.0, 40.0), ("D3", 6.366, 2000.0, 40.0)):
        scene = Scene(speed, load, defect=Defect(math.radians(degrees), 500e-6))
        slips = [Slip(p, "mean_force") for p in (0.0, 0.005, 0.02)]
        rms = [simulate_lanes([replace(scene, slip=slip)]).rms[0] for slip in slips]
        assert rms[0] > rms[1] > rms[2]
        ratios[name] = rms[2] / rms[0]
    assert ratios["D1"] < ratios["D3"]


def test_steps_of_a_block_dither() -> None:
    for steps in (8, 100, 256, 1000):
        count = block_steps(195.6, steps)
        assert count > PERIODS * steps
        assert math.gcd(count, PERIODS) == 1


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"speed": 30.0}, "speed"),
        ({"clearance": 1e-6}, "clearance"),
        ({"load": -1.0}, "load"),
        ({"gravity": 9.81}, "gravity"),
        ({"slip": Slip(0.01)}, "slip"),
        ({"defect": Defect(0.1, 1e-5, rows=2)}, "rows"),
    ],
)
def test_scenes_that_cannot_stand_side_by_side_are_refused(change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        simulate_lanes([SCENE, replace(SCENE, **change)])


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: Slip(-1.0), "phi_slip"),
        (lambda: Slip(0.01, cast("Any", "sometimes")), "rule"),
        (lambda: LaneOptions(tolerance=0.0), "tolerance"),
        (lambda: LaneOptions(steps_per_period=4), "steps_per_period"),
        (lambda: LaneOptions(slip_blocks=1), "slip_blocks"),
        (lambda: simulate_lanes([]), "at least one"),
        (lambda: simulate_lanes([SCENE], LaneOptions(band=(0.0, 1e6))), "band"),
    ],
)
def test_impossible_options_are_refused(make: object, word: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=word):
        make()

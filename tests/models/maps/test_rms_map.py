from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from netCDF4 import Dataset

from models.machine.scene import Floor, Slip
from models.maps.build import build_map
from models.maps.check import check_map, rms_and_most
from models.maps.data import RmsMap
from models.maps.file import cached_map, default_map_path, load_map, save_map
from models.maps.nodes import drawn_rig
from models.maps.plan import MAP_ACCURACY, MapError, MapPlan, scene_at
from models.solve.response import HARMONICS, STATUSES
from models.solve.simulate import simulate
from tests.support.rigs import six_dof

PLAN = MapPlan(
    load=(3000.0, 5000.0),
    speed=(40.0,),
    h_d=(0.0, 10e-6, 20e-6),
    dphi_d=(0.0, 0.1, 0.2, 0.35),
    rms_band=(0.0, 9500.0),
)
SMALL = replace(PLAN, load=(4000.0,), h_d=(10e-6, 20e-6), dphi_d=(0.1, 0.2))


@cache
def built() -> RmsMap:
    return build_map(PLAN)


def test_nodes_are_the_simulation() -> None:
    m = built()
    for i, j, k, n in ((0, 0, 1, 2), (1, 0, 2, 3)):
        scene = scene_at(PLAN, PLAN.load[i], PLAN.speed[j], PLAN.h_d[k], PLAN.dphi_d[n])
        response = simulate(scene, band=PLAN.rms_band, accuracy=MAP_ACCURACY)
        assert m.rms[i, j, k, n] == pytest.approx(response.rms, rel=1e-12)
        assert m.harmonic_amplitude[i, j, k, n] == pytest.approx(response.harmonics, rel=1e-12)
        assert STATUSES[m.status[i, j, k, n]] == response.status


def test_shapes_and_healthy_edges() -> None:
    m = built()
    for name in ("interpolation_error", "condition_error"):
        assert 0.0 < m.attributes[name] < m.attributes[f"{name}_max"]
    assert "condition_error" not in build_map(SMALL).attributes
    assert m.rms.shape == m.rms_std.shape == m.rms_se.shape == m.rms_error.shape == m.status.shape == PLAN.shape
    assert m.harmonic_amplitude.shape == m.harmonic_std.shape == (*PLAN.shape, HARMONICS)
    healthy = m.rms[:, :, 0, 0]
    assert m.rms[:, :, 0, :] == pytest.approx(np.broadcast_to(healthy[..., None], m.rms[:, :, 0, :].shape), rel=1e-6)
    assert m.rms[:, :, :, 0] == pytest.approx(np.broadcast_to(healthy[..., None], m.rms[:, :, :, 0].shape), rel=1e-6)
    assert np.all(m.rms_error < 3e-3 * m.rms)
    assert m.harmonic_error.shape == m.harmonic_se.shape == m.harmonic_amplitude.shape
    assert np.all((m.harmonic_error > 0.0) & (m.harmonic_error < 6e-3 * m.rms[..., None]))
    assert np.all(m.harmonic_se == 0.0)
    assert np.all(m.rms_std == 0.0)


def test_several_floors_have_mean_spread_and_standard_error() -> None:
    plan = replace(SMALL, floor=Floor("rough", seed=7), floors=3)
    m = build_map(plan)
    levels = [
        simulate(
            scene_at(plan, 4000.0, 40.0, plan.h_d[0], plan.dphi_d[1], seed),
            band=plan.rms_band,
            accuracy=MAP_ACCURACY,
        ).rms
        for seed in range(3)
    ]
    assert m.rms[0, 0, 0, 1] == pytest.approx(np.mean(levels))
    assert m.rms_std[0, 0, 0, 1] == pytest.approx(np.std(levels, ddof=1))
    assert m.rms_se[0, 0, 0, 1] == pytest.approx(np.std(levels, ddof=1) / math.sqrt(3))
    assert np.all(m.harmonic_std > 0.0)
    assert m.harmonic_se == pytest.approx(m.harmonic_std / math.sqrt(3))
    assert m.attributes["floor_seed"] == 7


def test_the_spread_over_rigs_is_that_of_their_draws() -> None:
    plan = replace(SMALL, rig_draws=4, rig_seed=3)
    m = build_map(plan)
    assert np.array_equal(m.rms, build_map(SMALL).rms)
    assert np.all(m.rms_std == 0.0)
    rigs = [six_dof(drawn_rig(plan, n)) for n in range(4)]
    rig = six_dof(plan.rig)
    assert len({drawn.k_c for drawn in rigs}) == 4
    assert all(drawn.m_i == rig.m_i and abs(drawn.k_r / rig.k_r - 1.0) < 0.06 for drawn in rigs)
    responses = [
        simulate(
            scene_at(replace(plan, rig=rig), 4000.0, 40.0, plan.h_d[1], plan.dphi_d[0]),
            band=plan.rms_band,
            accuracy=MAP_ACCURACY,
        )
        for rig in rigs
    ]
    spread = np.std([r.rms for r in responses], ddof=1)
    assert spread > 0.0
    assert m.rms_rig_std[0, 0, 1, 0] == pytest.approx(spread)
    lines = np.std([r.harmonics for r in responses], axis=0, ddof=1)
    assert m.harmonic_rig_std[0, 0, 1, 0] == pytest.approx(lines)
    at = m.slice_at(4000.0, 40.0)
    assert np.array_equal(at.rms_rig_std, m.rms_rig_std[0, 0])
    assert np.array_equal(at.harmonic_rig_std, m.harmonic_rig_std[0, 0])
    none = build_map(replace(plan, rig_spread=0.0, rig_spread_k_r=0.0))
    assert np.all(none.rms_rig_std == 0.0)


@pytest.mark.process
def test_rigs_and_floors_are_told_apart() -> None:
    plan = replace(SMALL, floor=Floor("rough", seed=7), floors=2, rig_draws=3, rig_spread=1e-9, rig_spread_k_r=1e-9)
    m = build_map(plan)
    assert np.all(m.rms_std > 1e-3 * m.rms)
    assert np.all(m.rms_rig_std < 1e-3 * m.rms_std)


def test_progress_counts_every_node() -> None:
    seen: list[tuple[int, int]] = []
    build_map(SMALL, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(2, 4), (4, 4)]


def test_saved_and_loaded_is_the_same(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "map.nc"
    save_map(built(), path)
    loaded = load_map(path)
    for name in ("load", "speed", "h_d", "dphi_d", "rms", "rms_std", "rms_se", "rms_error", "rms_rig_std", "status"):
        assert np.array_equal(getattr(loaded, name), getattr(built(), name)), name
    assert np.array_equal(loaded.harmonic_amplitude, built().harmonic_amplitude)
    assert loaded.plan == PLAN
    assert loaded.hash == PLAN.hash()
    assert loaded.rms_band == (0.0, 9500.0)
    assert loaded.part_radius == 22.91e-3
    assert list(path.parent.iterdir()) == [path]


def test_a_map_that_cannot_be_written_leaves_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.nc"
    path.write_bytes(b"before")

    def fail(*_: object) -> None:
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr("models.maps.file._write", fail)
    with pytest.raises(OSError, match=r"NetCDF: HDF error, with \d+\.\d MB free"):
        save_map(built(), path)
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_the_file_says_what_made_it(tmp_path: Path) -> None:
    save_map(built(), tmp_path / "map.nc")
    with Dataset(tmp_path / "map.nc") as dataset:
        assert list(dataset.dimensions) == ["load", "speed", "h_d", "dphi_d", "bpfo_harmonic"]
        units = {name: dataset[name].units for name in ("load", "speed", "h_d", "dphi_d", "rms", "harmonic_amplitude")}
        attributes = {name: dataset.getncattr(name) for name in dataset.ncattrs()}
        meanings = dataset["status"].flag_meanings
    assert units == {
        "load": "N",
        "speed": "Hz",
        "h_d": "m",
        "dphi_d": "rad",
        "rms": "m s-2",
        "harmonic_amplitude": "m s-2",
    }
    assert meanings.split() == list(STATUSES)
    assert attributes["rms_band_hz"].tolist() == [0.0, 9500.0]
    assert attributes["rig_k_c"] == six_dof(PLAN.rig).k_c
    assert attributes["bearing_designation"] == "1205 ETN9"
    assert attributes["floor_kind"] == "smooth"
    assert attributes["software_version"].startswith("spallwatch ")


def test_full_bandwidth_survives_the_file(tmp_path: Path) -> None:
    save_map(build_map(replace(SMALL, rms_band=None)), tmp_path / "map.nc")
    assert load_map(tmp_path / "map.nc").rms_band is None


def damage(path: Path, change: Callable[[Dataset], None]) -> None:
    with Dataset(path, "r+") as dataset:
        change(dataset)


def _set(name: str, value: object) -> Callable[[Dataset], None]:
    return lambda dataset: dataset.setncattr(name, value)


def _poke(name: str, value: float) -> Callable[[Dataset], None]:
    def change(dataset: Dataset) -> None:
        dataset[name][...] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_set("hash", "0"), "hash"),
        (_set("schema_version", 99), "schema_version is 99"),
        (_set("schema_version", 1), "another version, build it anew"),
        (_set("parameters", "{}"), "parameters"),
        (_set("parameters", "nonsense"), "parameters"),
        (_poke("rms", -1.0), "rms holds values"),
        (_poke("rms", math.nan), "rms holds values"),
        (_poke("status", 9), "status"),
        (_poke("load", 1.0), "axis load"),
        (lambda dataset: dataset.renameVariable("rms_se", "other"), "rms_se"),
    ],
)
def test_damaged_maps_are_refused(tmp_path: Path, change: Callable[[Dataset], None], message: str) -> None:
    path = tmp_path / "damaged.nc"
    save_map(built(), path)
    damage(path, change)
    with pytest.raises(MapError, match=message) as caught:
        load_map(path)
    assert "damaged.nc" in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"not a map", b"\x89HDF\r\n\x1a\n" + bytes(200), b"CDF\x01" + bytes(50)])
def test_files_that_are_no_maps_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.nc"
    path.write_bytes(content)
    with pytest.raises(MapError, match=r"other\.nc"):
        load_map(path)


def test_another_netcdf_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.nc"
    with Dataset(path, "w") as dataset:
        dataset.createDimension("time", 3)
    with pytest.raises(MapError, match="not an RMS map"):
        load_map(path)
    with pytest.raises(MapError, match="no such file"):
        load_map(tmp_path / "absent.nc")


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "map.nc"
    save_map(built(), path)
    before = path.read_bytes()
    unsavable = replace(built(), attributes={**built().attributes, "x": object()})
    with pytest.raises(Exception, match=r".+"):
        save_map(unsavable, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_the_cache_builds_once_and_repairs(tmp_path: Path) -> None:
    built_nodes: list[int] = []

    def note(done: int, _total: int) -> None:
        built_nodes.append(done)

    first = cached_map(SMALL, tmp_path, progress=note)
    assert built_nodes
    built_nodes.clear()
    assert np.array_equal(cached_map(SMALL, tmp_path, progress=note).rms, first.rms)
    assert not built_nodes
    default_map_path(SMALL, tmp_path).write_bytes(b"cut off")
    assert np.array_equal(cached_map(SMALL, tmp_path, progress=note).rms, first.rms)
    assert built_nodes


def test_every_parameter_is_in_the_hash() -> None:
    others = [
        replace(SMALL, load=(4001.0,)),
        replace(SMALL, clearance=1e-6),
        replace(SMALL, floor=Floor("rough")),
        replace(SMALL, floor=Floor("rough", seed=1)),
        replace(SMALL, rows=2),
        replace(SMALL, rms_band=None),
        replace(SMALL, rig=replace(SMALL.rig, m_o=6.0)),
        replace(SMALL, bearing=replace(SMALL.bearing, n_elements=13)),
        replace(SMALL, steps_per_period=1000),
        replace(SMALL, slip=Slip(0.01), floors=2),
        replace(SMALL, slip=Slip(0.01, "mean_force")),
        replace(SMALL, rig_draws=2),
        replace(SMALL, rig_draws=2, rig_seed=1),
        replace(SMALL, rig_draws=2, rig_spread=0.01),
    ]
    hashes = {plan.hash() for plan in [SMALL, *others]}
    assert len(hashes) == len(others) + 1
    assert all(MapPlan.from_json(plan.as_json()) == plan for plan in others)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"load": ()}, "load"),
        ({"load": (2.0, 1.0)}, "load must ascend"),
        ({"h_d": (-1e-6, 1e-6)}, "h_d"),
        ({"dphi_d": (math.nan,)}, "dphi_d"),
        ({"speed": (0.0, 1.0)}, "speed"),
        ({"floors": 0}, "floors"),
        ({"floors": 2}, "floors"),
        ({"slip": Slip(0.01)}, "floors"),
        ({"rig_draws": 1}, "rig_draws"),
        ({"rig_draws": 2, "rig_spread": -0.1}, "rig_spread"),
    ],
)
def test_impossible_plans_are_refused(change: dict[str, object], word: str) -> None:
    with pytest.raises(MapError, match=word):
        replace(SMALL, **change)


def test_check_measures_the_error() -> None:
    seen: list[int] = []
    check = check_map(built(), 6, progress=lambda done, _total: seen.append(done))
    assert seen == [1, 2, 3, 4, 5, 6, 12, 18]
    assert 0.0 < check.error_rms <= check.error_max < 3e-3
    assert check.interpolation_max >= check.interpolation_rms > check.error_rms
    assert check.condition_rms is not None
    assert check.condition_max is not None
    assert check.condition_max >= check.condition_rms > check.error_rms
    assert check_map(build_map(SMALL), 2).condition_rms is None
    wrong = replace(built(), rms=1.1 * built().rms)
    assert check_map(wrong, 6).error_rms == pytest.approx(0.1, rel=0.05)
    with pytest.raises(ValueError, match="points"):
        check_map(built(), 0)


def test_errors_are_summed_up_or_there_are_none() -> None:
    assert rms_and_most([3.0, -4.0]) == pytest.approx((math.sqrt(12.5), 4.0))
    assert all(math.isnan(value) for value in rms_and_most([]))


@pytest.mark.process
def test_reading_a_map_needs_no_compiler(tmp_path: Path) -> None:
    save_map(built(), tmp_path / "map.nc")
    code = (
        "import sys; from models.maps.file import load_map;"
        f"m = load_map({str(tmp_path / 'map.nc')!r}); m.slice_at(4000.0, 40.0).interpolate(0.1, 1e-5);"
        "sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

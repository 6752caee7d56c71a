"""From configuration to settings: units, maps that fit, maps that are refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from models.lives.population import Population
from models.machine.scene import Part
from models.maps.build import build_map
from models.maps.file import save_map
from models.maps.plan import MapPlan
from models.solve.nominal_rigs import nominal_rig
from models.solve.rotor.rig import RotorRig
from monitor.config.load import ConfigError, validate
from monitor.desk.judge.problems import find_problems
from monitor.health.onset import FEATURES
from monitor.health.size import EdvStatus
from monitor.health.size.library.fit import FitSettings
from monitor.service.libraries import build_library
from monitor.service.setup import source_settings, source_spec

BAND = (0.0, 9500.0)


@pytest.fixture(scope="module")
def plan() -> MapPlan:
    extents = tuple(math.radians(d) for d in (0.0, 4.0, 8.0))
    return MapPlan(load=(4000.0,), speed=(40.0,), h_d=(0.0, 5e-6, 10e-6), dphi_d=extents, rms_band=BAND)


@pytest.fixture(scope="module")
def small_map(plan):
    return build_map(plan)


def config(**channel):
    return validate(
        {
            "bearing": [{"name": "test", "designation": "1205 ETN9"}],
            "operating": {"speed_hz": 40.0, "load_newton": 4000.0},
            "source": [{"name": "s", "url": "x", "rate_hz": 25600, "range_g": 50}],
            "channel": [
                {
                    "name": "c",
                    "source": "s",
                    "unit": "g",
                    "bearing": "test",
                    "rms_band_hz": BAND,
                    "track": True,
                    **channel,
                }
            ],
        },
        Path("machine.toml"),
    )


def test_settings_are_si(small_map):
    c = config()
    channel = source_settings(c, c.source[0], {"c": small_map}).channels["c"]
    assert channel.signal_range == pytest.approx(50 * 9.80665)
    assert channel.samples == 128000
    assert channel.detect.end_of_life_peak == pytest.approx(196.133)
    assert (channel.detect.features, channel.detect.close_blocks) == (FEATURES, 50)
    assert channel.damage is not None
    assert channel.damage.thresholds == (0.05e-6,)
    spec = source_spec(c, c.source[0], "other.npy")
    assert spec.url == "other.npy"
    assert spec.channels[0].unit == "g"


def test_the_map_is_given_where_it_holds(small_map):
    c = config()
    damage = source_settings(c, c.source[0], {"c": small_map}).channels["c"].damage
    assert damage is not None
    at = damage.maps["outer"].map_at
    found, gate = at(4000.0, 40.0)
    assert gate is None
    assert found is not None
    assert found.rms.shape == (3, 3)
    assert at(4000.0, 40.2)[1] is None
    for load, speed in ((3000.0, 40.0), (4000.0, 30.0), (None, 40.0), (4000.0, None)):
        assert at(load, speed) == (None, EdvStatus.OUTSIDE_CONDITIONS)


def test_one_map_a_part_is_read_from_the_files_and_two_of_a_part_are_refused(plan, small_map, tmp_path):
    inner = build_map(replace(plan, part="inner", h_d=(5e-6, 10e-6), dphi_d=plan.dphi_d[1:]))
    save_map(small_map, tmp_path / "outer.nc")
    save_map(inner, tmp_path / "inner.nc")
    files = [str(tmp_path / name) for name in ("inner.nc", "outer.nc")]
    c = config(map=files)
    channel = source_settings(c, c.source[0]).channels["c"]
    assert channel.damage is not None
    assert channel.map_hash == f"{small_map.hash}+{inner.hash}"
    maps = channel.damage.maps
    assert set(maps) == {"outer", "inner"}
    cases: tuple[tuple[Part, float, int], ...] = (("outer", 22.91e-3, 3), ("inner", 16.64e-3, 0))
    for part, radius, lines in cases:
        used, found = maps[part].filter, maps[part].map_at(4000.0, 40.0)[0]
        assert used is not None
        assert found is not None
        assert used.part_radius == pytest.approx(radius)
        assert used.lines == lines
        assert found.volume(0.1, 1e-5) == pytest.approx(radius * 1e-6)
    assert not [problem for problem in find_problems(c) if "map" in problem.came]
    twice = config(map=[files[0], files[0]])
    with pytest.raises(ConfigError, match="two files are maps of the part 'inner'"):
        source_settings(twice, twice.source[0])
    missing = config(map=[files[0], str(tmp_path / "ball.nc")])
    assert any("ball.nc does not exist" in problem.came for problem in find_problems(missing))


def test_a_map_of_the_inner_race_needs_its_radius(plan, small_map):
    other = replace(plan.bearing, inner_race_radius=16.0e-3)
    for part, refused in (("outer", False), ("inner", True)):
        parameters = replace(plan, part=part, bearing=other).as_json()
        changed = replace(small_map, attributes={**small_map.attributes, "parameters": parameters})
        c = config()
        if refused:
            with pytest.raises(ConfigError, match="inner_race_radius"):
                source_settings(c, c.source[0], {"c": changed})
        else:
            source_settings(c, c.source[0], {"c": changed})


def test_a_map_of_another_band_is_refused(small_map):
    c = config(rms_band_hz=[0, 8000])
    with pytest.raises(ConfigError, match=r"rms_band_hz = \[0, 8000\].*\[0, 9500\]"):
        source_settings(c, c.source[0], {"c": small_map})


@pytest.mark.parametrize(("name", "factor"), [("m_r", 1.01), ("k_c", 0.9)])
def test_a_map_of_another_rig_is_refused(plan, small_map, name, factor):
    other = replace(plan.rig, **{name: getattr(plan.rig, name) * factor})
    changed = replace(small_map, attributes={**small_map.attributes, "parameters": replace(plan, rig=other).as_json()})
    c = config()
    with pytest.raises(ConfigError, match=f"rig {name}"):
        source_settings(c, c.source[0], {"c": changed})


@pytest.mark.parametrize(("shaft", "words"), [({}, None), ({"disc_mass_kg": 7.0}, "rig m = 5.0, configured is 7.0")])
def test_a_map_of_another_model_must_be_that_of_the_shaft(shaft, words):
    values = config().model_dump(mode="json", exclude_unset=True)
    values["bearing"] = [{"name": "test", "designation": "6205"}]
    c = validate(values | {"shaft": shaft}, Path("machine.toml"))
    entry = c.bearing[0].to_entry()
    rig = nominal_rig(RotorRig, entry)
    plan = MapPlan(
        (4000.0,), (40.0,), (0.0, 1e-5), (0.0, 0.1), bearing=entry.bearing, rig=rig, model="rotor", rms_band=BAND
    )
    built = build_map(plan)
    if words is None:
        damage = source_settings(c, c.source[0], {"c": built}).channels["c"].damage
        assert damage is not None
        assert damage.maps["outer"].model == "rotor"
    else:
        with pytest.raises(ConfigError, match=words):
            source_settings(c, c.source[0], {"c": built})


def test_a_map_that_is_not_there_says_how_to_make_one(tmp_path, small_map):
    c = config(map=str(tmp_path / "none.nc"))
    with pytest.raises(ConfigError, match=r"none\.nc.*spallwatch map build"):
        source_settings(c, c.source[0])
    save_map(small_map, tmp_path / "there.nc")
    c = config(map=str(tmp_path / "there.nc"))
    assert source_settings(c, c.source[0]).channels["c"].map_hash is not None
    (tmp_path / "garbage.nc").write_bytes(b"not a map")
    c = config(map=str(tmp_path / "garbage.nc"))
    with pytest.raises(ConfigError, match=r"garbage\.nc"):
        source_settings(c, c.source[0])


@pytest.fixture(scope="module")
def library():
    population = Population(load=(3900.0, 4100.0), speed=(39.0, 41.0), durations=(2400.0, 4800.0))
    return build_library(population, runs=20, thresholds=(0.05e-6,), settings=FitSettings(columns=60))


def damage_of(c, **given):
    damage = source_settings(c, c.source[0], **given).channels["c"].damage
    assert damage is not None
    return damage


def test_without_a_method_a_library_is_taken_where_there_is_one(small_map, library):
    c = config()
    damage = damage_of(c, maps={"c": small_map})
    assert (damage.track_method, damage.forecast_method, damage.prior) == ("thesis", "thesis", None)
    damage = damage_of(c, libraries={"c": library})
    assert (damage.track_method, damage.forecast_method) == ("library", "library")
    assert damage.prior == library.prior
    assert damage.library_settings.features == "rms+harmonics"
    mixed = c.model_copy(update={"track": c.track.model_copy(update={"method": "filter"})})
    damage = damage_of(mixed, maps={"c": small_map}, libraries={"c": library})
    assert (damage.track_method, damage.forecast_method) == ("filter", "library")
    used = damage.maps["outer"].filter
    assert used is not None
    assert used.lines == 3
    assert library.prior in str(damage.prior)
    assert "may stall or jump" in str(damage.prior)


@pytest.mark.parametrize(
    ("forecast", "channel", "words"),
    [
        ({"threshold_mm2": 0.08}, {}, r"threshold_mm2 0\.08 is not in the library"),
        ({}, {"rms_band_hz": [0, 8000]}, r"its library was made for \[0, 9500\]"),
    ],
)
def test_a_library_that_does_not_fit_is_refused(library, forecast, channel, words):
    c = config(**channel)
    c = c.model_copy(update={"forecast": c.forecast.model_copy(update=forecast)})
    with pytest.raises(ConfigError, match=words):
        damage_of(c, libraries={"c": library})


def test_a_library_of_another_rig_is_refused(library):
    c = config()
    c = c.model_copy(update={"rig": c.rig.model_copy(update={"m_r_kg": 0.5})})
    with pytest.raises(ConfigError, match=r"rig m_r.*spallwatch library build"):
        damage_of(c, libraries={"c": library})


def test_check_names_the_library_that_is_not_there(tmp_path):
    c = config(library=str(tmp_path / "none.npz"))
    assert [problem for problem in find_problems(c) if "none.npz does not exist" in problem.came]
    with pytest.raises(ConfigError, match=r"none\.npz"):
        damage_of(c)

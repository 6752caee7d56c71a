"""The configuration: what is accepted, and that every refusal names the key, what came and what is allowed."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from monitor.config.load import Config, ConfigError, load_config, validate
from tests.support.config import MINIMAL, message

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = sorted((ROOT / "examples").glob("*.toml"))


def changed(section, **keys):
    values = {
        name: [dict(row) for row in rows] if isinstance(rows, list) else dict(rows) for name, rows in MINIMAL.items()
    }
    target = values.setdefault(section, {})
    (target[0] if isinstance(target, list) else target).update(keys)
    return values


def test_the_minimal_configuration_has_the_documented_defaults():
    config = validate(MINIMAL, Path("machine.toml"))
    assert config.source[0].settle_s == 2
    assert config.source[0].block_s == 5
    assert config.channel[0].band_hz == "auto"
    assert config.channel[0].average_blocks == 1
    assert not config.channel[0].track
    assert config.detect.end_of_life_peak_g == 20
    assert config.detect.end_of_life_blocks == 3
    assert config.track.smoothing_blocks == 6
    assert config.forecast.thresholds == (0.05e-6,)
    assert (config.track.method, config.forecast.method) == (None, None)
    assert config.track.features == ("rms", "harmonics")
    assert (config.forecast.interval, config.forecast.window_hours) == (0.8, None)
    assert not config.rig.calibrated


@pytest.mark.parametrize("path", [ROOT / "config.toml", *EXAMPLES], ids=lambda path: path.stem)
def test_shipped_configurations_are_valid(path):
    assert load_config(path).channel


def test_the_examples_of_the_interface_are_there():
    assert {path.stem for path in EXAMPLES} >= {
        "pronostia_1800rpm_4000n",
        "pronostia_1650rpm_4200n",
        "pronostia_1500rpm_5000n",
        "cwru_drive_end",
        "cwru_fan_end",
        "mfpt",
        "hit_sm",
        "ims_test1",
        "ims_test2",
        "uestc",
        "ferrara_stationary",
    }


def test_no_run_is_tuned_for():
    sections = [tomllib.loads(path.read_text())["detect"] for path in [ROOT / "config.toml", *EXAMPLES]]
    assert all(section == sections[0] for section in sections)
    methods = [load_config(path) for path in EXAMPLES]
    assert len({(config.track, config.forecast) for config in methods}) == 1


def test_every_key_of_the_root_configuration_is_commented():
    section, explained = "", set()
    for line in (ROOT / "config.toml").read_text().splitlines():
        if line.startswith("["):
            section = line.split("#")[0].strip()
        elif "=" in line and (key := line.removeprefix("# ").split("=")[0].strip()).isidentifier():
            assert (section, key) in explained or line.removeprefix("# ").count("#") == 1, line
            explained.add((section, key))
    assert len(explained) > 50


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (changed("detect", learn_block=50), ["machine.toml", "detect.learn_block", "unknown key", "learn_blocks"]),
        (changed("channel", unit="mm"), ["channel[0].unit", "'mm'", "'g'", "'unknown'"]),
        (changed("channel", unit="V"), ["channel[0] (de)", "sensitivity_mv_per_g"]),
        (changed("channel", unit="in/s"), ["channel[0].unit", "in/s", 'unit = "mm/s" and scale = 25.4']),
        (changed("channel", sensor_max_hz=1000.0), ["sensor_max_hz", 'unit = "mm/s"']),
        (
            changed("channel", unit="mm/s", sensor_max_hz=1000.0, band_hz=[[500, 2000]]),
            ["band_hz", "2000", "sensor_max_hz = 1000"],
        ),
        (changed("channel", band_hz=[[5000, 20000]]), ["'de'", "band_hz", "20000", "12800", "Nyquist"]),
        (changed("channel", rms_band_hz=[0, 12801]), ["rms_band_hz", "12801", "12800"]),
        (changed("channel", band_hz=[[9000, 7000]]), ["band_hz", "9000", "7000"]),
        (changed("channel", band_hz=[]), ["band_hz", "empty"]),
        (changed("channel", bearing="other"), ["'de'", "'other'", "test"]),
        (changed("channel", source="other"), ["'de'", "'other'", "logger"]),
        (changed("channel", scale=0), ["channel[0].scale", "other than 0"]),
        (changed("channel", column=1, key="x"), ["column or key"]),
        (changed("channel", average_blocks=0), ["channel[0].average_blocks", "greater than or equal to 1"]),
        (changed("bearing", designation="6999"), ["bearing[0] (test)", "'6999'", "6205"]),
        (changed("bearing", designation="6205-QX"), ["bearing[0] (test)", "unknown suffix 'QX'"]),
        (changed("bearing", element_length_mm=8.0), ["bearing[0] (test)", "element_length_mm", "balls"]),
        (changed("bearing", designation=None), ["bearing[0] (test)", "n_elements"]),
        (changed("operating", speed_hz=-5), ["operating.speed_hz", "-5", "greater than 0"]),
        (changed("operating", speed_hz=float("nan")), ["operating.speed_hz", "nan"]),
        (changed("source", block_s="hour"), ["source[0].block_s", "'hour'"]),
        (changed("machine", timezone="Mars/Base"), ["machine.timezone", "Mars/Base"]),
        (changed("machine", name="../up"), ["machine.name", "../up"]),
        (changed("detect", learn_blocks=50, learn_hours=3), ["learn_blocks or learn_hours"]),
        (changed("detect", features=["h_or"]), ["detect.features", 'must hold "rms"']),
        (changed("detect", features=["rms", "h_or", "h_or"]), ["detect.features", "at most once"]),
        (changed("detect", features=["rms", "peak"]), ["detect.features", "h_cage"]),
        (changed("detect", close_blocks=0), ["detect.close_blocks"]),
        (changed("detect", false_alarms_per_1000_blocks=0), ["detect.false_alarms_per_1000_blocks", "0"]),
        (changed("forecast", threshold_mm2=[0.1, 0.05]), ["forecast.threshold_mm2", "ascending"]),
        (changed("track", method="magic"), ["track.method", "'magic'", "'thesis'", "'filter'", "'library'"]),
        (changed("track", features=["harmonics"]), ["track.features", '["rms", "harmonics"]']),
        (changed("forecast", method="filter"), ["forecast.method", "'filter'", "'thesis'", "'library'"]),
        (changed("forecast", interval=80), ["forecast.interval", "80", "0.98"]),
        (changed("forecast", window_hours=0), ["forecast.window_hours", "0", "greater than 0"]),
        ({**MINIMAL, "sensor": []}, ["sensor", "unknown key", "channel"]),
        ({**MINIMAL, "channel": []}, ["channel", "at least 1"]),
        ({"bearing": MINIMAL["bearing"]}, ["source", "missing"]),
        ({**MINIMAL, "channel": MINIMAL["channel"] * 2}, ["'de'", "twice"]),
    ],
)  # fmt: skip
def test_refusals_name_the_key_what_came_and_what_is_allowed(values, words):
    text = message({key: value for key, value in values.items() if value is not None})
    for word in words:
        assert word in text


def test_one_mistake_is_one_line():
    assert len(message(changed("channel", unit="mm")).splitlines()) == 1
    assert len(message(changed("channel", unit="mm", bearing="")).splitlines()) == 2


def test_a_file_that_is_no_toml_or_not_there(tmp_path):
    broken = tmp_path / "broken.toml"
    broken.write_text("[machine\nname = 1")
    with pytest.raises(ConfigError, match=r"broken\.toml:1: not valid TOML"):
        load_config(broken)
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read"):
        load_config(tmp_path / "none.toml")


def test_paths_are_relative_to_the_file(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(
        "\n".join(
            [
                '[[bearing]]\nname = "a"\ndesignation = "6205"',
                '[[source]]\nname = "s"',
                '[[channel]]\nname = "c"\nsource = "s"\nunit = "g"\nbearing = "a"\ntrack = true\nmap = "maps/m.nc"',
            ]
        )
    )
    config = load_config(path)
    assert config.channel[0].maps == (tmp_path / "maps" / "m.nc",)
    path.write_text(path.read_text().replace('"maps/m.nc"', '["maps/m.nc", "/other/inner.nc"]'))
    assert load_config(path).channel[0].maps == (tmp_path / "maps" / "m.nc", Path("/other/inner.nc"))
    path.write_text(path.read_text().replace('["maps/m.nc", "/other/inner.nc"]', "[]"))
    with pytest.raises(ConfigError, match="map is empty"):
        load_config(path)
    path.write_text(path.read_text().replace("map = []", "map = 3"))
    with pytest.raises(ConfigError, match="map"):
        load_config(path)
    assert config.machine.state_dir == tmp_path / "state"


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("folder:data", "folder:{here}/data"),
        ("dataset:ims:runs/1st", "dataset:ims:{here}/runs/1st"),
        ("a.wav", "{here}/a.wav"),
        ("folder:/data/press", "folder:/data/press"),
        ("rig:demo?seed=1", "rig:demo?seed=1"),
        ("tcp://127.0.0.1:7", "tcp://127.0.0.1:7"),
    ],
)
def test_the_path_in_a_url_is_relative_to_the_file(tmp_path, url, expected):
    path = tmp_path / "machine.toml"
    path.write_text(
        '[[bearing]]\nname = "a"\ndesignation = "6205"\n'
        f'[[source]]\nname = "s"\nurl = "{url}"\n'
        '[[channel]]\nname = "c"\nsource = "s"\nunit = "g"\nbearing = "a"\n'
    )
    assert load_config(path).source[0].url == expected.format(here=tmp_path)


def test_the_hash_follows_the_meaning():
    one, two = validate(MINIMAL, Path("a.toml")), validate(MINIMAL, Path("a.toml"))
    other = validate(changed("operating", speed_hz=31.0), Path("a.toml"))
    assert one.hash == two.hash != other.hash
    judged = validate(changed("machine", iso_class="20816-3:2:rigid"), Path("a.toml"))
    assert judged.hash != one.hash


def test_the_hash_of_an_older_configuration_stays():
    """Keys that are newer than a configuration do not change its hash where they are not given."""
    level = {"feature": "rms", "alert_g": 1.0}
    config = validate({**MINIMAL, "alarms": {"level": [level]}}, Path("a.toml"))
    dumped = []
    whole = type(config).model_dump_json
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(type(config), "model_dump_json", lambda *a, **k: dumped.append(whole(*a, **k)) or dumped[-1])
        assert config.hash
    assert not any(key in dumped[0] for key in ("iso_class", "alert_mm_s", "danger_mm_s"))
    slow = {"feature": "velocity_rms", "alert_mm_s": 4.5}
    given = validate({**MINIMAL, "alarms": {"level": [slow]}}, Path("a.toml"))
    other = validate({**MINIMAL, "alarms": {"level": [slow | {"alert_mm_s": 7.1}]}}, Path("a.toml"))
    assert given.hash != other.hash
    alert = given.alarms.level[0].to_rule().alert
    assert alert is not None
    assert alert.value == pytest.approx(4.5e-3)


def test_geometry_given_in_the_configuration_takes_precedence():
    config = validate(changed("bearing", n_elements=10, contact_angle_deg=15.0), Path("a.toml"))
    bearing = config.bearing_of(config.channel[0])
    assert bearing.n_elements == 10
    assert bearing.contact_angle == pytest.approx(0.261799, abs=1e-6)
    assert bearing.element_diameter == pytest.approx(7.94e-3, abs=0.05e-3)


def test_the_schema_covers_every_section():
    schema = Config.model_json_schema()
    assert set(schema["properties"]) == set(Config.model_fields)
    assert schema["additionalProperties"] is False


def test_the_length_of_a_roller_and_other_keys_take_precedence() -> None:
    values = changed("bearing", designation="NU205 ECP/C3", element_length_mm=7.5, n_elements=12)
    entry = Config.model_validate(values).bearing[0].to_entry()
    assert entry.bearing.effective_length == pytest.approx(7.5e-3)
    assert entry.bearing.n_elements == 12
    assert entry.bearing.element_diameter == pytest.approx(7.5e-3)
    assert {name: entry.origins[name].kind for name in ("effective_length", "n_elements", "element_diameter")} == {
        "effective_length": "configured",
        "n_elements": "configured",
        "element_diameter": "estimated",
    }
    assert entry.counts == ((12, 1.0),)


def test_geometry_without_a_designation_is_taken_as_exact() -> None:
    given = {"n_elements": 9, "element_diameter_mm": 7.9, "pitch_diameter_mm": 39.0, "element": "roller"}
    values = changed("bearing", designation=None, element_length_mm=8.0, **given)
    entry = Config.model_validate(values).bearing[0].to_entry()
    assert entry.bearing.effective_length == pytest.approx(8e-3)
    assert not entry.estimated

"""A sensor of velocity in the monitor: what it shows of the same motion as one of acceleration, and what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spallwatch as sw
from monitor.config.load import Config, load_config
from monitor.desk.judge.problems import find_problems
from monitor.health.signal.bands import candidate_bands
from monitor.health.state import ChannelSettings, SourceSettings, SourceState
from monitor.health.step import SourceOutput, step
from streams.types.block import Block
from tests.support.moving import KnownMotion, rung, tone
from tests.support.pipeline import BEARING, DAMAGE, DETECT, LINES, SPEED
from tests.support.ways_in import by_hand, by_init, channel_table

RATE, N = 25600.0, 25600
T = np.arange(N) / RATE
BANDS = ((700.0, 1700.0),)
CONDITION = ChannelSettings("x", BEARING).condition


def motion(seed: int = 0, line: float = LINES.bpfo) -> KnownMotion:
    """The shaft, and a resonance that a fault of the outer race excites, with a floor that both sensors measure."""
    rng = np.random.default_rng(seed)
    found = tone(T, SPEED, 3e-3) + rung(T, line, 1200.0, 2e-3)
    for hertz, phase in zip(rng.uniform(600.0, 1900.0, 60), rng.uniform(0.0, 6.28, 60), strict=True):
        found += tone(T, float(hertz), 2e-6, float(phase))
    return found


def settings(unit: str, **changes: Any) -> ChannelSettings:
    condition = replace(CONDITION, speed=SPEED, load=4200.0)
    given = {"unit": unit, "bands": BANDS, "detect": DETECT, "condition": condition, **changes}
    return ChannelSettings("one", BEARING, **given)


def taken(samples: np.ndarray, channel: ChannelSettings, unit: str | None = None) -> SourceOutput:
    block = Block(
        samples[None].astype(np.float32), RATE, ("one",), (unit or channel.unit,), "s", 1, "block", elapsed=0.0
    )
    source = SourceSettings("s", {"one": channel})
    return step(SourceState.begin(source), block, source)[1]


def values_of(samples: np.ndarray, unit: str, **changes: Any) -> dict[str, Any]:
    return dict(taken(samples, settings(unit, **changes)).record.channels["one"])


def test_it_shows_the_same_of_a_motion_as_a_sensor_of_acceleration() -> None:
    true = motion()
    by_acceleration = values_of(true.acceleration, "m/s2")
    by_velocity = values_of(1e3 * true.velocity, "mm/s")
    for name in ("rms", "peak", "kurtosis", "velocity_rms", "h_or", "a_star", "fault_snr", "fault_depth"):
        assert by_velocity[name] == pytest.approx(by_acceleration[name], rel=0.02), name
    for name in ("envelope_amplitude", "bpfo_amplitude"):
        found, expected = (np.array(values[name][0] if name == "envelope_amplitude" else values[name], float)
                           for values in (by_velocity, by_acceleration))  # fmt: skip
        assert np.max(np.abs(found - expected)) < 5e-3 * np.max(expected), name
    assert by_velocity["fault"] == by_acceleration["fault"] == "outer"
    assert by_velocity["velocity_status"] == "ok"
    assert (by_velocity["quantity"], by_velocity["acceleration_limit"]) == ("velocity", 2000.0)
    assert "quantity" not in by_acceleration


def test_its_peak_and_rms_are_of_the_band_that_it_measures() -> None:
    """An acceleration at 6 kHz, beyond what it measures, is not in them; one of acceleration has it."""
    true = motion() + tone(T, 6000.0, 2e-3)
    assert values_of(true.acceleration, "m/s2")["rms"] > 50.0
    within = values_of(motion().acceleration, "m/s2")
    found = values_of(1e3 * true.velocity, "mm/s")
    assert found["rms"] == pytest.approx(within["rms"], rel=0.02)
    assert found["peak"] == pytest.approx(within["peak"], rel=0.05)
    wider = values_of(1e3 * true.velocity, "mm/s", velocity_limit=10000.0)
    assert wider["rms"] == pytest.approx(values_of(true.acceleration, "m/s2")["rms"], rel=0.01)


def test_volume_and_its_time_are_refused_by_a_status_of_their_own() -> None:
    found = set[tuple[str, str]]()
    for unit in ("m/s2", "mm/s"):
        channel = settings(unit, damage=DAMAGE)
        output = taken(1e3 * motion().velocity if unit == "mm/s" else motion().acceleration, channel)
        values = output.record.channels["one"]
        found.add((unit, str(values["edv_status"])))
        assert values["v_eq"] is None or unit == "m/s2"
    assert found == {("m/s2", "not_final_stage"), ("mm/s", "velocity_sensor")}


def test_a_velocity_is_judged_without_the_range_that_it_does_not_reach() -> None:
    found = values_of(1e3 * motion().velocity, "mm/s", velocity_limit=900.0, bands=((600.0, 880.0),))
    assert (found["velocity_status"], found["velocity_rms"]) == ("sensor_limit", None)


@pytest.mark.parametrize(
    ("configured", "came"), [("mm/s", "m/s2"), ("g", "mm/s"), ("unknown", "mm/s"), ("mm/s", "unknown")]
)
def test_a_live_block_of_another_quantity_is_rejected(configured: str, came: str) -> None:
    record = taken(motion().acceleration, settings(configured), came).record
    assert record.status == "wrong_unit"
    assert f"unit '{came}', configured is '{configured}'" in record.reason


def test_faults_of_the_sensor_are_those_of_what_it_gives_not_of_the_derivative() -> None:
    velocity = 1e3 * motion().velocity
    clipped = np.clip(velocity, -2.0, 2.0)
    assert "clipped" in taken(clipped, settings("mm/s")).record.flags
    assert "flat" in taken(np.full(N, 0.3), settings("mm/s")).record.flags
    assert taken(np.where(T > 0.5, np.nan, velocity), settings("mm/s")).record.status == "nan"
    assert "stopped" in taken(1e-5 * velocity, settings("mm/s")).record.flags
    assert taken(velocity, settings("mm/s")).record.flags == ()


def test_its_bands_are_sought_where_it_measures() -> None:
    assert all(high <= 2000.0 for _, high in candidate_bands(RATE, 100.0, 2000.0))
    assert len(candidate_bands(RATE, 100.0, 2000.0)) > 1
    with pytest.raises(ValueError, match="a sensor up to 2000 Hz leaves no band"):
        candidate_bands(RATE, 300.0, 2000.0)
    slow = replace(CONDITION, speed=20.0)
    values = values_of(1e3 * motion().velocity, "mm/s", bands=None, condition=slow)
    assert values["band_hi"] <= 2000.0


def written(folder: Path, unit: str = "mm/s", factor: float = 1e3) -> Path:
    """Three files of a logger of velocity."""
    data = folder / "data"
    data.mkdir()
    for hour in range(3):
        rows = "\n".join(f"{value:.7g}" for value in factor * motion(hour, 24.8 * 3.585).velocity)
        head = f"Start: 2026-01-01T0{hour}:00:00Z\nSample rate: 25600 Hz\nUnit: {unit}\nbearing\n"
        (data / f"{hour}.csv").write_text(f"{head}{rows}\n", encoding="utf-8")
    return data


def test_a_folder_is_read_the_same_by_init_by_hand_and_by_python(tmp_path: Path) -> None:
    data = written(tmp_path)
    came = by_init(tmp_path)
    assert came.configuration is not None, came.said
    channel = came.configuration["channel"][0]
    assert channel["unit"] == "mm/s"
    by_hands = by_hand(tmp_path, channel_table("column = 'bearing'", "mm/s"))
    rms = np.std(motion(0, 24.8 * 3.585).acceleration)
    assert next(iter(came.rms.values())) == pytest.approx([rms] * 3, rel=0.02)
    assert by_hands.rms["c"] == pytest.approx(next(iter(came.rms.values())), rel=1e-6)
    signal = sw.read(data / "0.csv")
    assert signal.values[0] == pytest.approx(motion(0, 24.8 * 3.585).velocity, abs=1e-8)
    assert float(sw.features(signal, bearing="6205", speed_hz=24.8)["rms"][0]) == pytest.approx(rms, rel=0.02)
    assert [block.attrs["units"] for block in sw.blocks(data, block_s="file")] == ["m s-1"] * 3
    text = (tmp_path / "by_init.toml").read_text(encoding="utf-8")
    assert "# sensor_max_hz = 2000" in text
    assert "mm/s in 0.csv" in text
    preview = sw.describe(data, bearing="6205", speed_hz="24.8 Hz").preview()
    assert preview.channels[0].unit == "mm/s"
    assert "mm/s" in preview.ends[0]


def test_its_records_and_reports_say_what_it_measures(tmp_path: Path) -> None:
    written(tmp_path)
    by_hand(tmp_path, channel_table("column = 'bearing'", "mm/s"))
    (path,) = sorted((tmp_path / "by_hand-out" / "records").glob("*.nc"))
    records = sw.open_records(path)
    assert set(records["quantity"].values.ravel()) == {"velocity"}
    assert set(records["acceleration_limit"].values.ravel()) == {2000.0}
    assert records.attrs["velocity_sensors"] == "c: acceleration up to 2000 Hz by differentiation"
    assert records.attrs["rms_band_hz"] == "c: 0 to 2000"


def test_what_is_configured_otherwise_than_stated_is_refused(tmp_path: Path) -> None:
    written(tmp_path, "m/s2")
    came = by_hand(tmp_path, channel_table("column = 'bearing'", "mm/s"))
    assert "the recording is in m/s2, unit = 'mm/s'" in came.said + json.dumps(came.summary)


TABLES = """
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = {speed}
[[source]]
name = "acq"
url = "folder:data"
rate_hz = 25600
"""


def configured(folder: Path, extra: str = "", speed: float = 24.8, band: str = "") -> Config:
    table = channel_table("column = 1", "mm/s")
    table = table.replace('band_hz = "auto"', band or 'band_hz = "auto"')
    (folder / "m.toml").write_text(TABLES.format(speed=speed) + table + extra, encoding="utf-8")
    return load_config(folder / "m.toml")


@pytest.mark.parametrize(
    ("extra", "speed", "band", "rule", "words"),
    [
        ("", 24.8, "band_hz = [2000, 8000]", "band", "channel[c].band_hz: up to 8000 Hz"),
        ("", 90.0, "", "band", "a sensor up to 2000 Hz leaves no band"),
        ("track = true\n", 24.8, "", "damage", "V_eq will answer velocity_sensor"),
    ],
)
def test_check_doubts_what_it_cannot_give(
    extra: str, speed: float, band: str, rule: str, words: str, tmp_path: Path
) -> None:
    found = [doubt for doubt in find_problems(configured(tmp_path, extra, speed, band)) if doubt.rule == rule]
    assert any(words in doubt.text for doubt in found), [doubt.text for doubt in found]


def test_check_takes_the_range_that_is_stated(tmp_path: Path) -> None:
    config = configured(tmp_path, "sensor_max_hz = 20000\n", band="band_hz = [2000, 8000]")
    assert config.channel[0].velocity_limit == 20000.0
    assert not [doubt for doubt in find_problems(config) if doubt.rule == "band"]
    assert configured(tmp_path, band="band_hz = [2000, 8000]").channel[0].velocity_limit == 8000.0
    assert configured(tmp_path).channel[0].velocity_limit == 2000.0


def test_a_channel_of_acceleration_is_not_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise AssertionError

    true = motion()
    before = values_of(true.acceleration, "m/s2")
    monkeypatch.setattr("monitor.health.state.acceleration_of", fail)
    assert values_of(true.acceleration, "m/s2") == before
    with pytest.raises(AssertionError):
        values_of(1e3 * true.velocity, "mm/s")


def test_python_keeps_a_velocity_and_differentiates_where_an_acceleration_is_meant() -> None:
    true = motion()
    signal = sw.to_signal(1e3 * true.velocity, rate_hz=RATE, unit="mm/s")
    by_acceleration = sw.to_signal(true.acceleration, rate_hz=RATE, unit="m/s2")
    assert sw.spectrum(signal).attrs["units"] == "m s-1"
    assert float(sw.spectrum(signal).max()) == pytest.approx(3e-3, rel=0.2)
    found, expected = (sw.envelope_spectrum(one, BANDS[0]) for one in (signal, by_acceleration))
    assert found.attrs["units"] == "m s-2"
    assert np.max(np.abs(found.values - expected.values)) < 5e-3 * expected.values.max()
    assert sw.name_fault(signal, bearing=BEARING, speed_hz=SPEED, band_hz=BANDS[0]).fault == "outer"
    with pytest.raises(sw.SpallwatchError, match="up to 8000 Hz, the sensor of velocity has sensor_max_hz = 2000"):
        sw.envelope_spectrum(signal, (2000.0, 8000.0))
    signal.attrs["sensor_max_hz"] = 10000.0
    assert sw.envelope_spectrum(signal, (2000.0, 8000.0)).sizes["frequency"] > 1

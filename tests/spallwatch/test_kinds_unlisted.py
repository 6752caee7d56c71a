"""Values under keys of no table that bear on a fact: they are offered or doubted, in any format, and never believed."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import spallwatch as sw
from monitor.cli import spallwatch
from streams.files.statements import plain_key
from streams.files.unlisted import bearings_of, unlisted_in
from streams.open import open_source
from streams.types.block import Block
from streams.types.spec import ChannelSpec, SourceSpec
from tests.support.stated_files import (
    RATE,
    START,
    iso,
    noise,
    write_csv,
    write_hdf5,
    write_mat,
    write_netcdf,
    write_tdms,
)

ROWS = noise(1, 8192)
ROWS[0, 5] = 2.5
Words = Mapping[str, Any]
START_TEXT = {"start_utc": iso(START)}


def _csv(path: Path, words: Words, unit: str) -> Path:
    head = [f"{key}: {value:.10g}" if isinstance(value, float) else f"{key}: {value}" for key, value in words.items()]
    return write_csv(path.with_suffix(".csv"), ROWS, head, [f"acc [{unit}]"])


def _tdms(path: Path, words: Words, unit: str) -> Path:
    return write_tdms(path.with_suffix(".tdms"), ROWS, None, {**words, "unit_string": unit})


FORMS: dict[str, Callable[[Path, Words, str], Path]] = {
    "csv": _csv,
    "hdf5": lambda path, words, unit: write_hdf5(path.with_suffix(".h5"), ROWS, words, {"unit": unit}),
    "netcdf": lambda path, words, unit: write_netcdf(path.with_suffix(".nc"), ROWS, words, {"units": unit}),
    "mat": lambda path, words, unit: write_mat(path.with_suffix(".mat"), ROWS, {**words, "unit": unit}),
    "tdms": _tdms,
}
KINDS: dict[str, tuple[Words, Words, str, Words]] = {
    "rate": ({"fs": RATE}, {"smpl_clk_hz": 25600.0}, "g", {"smpl_clk_hz": RATE}),
    "rate in kHz": ({"fs": RATE}, {"acq_fs_khz": 25.6}, "g", {"acq_fs_khz": 4.096}),
    "rate, German": ({"fs": RATE}, {"AbtastFrequenzKanal1": 25600.0}, "g", {"AbtastFrequenzKanal1": RATE}),
    "rate, French": ({"fs": RATE}, {"Cadence_freq_echantillonnage": "25,6 kHz"}, "g", {"freq_acq": "4096 Hz"}),
    "step": ({"fs": RATE}, {"Abtast_Abstand_us": 39.0625}, "g", {"Abtast_Abstand_us": 244.140625}),
    "start": ({"fs": RATE}, {"acq_begin": "2024-01-01T00:00:00Z"}, "g", {"acq_begin": iso(START)}),
    "end": ({"fs": RATE}, {"acq_stop": "2024-01-01T00:00:00Z"}, "g", {"acq_stop": "2025-11-04T08:15:02Z"}),
    "unit": ({"fs": RATE}, {"SensorEinheit": "m/s2"}, "g", {"SensorEinheit": "g"}),
    "quantity": ({"fs": RATE}, {"Messgroesse_1": "Schwinggeschwindigkeit"}, "g", {"Messgroesse_1": "Beschleunigung"}),
    "sensitivity": (
        {"fs": RATE, "sensitivity": "100 mV/g"}, {"amp_V_per_g": 0.05}, "V", {"amp_V_per_g": 0.1},
    ),
    "factor": ({"fs": RATE}, {"Kalibrierfaktor_neu": 0.0981}, "g", {"Kalibrierfaktor_neu": 1.0}),
    "gain": ({"fs": RATE, "sensitivity": "100 mV/g"}, {"Verstaerkung_Kanal": 10.0}, "V", {"Verstaerkung_Kanal": 1.0}),
    "range": ({"fs": RATE}, {"Messbereich": "±0.5 g"}, "g", {"Messbereich": "±50 g"}),
    "fill": ({"fs": RATE}, {"invalid_code": 2.5}, "g", {"invalid_code": -32768.0}),
    "speed": ({"fs": RATE, "speed": "1500 rpm"}, {"Drehzahl_Welle": "900 rpm"}, "g", {"Drehzahl_Welle": "1500 rpm"}),
    "load": ({"fs": RATE, "load": "400 N"}, {"radial_force_on_ring": "9 kN"}, "g", {"force_on_ring": "0.4 kN"}),
}  # fmt: skip
"""By kind: what is stated, a value of no table that contradicts it, the unit, one that agrees."""
NOT_BEARING = (
    *("Filter cut-off frequency", "oversampling_rate", "Scan Interval", "NI_ChannelName", "long_name", "Serial number"),
    *("Max speed", "rated load", "CPU load", "bearing_fault_freq_hz", "Date modified", "calibration_due", "Test unit"),
    *("temperature_sampling_rate", "Sensor SN", "Operator", "Comment", "wind speed", "font_scale", "gps_rate"),
)


def doubts_in(folder: Path, path: Path) -> list[str]:
    """Return what ``init`` says of statements that do not agree."""
    words = ["init", str(path), "--bearing", "6205", "--speed-hz", "25", "--yes", "--json", "--force"]
    done = CliRunner().invoke(spallwatch, [*words, "--out", str(folder / "m.toml")])
    assert done.stdout.startswith("{"), f"{done.output} {done.exception}"
    return [text for text in json.loads(done.stdout)["problems"] if "statements that agree" in text]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", KINDS)
def test_what_contradicts_is_doubted_and_what_agrees_is_not(kind: str, form: str, tmp_path: Path) -> None:
    stated, other, unit, same = KINDS[kind]
    path = FORMS[form](tmp_path / "x", {**stated, **START_TEXT, **other}, unit)
    (said,) = doubts_in(tmp_path, path)
    ((key, value),) = other.items()
    assert said.startswith("warning: ")
    assert all(word in said for word in (path.name, key, f"{value:g}" if isinstance(value, float) else value))
    assert np.isclose(sw.read(path).attrs["rate_hz"], RATE)
    checked = CliRunner().invoke(spallwatch, ["check", "--config", str(tmp_path / "m.toml"), "--json"])
    assert [each["severity"] for each in json.loads(checked.stdout)["problems"] if key in each["came"]] == ["warning"]
    path.unlink()
    assert doubts_in(tmp_path, FORMS[form](tmp_path / "x", {**stated, **START_TEXT, **same}, unit)) == []
    (tmp_path / "m.toml").unlink()


ASKED: dict[str, tuple[Words, Words, str, str, str]] = {
    "rate": ({}, {"smpl_clk_hz": 4096.0}, "g", "--rate-hz", "4096 Hz"),
    "sensitivity": ({"fs": RATE}, {"amp_V_per_g": 0.1}, "V", "--sensitivity-mv-per-g", "100 mV/g"),
    "speed": ({"fs": RATE}, {"Drehzahl_Welle": 1500.0}, "g", "--speed-hz", "1500 rpm"),
}


@pytest.mark.parametrize("form", ["csv", "hdf5", "mat", "tdms"])
@pytest.mark.parametrize("kind", ASKED)
def test_what_nothing_else_states_is_offered_and_not_taken(kind: str, form: str, tmp_path: Path) -> None:
    stated, offered, unit, option, answer = ASKED[kind]
    path = FORMS[form](tmp_path / "x", {**stated, **START_TEXT, **offered}, unit)
    words = ["init", str(path), "--bearing", "6205", "--load-newton", "unknown", "--out", str(tmp_path / "m.toml")]
    if kind != "speed":
        words += ["--speed-hz", "25"]
    done = CliRunner().invoke(spallwatch, [*words, "--yes"])
    said = " ".join(str(done.exception).split())
    ((key, _),) = offered.items()
    assert not (tmp_path / "m.toml").exists()
    assert option in said
    assert f"may state it: {answer}." in said
    assert key in said
    done = CliRunner().invoke(spallwatch, words, input="\n\n")
    assert f"[{answer}]" in done.output
    assert (tmp_path / "m.toml").exists(), done.output
    found = sw.describe(str(path), bearing="6205")
    assert [one.proposed for one in found.questions if one.key == option[2:].replace("-", "_")] == [answer]


@pytest.mark.parametrize("form", ["csv", "hdf5", "tdms"])
def test_an_answer_that_an_unlisted_value_contradicts_is_doubted(form: str, tmp_path: Path) -> None:
    path = FORMS[form](tmp_path / "x", {"smpl_clk_hz": 25600.0, **START_TEXT}, "g")
    words = ["init", str(path), "--bearing", "6205", "--speed-hz", "25", "--rate-hz", "4096", "--yes", "--json"]
    done = CliRunner().invoke(spallwatch, [*words, "--out", str(tmp_path / "m.toml")])
    assert any("smpl_clk_hz" in text and "4096 Hz" in text for text in json.loads(done.stdout)["problems"])


@pytest.mark.parametrize("form", ["csv", "hdf5", "tdms"])
def test_a_doubt_is_logged_once_and_flags_nothing(form: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    for hour in range(4):
        words = {"fs": RATE, "start_utc": f"2025-11-04T{hour:02d}:00:00Z", "smpl_clk_hz": 25600.0}
        FORMS[form](folder / f"rec_{hour}", words, "g")
    spec = SourceSpec("s", str(folder), block_s="file", channels=(ChannelSpec("acc", column=1, unit="g"),))
    with caplog.at_level(logging.WARNING):
        blocks = list(open_source(spec))
    assert [type(block) for block in blocks] == [Block] * 4
    assert sum("smpl_clk_hz" in record.message for record in caplog.records) == 1
    caplog.clear()
    silent = SourceSpec("s", str(folder), block_s="file", channels=spec.channels, disregard=("smpl_clk_hz",))
    with caplog.at_level(logging.WARNING):
        assert len(list(open_source(silent))) == 4
    assert not caplog.records


def test_data_sets_of_one_value_state_what_attributes_do(tmp_path: Path) -> None:
    beside = {"smpl_clk_hz": (np.float64(25600.0), {}), "acq_begin": (b"2024-01-01T00:00:00Z", {})}
    path = write_hdf5(tmp_path / "x.h5", ROWS, START_TEXT, {"unit": "g"}, fs=(np.float64(RATE), {}), **beside)
    assert sw.read(path).attrs["rate_hz"] == RATE
    found = " ".join(doubts_in(tmp_path, path))
    assert all(text in found for text in ("smpl_clk_hz '25600.0'", "acq_begin '2024-01-01T00:00:00Z'"))
    wrong = write_hdf5(tmp_path / "y.h5", ROWS, {"fs": RATE}, {"unit": "g"}, dt=(np.float64(2e-4), {}))
    with pytest.raises(sw.SpallwatchError, match=r"4096.*5000|5000.*4096"):
        sw.read(wrong)


def test_a_note_beside_a_recording_bears_on_it(tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", ROWS[0])
    (tmp_path / "x.txt").write_text("Sample Rate: 4096 Hz\nUnit: g\nsmpl_clk_hz: 25600\n", encoding="utf-8")
    (said,) = doubts_in(tmp_path, tmp_path / "x.npy")
    assert "smpl_clk_hz '25600'" in said


@pytest.mark.parametrize("key", NOT_BEARING)
def test_keys_of_other_things_bear_on_nothing(key: str) -> None:
    assert [fact for fact, unit in bearings_of(key) if unit != "?"] == []


@pytest.mark.parametrize(
    ("key", "fact"),
    [
        *((key, "rate") for key in ("AbtastFrequenzKanal1", "smpl_clk_hz", "acq.fs_khz", "Taux de scan")),
        *((key, "step") for key in ("Abtast_Abstand_us", "periodo_campionamento_s", "dt_ns")),
        *((key, "sensitivity") for key in ("amp_V_per_g", "Empfindlichkeit_Kanal_2", "sens_ch1_mV_per_g")),
        *((key, "factor") for key in ("Kalibrierfaktor_neu", "cal_coeff_a", "SkalierungsFaktor2")),
        *((key, "zone") for key in ("tz_minutes", "clock_utc_shift_h", "fuseau_machine")),
    ],
)  # fmt: skip
def test_words_of_keys_in_five_languages(key: str, fact: str) -> None:
    assert fact in [found for found, unit in bearings_of(key) if unit != "?"]


def test_a_date_under_an_unknown_key_has_each_of_its_readings() -> None:
    facts = {plain_key("Aufnahme_begonnen"): "25/03/21 10:00:00"}
    (one,) = unlisted_in(facts, [], "UTC")
    assert one.fact == "start"
    assert {datetime.fromtimestamp(time, UTC).date() for time in one.readings} == {date(2021, 3, 25), date(2025, 3, 21)}

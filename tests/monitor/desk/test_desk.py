"""The import desk: what files are read as, what is refused and in which words, and that all callers write the same."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spallwatch as sw
from monitor.config.load import load_config
from monitor.desk.judge.problems import find_problems
from tests.support.commands import run_command
from tests.support.press import RATE, write_press

GIVEN: dict[str, Any] = {"bearing": "6205", "speed_hz": "29.5 Hz"}


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_press(tmp_path_factory.mktemp("desk") / "press")


def test_a_description_gives_readings_evidence_and_what_is_open(press: Path) -> None:
    found = sw.describe(press)
    assert [(column.title, column.unit, column.origin) for column in found.columns] == [
        ("drive end (g)", "g", "stated"),
        ("other end (g)", "g", "stated"),
    ]
    assert found.columns[0].place == "column 2 of 2026-03-01_000000.csv"
    assert found.columns[0].rms_g == pytest.approx(1.0, rel=0.02)
    facts = {fact.key: fact for fact in found.facts}
    assert (facts["rate_hz"].value, facts["rate_hz"].origin) == ("10000 Hz", "stated")
    assert facts["rate_hz"].place.startswith("2026-03-01_000000.csv: the times in 'time' '0, 0.0001")
    assert (facts["speed_hz"].value, facts["speed_hz"].origin) == (None, "open")
    assert (facts["load_newton"].value, facts["load_newton"].origin) == ("unknown", "assumed")
    assert [question.key for question in found.missing] == ["bearing", "speed_hz"]
    assert [date.time for date in found.dates] == [pytest.approx(1_772_323_200.0 + 3600 * hour) for hour in range(3)]
    with pytest.raises(sw.DeskError, match=r"bearing: Bearing\..*speed_hz: Speed"):
        found.configuration()


def test_a_preview_shows_levels_fault_lines_and_what_check_says(press: Path) -> None:
    preview = sw.describe(press, **GIVEN).preview()
    first = preview.channels[0]
    lines = sw.fault_frequencies("6205", 29.5)
    assert first.lines["outer"] == pytest.approx([k * lines.bpfo for k in range(1, 6)])
    assert first.lines["ball"] == pytest.approx([2 * k * lines.bsf for k in range(1, 6)])
    assert (first.rms, first.peak) == (pytest.approx(1.0, rel=0.02), pytest.approx(3.93, abs=0.01))
    assert len(preview.ends) == 2
    assert preview.doubts == ()
    assert first.spectrum.step * first.spectrum.high.size >= RATE / 2
    assert first.signal.high.max() <= first.peak


def test_the_spectrum_shows_the_amplitude_of_a_sine(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", 2.0 * np.sin(2 * np.pi * 1000.0 * np.arange(RATE) / RATE))
    found = sw.describe(tmp_path / "a.npy", unit="m/s2", rate_hz=RATE, **GIVEN).preview().channels[0]
    peak = int(np.argmax(found.spectrum.high))
    assert found.spectrum.high[peak] == pytest.approx(2.0 / 9.80665, rel=1e-3)
    assert peak * found.spectrum.step == pytest.approx(1000.0, abs=found.spectrum.step)


def test_the_configuration_is_that_of_init_and_check_takes_it(press: Path, tmp_path: Path) -> None:
    out = tmp_path / "press.toml"
    found = sw.describe(press, out=out, **GIVEN)
    assert found.save() == out
    with pytest.raises(sw.DeskError, match=r"press\.toml is there already"):
        sw.describe(press, out=out, **GIVEN).save()
    config = load_config(out)
    assert [channel.column for channel in config.channel] == ["drive end (g)", "other end (g)"]
    assert list(find_problems(config)) == []
    done = run_command("init", str(press), "--bearing", "6205", "--speed-hz", "29.5", "--yes", "--out", "init.toml",
                       cwd=tmp_path)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "init.toml").read_text().replace("init.toml", "press.toml") == out.read_text()


def test_columns_are_chosen_by_title_name_or_number(press: Path) -> None:
    for name in ("other end (g)", "other_end", "3"):
        found = sw.describe(press, columns=[name], **GIVEN)
        assert [column.taken for column in found.columns] == [False, True]
        assert found.configuration().count("[[channel]]") == 1
        assert 'column = "other end (g)"' in found.configuration()


def _two_sensors(folder: Path) -> Path:
    """Write files of two sensors in turn, whose names do not tell them apart."""
    folder.mkdir()
    random = np.random.default_rng(2)
    for number in range(8):
        np.save(folder / f"f{number:03d}.npy", random.normal(size=8000) * (1.0 if number % 2 else 4.0))
    return folder


def _other_program(folder: Path) -> Path:
    folder.mkdir()
    with zipfile.ZipFile(folder / "report.docx", "w") as archive:
        archive.writestr("word/document.xml", "<a/>")
    return folder


def _empty(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _press(folder: Path) -> Path:
    return write_press(folder)


def _in_ms2(folder: Path) -> Path:
    """Write a file without a unit that shows gravity in m/s2."""
    folder.mkdir()
    np.save(folder / "a.npy", 9.80665 + np.random.default_rng(3).normal(size=8000))
    return folder


Made = Callable[[Path], Path]
REFUSED: list[tuple[str, Made, dict[str, Any], str, str]] = [
    ("rpm as Hz", _press, {"speed_hz": 1770}, "speed_hz", "did you mean 1770 rpm?"),
    ("comma of thousands", _press, {"speed_hz": "1,770 rpm"}, "speed_hz", "can be read as 1.770 or 1770"),
    ("no unit at all", _press, {"unit": "furlong"}, "unit", "g, m/s2, V, unknown, mm/s, mV, mg; got 'furlong'"),
    ("another unit than stated", _press, {"unit": "m/s2"}, "unit", "drive end (g) of 2026-03-01_000000.csv states g"),
    ("no such bearing", _press, {"bearing": "9999"}, "bearing", "'9999' is not in the catalogue"),
    ("another rate than stated", _press, {"rate_hz": 5000}, "rate_hz", "csv states 10000 Hz"),
    ("no such column", _press, {"columns": ["x"]}, "columns", "expected some of drive end (g), other end (g)"),
    ("no folder", lambda folder: folder / "none", {}, "", "there is no "),
    ("empty folder", _empty, {}, "", "holds no files"),
    ("another program", _other_program, {}, "", "a zip archive; unpack it into the folder"),
    ("no name", _press, {"name": "a b/c"}, "name", "got 'a b/c'"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "given", "key", "said"), [case[1:] for case in REFUSED], ids=[c[0] for c in REFUSED])
def test_what_people_get_wrong_is_refused_by_name(
    tmp_path: Path, make: Made, given: dict[str, Any], key: str, said: str
) -> None:
    with pytest.raises(sw.DeskError) as refused:
        sw.describe(make(tmp_path / "recording"), **(GIVEN | given))
    assert refused.value.key == key
    assert said in str(refused.value)


DOUBTED: list[tuple[str, Made, dict[str, Any], str]] = [
    ("rpm as Hz, with its unit", _press, {"speed_hz": "1770 Hz"}, "29.5 Hz if rpm was meant"),
    ("g for m/s2", _in_ms2, {"unit": "g", "rate_hz": 8000}, "is the unit m/s2?"),
    (
        "two sensors in turn",
        _two_sensors,
        {"unit": "g", "rate_hz": 8000},
        "of those between, over 8; expected blocks of one sensor",
    ),
]


@pytest.mark.parametrize(("make", "given", "said"), [case[1:] for case in DOUBTED], ids=[case[0] for case in DOUBTED])
def test_what_only_the_samples_show_is_a_problem_of_the_preview(
    tmp_path: Path, make: Made, given: dict[str, Any], said: str
) -> None:
    doubts = sw.describe(make(tmp_path / "recording"), **(GIVEN | given)).preview().doubts
    assert any(doubt.severity == "problem" and said in doubt.text for doubt in doubts), doubts


def test_a_decimal_comma_is_read(press: Path) -> None:
    found = sw.describe(press, bearing="9 7,94 39,04", speed_hz="29,5")
    assert "element_diameter_mm = 7.94" in found.configuration()
    assert "speed_hz = 29.5" in found.configuration()


def test_an_answer_that_is_none_is_a_programming_error(press: Path) -> None:
    with pytest.raises(TypeError, match="'speed' is no answer; expected one of bearing, speed_hz"):
        sw.describe(press, speed=29.5)  # pyright: ignore[reportCallIssue]


def _three_columns(folder: Path) -> Path:
    """Write a file of 1 g in mV at 98.1 mV/g, 0.5 g in g, and a tacho, of which only the tacho states a unit."""
    folder.mkdir(exist_ok=True)
    noise = np.random.default_rng(4).normal(size=(2, RATE))
    tacho = np.where(np.arange(RATE) * 29.5 / RATE % 1.0 < 0.1, 4.8, 0.1)
    rows = np.column_stack([98.1 * noise[0] / noise[0].std(), 0.5 * noise[1] / noise[1].std(), tacho])
    place = folder / "2026-03-01_000000.csv"
    np.savetxt(place, rows, "%.6f", ",", header=f"Sample rate: {RATE} Hz\nDE,NDE,Tacho [V]", comments="")
    return place


OWN: dict[str, dict[str, Any]] = {
    "in words": {"unit": "DE=mV; NDE=g", "sensitivity_mv_per_g": "DE=98.1 mV/g"},
    "one for all others": {"unit": "g; DE=mV", "sensitivity_mv_per_g": 98.1},
    "by names": {"unit": {"DE": "mV", "NDE": "g"}, "sensitivity_mv_per_g": {"DE": 98.1}},
    "the other way round": {"unit": {"": "mV", "NDE": "g"}, "sensitivity_mv_per_g": {"DE": "10.0034 mV/(m/s2)"}},
    "the unit of one number": {"unit": "DE=g; NDE=g", "scale": "DE=0.0101936799"},
}


@pytest.mark.parametrize("given", OWN.values(), ids=OWN)
def test_each_column_has_a_unit_and_a_sensitivity_of_its_own(given: dict[str, Any], tmp_path: Path) -> None:
    found = sw.describe(_three_columns(tmp_path), out=tmp_path / "config.toml", **(GIVEN | given))
    assert [column.rms_g for column in found.columns if column.taken] == pytest.approx([1.0, 0.5], rel=1e-3)
    found.save()
    config = load_config(tmp_path / "config.toml")
    assert [channel.name for channel in config.channel] == ["DE", "NDE"]
    assert config.channel[1].unit == "g"
    assert config.channel[1].scale in (None, 1.0)
    assert config.channel[1].sensitivity_mv_per_g is None
    assert config.operating.tacho_channel == "Tacho [V]"


def test_the_command_takes_the_units_of_columns_in_the_same_words(tmp_path: Path) -> None:
    place = _three_columns(tmp_path / "data")
    given = OWN["in words"]
    found = sw.describe(place, out=tmp_path / "python.toml", **(GIVEN | given)).configuration()
    words = ["--unit", given["unit"], "--sensitivity-mv-per-g", given["sensitivity_mv_per_g"]]
    done = run_command("init", str(place), "--bearing", "6205", "--speed-hz", "29.5 Hz", *words, "--yes", "--out",
                       "python.toml", cwd=tmp_path)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "python.toml").read_text() == found
    done = run_command("replay", str(place), "--config", "python.toml", "--out", "out", "--no-report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    records = sw.open_records(next((tmp_path / "out" / "records").glob("*.nc")))
    assert (records["rms"].values.ravel() / 9.80665) == pytest.approx([1.0, 0.5], rel=1e-3)


def test_the_columns_that_are_left_open_are_asked(tmp_path: Path) -> None:
    place = _three_columns(tmp_path)
    (question,) = sw.describe(place, unit={"DE": "mV"}, sensitivity_mv_per_g=98.1, **GIVEN).missing
    assert question.key == "unit"
    assert question.why.startswith("NDE: no unit is stated")
    assert "DE=mV; NDE=g" in question.why
    with pytest.raises(sw.DeskError, match=r"unit: 'XDE' is no channel; expected one of DE, NDE"):
        sw.describe(place, unit={"XDE": "mV"}, **GIVEN)
    with pytest.raises(sw.DeskError, match=r"rate_hz: expected one answer for all channels"):
        sw.describe(place, rate_hz={"DE": 1.0}, **GIVEN)  # pyright: ignore[reportArgumentType]


def test_where_no_column_seems_vibration_the_columns_are_asked(tmp_path: Path) -> None:
    times = np.arange(RATE) / RATE
    lines = [f"{time:.4f},{20 + time:.4f}" for time in times]
    (tmp_path / "a.csv").write_text("\n".join(["time (s),temperature (degC)", *lines, ""]))
    found = sw.describe(tmp_path / "a.csv", **GIVEN)
    assert [question.key for question in found.missing] == ["columns"]
    assert not any(column.taken for column in found.columns)


def test_files_that_are_left_out_are_named_with_what_was_seen_in_them(tmp_path: Path) -> None:
    write_press(tmp_path / "press", count=1)
    (tmp_path / "press" / "2026-03-01_010000.csv").write_text("time (s),drive end (g),other end (g)\n0,1,x y z\n")
    _other_program(tmp_path / "press" / "notes")
    facts = {fact.key: fact for fact in sw.describe(tmp_path / "press").facts}
    assert "notes/report.docx (" in facts["ignored"].place
    assert "a zip archive" in facts["ignored"].place
    assert "2026-03-01_010000.csv: line 2" in facts["refused"].place

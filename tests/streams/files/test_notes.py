"""A text beside a recording whose format states little."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import soundfile

from spallwatch import read
from spallwatch.recordings import RecordingError
from streams.files.survey import survey

VOLTS = np.sin(np.arange(4096.0))


def wav(folder: Path, note: str, name: str = "pump.txt") -> Path:
    soundfile.write(folder / "pump.wav", VOLTS, 4096, subtype="DOUBLE")
    (folder / name).write_text(note)
    return folder / "pump.wav"


@pytest.mark.parametrize("name", ["pump.txt", "pump.wav.txt", "pump.info"])
def test_it_states_unit_sensitivity_speed_and_start(tmp_path: Path, name: str) -> None:
    path = wav(tmp_path, "Unit: V\nSensitivity: 50 mV/g\nSpeed: 1488 rpm\nStart: 2026-01-01T12:00:00Z\n", name)
    found = read(path)
    assert found.values[0] == pytest.approx(VOLTS * 20.0 * 9.80665)
    assert found.attrs["start_utc"].startswith("2026-01-01T12:00:00")
    surveyed = survey(str(tmp_path))
    assert surveyed.speed == pytest.approx(24.8)
    assert surveyed.ignored == ()


@pytest.mark.parametrize(
    ("note", "words"),
    [
        ("Unit: g\nSample rate: 8192 Hz\n", "the file 4096 Hz, samplerate 8192 Hz"),
        ("Unit: g\nUnits: V\n", "several units"),
    ],
)
def test_what_contradicts_is_refused(tmp_path: Path, note: str, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        read(wav(tmp_path, note))


def test_a_text_without_a_known_key_is_none(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"unit is missing|no unit"):
        read(wav(tmp_path, "Pump of the north hall\nSee the manual.\n"))


def test_another_sensitivity_than_the_configured_one_is_refused(tmp_path: Path) -> None:
    path = wav(tmp_path, "Unit: V\nSensitivity: 50 mV/g\n")
    assert read(path, unit="V", sensitivity_mv_per_g=50.2).values.max() == pytest.approx(9.80665 * 1e3 / 50.2, rel=1e-3)
    with pytest.raises(RecordingError, match="50 mV/g by the recording, 100 by sensitivity_mv_per_g"):
        read(path, unit="V", sensitivity_mv_per_g=100.0)

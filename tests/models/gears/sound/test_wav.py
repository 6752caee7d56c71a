"""WAV files of sound pressure: calibrated, read by others, nothing clipped."""

from __future__ import annotations

import io

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from models.gears.sound.wav import WavError, full_scale_for, read_wav, write_wav


def tones(samples: int = 1000) -> np.ndarray:
    time = np.arange(samples) / 8000.0
    return np.stack([0.5 * np.sin(2.0 * np.pi * 440.0 * time), 0.1 * np.cos(2.0 * np.pi * 100.0 * time)])


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("samples", [999, 1000])
def test_pressure_comes_back_to_half_a_count(tmp_path, channels, samples):
    path, pressure = tmp_path / "a.wav", tones(samples)[:channels]
    write_wav(path, pressure, 8000, full_scale=1.0)
    sound = read_wav(path)
    assert (sound.rate, sound.full_scale) == (8000, 1.0)
    assert np.max(np.abs(sound.pressure - pressure)) <= 0.5 / (1 << 23) * (1.0 + 1e-9)


def test_another_reader_finds_the_same_pressure_and_the_full_scale(tmp_path):
    path = tmp_path / "a.wav"
    write_wav(path, tones(), 8000, full_scale=2.0)
    with soundfile.SoundFile(io.BytesIO(path.read_bytes())) as file:
        assert (file.samplerate, file.subtype, file.comment) == (8000, "PCM_24", "spallwatch full_scale_pascal=2.0")
        assert pytest.approx(0.5 * tones(), abs=1e-7) == file.read(always_2d=True).T


@given(st.floats(1e-9, 1e6))
def test_the_round_full_scale_holds_the_peak(peak):
    scale = full_scale_for([-peak])
    assert peak <= scale <= 2.5 * peak * (1.0 + 1e-6)


def test_silence_has_a_full_scale():
    assert full_scale_for(np.zeros(3)) == 1.0


@pytest.mark.parametrize(
    ("pressure", "said"),
    [([0.5, 1.0], "would clip"), ([np.nan], "finite"), ([], "shape"), (np.zeros((2, 2, 2)), "shape")],
)
def test_what_a_file_cannot_hold_is_refused_and_the_old_file_stays(tmp_path, pressure, said):
    path = tmp_path / "a.wav"
    path.write_bytes(b"old")
    with pytest.raises(WavError, match=said):
        write_wav(path, pressure, 8000, full_scale=1.0)
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("a.wav", b"old")]


def test_rate_and_full_scale_are_checked(tmp_path):
    with pytest.raises(ValueError, match="rate"):
        write_wav(tmp_path / "a.wav", [0.0], 8000.5, full_scale=1.0)
    with pytest.raises(ValueError, match="full_scale"):
        write_wav(tmp_path / "a.wav", [0.0], 8000, full_scale=0.0)


def test_a_file_that_states_no_full_scale_is_refused(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, np.zeros(10), 8000, subtype="PCM_24")
    with pytest.raises(WavError, match=r"a\.wav: expected the comment"):
        read_wav(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda b: b[:-5], "promises"),
        (lambda b: b"RIFX" + b[4:], "expected a WAV file"),
        (lambda b: b.replace(b"pascal=1.0", b"pascal=-1."), "positive full_scale_pascal"),
        (lambda b: b.replace(b"pascal=1.0", b"pascal=one"), "positive full_scale_pascal"),
        (lambda b: b.replace(b"\x18\x00LIST", b"\x10\x00LIST"), "expected 24-bit integers"),
        (lambda b: b.replace(b"data", b"dada"), "expected the chunks"),
    ],
)
def test_a_damaged_file_is_refused_by_name(tmp_path, change, said):
    path = tmp_path / "a.wav"
    write_wav(path, tones(), 8000, full_scale=1.0)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(WavError, match=f"a.wav: .*{said}"):
        read_wav(path)

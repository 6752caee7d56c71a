"""Order spectra of single signals, with the angle from pulses, a channel or a speed."""

from __future__ import annotations

import numpy as np
import pytest

import spallwatch as sw

RATE, N = 8000.0, 16_000
TIME = np.arange(N) / RATE
SPEED = np.linspace(20.0, 20.0 + 4.0 * TIME[-1], 321)
TURNS = 20.0 * TIME + 2.0 * TIME**2
MARKS = 8


def pulse_times() -> np.ndarray:
    turns = np.arange(0.0, TURNS[-1], 1.0 / MARKS)
    return -5.0 + np.sqrt(25.0 + 0.5 * turns)


def signal() -> np.ndarray:
    line = 3.0 * np.cos(2.0 * np.pi * 5.5 * TURNS)
    return line + (1.0 + 0.5 * np.cos(2.0 * np.pi * 3.25 * TURNS)) * np.cos(2.0 * np.pi * 2500.0 * TIME)


@pytest.mark.parametrize(
    "angle", [{"speed_hz": SPEED}, {"pulse_times_s": pulse_times(), "pulses_per_revolution": MARKS}]
)
def test_a_line_of_constant_order_reads_its_amplitude(angle):
    found = sw.order_spectrum(signal(), rate_hz=RATE, unit="m/s2", max_order=40.0, **angle)
    assert found.dims == ("channel", "order")
    assert found.attrs["revolutions"] == pytest.approx(48.0, abs=0.02)
    assert found.attrs["speed_max_hz"] == pytest.approx(28.0, rel=0.01)
    near = found.sel(order=slice(5.4, 5.6))
    assert float(np.sqrt((near**2).sum() / 1.5)) == pytest.approx(3.0, rel=2e-3)
    assert float(found.sel(order=slice(8.0, 30.0)).max()) < 0.01


def test_the_envelope_of_a_fixed_tone_modulated_by_the_shaft_has_its_order():
    found = sw.order_spectrum(signal(), rate_hz=RATE, unit="m/s2", speed_hz=SPEED, band_hz=(2000, 3000))
    near = found.sel(order=slice(3.0, 3.5))
    assert float(np.sqrt((near**2).sum() / 1.5)) == pytest.approx(0.5, rel=5e-3)
    assert found.envelope_mean.item() == pytest.approx(1.0, rel=0.01)
    assert found.attrs["band_hz"] == [2000.0, 3000.0]


def test_a_channel_of_the_signal_gives_the_angle():
    tacho = (TURNS * MARKS % 1.0 < 0.5).astype(np.float64)
    both = sw.to_signal(np.stack([signal(), tacho]), rate_hz=RATE, unit="m/s2", channels=["drive", "tacho"])
    found = sw.order_spectrum(both, tacho_channel="tacho", pulses_per_revolution=MARKS, max_order=40.0)
    assert found.channel.values.tolist() == ["drive"]
    near = found.sel(order=slice(5.4, 5.6))
    assert float(np.sqrt((near**2).sum() / 1.5)) == pytest.approx(3.0, rel=5e-3)


@pytest.mark.parametrize(
    ("angle", "message"),
    [
        ({}, "expected speed_hz, tacho_channel or pulse_times_s, got none"),
        ({"speed_hz": 20.0, "pulse_times_s": [0.0]}, "expected pulses or speed_hz, got both: pulse_times_s"),
        ({"speed_hz": np.linspace(2.0, 20.0, 50)}, "the speed varies from .* Hz, at most by a factor of 6"),
        ({"speed_hz": [20.0, -1.0]}, "speed_hz: expected a positive number"),
        ({"pulse_times_s": [0.1, 0.2]}, "too_few: 2 pulses in 2 s give no angle"),
        ({"tacho_channel": "tacho"}, "tacho_channel: 'tacho' is not beside another channel of the signal: channel_1"),
    ],
)
def test_without_one_angle_there_is_no_spectrum(angle, message):
    with pytest.raises(sw.SpallwatchError, match=message):
        sw.order_spectrum(signal(), rate_hz=RATE, unit="m/s2", **angle)

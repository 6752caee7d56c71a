"""The spectrum of the angular speed in the Python interface."""

from __future__ import annotations

import numpy as np
import pytest

import spallwatch as sw
from tests.monitor.health.signal.rotation.wheels import MARKS, eccentric, wheel

TRAIN = wheel(60, lines=[(4.5, 1e-3, 0.0)], error=eccentric(0.05))


def test_a_spectrum_over_events_per_revolution():
    found = sw.ias_spectrum(TRAIN.times, pulses_per_revolution=MARKS)
    assert found.dims == ("order",)
    assert found.attrs["units"] == "rad s-1"
    assert found.sel(order=4.5, method="nearest").item() == pytest.approx(2 * np.pi * 40.0 * 1e-3, rel=1e-2)
    assert found.attrs["wheel_error_deg"] == pytest.approx(0.05, rel=0.02)
    without = sw.ias_spectrum(TRAIN.times, pulses_per_revolution=MARKS, remove_wheel=True)
    assert without.sel(order=1.0, method="nearest") < 0.01 * found.sel(order=1.0, method="nearest")
    figure = sw.plot_spectrum(found, sw.fault_frequencies("6205", 1.0), log=True)
    assert figure.axes[0].get_xlabel() == "events per revolution"


def test_a_track_of_an_encoder():
    rate = 51_200.0
    time = np.arange(round(rate)) / rate
    track = sw.to_signal(np.sign(np.sin(2 * np.pi * 32 * 40.0 * time)), rate_hz=rate, unit="unknown")
    found = sw.ias_spectrum(track, pulses_per_revolution=32)
    assert found.attrs["speed_hz"] == pytest.approx(40.0, rel=1e-4)


def test_what_has_no_speed_is_refused():
    with pytest.raises(sw.SignalError, match="never fall"):
        sw.ias_spectrum([1.0, 0.5], pulses_per_revolution=8)
    with pytest.raises(sw.SignalError, match="16 turns or more"):
        sw.ias_spectrum(wheel(4).times, pulses_per_revolution=MARKS)

"""Spectra, features and names of single signals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

import spallwatch as sw
from reference.signals import bearing_lines, impacts

RATE, SPEED, BAND = 25600.0, 30.0, (2000.0, 6000.0)


@pytest.fixture(scope="module")
def outer():
    _, lines = bearing_lines("6205", SPEED)
    samples = impacts(np.random.default_rng(3), "outer", lines, rate=RATE)
    return sw.to_signal(samples, rate_hz=RATE, unit="m/s2", channels=["drive"])


def test_a_line_reads_its_amplitude():
    time = np.arange(25600) / RATE
    signal = 3.0 * np.sin(2 * np.pi * 1000.0 * time)
    found = sw.spectrum(signal, rate_hz=RATE, unit="m/s2")
    assert found.sel(frequency=1000.0, method="nearest").item() == pytest.approx(3.0, rel=1e-4)
    assert float(found.max()) == pytest.approx(3.0, rel=1e-4)


def test_the_envelope_of_a_modulated_tone_has_its_line():
    time = np.arange(25600) / RATE
    signal = (2.0 + 0.5 * np.cos(2 * np.pi * 100.0 * time)) * np.sin(2 * np.pi * 4000.0 * time)
    found = sw.envelope_spectrum(signal, BAND, rate_hz=RATE, unit="m/s2")
    assert found.sel(frequency=100.0, method="nearest").item() == pytest.approx(0.5, rel=1e-3)
    assert found.envelope_mean.item() == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("fault", ["outer", "inner"])
def test_a_seeded_fault_is_named(fault):
    _, lines = bearing_lines("6205", SPEED)
    samples = impacts(np.random.default_rng(1), fault, lines, rate=RATE)
    found = sw.name_fault(
        samples, bearing="6205", speed_hz=SPEED, band_hz=BAND, speed_exact=True, rate_hz=RATE, unit="m/s2"
    )
    assert found.fault == fault
    assert found.verified


def test_noise_is_not_named():
    samples = np.random.default_rng(2).standard_normal(51200)
    found = sw.name_fault(samples, bearing="6205", speed_hz=SPEED, speed_exact=True, rate_hz=RATE, unit="g")
    assert found.fault is None


def test_features_are_those_of_a_monitor(outer, tmp_path):
    """The record that the whole program makes of the same samples has the same values."""
    np.save(tmp_path / "signal.npy", outer.values)
    conditions = {"bearing": "6205", "speed_hz": SPEED}
    found = sw.features(outer, **conditions)
    records = sw.replay(tmp_path / "signal.npy", block_s="file", rate_hz=RATE, unit="m/s2", **conditions)
    for name in ("rms", "kurtosis", "h_or", "h_ir", "band_lo", "envelope_snr", "fault_depth"):
        np.testing.assert_array_equal(found[name].values, records[name].isel(time=0).values, err_msg=name)
    assert found.fault.item() == records.fault.isel(time=0).item() == "outer"


def test_features_have_units_and_parts_by_name(outer):
    found = sw.features(outer, bearing="6205", speed_hz=SPEED, band_hz=BAND, speed_exact=True)
    assert found.rms.attrs["units"] == "m s-2"
    assert found.band_lo.item() == BAND[0]
    snr = found.envelope_snr.sel(channel="drive")
    assert snr.sel(part="outer").max() > 5.0 * snr.sel(part="cage").max()
    assert not [name for name in found.data_vars if str(name).startswith(("tt_", "v_eq", "t_fs"))]


def test_a_geometry_is_as_good_as_its_designation(outer):
    by_name = sw.features(outer, bearing="6205", speed_hz=SPEED)
    by_size = sw.features(outer, bearing=sw.bearing("6205"), speed_hz=SPEED)
    np.testing.assert_allclose(by_size.h_or.values, by_name.h_or.values, rtol=1e-12)


def test_what_a_recording_states_of_its_speed_is_taken(outer):
    stated = outer.assign_attrs(speed_hz=SPEED)
    assert sw.features(stated, bearing="6205").speed.item() == SPEED
    assert sw.features(stated, bearing="6205", speed_hz=29.9).speed.item() == 29.9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda signal: signal.where(signal.time > 0.1), "nan"),
        (lambda signal: signal.drop_attrs(), "rate_hz"),
        (lambda signal: signal.values, "rate_hz and unit"),
        (lambda signal: signal.isel(time=slice(32)), "64"),
    ],
)
def test_what_cannot_be_analysed_is_refused_with_the_reason(outer, change, message):
    with pytest.raises(sw.SpallwatchError, match=f"(?i){message}"):
        sw.features(change(outer), bearing="6205", speed_hz=SPEED)


def test_a_dead_sensor_is_said(outer):
    found = sw.features(xr.zeros_like(outer), bearing="6205", speed_hz=SPEED)
    assert "flat" in found.attrs["flags"].split()
    assert "fault" not in found


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"bearing": "no such"}, "no such"),
        ({"speed_hz": -1.0}, "speed_hz"),
        ({"speed_hz": None}, "speed_hz"),
        ({"band_hz": (6000.0, 2000.0)}, "band_hz"),
        ({"band_hz": (2000.0, 20000.0)}, "12800"),
    ],
)
def test_wrong_arguments_are_named(outer, wrong, message):
    arguments: dict[str, Any] = {"bearing": "6205", "speed_hz": SPEED, **wrong}
    with pytest.raises(sw.SpallwatchError, match=message):
        sw.features(outer, **arguments)


def test_one_channel_is_named_at_a_time(outer):
    both = sw.to_signal(np.vstack([outer.values, outer.values]), rate_hz=RATE, unit="m/s2", channels=["a", "b"])
    with pytest.raises(sw.SpallwatchError, match="a, b"):
        sw.name_fault(both, bearing="6205", speed_hz=SPEED)
    assert sw.name_fault(both.sel(channel="b"), bearing="6205", speed_hz=SPEED, speed_exact=True).fault == "outer"

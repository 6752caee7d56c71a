"""Signals with the pulses of a tacho: features and names over the angle of the shaft."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import spallwatch as sw
from tests.support.varying_speed import DESIGNATION, PULSES, RATE, block, turns_of

NUMBER = 110


@pytest.fixture(scope="module")
def signal() -> xr.DataArray:
    """A damaged outer race at a speed that varies by 30 % within the signal."""
    return sw.to_signal(block(NUMBER).T, rate_hz=RATE, unit="m/s2", channels=["radial", "axial", "tacho"])


def test_features_with_a_tacho_are_over_the_angle(signal: xr.DataArray) -> None:
    found = sw.features(signal, bearing=DESIGNATION, tacho_channel="tacho", pulses_per_revolution=PULSES)
    angle, speed = turns_of(NUMBER, np.random.default_rng(1000 + NUMBER))
    assert found.channel.values.tolist() == ["radial", "axial"]
    assert found.domain.values.tolist() == ["order", "order"]
    assert found.speed_min.values == pytest.approx(speed.min(), rel=0.01)
    assert found.speed_max.values == pytest.approx(speed.max(), rel=0.01)
    assert found.revolutions.values == pytest.approx(angle[-1] - angle[0], rel=1e-3)
    mean = float(found.speed.values[0])
    smeared = sw.features(signal.isel(channel=[0]), bearing=DESIGNATION, speed_hz=mean)
    assert smeared.domain.values.tolist() == ["hertz"]
    assert float(found.h_or[0]) > 2.0 * float(smeared.h_or[0])


def test_the_part_is_named_with_the_pulses_on_far_more_evidence_than_without(signal: xr.DataArray) -> None:
    edges = np.flatnonzero(np.diff((signal.values[2] > 2.5).astype(int)) > 0) / RATE
    one = signal.isel(channel=[0])
    given = one.assign_attrs(pulse_times_s=edges, pulses_per_revolution=PULSES)
    named = sw.name_fault(given, bearing=DESIGNATION)
    assert named.fault == "outer"
    # A part of the signal takes the pulses that belong to it.
    part = sw.features(given.isel(time=slice(RATE, 3 * RATE)), bearing=DESIGNATION)
    _, speed = turns_of(NUMBER, np.random.default_rng(1000 + NUMBER))
    assert float(part.speed[0]) == pytest.approx(speed[RATE : 3 * RATE].mean(), rel=2e-3)
    smeared = sw.name_fault(one, bearing=DESIGNATION, speed_hz=float(speed.mean()))
    assert named.evidence is not None
    assert smeared.evidence is not None
    assert named.evidence.family_snr > 3.0 * smeared.evidence.family_snr


def test_wrong_pulses_are_refused_by_name(signal: xr.DataArray) -> None:
    with pytest.raises(sw.SpallwatchError, match="'other' is not beside another channel"):
        sw.features(signal, bearing=DESIGNATION, tacho_channel="other")
    with pytest.raises(sw.SpallwatchError, match="expected one of tacho_channel, pulse_times_s, got both"):
        sw.features(signal, bearing=DESIGNATION, tacho_channel="tacho", pulse_times_s=[0.0])
    with pytest.raises(sw.SpallwatchError, match="must be finite and never fall"):
        sw.features(signal, bearing=DESIGNATION, pulse_times_s=[1.0, 0.5])
    with pytest.raises(TypeError, match="'tacho' is not an argument"):
        sw.features(signal, bearing=DESIGNATION, tacho="tacho")  # pyright: ignore[reportCallIssue]

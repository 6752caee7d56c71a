"""Loading: rates that agree, channels that are found, units that are converted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from streams.files.judge import agreed_rate
from streams.files.load import choose_channels
from streams.types.block import STANDARD_GRAVITY, to_si
from streams.types.samples import ReaderError, Samples
from streams.types.spec import ChannelSpec


def test_rate_is_what_all_agree_on() -> None:
    assert agreed_rate((48828.0, None), 48828.125, "x") == 48828.0
    assert agreed_rate((None, None), 100.0, "x") == 100.0
    for stated, configured in (((None, None), None), ((100.0, None), 101.0), ((100.0, 200.0), None)):
        with pytest.raises(ReaderError, match="x: ") as caught:
            agreed_rate(stated, configured, "x")
        assert caught.value.status == "wrong_rate"


SAMPLES = Samples(np.zeros((3, 4)), ("X1_DE_time", "X1_FE_time", "rpm"), units=("g", "g", None))


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        (ChannelSpec("a", key="X*_time", unit="g"), "2 columns by key 'X*_time'"),
        (ChannelSpec("a", key="y*", unit="g"), "no column by key 'y*'"),
        (ChannelSpec("a", column=4, unit="g"), "no column by column 4; the file has X1_DE_time, X1_FE_time, rpm"),
        (ChannelSpec("a", column="b", unit="g"), "no column by column 'b'"),
        (ChannelSpec("a", unit="g"), "no column by its name"),
        (ChannelSpec("rpm"), "no unit is stated"),
        (ChannelSpec("X1_DE_time", unit="m/s2"), "the recording is in g, unit = 'm/s2'; write unit = \"g\""),
    ],
)
def test_channel_that_does_not_fit(channel: ChannelSpec, words: str) -> None:
    with pytest.raises(ReaderError) as caught:
        choose_channels(SAMPLES, (channel,), None, "x.mat")
    assert words in str(caught.value)
    assert caught.value.status in ("wrong_shape", "wrong_unit")


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_units(dtype: type[np.floating]) -> None:
    samples = np.array([[1.0, -2.0]], dtype=dtype)
    g, unit = to_si(samples, "g")
    assert unit == "m/s2"
    assert g.dtype == dtype
    np.testing.assert_allclose(g, [[STANDARD_GRAVITY, -2 * STANDARD_GRAVITY]], rtol=1e-7)
    same, unit = to_si(samples, "m/s2")
    assert same is samples
    assert unit == "m/s2"
    volts, unit = to_si(samples, "V", scale=0.5, sensitivity_mv_per_g=100.0)
    assert unit == "m/s2"
    np.testing.assert_allclose(volts, [[5 * STANDARD_GRAVITY, -10 * STANDARD_GRAVITY]], rtol=1e-6)
    unknown, unit = to_si(samples, "unknown", scale=2.0)
    assert unit == "unknown"
    assert_array_equal(unknown, [[2, -4]])
    assert_array_equal(samples, [[1, -2]])


def test_units_that_are_wrong() -> None:
    samples = np.zeros((1, 2))
    with pytest.raises(ValueError, match="must be g, m/s2, V, unknown or mm/s, got 'm/s'"):
        to_si(samples, "m/s")
    for sensitivity in (None, 0.0, -1.0):
        with pytest.raises(ValueError, match="sensitivity_mv_per_g"):
            to_si(samples, "V", sensitivity_mv_per_g=sensitivity)


def test_conversion_of_extreme_samples_does_not_warn() -> None:
    converted, _ = to_si(np.array([[3e38, np.nan, np.inf]], dtype=np.float32), "g")
    assert math.isinf(converted[0, 0])


@pytest.mark.parametrize(
    ("stated", "unit", "channel", "factor"),
    [
        ("mV", "V", {"sensitivity_mv_per_g": 100.0}, 1e-3),
        ("mV", "V", {"sensitivity_mv_per_g": 100.0, "scale": 2e-3}, 1.0),
        ("mg", "g", {}, 1e-3),
        ("mg", None, {}, 1e-3),
        ("mm/s²", "m/s2", {}, 1e-3),
        ("mm/s", None, {}, 1.0),
        ("m/s", "mm/s", {}, 1e3),
        ("ips", None, {}, 25.4),
        ("µm/s", None, {}, 1e-3),
        ("g", "g", {}, 1.0),
    ],
)
def test_multiples_of_a_unit_are_converted_unless_a_scale_is_given(stated, unit, channel, factor):
    samples = Samples(np.ones((2, 4)), names=("a", "b"), units=(stated, "g"))
    chosen = choose_channels(samples, [ChannelSpec("a", unit=unit, **channel), ChannelSpec("b", unit="g")], None, "f")
    ours = {"mV": "V", "mg": "g", "mm/s²": "m/s2", **dict.fromkeys(("m/s", "ips", "µm/s"), "mm/s")}
    assert chosen.units == (ours.get(stated, stated), "g")
    assert_array_equal(chosen.values, np.array([[factor], [1.0]]) * np.ones((2, 4)))


def test_multiples_of_a_unit_are_converted_where_no_channel_is_configured():
    samples = Samples(np.ones((1, 4), np.float32), units=("mg",))
    chosen = choose_channels(samples, [], None, "f")
    assert (chosen.units, chosen.values.dtype) == (("g",), np.float32)
    assert_array_equal(chosen.values, np.full((1, 4), np.float32(1e-3)))


def test_a_multiple_of_another_unit_is_refused():
    samples = Samples(np.ones((1, 4)), names=("a",), units=("mV",))
    with pytest.raises(ReaderError, match="the recording is in V, unit = 'g'"):
        choose_channels(samples, [ChannelSpec("a", unit="g")], None, "f")

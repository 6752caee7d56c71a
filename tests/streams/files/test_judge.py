"""The judge of statements: agreement is a fact, disagreement a refusal that quotes both places."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streams.files.circumstances import without
from streams.files.formats.text import read_layout
from streams.files.judge import StatedRow, agreed_rate, judge_rate, judged, opened_rate
from streams.files.load import choose_channels
from streams.files.statements import StatedNumber, nearest, number_in, plain_key, rate_statements
from streams.types.samples import ReaderError
from streams.types.spec import ChannelSpec

NOON = 1_714_564_800.0
"""2024-05-01 12:00 UTC, s."""


def text(*lines: str, rate: float = 4096.0, times: bool = False) -> bytes:
    rows = (f"{i / rate:.9f},{math.sin(i)}" if times else f"{math.sin(i)}" for i in range(64))
    return "\n".join((*lines, *rows)).encode()


@pytest.mark.parametrize(
    ("value", "readings"),
    [
        ("4096", (4096.0,)),
        ("4.096", (4.096,)),
        ("4,096", (4.096, 4096.0)),
        ("25,6 kHz", (25600.0,)),
        ("25 600 kHz", (25600000.0,)),
        ("25\N{NO-BREAK SPACE}600,5", (25600.5,)),
        ("4,096.0 Hz", (4096.0,)),
        ("1.234.567", (1234567.0,)),
        ("0,500", (0.5,)),
        ("2,441406250000E-04", (2.44140625e-4,)),
        ("25600 rpm", None),
        ("1,2,3", None),
        ("", None),
        (True, None),
        (np.float32(50.0), (50.0,)),
        (math.inf, None),
    ],
)
def test_a_number_has_the_readings_that_its_signs_leave(value: object, readings: tuple[float, ...] | None) -> None:
    found = number_in(value, "place", {"": 1.0, "hz": 1.0, "khz": 1e3})
    assert (None if found is None else found.readings) == (None if readings is None else pytest.approx(readings))


@given(st.floats(1e-3, 1e6), st.integers(2, 9))
def test_a_number_lies_within_its_resolution(value: float, digits: int) -> None:
    found = number_in(f"{value:.{digits}f}", "place", {"": 1.0})
    assert found is not None
    assert abs(found.readings[0] - value) <= found.resolution * (1.0 + 1e-9) + 1e-12 * value


@given(st.floats(100.0, 2e5), st.lists(st.integers(3, 12), min_size=1, max_size=4))
def test_statements_of_one_rate_agree_however_they_are_rounded(rate: float, digits: list[int]) -> None:
    stated = [number_in(f"{1.0 / rate:.{count}e}", f"dt{count}", {"": 1.0}) for count in digits]
    facts = {f"dt#{one.place}": one.written for one in stated if one is not None}
    found = judge_rate(rate_statements(facts, "x"), "x").value
    assert found is not None
    assert abs(found - rate) <= max(1e-4, 10.0 ** -max(digits)) * rate


@given(st.floats(100.0, 2e5), st.sampled_from([1e-3, 1e3, 1.01, 0.5, 2.0, 1e-6]))
def test_rates_that_differ_are_refused_with_both_places(rate: float, factor: float) -> None:
    stated = [StatedNumber("one", f"{rate}", (rate,)), StatedNumber("other", f"{rate * factor}", (rate * factor,))]
    for statements in (stated, stated[::-1]):
        with pytest.raises(ReaderError, match=r"one .* Hz") as caught:
            judge_rate(statements, "x")
        assert "other" in str(caught.value)
        assert caught.value.status == "wrong_rate"


def test_a_quoted_value_is_taken_whole() -> None:
    found = read_layout(text('# Sampling Frequency,"4,096 Hz"', '"Unit";"m/s²"', "acc"), "x.csv")
    assert (found.rate_readings, found.units) == ((4.096, 4096.0), ("m/s2",))


def test_an_open_rate_is_decided_by_another_statement_or_by_the_configuration() -> None:
    ambiguous = text("Sample Rate: 4,096 Hz", "Unit: g", "acc")
    found = read_layout(ambiguous, "x.csv")
    assert found.rate is None
    assert found.rate_readings == (4.096, 4096.0)
    with pytest.raises(ReaderError, match=r"'4,096 Hz' may mean 4.096 or 4096 Hz; give"):
        agreed_rate((found.rate,), None, "x.csv", opened_rate(found))
    assert agreed_rate((found.rate,), 4096.0, "x.csv", opened_rate(found)) == 4096.0
    with pytest.raises(ReaderError, match="rate_hz is 5000"):
        agreed_rate((found.rate,), 5000.0, "x.csv", opened_rate(found))
    assert read_layout(text("Sample Rate: 4,096 Hz", "t,acc", times=True), "x.csv").rate == 4096.0


def test_a_step_that_is_rounded_too_coarsely_is_no_rate() -> None:
    found = read_layout(text("dt: 0.000039", "acc"), "x.csv")
    assert found.rate is None
    assert found.rate_readings == pytest.approx((25641.0256,))
    assert agreed_rate((None,), 25600.0, "x", opened_rate(found)) == 25600.0
    assert read_layout(text("dt: 0.00004", "acc"), "x.csv").rate == 25000.0


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (("Sample Rate: 4096 Hz", "fs: 8192", "acc"), "samplerate 4096 Hz, fs 8192 Hz"),
        (("Sample Rate: 4096 Hz", "Sample Rate: 8192 Hz", "acc"), r"Sample Rate \(again\) 8192 Hz"),
        (("Sample Rate: 4096 kHz", "t,acc"), "the times in 't' 4096 Hz"),
        (("Unit: m/s2", "acc [g]"), "acc .* g, unit m/s2"),
        (("Start Time: 2024-05-01T12:00:00Z", "Recorded at: 2024-05-01T13:00:00Z", "acc"), "starttime .* recordedat"),
        (("Date: 2024-05-01", "Time: 12:00:00", "Start Time: 11:00:00", "acc"), "several times of its start"),
        (("RPM: 1500", "Speed: 24 Hz", "acc"), "several values of the speed"),
    ],
)
def test_two_statements_of_a_text_that_differ_are_refused(head: tuple[str, ...], words: str) -> None:
    with pytest.raises(ReaderError, match=words):
        read_layout(text(*head, times="t,acc" in head), "x.csv")


def test_what_is_not_believed_does_not_count() -> None:
    data = text("Sample Rate: 4096 Hz", "fs: 8192", "Unit: g", "acc")
    for pattern in ("fs", "FS", "f*"):
        assert read_layout(data, "x.csv", "UTC", (pattern,)).rate == 4096.0
    assert read_layout(data, "x.csv", "UTC", ("Sample Rate",)).rate == 8192.0
    assert without({"fs": 1.0, "scalefactor": 2.0, "other": 3}, ("*",)) == {"other": 3}


@pytest.mark.parametrize(
    ("title", "unit", "counts"),
    [
        ("Time (us)", "", 1e6),
        ("t [ms]", "", 1e3),
        ("Time_ns", "", 1e9),
        ("epoch_ms", "", 1e3),
        ("Zeit", "", 1e6),
        ("micros", "", 1e6),
    ],
)
def test_a_column_of_times_counts_in_its_unit(title: str, unit: str, counts: float) -> None:
    rows = "\n".join(f"{i / 4096.0 * counts:.4f},{math.sin(i)}" for i in range(256))
    found = read_layout(f"{title},acc [g]\n{rows}\n".encode(), "x.csv")
    assert found.channels == ("acc",)
    if title == "Zeit":
        # Nothing states the unit, and 0.004 Hz is no rate of vibration.
        assert found.rate is None
        assert min(abs(rate - 4096.0) for rate in found.rate_readings) < 1.0
    else:
        assert found.rate == 4096.0


@pytest.mark.parametrize("counts", [1.0, 1e3, 1e6, 1e9])
def test_times_since_1970_are_told_by_their_size(counts: float) -> None:
    rows = "\n".join(f"{(NOON + i / 1000.0) * counts:.4f},{math.sin(i)}" for i in range(2000))
    found = read_layout(f"timestamp,acc [g]\n{rows}\n".encode(), "x.csv")
    assert (found.channels, found.rate) == (("acc",), 1000.0)
    assert found.start == pytest.approx(NOON, abs=1e-3)


def test_a_head_in_another_zone_than_configured_is_refused_with_what_to_write() -> None:
    rows = "\n".join(f"{(NOON + i / 1000.0):.3f},{math.sin(i)}" for i in range(2000))
    data = f"Date: 2024-05-01 14:00:00\ntimestamp,acc\n{rows}\n".encode()
    assert read_layout(data, "x.csv", "Europe/Berlin").start == pytest.approx(NOON, abs=1e-3)
    with pytest.raises(ReaderError, match=r"several times of its start: .* 2 h off: write its zone as timezone"):
        read_layout(data, "x.csv")
    with pytest.raises(ReaderError, match=r"several times of its start: [^;]*; name what"):
        read_layout(data.replace(b"-05-", b"-04-"), "x.csv")


def test_running_numbers_are_no_channels_by_name_or_without_one() -> None:
    rows = [f"{i},{i / 4096.0:.9f},{math.sin(i):.6f}" for i in range(64)]
    found = read_layout("\n".join(rows).encode(), "x.txt")
    assert (found.columns, found.rate) == ((3,), 4096.0)
    named = read_layout(("Nr.,t,acc\n" + "\n".join(rows)).encode(), "x.csv")
    assert (named.channels, named.rate) == (("acc",), 4096.0)
    # One that does not count by ones may be anything.
    assert read_layout(b"no,acc\n1,2\n5,3\n2,4\n", "x.csv").channels == ("no", "acc")


@pytest.mark.parametrize(("line", "factor"), [("Scale: 3.9 mg/LSB", 3.9e-3), ("Sensitivity: 256 LSB/g", 1 / 256.0)])
def test_counts_are_in_g_where_one_count_is_stated(line: str, factor: float) -> None:
    found = read_layout(f"Unit: counts\n{line}\nacc\n100\n-50\n3\n".encode(), "x.csv")
    expected = np.array([100.0, -50.0, 3.0]) * factor
    alone = choose_channels(found, (), None, "x.csv")
    assert alone.units == ("g",)
    assert alone.values[0] == pytest.approx(expected)
    # A scale of the configuration, which is applied to the block, is the same one and not a second.
    for unit, scale in (("g", factor), ("m/s2", factor * 9.80665)):
        own = choose_channels(found, (ChannelSpec("acc", unit=unit, scale=scale),), None, "x.csv")
        assert own.values[0] == pytest.approx([100.0, -50.0, 3.0])
    with pytest.raises(ReaderError, match="g a count by the recording, 1 by scale"):
        choose_channels(found, (ChannelSpec("acc", unit="g", scale=1.0),), None, "x.csv")


def test_rows_of_one_file_must_agree_in_unit_rate_and_start() -> None:
    values = np.ones(4)

    def joined(*facts: dict[str, object]) -> object:
        rows = [StatedRow(values, f"row{i}", f"row{i}", one) for i, one in enumerate(facts)]
        return judged(rows, "x", "channels", "UTC")

    joined({"fs": 100.0, "unit": "g"}, {"fs": 100.0, "unit": "m/s2"})
    with pytest.raises(ReaderError, match="fs of row0 100 Hz, fs of row1 200 Hz"):
        joined({"fs": 100.0}, {"fs": 200.0})
    with pytest.raises(ReaderError, match=r"start of row0 .* start of row1"):
        joined({"start": "2024-05-01T12:00:00Z"}, {"start": "2024-05-01T12:00:02Z"})
    with pytest.raises(ReaderError, match="unit g, of the file m/s2"):
        joined(nearest({"unit": "m/s2"}, {"unit": "g"}, "of the file"))
    joined(nearest({"unit": "m/s2"}, {"unit": "degC"}, "of the file"))


def test_keys_are_told_with_accents_and_units() -> None:
    assert plain_key("Fréquence d'échantillonnage (Hz)") == "frequencedechantillonnagehz"
    found = read_layout("Période d'échantillonnage: 0,05 ms\nacc [m/s²]\n1,5\n2,5\n".encode(), "x.txt")
    assert (found.rate, found.units) == (20000.0, ("m/s2",))


@pytest.mark.parametrize(
    ("head", "start"),
    [
        (("Time zone: UTC+2", "Start: 2024-05-01 14:00:00"), NOON),
        (("Zeitzone: Europe/Berlin", "Start: 2024-05-01 14:00:00"), NOON),
        (("Time zone: MESZ", "Date: 01.05.2024", "Time: 14:00:00"), NOON),
        (("Time zone: CET", "Start: 2024-05-01 12:00:00Z"), NOON),
    ],
)
def test_a_zone_may_stand_in_a_line_of_its_own(head: tuple[str, ...], start: float) -> None:
    assert read_layout(text(*head, "acc"), "x.csv").start == start


def test_points_group_thousands_where_commas_are_decimal() -> None:
    found = read_layout(b"Abtastrate: 4.096 Hz\nacc [g]\n0,1\n0,2\n", "x.csv")
    assert (found.rate, found.rate_readings) == (None, (4.096, 4096.0))
    assert read_layout(b"Abtastrate: 4.096 kHz\nacc [g]\n0.1\n0.2\n", "x.csv").rate == 4096.0


@given(st.sampled_from([-9999.0, 9999.0, 1e20, -999.0]), st.lists(st.integers(0, 63), min_size=1, max_size=9))
def test_codes_of_missing_samples_are_no_numbers(code: float, places: list[int]) -> None:
    values = np.sin(np.arange(64.0))
    values[places] = code
    found = read_layout(("acc [g]\n" + "\n".join(f"{value:.6f}" for value in values)).encode(), "x.csv")
    assert sorted(np.flatnonzero(np.isnan(found.values[0]))) == sorted(set(places))
    if abs(code) >= 1e15:
        return
    # A signal that reaches them is not cut.
    large = np.where(values == code, code, 0.2 * abs(code) * np.sin(np.arange(64.0)))
    whole = judged([StatedRow(large, "a", "a", {})], "x", "rows", "UTC")
    assert np.isfinite(whole.values).all()


def test_times_that_are_too_coarse_are_compared_but_state_no_rate() -> None:
    rows = "\n".join(f"{i / 4096.0:.3f},{math.sin(i):.6f}" for i in range(128))
    alone = read_layout(f"t [s],acc\n{rows}\n".encode(), "x.csv")
    assert alone.rate is None
    assert opened_rate(alone).fits(4096.0)
    assert read_layout(f"fs: 4096\nt [s],acc\n{rows}\n".encode(), "x.csv").rate == 4096.0
    labview = "LabVIEW Measurement\t\n***End_of_Header***\t\nDelta_X\t{}\n***End_of_Header***\t\nX_Value\ta\n"
    body = "\n".join(f"{i / 4096.0:.9f}\t{math.sin(i):.6f}" for i in range(128))
    assert read_layout((labview.format("0.000244140625") + body).encode(), "x.lvm").rate == 4096.0
    with pytest.raises(ReaderError, match="several sampling rates"):
        read_layout((labview.format("0.244140625") + body).encode(), "x.lvm")
    with pytest.raises(ReaderError, match="several sampling rates"):
        read_layout(f"fs: 4.5\nt [s],acc\n{rows}\n".encode(), "x.csv")
    assert read_layout(f"fs: 4.096\nt [s],acc\n{rows}\n".encode(), "x.csv").rate == 4096.0


def test_the_unit_in_a_name_is_a_statement_in_every_format() -> None:
    values = np.ones(4)
    row = StatedRow(values, "group/acc [g]", "acc [g]", {})
    assert judged([row], "x", "channels", "UTC").units == ("g",)
    with pytest.raises(ReaderError, match=r"unit m/s2, the name 'acc \[g\]' g"):
        judged([StatedRow(values, "acc [g]", "acc [g]", {"unit": "m/s2"})], "x", "channels", "UTC")
    assert judged([StatedRow(values, "T [degC]", "T [degC]", {"unit": "g"})], "x", "rows", "UTC").units == ("g",)


def test_one_column_may_have_a_line_of_its_unit_below_a_name_with_blanks() -> None:
    found = read_layout(b"fs: 100\nacc axial\nm/s2\n0.1\n0.2\n", "x.csv")
    assert (found.channels, found.units) == (("acc axial",), ("m/s2",))
    with pytest.raises(ReaderError, match="several units"):
        read_layout(b"acc [g]\nm/s2\n0.1\n0.2\n", "x.csv")


@pytest.mark.parametrize(("sign", "decimal"), [("\t", "."), ("\t", ","), (",", ".")])
@pytest.mark.parametrize("channels", [1, 2])
def test_labview_leaves_out_times_and_comments(sign: str, decimal: str, channels: int) -> None:
    values = np.round(np.sin(np.arange(40.0 * channels)).reshape(40, channels), 5)
    head = ["LabVIEW Measurement", f"Decimal_Separator{sign}{decimal}", f"X_Columns{sign}No", "***End_of_Header***", ""]
    head += [sign.join(["Y_Unit_Label", *["g"] * channels]), sign.join(["Delta_X", *["0.001"] * channels])]
    head += ["***End_of_Header***", sign.join(["X_Value", *(f"a{i}" for i in range(channels)), "Comment"])]
    rows = [sign.join(["", *(f"{value:.5f}".replace(".", decimal) for value in row), ""]) for row in values]
    found = read_layout("\r\n".join([*head, *rows, ""]).encode(), "x.lvm")
    assert found.values == pytest.approx(values.T)
    assert (found.rate, found.units) == (1000.0, ("g",) * channels)


def test_a_column_in_another_unit_says_so() -> None:
    found = read_layout(b"fs: 100\np [Pa],T [\xc2\xb0C],acc [left],b [g]\n1,2,3,4\n2,1,4,3\n", "x.csv")
    assert found.units == ("Pa", "\N{DEGREE SIGN}C", None, "g")
    assert found.channels == ("p [Pa]", "T [\N{DEGREE SIGN}C]", "acc [left]", "b")

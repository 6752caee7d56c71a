from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.gears.transfer.frf import FrequencyResponses
from monitor.gears.frf_files import FrfError, frf_to_csv, frf_to_uff, read_frf
from tests.support.effort import effort_count

pyuff = pytest.importorskip("pyuff")
HEAD = "frequency_hz,output,input,real_m_per_s2_per_newton,imag_m_per_s2_per_newton\n"


def responses(frequency: NDArray[np.float64] | None = None, unit: str = "m/s2") -> FrequencyResponses:
    frequency = np.arange(100.0, 110.0, 2.5) if frequency is None else frequency
    h = np.random.default_rng(3).normal(size=(2, frequency.size, 2, 3)) * 1e-2
    return FrequencyResponses(frequency, h[0] + 1j * h[1], ("acc1.x", "12.z"), ("left.x", "left.y", "7.z"), unit)


def assert_same(found: FrequencyResponses, expected: FrequencyResponses, rtol: float) -> None:
    assert (found.outputs, found.inputs) == (expected.outputs, expected.inputs)
    assert (found.output_unit, found.input_unit) == (expected.output_unit, expected.input_unit)
    np.testing.assert_allclose(found.frequency, expected.frequency, rtol=rtol)
    np.testing.assert_allclose(found.h, expected.h, rtol=rtol)


@settings(max_examples=effort_count(quick=8, full=200), deadline=None)
@given(
    st.lists(st.floats(0.0, 1e5), min_size=2, max_size=6, unique=True),
    st.sampled_from(["m/s2", "m/s", "m", "Pa"]),
    st.lists(st.text("ab,;'\"1", min_size=1, max_size=8), min_size=2, max_size=2, unique=True),
)
def test_csv_gives_back_every_bit(lines: list[float], unit: str, names: list[str]) -> None:
    frequency = np.sort(np.array(lines))
    h = np.random.default_rng(len(lines)).normal(size=(2, frequency.size, 1, 2))
    frf = FrequencyResponses(frequency, h[0] + 1j * h[1], ("out",), tuple(names), unit)
    assert_same(read_frf(frf_to_csv(frf).encode(), "x.csv"), frf, rtol=0.0)


@pytest.mark.parametrize("frequency", [np.arange(100.0, 110.0, 2.5), np.array([10.0, 11.0, 20.0, 5000.1])])
@pytest.mark.parametrize("unit", ["m/s2", "m/s", "m", "Pa"])
def test_universal_files_give_back_their_digits(frequency: NDArray[np.float64], unit: str) -> None:
    frf = responses(frequency, unit)
    assert_same(read_frf(frf_to_uff(frf), "x.uff"), frf, rtol=5e-13)


def test_a_universal_file_of_pyuff_is_read(tmp_path: Path) -> None:
    """Written by other code: one response, g over lbf, in -Y and +Z."""
    path = tmp_path / "x.uff"
    h = np.array([1.0 + 2.0j, 3.0 - 1.0j, 0.5 + 0.25j])
    pyuff.UFF(str(path)).write_sets(
        pyuff.prepare_58(
            binary=0, func_type=4, rsp_node=4, rsp_dir=-2, ref_node=9, ref_dir=3, load_case_id=0,
            data=h, x=np.array([10.0, 12.0, 14.0]), id1="frf", rsp_ent_name="NONE", ref_ent_name="shaker",
            abscissa_spacing=1, abscissa_min=10.0, abscissa_inc=2.0, num_pts=3, ord_data_type=6,
            abscissa_spec_data_type=18, ordinate_spec_data_type=12, orddenom_spec_data_type=13,
            ordinate_axis_units_lab="g", orddenom_axis_units_lab="lbf",
        ),
        "overwrite",
    )  # fmt: skip
    found = read_frf(path.read_bytes(), "x.uff")
    assert (found.outputs, found.inputs) == (("4.y",), ("shaker.z",))
    np.testing.assert_allclose(found.h[:, 0, 0], -h * 9.80665 / 4.4482216152605)
    np.testing.assert_allclose(found.frequency, [10.0, 12.0, 14.0])


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_functions_are_read(order: str) -> None:
    frf = responses().select(["12.z"], ["7.z"])
    before, head, values = frf_to_uff(frf).partition(b"    58" + 74 * b" ")
    lines = values.split(b"\n")
    body = np.stack([frf.h.real, frf.h.imag], axis=-1).astype(f"{order}f8").tobytes()
    mark = f"    58b{1 if order == '<' else 2:6d}{2:6d}{11:12d}{len(body):12d}{0:6d}{0:6d}{0:12d}{0:12d}".encode()
    data = before + mark + b"\n".join(lines[:12]) + b"\n" + body + b"\n    -1\n"
    assert head
    assert_same(read_frf(data, "x.uff"), frf, rtol=0.0)


def test_pyuff_reads_what_is_written(tmp_path: Path) -> None:
    frf = responses()
    path = tmp_path / "x.uff"
    path.write_bytes(frf_to_uff(frf))
    sets = pyuff.UFF(str(path)).read_sets()
    assert sets[0]["type"] == 164
    assert sets[0]["units_code"] == 1
    first, last = sets[1], sets[-1]
    assert (first["rsp_ent_name"].strip(), first["rsp_dir"], first["ref_ent_name"].strip()) == ("acc1", 1, "left")
    assert (last["rsp_node"], last["rsp_dir"], last["ref_node"], last["ref_dir"]) == (12, 3, 7, 3)
    np.testing.assert_allclose(last["data"], frf.h[:, 1, 2], rtol=5e-13)


def test_magnitude_and_phase_and_g_are_read() -> None:
    text = "# a comment\nfrequency_hz,output,input,magnitude_g_per_newton,phase_deg\n1,a,f,2,90\n2,a,f,1,-180\n"
    found = read_frf(text.encode(), "x.csv")
    np.testing.assert_allclose(found.h[:, 0, 0], [2j * 9.80665, -9.80665], atol=1e-14)
    assert found.output_unit == "m/s2"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "x.csv: expected a line of column names, found none"),
        ("f,a\n", r"x.csv, line 1: expected the columns frequency_hz,output.* found f,a"),
        (HEAD, "x.csv: expected frequency responses, found none"),
        (HEAD + "1,a,f,2,x\n", "x.csv, line 2: expected a frequency, two names and .* numbers, found '1,a,f,2,x'"),
        (HEAD + "1,a,f,2,nan\n", "x.csv, line 2: expected a frequency"),
        (HEAD + "1,a,f,2,3,4\n", "x.csv, line 2: expected a frequency"),
        (HEAD + "1,a,f,2,3\n", "x.csv: frequency must be .* two lines at least"),
        (HEAD + "2,a,f,2,3\n1,a,f,2,3\n", "x.csv: frequency must be .* ascending, got 1.0 Hz"),
        (HEAD + "1,a,f,2,3\n2,a,f,2,3\n1,b,f,2,3\n", "from line 4: expected the frequencies of .* are 2 from 1 to 2"),
        (HEAD + "1,a,f,1,1\n2,a,f,1,1\n1,b,g,1,1\n2,b,g,1,1\n", "x.csv: .* missing: a over g, b over f"),
    ],
)  # fmt: skip
def test_csv_that_cannot_be_used_is_named_with_its_line(text: str, message: str) -> None:
    with pytest.raises(FrfError, match=message):
        read_frf(text.encode(), "x.csv")


def changed(old: str, new: str, count: int = 1) -> bytes:
    text = frf_to_uff(responses().select(["12.z"], ["left.x", "7.z"])).decode()
    assert text.count(old) >= count
    return text.replace(old, new, count).encode()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("    4         0    0         0", "    4         0    0         5", "data set 2: expected one excitation"),
        ("        12   3 left", "        12   5 left", "data set 2: expected a direction from -3 to 3 at 12, found 5"),
        (
            "Acceleration         m/s2",
            "Acceleration         furl",
            "data set 2: expected a numerator in one of .*'furl'",
        ),
        ("Acceleration         m/s2", "Acceleration         m/s ", "said to be in 'm/s' and of a type in m/s2"),
        ("       6         4         1", "       6         5         1", "data set 2: 5 values promised, 4 there"),
        ("       6         4         1", "       4         4         1", "data set 2: expected complex numbers"),
        (" 2.50000e+00", " 2.40000e+00", r"expected the frequencies of x.uff: data set 2 \(12.z over left.x\)"),
        (" NONE               7   3", " left               1   1", "was given before, at x.uff: data set 2"),
    ],
)
def test_functions_that_cannot_be_used_are_named(old: str, new: str, message: str) -> None:
    data = changed(old, new)
    with pytest.raises(FrfError, match=message):
        read_frf(data, "x.uff")


def test_other_functions_are_left() -> None:
    data = changed("    4         0    0         0", "    6         0    0         0")
    assert read_frf(data, "x.uff").inputs == ("7.z",)
    with pytest.raises(FrfError, match=r"x.uff: expected frequency responses, found none"):
        read_frf(data.replace(b"    4         0    0         0", b"    1         0    0         0"), "x.uff")


def test_a_unit_is_told_by_its_type_only_where_the_file_says_si() -> None:
    data = changed("Acceleration         m/s2", "Acceleration         NONE", 2)
    assert read_frf(data, "x.uff").output_unit == "m/s2"
    with pytest.raises(FrfError, match="expected the unit of the numerator, found none and no data set 164"):
        read_frf(data.replace(b"         1Meter (newton)", b"         2Foot (pound f)"), "x.uff")


def test_files_that_are_broken_off_are_refused() -> None:
    data = frf_to_uff(responses())
    with pytest.raises(FrfError, match="breaks off within a data set"):
        read_frf(data[: len(data) // 2], "x.uff")
    with pytest.raises(FrfError, match=r"x.uff: not a readable universal file"):
        read_frf(data.replace(b"e-0", b"zz", 1), "x.uff")


@settings(max_examples=effort_count(quick=40, full=2000), deadline=None)
@given(st.booleans(), st.integers(0, 10**6), st.integers(0, 255), st.integers(0, 60))
def test_changed_bytes_are_read_or_refused_by_name(universal: bool, place: int, byte: int, cut: int) -> None:
    data = bytearray(frf_to_uff(responses()) if universal else frf_to_csv(responses()).encode())
    place %= len(data)
    data[place : place + cut] = bytes([byte])
    refused = None
    try:
        assert np.isfinite(read_frf(bytes(data), "some file").h).all()
    except FrfError as error:
        refused = str(error)
    assert refused is None or "some file" in refused


@pytest.mark.parametrize("data", [b'a,"' + b"x" * 200000, b"\xff\xfe1,2"])
def test_what_is_no_csv_is_refused(data: bytes) -> None:
    with pytest.raises(FrfError, match=r"x.csv: expected CSV"):
        read_frf(data, "x.csv")


def test_what_a_universal_file_cannot_hold_is_refused() -> None:
    frf = responses()
    with pytest.raises(ValueError, match="up to 10 characters, got 'accelerometer'"):
        frf_to_uff(FrequencyResponses(frf.frequency, frf.h[:, :1], ("accelerometer.x",), frf.inputs))
    with pytest.raises(ValueError, match="six digits"):
        frf_to_uff(responses(np.array([1000.0, 1000.001])))
    with pytest.raises(ValueError, match=r"universal files know .*, got 'V'"):
        frf_to_uff(responses(unit="V"))
    with pytest.raises(ValueError, match="V over N have no column name"):
        frf_to_csv(responses(unit="V"))

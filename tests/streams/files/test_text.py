from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streams.files.formats.text import read_text
from streams.types.samples import ReaderError
from tests.oracles.text_oracle import parse_slowly

NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=64)


# The first file imports pandas, which takes longer than a case may.
@given(
    rows=st.integers(1, 4).flatmap(
        lambda n: st.lists(st.lists(NUMBERS, min_size=n, max_size=n), min_size=2, max_size=12)
    ),
    separator=st.sampled_from([",", ";", "\t", " ", "   "]),
    form=st.sampled_from(["{!r}", "{:.4e}", "{:.3f}", "{:+.6E}"]),
    ending=st.sampled_from(["\n", "\r\n"]),
    last=st.booleans(),
)
def test_reads_what_the_slow_way_reads(
    rows: list[list[float]], separator: str, form: str, ending: str, last: bool
) -> None:
    text = ending.join(separator.join(form.format(value) for value in row) for row in rows) + (ending if last else "")
    expected = parse_slowly(text.encode(), None if separator.isspace() else separator)
    reading = read_text(text.encode(), "x.csv")
    assert reading.values.shape == expected.shape
    assert reading.values.flags.c_contiguous
    np.testing.assert_allclose(reading.values, expected, rtol=4e-16, atol=1e-307)


def test_header_names_the_columns() -> None:
    reading = read_text(b'"time",acc h,acc v\n0,1.5,2\n1,2.5,3\n', "x.csv")
    assert reading.names == ("time", "acc h", "acc v")
    assert reading.values.tolist() == [[0, 1], [1.5, 2.5], [2, 3]]


def test_byte_order_mark_comments_and_no_final_newline() -> None:
    reading = read_text(b"\xef\xbb\xbf# from a logger\n% second\n1;2\n3;4", "x.csv")
    assert reading.values.tolist() == [[1, 3], [2, 4]]
    assert reading.names == ("column_1", "column_2")


@pytest.mark.parametrize(("separator"), [";", "\t"])
def test_decimal_commas_where_they_are_unambiguous(separator: str) -> None:
    text = f"0,552{separator}-1,5e-1\n2{separator}3,25\n"
    assert read_text(text.encode(), "x.csv").values.tolist() == [[0.552, 2], [-0.15, 3.25]]


def test_not_a_number_and_infinity_are_samples() -> None:
    samples = read_text(b"1,nan\ninf,-inf\n", "x.csv").values
    np.testing.assert_array_equal(samples, [[1, np.inf], [np.nan, -np.inf]])


def test_number_beyond_single_precision_becomes_infinite() -> None:
    samples = read_text(b"1,1e308\n2,3\n", "x.csv", precision=np.float32).values
    assert samples.dtype == np.float32
    np.testing.assert_array_equal(samples, [[1, 2], [np.inf, 3]])


def test_some_columns_only() -> None:
    reading = read_text(b"8;40;1.5;2\n8;41;2.5;3\n", "x.csv", columns=(3, 4), n_columns=4)
    assert reading.values.tolist() == [[1.5, 2.5], [2, 3]]
    assert reading.columns == (3, 4)


@pytest.mark.parametrize("chosen", [None, (2, 3)])
@pytest.mark.parametrize(
    ("text", "status", "where"),
    [
        (b"", "empty", "0 bytes"),
        (b" \n\n", "empty", "no line of numbers"),
        (b"# only a comment\n", "empty", "no line of numbers"),
        (b"a,b,c\n", "empty", "header"),
        (b"1,2,3\n4,5\n6,7,8\n", "wrong_shape", "line 2: expected 3 columns, found 2"),
        (b"1,2,3\n4,5,6,7\n", "wrong_shape", "line 2: expected 3 columns, found 4"),
        (b"1,2,3\n\n4,5,6\n", "wrong_shape", "line 2: expected 3 columns, found 1"),
        (b"1,2,3\n4,,6\n", "unreadable", "line 2, column 2: expected a number, found ''"),
        (b"1,2,3\n4,x5,6\n", "unreadable", "line 2, column 2: expected a number, found 'x5'"),
        (b"1,2,3\n4,1_0,6\n", "unreadable", "line 2, column 2"),
        (b"1,2,3\n4,5,6\n7,8", "incomplete", "line 3: expected 3 columns, found 2"),
        (b"1,2,3\n4,5,6\n7,8,-", "incomplete", "line 3, column 3"),
        (b"t,a,b\n1,2,3\n4,5,oops\n", "unreadable", "line 3, column 3: expected a number, found 'oops'"),
        (b"t,a\n1,2,3\n4,5,6\n", "wrong_shape", "2 names in the header, 3 columns"),
        (b"1,2,3\n\x00\x01\x02", "unreadable", "binary"),
        (b"hello\nworld\n", "unreadable", "line 2, column 1: expected a number, found 'world'"),
        ("é,ü,x\n1,ß,2\n".encode(), "unreadable", "line 2, column 2"),
    ],
)
def test_what_is_wrong_and_where(text: bytes, status: str, where: str, chosen: tuple[int, ...] | None) -> None:
    with pytest.raises(ReaderError) as caught:
        read_text(text, "x.csv", columns=chosen)
    assert caught.value.status == status
    assert "x.csv" in str(caught.value)
    assert where in str(caught.value)


def test_no_header_where_none_may_be() -> None:
    with pytest.raises(ReaderError, match="line 1, column 1"):
        read_text(b"a,b\n1,2\n", "x.csv", header=False)


def test_column_that_is_not_there() -> None:
    with pytest.raises(ReaderError, match="expected at least 5 columns, found 2") as caught:
        read_text(b"1,2\n3,4\n", "x.csv", columns=(1, 5))
    assert caught.value.status == "wrong_shape"


def test_number_of_columns() -> None:
    with pytest.raises(ReaderError, match="expected 4 or 8 columns, found 2") as caught:
        read_text(b"1,2\n3,4\n", "x.csv", n_columns=(4, 8))
    assert caught.value.status == "wrong_shape"

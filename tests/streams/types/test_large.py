"""Files that are read from disk piece by piece give what the same bytes give in memory."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from streams.files.container import content_hash, open_files, read_regular, unpack
from streams.files.formats.npy_wav import read_plain_npy
from streams.files.formats.text import read_layout
from streams.files.parse.child import isolated
from streams.files.parse.complete import declared_size
from streams.types import large
from streams.types.large import FileBytes
from streams.types.samples import ReaderError, Samples
from tests.streams.format_makers import (
    signal,
)
from tests.support.large import FILES, LENGTH, Reader, npy_bytes, on_disk, text_bytes


@pytest.fixture
def small_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "MAX_IN_MEMORY", 1000)
    monkeypatch.setattr(large, "PIECE_BYTES", 999)


def assert_same(found: Samples, wanted: Samples) -> None:
    for field in fields(Samples):
        one, other = getattr(found, field.name), getattr(wanted, field.name)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype
            assert one.flags.c_contiguous
            np.testing.assert_array_equal(one, other)
        elif field.name == "pulses" and one is not None:
            np.testing.assert_array_equal(one.times, other.times)
        else:
            assert one == other, field.name


def verdict(reader: Reader, data: object, name: str) -> tuple[str, str]:
    try:
        reader(data, name)
    except ReaderError as error:
        # Behind a bracket are the words of a library.
        return error.status, str(error).partition("(")[0]
    return "read", ""


@pytest.mark.parametrize("kind", FILES)
def test_a_file_on_disk_gives_the_samples_of_its_bytes(
    kind: str, tmp_path: Path, small_limits: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader, name, make = FILES[kind]
    data = make()
    found = reader(on_disk(tmp_path / name, data), name)
    assert not found.values.flags.owndata
    monkeypatch.undo()
    assert_same(found, reader(data, name))


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.999])
def test_a_file_that_breaks_off_is_refused_in_the_same_words(
    kind: str, share: float, tmp_path: Path, small_limits: None
) -> None:
    reader, name, make = FILES[kind]
    data = make()
    data = data[: int(share * len(data))]
    assert verdict(reader, on_disk(tmp_path / name, data), name) == verdict(reader, data, name)
    file = FileBytes.opened(str(tmp_path / name))
    assert declared_size(file, name) == declared_size(data, name)
    assert content_hash(file) == content_hash(data)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (1012, b"0.5,x"),
        (700, b"0.5"),
        (701, b"0.5,0.25,0.125"),
        (300, b""),
        (400, b"0.5,"),
        (2, b"a,b"),
        (500, b"0.5,1.5 "),
        (900, b"nan,inf"),
        (1013, b"0.5"),
        (1013, b"0.5 "),
        (1013, b"0.5,x  "),
        (1013, b"0.5,x \n  \r"),
    ],
)
@pytest.mark.parametrize("separator", [b",", b" ", b";"])
@pytest.mark.parametrize("end", [b"\n", b"", b" "])
def test_a_wrong_line_of_a_text_is_named(
    line: int, text: bytes, separator: bytes, end: bytes, tmp_path: Path, small_limits: None
) -> None:
    lines = text_bytes("", ",", ".").split(b"\n")[:-1]
    lines[line - 1] = text
    data = b"\n".join(lines).replace(b",", separator) + end
    assert verdict(read_layout, on_disk(tmp_path / "a", data), "a") == verdict(read_layout, data, "a")


def test_stamped_rows_are_read_as_a_whole(tmp_path: Path, small_limits: None) -> None:
    rows = "".join(f"2024-05-01 12:{i // 60:02d}:{i % 60:02d};{i / 8}\n" for i in range(LENGTH)).encode()
    assert_same(read_layout(on_disk(tmp_path / "a", rows), "a"), read_layout(rows, "a"))


def test_bytes_of_a_file(tmp_path: Path, small_limits: None) -> None:
    data = bytes(range(250)) * 20
    file = on_disk(tmp_path / "a", data)
    assert len(file) == len(data)
    assert file[3:1200] == data[3:1200]
    assert file[-7:] == data[-7:]
    assert file[400] == data[400]
    assert b"".join(file.pieces(5)) == data[5:]
    for part in (b"\x00", b"\xf9\x00\x01", bytes(range(200, 250)), b"\xff"):
        assert [file.find(part, begin) for begin in (0, 998, 4999)] == [data.find(part, b) for b in (0, 998, 4999)]
    assert not file.is_changed
    (tmp_path / "a").write_bytes(data[:900])
    assert file.is_changed
    with pytest.raises(EOFError, match="900 bytes instead of 5000"):
        file[800:1000]


@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".xz"])
def test_a_packed_file_is_unpacked_to_disk(suffix: str, tmp_path: Path, small_limits: None) -> None:
    from streams.files.container import _OPENERS

    data = b"0.25\n" * 3000
    with _OPENERS[suffix](tmp_path / f"a{suffix}", "wb") as packed:
        packed.write(data)
    file = FileBytes.opened(str(tmp_path / f"a{suffix}"))
    found = unpack(file, f"a{suffix}")
    assert isinstance(found, FileBytes)
    assert found[:] == data
    with pytest.raises(ReaderError, match="become more than 14999 when unpacked"):
        unpack(file, f"a{suffix}", limit=14999)
    assert unpack(file, f"a{suffix}", limit=15000)[:] == data


def test_a_large_file_of_a_folder_comes_from_the_child_as_samples_on_disk(tmp_path: Path) -> None:
    values = np.arange(2 * 4_500_000, dtype=np.float32).reshape(-1, 2)
    np.save(tmp_path / "a.npy", values)
    raw = read_regular(tmp_path, "a.npy")
    assert isinstance(raw, FileBytes)
    found = read_plain_npy(raw, "a.npy")
    assert not found.values.flags.owndata
    np.testing.assert_array_equal(found.values[:, ::1000], values.T[:, ::1000])


def test_a_reader_of_bytes_gets_those_of_a_large_file(tmp_path: Path) -> None:
    from streams.files.formats.text import first_characters

    assert isolated(first_characters)(on_disk(tmp_path / "a.txt", b"0.5\n" * 200), "a.txt") == "0.5\n" * 50


def test_a_large_member_of_an_archive_is_read_from_disk(tmp_path: Path, small_limits: None) -> None:
    import tarfile

    data = npy_bytes(signal(2, LENGTH))
    (tmp_path / "a.npy").write_bytes(data)
    with tarfile.open(tmp_path / "a.tar", "w") as archive:
        archive.add(tmp_path / "a.npy", "a.npy")
    for item in open_files("s", str(tmp_path / "a.tar")):
        raw = item.read()
        assert isinstance(raw, FileBytes)
        assert raw[:] == data

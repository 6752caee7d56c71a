from __future__ import annotations

import bz2
import gzip
import lzma
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streams.files import container as files
from streams.files.container import read_guarded, unpack
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.listing import natural_key, unpacked_name
from streams.types.samples import ReaderError
from streams.types.spec import SourceError, SourceSpec
from tests.streams.makers import fifo, pronostia_csv


def test_natural_order() -> None:
    names = ["b", "a10", "a9", "a9b", "10", "9", "a"]
    assert sorted(names, key=natural_key) == ["9", "10", "a", "a9", "a9b", "a10", "b"]


@given(st.lists(st.text(max_size=8), max_size=6))
def test_any_names_can_be_sorted(names: list[str]) -> None:
    assert sorted(sorted(names, key=natural_key)) == sorted(names)


@pytest.mark.parametrize(
    ("ending", "compress"), [(".xz", lzma.compress), (".bz2", bz2.compress), (".GZ", gzip.compress), ("", bytes)]
)
def test_single_compressed_files(ending: str, compress: Callable[[bytes], bytes]) -> None:
    data = compress(b"1 2 3\n" * 1000)
    assert unpack(data, f"a.csv{ending}") == b"1 2 3\n" * 1000
    assert unpacked_name(f"a.csv{ending}") == "a.csv"
    if not ending:
        return
    for wrong, status in ((data[:-15], "incomplete"), (b"garbage", "unreadable")):
        with pytest.raises(ReaderError) as caught:
            unpack(wrong, f"a.csv{ending}")
        assert caught.value.status == status
    with pytest.raises(ReaderError, match=r"\d+ bytes become more than 100 when unpacked") as caught:
        unpack(data, f"a.csv{ending}", limit=100)
    assert caught.value.status == "refused"


def test_links_and_pipes_are_refused_and_the_stream_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "Bearing3_9"
    folder.mkdir()
    (tmp_path / "outside.csv").write_bytes(pronostia_csv(2))
    (folder / "acc_00001.csv").write_bytes(pronostia_csv(1))
    (folder / "acc_00002.csv").symlink_to(tmp_path / "outside.csv")
    fifo(folder / "acc_00003.csv")
    (folder / "acc_00004.csv").symlink_to("/dev/zero")
    (folder / "acc_00005.csv").symlink_to(folder / "nowhere.csv")
    (folder / "acc_00006.csv").symlink_to(folder / "acc_00001.csv")
    (folder / "acc_00007.csv").mkdir()
    source = open_source(SourceSpec("test", str(folder)))
    found = list(source)
    statuses = [(item.sequence, item.status if isinstance(item, Rejected) else "ok") for item in found]
    expected = [(1, "ok"), (2, "refused"), (3, "refused"), (4, "refused"), (5, "refused"), (6, "refused")]
    assert statuses == expected
    assert isinstance(found[1], Rejected)
    assert "link out of Bearing3_9" in found[1].reason
    assert len(source) == 6


def test_path_cannot_climb_out(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "secret").write_text("x")
    with pytest.raises(ReaderError) as caught:
        read_guarded((tmp_path / "in").resolve(), "../secret")
    assert caught.value.status == "refused"


def test_folder_is_no_file(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(ReaderError, match="not a regular file") as caught:
        read_guarded(tmp_path.resolve(), "a")
    assert caught.value.status == "refused"


def test_file_above_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MAX_BYTES", 10)
    (tmp_path / "a.csv").write_text("1,2,3,4,5,6,7\n")
    with pytest.raises(ReaderError, match="14 bytes, 10 are allowed") as caught:
        read_guarded(tmp_path.resolve(), "a.csv")
    assert caught.value.status == "refused"


def test_file_that_changes_while_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.csv"
    path.write_text("1,2\n")
    real_fstat = os.fstat
    seen: list[int] = []

    def fstat(handle: int) -> os.stat_result:
        seen.append(handle)
        if len(seen) == 2:
            path.write_text("1,2\n3,4\n")
        return real_fstat(handle)

    monkeypatch.setattr(files.os, "fstat", fstat)
    with pytest.raises(ReaderError) as caught:
        read_guarded(tmp_path.resolve(), "a.csv")
    assert caught.value.status == "changed"


def test_link_that_the_user_named_is_followed(tmp_path: Path) -> None:
    (tmp_path / "acc_00001.csv").write_bytes(pronostia_csv(1))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "link.csv").symlink_to(tmp_path / "acc_00001.csv")
    (block,) = list(open_source(SourceSpec("test", str(tmp_path / "elsewhere" / "link.csv"))))
    assert isinstance(block, Block)


def test_pipe_that_the_user_named_is_refused_without_blocking(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="regular file"):
        open_source(SourceSpec("test", str(fifo(tmp_path / "acc_00001.csv"))))

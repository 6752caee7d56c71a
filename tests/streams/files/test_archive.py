from __future__ import annotations

import tarfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.spec import SourceError, SourceSpec
from tests.streams.makers import ims_text, pronostia_csv, tar_file
from tests.support.effort import effort_count


def members(numbers: list[int], folder: str = "Bearing1_9") -> list[tuple[str, bytes | tarfile.TarInfo]]:
    return [(f"{folder}/acc_{number:05d}.csv", pronostia_csv(number)) for number in numbers]


def read(path: Path) -> list[Block | Rejected]:
    return list(open_source(SourceSpec("test", str(path))))


@pytest.mark.parametrize("ending", [".tar", ".tar.gz", ".tar.bz2", ".tar.xz"])
def test_every_compression(tmp_path: Path, ending: str) -> None:
    found = read(tar_file(tmp_path / f"x{ending}", members([1, 2, 3])))
    assert [item.sequence for item in found] == [1, 2, 3]
    assert all(isinstance(item, Block) and item.speed == 30 for item in found)


@settings(
    max_examples=effort_count(quick=5, full=100),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(order=st.permutations(list(range(1, 7))), gap=st.integers(0, 6), first=st.sampled_from([0, 40]))
def test_blocks_come_by_number_whatever_the_order(tmp_path: Path, order: list[int], gap: int, first: int) -> None:
    numbers = [first + number for number in order if number != gap]
    source = open_source(SourceSpec("test", str(tar_file(tmp_path / "x.tar", members(numbers)))))
    found = list(source)
    assert [item.sequence for item in found] == sorted(numbers)
    assert [item.samples[0, 0] for item in found if isinstance(item, Block)] == sorted(numbers)
    assert len(source) == len(numbers)


def test_a_rate_that_no_file_of_an_archive_states_is_asked_for(tmp_path: Path) -> None:
    path = tar_file(tmp_path / "x.tar", [("a.csv", b"x [g],y [g]\n1,2\n3,4\n")])
    with pytest.raises(SourceError, match="rate_hz is missing"):
        open_source(SourceSpec("test", str(path)))


def test_folder_and_archive_give_the_same_blocks(tmp_path: Path) -> None:
    folder = tmp_path / "Bearing1_9"
    folder.mkdir()
    for name, data in members([3, 1, 2]):
        assert isinstance(data, bytes)
        (tmp_path / name).write_bytes(data)
    one, other = read(folder), read(tar_file(tmp_path / "x.tar.gz", members([2, 3, 1])))
    for a, b in zip(one, other, strict=True):
        assert isinstance(a, Block)
        assert isinstance(b, Block)
        assert (a.sequence, a.elapsed, a.speed, a.load) == (b.sequence, b.elapsed, b.speed, b.load)
        assert a.content_hash == b.content_hash
        assert_array_equal(a.samples, b.samples)


def test_archive_of_stamped_files_is_sorted_by_time(tmp_path: Path) -> None:
    names = ["2004.02.12.10.52.39", "2004.02.12.10.32.39", "2004.02.12.10.42.39"]
    found = read(
        tar_file(tmp_path / "x.tar.xz", [(name, ims_text(4, 20480 - place)) for place, name in enumerate(names)])
    )
    assert [item.name for item in found] == sorted(names)
    assert [item.elapsed for item in found if isinstance(item, Block)] == [0, 600, 1200]


@pytest.mark.parametrize("ending", [".tar", ".tar.gz", ".tar.xz"])
def test_truncated_archive_gives_what_it_has_and_says_so(tmp_path: Path, ending: str) -> None:
    path = tar_file(tmp_path / f"x{ending}", members([1, 2, 3, 4, 5, 6, 7, 8]))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * 0.7)])
    source = open_source(SourceSpec("test", str(path)))
    found = list(source)
    assert len(found) >= 2
    assert all(isinstance(item, Block) for item in found[:-1])
    assert isinstance(found[-1], Rejected)
    assert found[-1].status == "incomplete"
    assert [item.sequence for item in found] == list(range(1, len(found) + 1))
    assert len(source) == len(found)


def test_archive_cut_before_its_first_file_cannot_be_opened(tmp_path: Path) -> None:
    # bzip2 gives out nothing before a block of 900 kB is whole.
    path = tar_file(tmp_path / "x.tar.bz2", members([1, 2, 3]))
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(SourceError, match="the archive breaks off here"):
        open_source(SourceSpec("test", str(path)))


def test_damaged_archive_never_escapes(tmp_path: Path) -> None:
    path = tar_file(tmp_path / "x.tar.gz", members([1, 2, 3, 4]))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    found = read(path)
    assert isinstance(found[-1], Rejected)
    assert found[-1].status in ("unreadable", "incomplete", "wrong_shape", "short")


def test_links_and_devices_in_an_archive_are_refused(tmp_path: Path) -> None:
    link = tarfile.TarInfo("Bearing1_9/acc_00002.csv")
    link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
    pipe = tarfile.TarInfo("Bearing1_9/acc_00003.csv")
    pipe.type = tarfile.FIFOTYPE
    found = read(tar_file(tmp_path / "x.tar", [*members([1]), ("", link), ("", pipe), *members([4])]))
    assert [getattr(item, "status", "ok") for item in found] == ["ok", "refused", "refused", "ok"]


@pytest.mark.parametrize("order", [[1, 2, 2, 3], [2, 2, 1, 3]])
def test_number_that_comes_twice(tmp_path: Path, order: list[int]) -> None:
    found = read(tar_file(tmp_path / "x.tar", members(order)))
    assert sorted(item.sequence for item in found if isinstance(item, Block)) == [1, 2, 3]
    assert [(item.sequence, item.status) for item in found if isinstance(item, Rejected)] == [(2, "duplicate")]


def test_several_runs_at_once_are_refused(tmp_path: Path) -> None:
    path = tar_file(tmp_path / "x.tar", [*members([1]), *members([1], "Bearing1_8")])
    with pytest.raises(SourceError, match=r"several runs \(Bearing1_8, Bearing1_9\)"):
        read(path)


def test_other_files_and_hidden_ones_are_no_blocks(tmp_path: Path) -> None:
    extra: list[tuple[str, bytes | tarfile.TarInfo]] = [
        ("Bearing1_9/temp_00001.csv", b"9,10,1,0,65.2\n"),
        ("Bearing1_9/._acc_00001.csv", b"\x00\x05\x16\x07"),
    ]
    assert len(read(tar_file(tmp_path / "x.tar", [*extra, *members([1, 2])]))) == 2


@pytest.mark.parametrize("content", [b"", b"no archive at all", b"\xfd7zXZ\x00garbage"])
def test_what_is_no_archive(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.tar.xz"
    path.write_bytes(content)
    with pytest.raises(SourceError, match=r"\[\[source\]\] test: url: .*x\.tar\.xz"):
        open_source(SourceSpec("test", str(path)))

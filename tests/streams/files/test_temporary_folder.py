"""A temporary folder that is full or cannot be written ends the run; it is no verdict on a file, and nothing leaks."""

from __future__ import annotations

import errno
import gzip
import os
import tarfile
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streams.files.container import unpack
from streams.files.formats.npy_wav import read_npy
from streams.files.parse import worker
from streams.files.parse.child import ReaderProcess
from streams.open import open_source
from streams.types import large
from streams.types.large import FileBytes, NoRoomError
from streams.types.samples import ReaderError
from streams.types.spec import ChannelSpec, SourceSpec
from tests.streams.format_makers import signal
from tests.support.large import FILES, LENGTH, npy_bytes, on_disk

# A workbook is made text in memory, where its size is limited.
ON_DISK = [kind for kind in FILES if kind not in ("npy, float32", "npy, one row", "xlsx")]
needs_proc = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc")


@pytest.fixture(autouse=True)
def small_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "MAX_IN_MEMORY", 1000)
    monkeypatch.setattr(large, "PIECE_BYTES", 999)


def fails(code: int) -> Any:
    def call(*arguments: object) -> None:
        raise OSError(code, os.strerror(code))

    return call


def temporary_files() -> list[str]:
    """The files of the temporary folder that this process has open; the empty one for the next file is none."""
    links = [link for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
    return [name for link in links if "/spallwatch-" in (name := str(link.readlink())) and link.stat().st_size]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize("kind", ON_DISK)
def test_no_room_for_samples_is_no_verdict(
    kind: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader, name, make = FILES[kind]
    file = on_disk(tmp_path / name, make())
    monkeypatch.setattr(large, "reserve", fails(code))
    with pytest.raises(NoRoomError, match=rf"no room for \d+ bytes .*\({os.strerror(code)}\); set TMPDIR"):
        reader(file, name)


@needs_proc
def test_no_room_for_what_is_unpacked_is_no_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = npy_bytes(signal(2, LENGTH))
    (tmp_path / "a.npy").write_bytes(data)
    with tarfile.open(tmp_path / "a.tar", "w") as archive:
        archive.add(tmp_path / "a.npy", "a.npy")
    monkeypatch.setattr(large, "write_whole", fails(errno.ENOSPC))
    with pytest.raises(NoRoomError, match="No space left on device"):
        unpack(gzip.compress(data), "a.npy.gz")
    channels = (ChannelSpec("a", column=1, unit="g"),)
    spec = SourceSpec("s", str(tmp_path / "a.tar"), block_s="file", rate=100.0, channels=channels)
    with pytest.raises(NoRoomError, match="No space left on device"):
        list(open_source(spec))
    assert temporary_files() == []


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_no_room_for_the_answer_of_a_child_is_no_verdict(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(npy_bytes(signal(2, LENGTH)))
    (tmp_path / "disk").touch()
    request = request_of(path, disk=str(tmp_path / "disk"))
    monkeypatch.setattr(worker, "write_at", fails(code))
    answer = worker._answer(request, -1, -1)
    assert answer == {"no_room": 2 * 8 * LENGTH, "reason": os.strerror(code)}


def request_of(path: Path, **more: object) -> dict[str, Any]:
    size = path.stat().st_size
    call = {"module": read_npy.__module__, "function": read_npy.__name__, "name": path.name, "arguments": []}
    return {**call, "size": size, "memory": 1 << 30, "path": str(path), **more}


def test_a_temporary_folder_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(npy_bytes(signal(2, LENGTH).astype(">f8")))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    assert worker._answer(request_of(path), -1, -1) == {
        "no_room": 2 * 8 * LENGTH,
        "reason": "No such file or directory",
    }
    with pytest.raises(NoRoomError, match="nowhere: no room for"):
        read_npy(FileBytes.opened(str(path)), "a.npy")
    monkeypatch.setattr(tempfile, "gettempdir", fails(errno.ENOENT))
    monkeypatch.setenv("TMPDIR", "/full")
    assert str(NoRoomError(5, "x")).startswith("/full: ")


@pytest.mark.process
def test_without_a_temporary_folder_what_needs_none_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.arange(100_000, dtype=np.float32)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with ReaderProcess() as child:
        assert child.call(read_npy, npy_bytes(values), "a.npy").values.tolist() == [values.tolist()]


@needs_proc
def test_no_temporary_file_stays_open_behind_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = gzip.compress(np.random.default_rng(1).bytes(5000))[:-100]
    with pytest.raises(ReaderError, match="breaks off before its end"):
        unpack(packed, "a.gz")
    assert temporary_files() == []
    monkeypatch.setattr(large.mmap, "mmap", fails(errno.ENOMEM))
    with pytest.raises(MemoryError):
        large.array_on_disk((100,), np.float64)
    monkeypatch.setattr(large.mmap, "mmap", fails(errno.EACCES))
    with pytest.raises(PermissionError):
        large.array_on_disk((100,), np.float64)
    assert temporary_files() == []

"""What POSIX has and its portable ways: the same contract for both."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from contextlib import closing
from pathlib import Path

import pytest

from models.platform import portable
from models.platform.portable import FileLock, MemoryFile, PipeReader

_CALLS = (
    *("pread", "preadv", "pwrite", "memfd_create", "posix_fadvise", "O_DIRECTORY", "nice", "ST_RDONLY", "major"),
    "geteuid",
)


def test_no_other_modules_make_such_calls() -> None:
    """Names are those that tests/without_posix takes away, and some that it has to leave."""
    root = Path(__file__).resolve().parents[3]
    taken = re.findall(r'"(\w+)"', (root / "tests" / "without_posix" / "sitecustomize.py").read_text())
    assert {"fcntl", "fork", "poll", "SIGHUP"} <= set(taken)
    names = "|".join([*taken, "getuid", "statvfs", "sysconf", "SIGKILL", "AF_UNIX", "SOCK_CLOEXEC"])
    call = re.compile(rf"\b(?:os|select|signal|socket)\.(?:{names})\b|^\s*(?:import|from) (?:{names})\b", re.MULTILINE)
    folders = ("models", "monitor", "spallwatch", "streams")
    found = {
        f"{path.relative_to(root)}: {made}"
        for folder in folders
        for path in (root / folder).rglob("*.py")
        for made in call.findall(path.read_text(encoding="utf-8"))
    }
    ours = ("models/platform/portable.py", "models/platform/process_signals.py")
    assert {name for name in found if not name.startswith(ours)} == set()


@pytest.fixture(params=["posix", "portable"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Take away what only POSIX has, or leave it."""
    if request.param == "portable":
        monkeypatch.setattr(portable, "_fcntl", None)
        monkeypatch.setattr(portable, "_resource", None)
        monkeypatch.delattr("select.poll")
        for name in _CALLS:
            monkeypatch.delattr(os, name)
    return request.param


def test_a_lock_has_one_holder_or_several_sharers(way: str, tmp_path: Path) -> None:
    path = tmp_path / "a b#?.lock"
    with closing(FileLock(path)) as one, closing(FileLock(path)) as other:
        assert one.take()
        assert not other.take()
        assert not other.take(shared=True)
        one.close()
        one.close()
        with closing(FileLock(path, read_only=True)) as third:
            assert other.take(shared=True)
            assert third.take(shared=True)
            with closing(FileLock(path)) as last:
                assert not last.take()
                other.close()
                third.close()
                assert last.take()
    assert path.stat().st_size == 0


def test_a_lock_file_that_cannot_be_made_or_is_missing_is_an_error(way: str, tmp_path: Path) -> None:
    for path, read_only in ((tmp_path / "none" / "x", False), (tmp_path / "x", True)):
        with pytest.raises(FileNotFoundError):
            FileLock(path, read_only=read_only)


def test_a_lock_is_waited_for(way: str, tmp_path: Path) -> None:
    held = FileLock(tmp_path / "lock")
    assert held.take()
    order: list[str] = []

    def wait() -> None:
        with closing(FileLock(tmp_path / "lock")) as lock:
            lock.wait()
            order.append("taken")

    thread = threading.Thread(target=wait)
    thread.start()
    order.append("released")
    held.close()
    thread.join()
    assert order == ["released", "taken"]


@pytest.mark.process
@pytest.mark.parametrize("without", [False, True])
def test_the_system_releases_the_lock_of_a_killed_process(tmp_path: Path, without: bool) -> None:
    code = (
        "import sys; from pathlib import Path; from models.platform import portable\n"
        f"portable._fcntl = None if {without} else portable._fcntl\n"
        "lock = portable.FileLock(Path(sys.argv[1])); print(lock.take(), flush=True); sys.stdin.read()"
    )
    path = tmp_path / "lock"
    with pytest.MonkeyPatch.context() as patch:
        if without:
            patch.setattr(portable, "_fcntl", None)
        command = [sys.executable, "-c", code, str(path)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
            assert child.stdout is not None
            assert child.stdout.readline() == b"True\n"
            with closing(FileLock(path)) as lock:
                assert not lock.take()
                child.kill()
                child.wait()
                assert lock.take()


def test_what_is_written_at_a_place_is_read_there(way: str) -> None:
    with closing(MemoryFile("x")) as file:
        assert portable.write_at(file.handle, b"abcdef", 2) == 6
        assert portable.read_at(file.handle, 3, 4) == b"cde"
        target = bytearray(10)
        assert portable.read_into_at(file.handle, memoryview(target), 5) == 3
        assert bytes(target) == b"def" + bytes(7)
        again = os.open(file.path, os.O_RDWR)
        try:
            assert portable.read_at(again, 9, 0) == b"\0\0abcdef"
        finally:
            os.close(again)
        portable.forget_cached(file.handle)
    if way == "portable":
        assert not Path(file.path).exists()


def test_a_pipe_is_waited_for_and_has_an_end(way: str) -> None:
    ours, theirs = os.pipe()
    reader = PipeReader(ours)
    assert not reader.wait(0.0)
    assert not reader.wait(0.01)
    os.write(theirs, b"one\ntwo\n")
    assert reader.wait(60.0)
    assert reader.read(4) == b"one\n"
    assert reader.wait(60.0)
    assert reader.read(100) == b"two\n"
    os.close(theirs)
    assert reader.wait(60.0)
    assert reader.read(1) == b""
    assert reader.read(1) == b""
    reader.close()


def test_folders_are_opened_and_made_durable(way: str, tmp_path: Path) -> None:
    portable.open_folder(str(tmp_path))
    portable.sync_folder(tmp_path)
    (tmp_path / "x").write_bytes(b"x")
    portable.sync_file(tmp_path / "x")
    for path in ("none", "x"):
        with pytest.raises(OSError, match=path):
            portable.open_folder(str(tmp_path / path))
    assert portable.may_write(tmp_path)
    assert not portable.is_read_only(tmp_path)
    assert portable.others_may(0o644, 0o004) is (way == "posix")
    assert not portable.others_may(0o600, 0o077)

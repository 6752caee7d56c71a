"""Folders for a while: those of killed processes go with the next one, and nothing else does."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from models.platform import memory
from models.platform.memory import check_address_space, group_memory, machine_memory
from models.platform.portable import FileLock
from models.platform.scratch import scratch_folder
from models.words.errors import WrongInputError
from tests.support.commands import run_command


def test_memory_of_the_machine(tmp_path: Path) -> None:
    (tmp_path / "meminfo").write_text("MemTotal:  16000000 kB\nMemFree: 12 kB\nMemAvailable:   8000000 kB\n")
    assert machine_memory(tmp_path / "meminfo") == 8_000_000 * 1024
    assert machine_memory(tmp_path / "missing") is None


def group(folder: Path, names: dict[str, str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in names.items():
        (folder / name).write_text(text)


def test_a_control_group_is_limited_by_those_above(tmp_path: Path) -> None:
    """Version 2; pages of files that can be dropped are free."""
    root, membership = tmp_path / "cgroup", tmp_path / "own"
    membership.write_text("0::/slice/service\n")
    group(root / "slice/service", {"memory.max": "max\n", "memory.current": "5\n", "memory.stat": "inactive_file 1\n"})
    assert group_memory(membership, root) is None
    group(root / "slice", {"memory.max": "1000\n", "memory.current": "700\n", "memory.stat": "inactive_file 100"})
    assert group_memory(membership, root) == 400.0
    group(root / "slice/service", {"memory.max": "300\n"})
    assert group_memory(membership, root) == 296.0


def test_a_control_group_of_version_one(tmp_path: Path) -> None:
    root, membership = tmp_path / "cgroup", tmp_path / "own"
    membership.write_text("8:pids:/job\n4:cpu,memory:/job\n0::/\n")
    names = {"memory.usage_in_bytes": "100", "memory.stat": "total_inactive_file 40"}
    group(root / "memory/job", names | {"memory.limit_in_bytes": "9223372036854771712"})
    assert group_memory(membership, root) is None
    # Inside a container the own group is mounted at the top.
    group(root / "memory", names | {"memory.limit_in_bytes": "1000"})
    assert group_memory(membership, root) == 940.0
    assert group_memory(tmp_path / "missing", root) is None


@pytest.mark.parametrize("words", [("replay", "rig:ferrara"), ("archive", "replay", __file__, "--out", "s3://a/b")])
def test_a_command_that_analyses_needs_address_space(words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "address_limit", lambda: 409_600_000)
    ended = run_command(*words)
    assert ended.returncode == 2
    said = "spallwatch: the address space is limited to 410 MB (ulimit -v), expected at least 600 MB\n"
    assert ended.stderr == said


@pytest.mark.parametrize("limit", [None, 600_000_000])
def test_enough_address_space_is_enough(limit: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "address_limit", lambda: limit)
    check_address_space()


@pytest.mark.process
def test_the_limit_of_the_address_space_is_that_of_the_shell() -> None:
    code = "import models.platform.memory as m; m.MIN_ADDRESS_BYTES = 1 << 40; m.check_address_space()"
    words = [sys.executable, "-c", f"import resource as r; r.setrlimit(r.RLIMIT_AS, (1 << 30,) * 2); {code}"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert f"{WrongInputError.__name__}: the address space is limited to 1074 MB" in ended.stderr


def test_the_folder_of_a_killed_process_is_removed_by_the_next(tmp_path):
    dead, live, other = (f"work-{digit * 16}" for digit in "0ab")
    for name in (dead, live, other, "work-mine", "more-" + "0" * 16):
        (tmp_path / name).mkdir()
    (tmp_path / dead / "file").touch()
    for name in (dead, "work-mine", "more-" + "0" * 16):
        (tmp_path / f"{name}.lock").touch()
    before = set(tmp_path.iterdir())
    alive = FileLock(tmp_path / f"{live}.lock")
    assert alive.take()
    with scratch_folder("work-", tmp_path) as folder:
        made = {folder, folder.with_name(f"{folder.name}.lock")}
        gone = {tmp_path / dead, tmp_path / f"{dead}.lock"}
        assert set(tmp_path.iterdir()) == (before | made | {tmp_path / f"{live}.lock"}) - gone
        assert folder.stat().st_mode & 0o77 == 0
    assert not made & set(tmp_path.iterdir())
    alive.close()


def test_without_a_parent_it_is_in_the_temporary_folder_with_locks_or_without(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def refuse(_lock: FileLock) -> bool:
        raise OSError("no locks here")

    for take in (FileLock.take, refuse):
        monkeypatch.setattr(FileLock, "take", take)
        with scratch_folder("work-") as folder:
            assert folder.parent == tmp_path
    assert list(tmp_path.iterdir()) == []

from pathlib import Path

from models.memory import group_memory, machine_memory


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

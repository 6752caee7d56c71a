"""Memory that this process holds and can still have, as Linux tells; elsewhere nothing is known."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from models.platform.portable import address_limit
from models.words.errors import WrongInputError

MIN_ADDRESS_BYTES = 600_000_000
"""Of a process that analyses: 433 MB after a short replay whose kernels were compiled before."""
_RESERVE_BYTES = 200e6
"""Left to the system."""


@dataclass(frozen=True)
class Memory:
    """Memory that can still be had, bytes, and what limits it, in words."""

    free: float
    limit: str


def free_memory() -> list[Memory]:
    """Return the limits of memory that are known: those of the control group and of the machine; [] if none is."""
    found: list[Memory] = []
    group = group_memory(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"))
    if group is not None:
        found.append(Memory(group - _RESERVE_BYTES, "control group of the process"))
    machine = machine_memory(Path("/proc/meminfo"))
    if machine is not None:
        found.append(Memory(machine - _RESERVE_BYTES, "memory of the machine"))
    return found


def check_address_space() -> None:
    """Raise WrongInputError where the address space is too small to load the numerical libraries.

    The OpenBLAS of scipy 1.17.1 asks again and again for memory that it does not get while it is loaded.
    """
    limit = address_limit()
    if limit is not None and limit < MIN_ADDRESS_BYTES:
        raise WrongInputError(
            f"the address space is limited to {1e-6 * limit:.0f} MB (ulimit -v), expected at least "
            f"{1e-6 * MIN_ADDRESS_BYTES:.0f} MB"
        )


def held_memory() -> float | None:
    """Return the memory that this process holds, bytes; None where the system does not say."""
    return _kilobytes(Path("/proc/self/status"), "VmRSS:")


def peak_memory() -> float | None:
    """Return the most memory that this process has held, bytes; None where the system does not say."""
    return _kilobytes(Path("/proc/self/status"), "VmHWM:")


def machine_memory(meminfo: Path) -> float | None:
    """Return the memory that the machine can give without swapping, bytes; None where it does not say."""
    return _kilobytes(meminfo, "MemAvailable:")


def group_memory(membership: Path, root: Path) -> float | None:
    """Return what the control groups of a process (version 1 or 2) leave it, bytes; None without a limit.

    Args:
        membership: ``/proc/self/cgroup``: lines ``id:controllers:path``.
        root: where the groups are mounted; a container may see its own group there and not the path.
    """
    try:
        lines = membership.read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    free: list[float] = []
    for line in lines:
        _, controllers, path = (*line.split(":", 2), "", "")[:3]
        if controllers == "":
            mount, names = root, ("memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            mount, names = root / "memory", ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        else:
            continue
        group = mount / path.lstrip("/")
        # A group is limited by all above it.
        for folder in (group, *group.parents):
            if not folder.is_relative_to(mount):
                break
            free.extend(_group_free(folder, *names))
    return min(free, default=None)


def _group_free(folder: Path, limit: str, used: str, cached: str) -> Iterator[float]:
    """Yield what a group has left, where it has a limit; pages of files count as used until they are needed."""
    # "max" is no limit, nor is a number beyond any memory.
    with suppress(OSError, ValueError):
        most = int((folder / limit).read_text(encoding="ascii"))
        if most < 1 << 60:
            left = most - int((folder / used).read_text(encoding="ascii"))
            for line in (folder / "memory.stat").read_text(encoding="ascii").splitlines():
                name, _, size = line.partition(" ")
                left += int(size) if name == cached else 0
            yield float(left)


def _kilobytes(file: Path, name: str) -> float | None:
    """Return a line ``name N kB`` of a file of /proc in bytes; None where the system has none."""
    with suppress(OSError, ValueError, IndexError):
        for line in file.read_text(encoding="utf-8").splitlines():
            if line.startswith(name):
                return 1024.0 * int(line.split()[1])
    return None

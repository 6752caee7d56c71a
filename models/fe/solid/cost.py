"""What the factorisation of a body will cost, said before it is begun, and the memory that there is for it.

The law is that of a cube of 27-node hexahedra, which fills in most for its unknowns: bars, rings and plates cost less
(benchmarks/fe_cost.py). Seconds are those of one core of the machine of that benchmark.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from models.errors import WrongInputError

ENTRIES = (0.168, 1.4)
"""Entries of the triangular factor of n unknowns: 1e6 a (n / 1000)^p."""
SECONDS = (0.017, 1.4)
"""Processor time of assembly, plan and factorisation of n unknowns, s: a (n / 1000)^p."""
PEAK_BYTES = 13.0
"""Bytes at the peak of the factorisation an entry of the factor: 8 for itself, the rest for fronts that wait."""
MATRIX_BYTES = 7_000.0
"""Bytes of the matrix an unknown: without supports, with them, and in the order of elimination."""
_RESERVE_BYTES = 200e6
"""Left to the system where the limit is what the machine has."""


class MemoryBoundError(WrongInputError):
    """A mesh that the machine, or the bound that the caller set, cannot hold; the message has both amounts."""


@dataclass(frozen=True)
class Cost:
    """Estimate for the factorisation of a body: memory at its peak, bytes, and processor time, s."""

    unknowns: int
    factor_entries: float
    memory: float
    seconds: float


@dataclass(frozen=True)
class Memory:
    """Memory that can still be had, bytes, and what limits it, in words."""

    free: float
    limit: str


def factor_cost(unknowns: int) -> Cost:
    """Return what the factorisation of a body of so many unknowns costs at most."""
    thousands = 1e-3 * unknowns
    entries = 1e6 * ENTRIES[0] * thousands ** ENTRIES[1]
    memory = PEAK_BYTES * entries + MATRIX_BYTES * unknowns
    return Cost(unknowns, entries, memory, SECONDS[0] * thousands ** SECONDS[1])


_bound: float | None = None


@contextmanager
def memory_bound(most: float | None) -> Generator[None]:
    """Bound the memory of this process, bytes, for factorisations within; None: what the machine has.

    It is one for all threads: they share the memory that it bounds.
    """
    global _bound
    before, _bound = _bound, most
    try:
        yield
    finally:
        _bound = before


def check_memory(unknowns: int, body: str = "a body", *, memory: float | None = None) -> Cost:
    """Return the cost of a factorisation that the memory allows; ``body`` is its name in the refusal.

    ``memory``, bytes, replaces the estimate where the plan of the factorisation is known.

    Raises:
        MemoryBoundError: it needs more than is free.
    """
    cost = factor_cost(unknowns)
    if memory is not None:
        cost = replace(cost, memory=memory)
    for limit in free_memory():
        if cost.memory > limit.free:
            raise MemoryBoundError(
                f"{body} of {unknowns:,} unknowns needs about {_gb(cost.memory)} of memory to be factorised; "
                f"{_gb(max(limit.free, 0.0))} are free ({limit.limit}): take a coarser mesh or more memory"
            )
    return cost


def free_memory() -> list[Memory]:
    """Return the limits of memory that are known: the bound, the control group, the machine; [] if none is."""
    found: list[Memory] = []
    if _bound is not None:
        held = _kilobytes(Path("/proc/self/status"), "VmRSS:") or 0.0
        found.append(Memory(_bound - held, f"bound of {_gb(_bound)} for the process"))
    group = group_memory(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"))
    if group is not None:
        found.append(Memory(group - _RESERVE_BYTES, "control group of the process"))
    machine = machine_memory(Path("/proc/meminfo"))
    if machine is not None:
        found.append(Memory(machine - _RESERVE_BYTES, "memory of the machine"))
    return found


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


def _gb(size: float) -> str:
    return f"{1e-9 * size:.2g} GB"

"""What the factorisation of a body will cost, said before it is begun, and whether there is the memory for it.

The law is that of a cube of 27-node hexahedra, which fills in most for its unknowns: bars, rings and plates cost less
(benchmarks/fe/cost.py). Seconds are those of one core of the machine of that benchmark.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from models.platform.memory import Memory, free_memory, held_memory
from models.words.errors import WrongInputError

ENTRIES = (0.168, 1.4)
"""Entries of the triangular factor of n unknowns: 1e6 a (n / 1000)^p."""
SECONDS = (0.017, 1.4)
"""Processor time of assembly, plan and factorisation of n unknowns, s: a (n / 1000)^p."""
PEAK_BYTES = 13.0
"""Bytes at the peak of the factorisation an entry of the factor: 8 for itself, the rest for fronts that wait."""
MATRIX_BYTES = 7_000.0
"""Bytes of the matrix an unknown: without supports, with them, and in the order of elimination."""


class MemoryBoundError(WrongInputError):
    """A mesh that the machine, or the bound that the caller set, cannot hold; the message has both amounts."""


@dataclass(frozen=True)
class Cost:
    """Estimate for the factorisation of a body: memory at its peak, bytes, and processor time, s."""

    unknowns: int
    factor_entries: float
    memory: float
    seconds: float


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
    for limit in (*_left_of_bound(), *free_memory()):
        if cost.memory > limit.free:
            raise MemoryBoundError(
                f"{body} of {unknowns:,} unknowns needs about {_gb(cost.memory)} of memory to be factorised; "
                f"{_gb(max(limit.free, 0.0))} are free ({limit.limit}): take a coarser mesh or more memory"
            )
    return cost


def _left_of_bound() -> Iterator[Memory]:
    if _bound is not None:
        yield Memory(_bound - (held_memory() or 0.0), f"bound of {_gb(_bound)} for the process")


def _gb(size: float) -> str:
    return f"{1e-9 * size:.2g} GB"

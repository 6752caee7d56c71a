"""Limits of what one file may hold or cost; a file beyond one is rejected, with both numbers in the reason.

``docs/reference/formats.md`` states them.
"""

from __future__ import annotations

from dataclasses import dataclass

MAX_BYTES = 1 << 30
"""Limit of the size of a file, unpacked or loaded: 1 GiB, about 45 min of eight float64 channels at 48 kHz."""

MAX_ROWS = 4096
"""Columns of a text, vectors of another file: channels, that is."""

MAX_DIMENSIONS = 2

MIN_COLUMNS_OF_A_ROW = 257
"""A text of one line with this many numbers or more is one channel, not one sample of so many."""

LARGE_BYTES = 64 << 20
"""A file or block of at least this size takes long, and is noted as being handled (``Ledger.handle``)."""

_MAX_EXPANSION = 100
_ALWAYS_ALLOWED_BYTES = 64 << 20
_MAX_BLOCKS = 20_000
_ALWAYS_ALLOWED_BLOCKS = 1000
_MIN_BYTES_A_BLOCK = 1024


def max_loaded_bytes(stored: int) -> int:
    """Return how many bytes a file of ``stored`` bytes may have unpacked or loaded.

    A hundred times its size, at least 64 MiB, at most ``MAX_BYTES``: a signal is not packed closer by any format.
    """
    return min(MAX_BYTES, max(_ALWAYS_ALLOWED_BYTES, _MAX_EXPANSION * stored))


def max_blocks(stored: int) -> int:
    """Return how many blocks a file of ``stored`` bytes may give: one for each KiB, 1,000 at least, 20,000 at most."""
    return min(_MAX_BLOCKS, max(_ALWAYS_ALLOWED_BLOCKS, stored // _MIN_BYTES_A_BLOCK))


@dataclass(frozen=True)
class ChildLimits:
    """Limits of a child that parses, for a small file; a large one has more of each but ``start_s`` and ``files``.

    Attributes:
        memory: address space, bytes, besides six times :func:`max_loaded_bytes`.
        cpu_s: processor time of a file; a second more for each 16 MiB.
        wall_s: the same of the clock; four seconds more for each 16 MiB. A loaded machine must not cost a file.
        start_s: time in which the child must have loaded its libraries.
        files: number of files until it is replaced.
    """

    memory: int = 1 << 30
    cpu_s: int = 4
    wall_s: float = 20.0
    start_s: float = 120.0
    files: int = 1000

    def memory_for(self, stored: int) -> int:
        """Return the address space for a file of ``stored`` bytes."""
        return self.memory + 6 * max_loaded_bytes(stored)

    def cpu_s_for(self, stored: int) -> int:
        """Return the processor time for a file of ``stored`` bytes, s."""
        return self.cpu_s + (stored >> 24)

    def wall_s_for(self, stored: int) -> float:
        """Return the time for a file of ``stored`` bytes, s."""
        return self.wall_s + 4.0 * (stored >> 24)

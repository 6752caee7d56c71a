"""Crash states of a short life: ``python -m benchmarks.crash [--states N] [--workers N] [--seconds S] [--json FILE]``.

Exit code 1 where a promise is broken, or where the control, on whose disk no call for durability has an effect, breaks
none. The places of work are in memory (/dev/shm) where there is such a folder.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.common import Row, print_table, write_json
from benchmarks.crash.explore import Found, explore, explore_shared, read_life, record_life, shown

_CONTROL_STATES, _CONTROL_BROKEN = 400, 20


@contextmanager
def workplace() -> Iterator[Path]:
    """Lend a folder in memory, where there is one."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(prefix="crash", dir=memory if memory.is_dir() else None) as folder:
        yield Path(folder)


def summary(found: Found, control: Found, calls: int) -> Row:
    """Return the counts of a run."""
    return {
        "calls recorded": calls,
        "states built": found.built,
        "distinct": found.distinct,
        "broken": len(found.broken),
        "made again from published files": found.salvaged,
        "published files made again": found.republished,
        "control: distinct": control.distinct,
        "control: broken": len(control.broken),
    }


def by_call(found: Found) -> list[Row]:
    """Return the distinct states by the call before the crash and the kind of its file."""
    calls = Counter(call for call, _ in found.seen.values())
    return [{"call": call, "of": kind, "distinct": times} for (call, kind), times in sorted(calls.items())]


def by_loss(found: Found) -> list[Row]:
    """Return the distinct states by model and loss."""
    losses = Counter(loss for _, loss in found.seen.values())
    return [{"model": model, "lost": loss, "distinct": times} for (model, loss), times in sorted(losses.items())]


def main() -> int:
    """Run the benchmark; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, default=10_000, metavar="N", help="distinct states that are aimed at")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes")
    parser.add_argument("--seconds", type=float, default=7200.0, metavar="S", help="end sooner, after so long")
    parser.add_argument("--life", type=Path, metavar="DIR", help="folder of a life that was recorded before")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    options = parser.parse_args()
    with workplace() as folder:
        life = read_life(options.life) if options.life else record_life(folder / "life")
        control = explore(life, _CONTROL_STATES, models=("ordered",), ignore_syncs=True, stop_at=_CONTROL_BROKEN)
        found = explore_shared(life, options.states, options.workers, options.seconds)
        calls = sum(entry.call != "mark" for entry in life.entries)
    tables = {"crash states": summary(found, control, calls), "by call": by_call(found), "by loss": by_loss(found)}
    for title, rows in tables.items():
        print_table(title, rows if isinstance(rows, list) else [rows])
    for line in shown(found):
        print(line)
    write_json(options.json, {**tables, "broken": [{"promise": line} for line in shown(found)]})
    return 1 if found.broken or not control.broken else 0


if __name__ == "__main__":
    sys.exit(main())

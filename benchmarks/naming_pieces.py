"""Names of records of one second: each recording cut into pieces, at its stated speed and at wrong ones.

Run as ``python -m benchmarks.naming_pieces [--json FILE] [--quick]``. Every recording of ``tests.support.recordings``
through the program as its example configuration says, in blocks of ``PIECE_S``; the name is the one of a piece's
record. The pieces hold 13 to 30 turns of the shaft. Left out is IMS, whose recording is a second long already.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.naming_census import SPEED_ERRORS, VERDICTS
from streams.block import Block
from tests.conftest import recordings_folder
from tests.support.recordings import CASES, OTHER_ENDS, watch

PIECE_S = 1.0
_NOTED = ("wrong", "healthy named")


def count(folder: Path, speed_error: float) -> tuple[Row, list[Row]]:
    """Return the counts of verdicts at an error of the stated speed, and what was wrong by recording and name."""
    counts, noted = Counter[str](), Counter[tuple[str, str]]()
    for case in (*CASES, *OTHER_ENDS):
        if case.config == "ims_test1":
            continue
        for block, steps, record in watch(case.config, folder / case.file, speed_error=speed_error, block_s=PIECE_S):
            if not isinstance(block, Block):
                continue
            for channel in steps.outputs:
                fault = record.channels[channel].get("fault")
                verdict = case.judge(fault)
                counts[verdict] += 1
                if verdict in _NOTED:
                    noted[case.file, str(fault)] += 1
    error = round(100 * speed_error)
    damaged = sum(counts[name] for name in ("right", "joined", "silent", "wrong"))
    row: Row = {"speed_error_%": error, **{name: counts[name] for name in VERDICTS}, "damaged": damaged}
    return row, [
        {"speed_error_%": error, "recording": file, "named": fault, "pieces": pieces}
        for (file, fault), pieces in sorted(noted.items())
    ]


def main() -> None:
    """Run, print, write."""
    options = arguments("Names of pieces of a second, at stated speeds that are right and wrong.")
    folder = recordings_folder()
    found = [count(folder, error) for error in ((-0.04, 0.0, 0.04) if options.quick else SPEED_ERRORS)]
    by_error, noted = [row for row, _ in found], [row for _, rows in found for row in rows]
    print_table("1. Pieces of 1 s, by error of the stated speed", by_error)
    if noted:
        print_table("2. Wrong, and healthy bearings named", noted)
    write_json(options.json, {"by_speed_error": by_error, "noted": noted})


if __name__ == "__main__":
    main()

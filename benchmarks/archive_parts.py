"""An archive of one large folder in parts: what reading on where a part ended saves, in files opened and CPU time.

Run: python -m benchmarks.archive_parts [--quick] [--json FILE]

"from the first file" is how parts read before the state between them held how far the files were read.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import streams.files
from benchmarks.common import arguments, print_table, write_json
from models.work.runner import Runner
from models.work.serial import SerialExecutor
from monitor.fleet import part
from monitor.fleet.history import unpack_state
from monitor.fleet.index import Index
from monitor.fleet.result import RecordingResult
from monitor.fleet.run import Plan, replay_waiting
from streams.large import Data
from tests.monitor.fleet.fleet_files import CONFIG, write_files

FILES = 5000
PART_BLOCKS = (1000, 250)


@contextmanager
def counted_files() -> Iterator[list[str]]:
    """Give a list that is extended by each file that is opened."""
    opened: list[str] = []
    read = streams.files.read_regular

    def noted(root: Path, path: str) -> Data:
        opened.append(path)
        return read(root, path)

    with patch.object(streams.files, "read_regular", noted):
        yield opened


def from_the_first_file(data: bytes, path: Path) -> None:
    """Unpack the store between two parts, and forget how far the files were read."""
    unpack_state(data, path)


def measure(folder: Path, count: int, blocks: int, *, goes_on: bool) -> dict[str, Any]:
    """Replay the folder in parts; say how many files were opened, and the CPU time."""
    out = folder / f"{blocks}-{goes_on}"
    manifest = folder / "manifest.toml"
    manifest.write_text('[[machine]]\nname = "m"\nconfig = "m.toml"\nrecordings = "in"\n')
    read_on = unpack_state if goes_on else from_the_first_file
    began = time.process_time()
    with (
        counted_files() as opened,
        patch.object(part, "unpack_state", read_on),
        Index(out / "index.db") as index,
        Runner(SerialExecutor()) as runner,
    ):
        counts = replay_waiting(Plan(manifest, str(out), part_blocks=blocks), index, runner)
        parts = runner.tally.chunks
    result = RecordingResult.from_json((out / "m/in/result.json").read_bytes())
    assert (counts.done, result.rows) == (1, count)
    return {
        "files": count,
        "parts_of": blocks,
        "parts": parts,
        "reading": "on" if goes_on else "from the first file",
        "files_opened": len(opened),
        "cpu_s": time.process_time() - began,
        "digests": [file.digest for file in result.files],
    }


def main() -> None:
    """Measure and print a table."""
    options = arguments(__doc__ or "")
    count = FILES // 10 if options.quick else FILES
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "m.toml").write_text(CONFIG)
        write_files(folder / "in", count, hours=1.0, grows_from=count)
        rows = [
            measure(folder, count, blocks * count // FILES, goes_on=goes_on)
            for blocks in PART_BLOCKS
            for goes_on in (False, True)
        ]
    wanted = rows[0]["digests"]
    for row in rows:
        row["equal"] = row.pop("digests") == wanted
    print_table(f"one folder of {count} files in parts", rows)
    write_json(options.json, {"rows": rows})


if __name__ == "__main__":
    main()

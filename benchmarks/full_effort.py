"""Run test files under ``SPALLWATCH_EFFORT=full``, one after the other, and keep what came of each.

Run as ``python -m benchmarks.full_effort [FILE ...] [--json FILE]``, by default all files of tests/faults. The results
of earlier runs in the JSON file stay, but those of files that are run again. It takes hours on two cores.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from xml.etree import ElementTree

from benchmarks.common import print_table, write_json

ROOT = Path(__file__).parents[1]

Row = dict[str, float | str]


def commit() -> str:
    """Return the commit of the tree, with a mark where files other than results differ from it."""

    def git(*command: str) -> str:
        return subprocess.run(["git", *command], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!benchmarks/results")
    return git("describe", "--always") + ("-dirty" if changed else "")


def run(file: str) -> Row:
    """Run the tests of a file; return how many passed, failed and were skipped."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        began = time.perf_counter()
        command = [sys.executable, "-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", f"--junitxml={report}", file]
        ended = subprocess.run(command, cwd=ROOT, env={**os.environ, "SPALLWATCH_EFFORT": "full"}, check=False)
        seconds = time.perf_counter() - began
        if not report.is_file() or ended.returncode not in (0, 1):
            raise RuntimeError(f"{file}: pytest ended with {ended.returncode}")
        suite = next(ElementTree.parse(report).getroot().iter("testsuite"))
    total, skipped = int(suite.attrib["tests"]), int(suite.attrib["skipped"])
    failed = int(suite.attrib["failures"]) + int(suite.attrib["errors"])
    counts: Row = {"tests": total, "passed": total - failed - skipped, "failed": failed, "skipped": skipped}
    return {"file": file, **counts, "seconds": round(seconds, 1), "commit": commit()}


def main() -> None:
    """Run the files, print a table and write it where asked, after each file."""
    parser = argparse.ArgumentParser(description="Run test files under full effort.")
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    files = options.files or sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("tests/faults/test_*.py"))
    before = json.loads(options.json.read_text())["files"] if options.json and options.json.is_file() else []
    rows: dict[str, Row] = {row["file"]: row for row in before}
    for file in files:
        rows[file] = run(file)
        write_json(options.json, {"files": sorted(rows.values(), key=lambda row: str(row["file"]))})
    print_table("full effort", [rows[file] for file in files])
    sys.exit(any(rows[file]["failed"] for file in files))


if __name__ == "__main__":
    main()

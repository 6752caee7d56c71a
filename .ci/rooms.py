"""Count each room of the house and compare it with its budget.

Run as ``python .ci/rooms.py [--against COMMIT] [--json FILE]``. The rooms and their budgets, in lines of Python and in
modules (of documentation: words and pages), are those of the list in ``docs/ARCHITECTURE.md``; a file counts for the
room with the longest name that leads to it. Exit code 1 where a room exceeds its budget or a file belongs to none.
``--against`` adds the totals of a commit; its rooms have other names.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLAN = ROOT / "docs" / "ARCHITECTURE.md"
_ROW = re.compile(r"^([a-z][\w/.]*) +([\d,]+) +(\d+)$", re.MULTILINE)
_FLOORS = ("models", "streams", "monitor", "spallwatch")
_WORDS = "docs"
"""Room whose budget is in words of Markdown and in pages."""


@dataclass(frozen=True)
class Size:
    """What a room holds: lines and modules of Python, and statements; words and pages for documentation."""

    lines: int = 0
    modules: int = 0
    statements: int = 0

    def __add__(self, other: Size) -> Size:
        """Return the sum of two rooms."""
        return Size(self.lines + other.lines, self.modules + other.modules, self.statements + other.statements)


def budgets(plan: str) -> dict[str, Size]:
    """Return lines and modules that each room may have, from the text of the plan.

    Raises:
        ValueError: there is no such list.
    """
    rows = {name: Size(*(int(each.replace(",", "")) for each in pair)) for name, *pair in _ROW.findall(plan)}
    if not rows:
        raise ValueError(f"{PLAN}: expected lines such as models/maps 1,800 9, found none")
    return rows


def room_of(path: str, rooms: list[str]) -> str | None:
    """Return the room of a file: the row with the longest name that leads to it."""
    found = [room for room in rooms if path == room or path.startswith(f"{room}/")]
    return max(found, key=len, default=None)


def size_of(path: str, text: str) -> Size:
    """Return what one file adds to its room."""
    if path.endswith(".md"):
        return Size(len(text.split()), 1)
    return Size(text.count("\n"), 1, sum(isinstance(node, ast.stmt) for node in ast.walk(ast.parse(text))))


def files_of(commit: str | None) -> dict[str, str]:
    """Return the texts of the tracked Python files and pages by path, of the working tree or of a commit."""
    listed = _git("ls-files") if commit is None else _git("ls-tree", "-r", "--name-only", commit)
    wanted = [path for path in listed.splitlines() if path.endswith(".py") or path.startswith(f"{_WORDS}/")]
    wanted = [path for path in wanted if path.endswith((".py", ".md"))]
    if commit is None:
        return {path: (ROOT / path).read_text(encoding="utf-8") for path in wanted if (ROOT / path).is_file()}
    return {path: _git("show", f"{commit}:{path}") for path in wanted}


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout


def totals(files: dict[str, str]) -> dict[str, Size]:
    """Return the sizes of product, tests, benchmarks and documentation."""
    found: dict[str, Size] = {}
    for path, text in files.items():
        top = path.partition("/")[0]
        name = "product" if top in _FLOORS else f"{top} (words)" if path.endswith(".md") else top
        found[name] = found.get(name, Size()) + size_of(path, text)
    return found


def by_room(files: dict[str, str], rooms: list[str]) -> tuple[dict[str, Size], list[str]]:
    """Return the size of each room, and the files of the product that belong to none."""
    sizes, homeless = dict.fromkeys(rooms, Size()), list[str]()
    for path, text in files.items():
        room = room_of(path, rooms)
        if room is not None and path.endswith(".md") == (room.partition("/")[0] == _WORDS):
            sizes[room] = sizes[room] + size_of(path, text)
        elif room is None and path.partition("/")[0] in _FLOORS:
            homeless.append(path)
    return sizes, homeless


def repeated_classes(files: dict[str, str]) -> dict[str, int]:
    """Return the public classes of the product whose name stands more than once, with how often."""
    names = Counter(
        node.name
        for path, text in files.items()
        if path.endswith(".py") and path.partition("/")[0] in _FLOORS
        for node in ast.parse(text).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    return {name: count for name, count in names.most_common() if count > 1}


def main() -> None:
    """Print the table; end with code 1 where a room exceeds its budget."""
    parser = argparse.ArgumentParser(description="count each room and compare it with its budget")
    parser.add_argument("--against", metavar="COMMIT", help="totals of this commit, too")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    options = parser.parse_args()
    allowed, files = budgets(PLAN.read_text(encoding="utf-8")), files_of(None)
    sizes, homeless = by_room(files, list(allowed))
    problems = [f"{path} belongs to no room of {PLAN.name}" for path in homeless]
    print(f"{'room':32}{'lines':>9}{'of':>9}{'modules':>9}{'of':>6}{'statements':>12}")
    for room, budget in allowed.items():
        size = sizes[room]
        print(f"{room:32}{size.lines:9,}{budget.lines:9,}{size.modules:9}{budget.modules:6}{size.statements:12,}")
        if size.lines > budget.lines or size.modules > budget.modules:
            problems.append(f"{room}: {size.lines} lines in {size.modules} modules exceed its budget")
    sums = {"now": totals(files)} | ({options.against: totals(files_of(options.against))} if options.against else {})
    for when, found in sums.items():
        for name, size in sorted(found.items()):
            print(f"{when}: {name}: {size.lines:,} in {size.modules}, {size.statements:,} statements")
    twice = repeated_classes(files)
    print(f"public class names used more than once: {len(twice)}")
    for problem in problems:
        print(problem, file=sys.stderr)
    if options.json is not None:
        rooms = {room: vars(size) | {"budget": vars(allowed[room])} for room, size in sizes.items()}
        sums_json = {when: {name: vars(size) for name, size in found.items()} for when, found in sums.items()}
        options.json.write_text(json.dumps({"rooms": rooms, "totals": sums_json, "repeated_classes": twice}, indent=1))
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()

"""Pages whose commands are run: files, commands and output stand on them in fenced blocks.

A block ``toml NAME`` or ``csv NAME`` is a file, ``sh`` are commands, and ``text`` is a part of what the last of them
printed: its words, and its numbers within 2 %.
"""

from __future__ import annotations

import re
import shlex
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from streams.block import STANDARD_GRAVITY
from tests.commands import run_command
from tests.signals import bearing_lines, impacts
from tests.test_docs import DOCS, read

PAGES = ["how-to/calibrate-your-machine.md"]
TOLERANCE = 0.02
BLOCK = re.compile(r"^```(\w*) ?(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass
class Session:
    """The commands of a page, run one after the other in a folder; ``printed`` is the output of the last one."""

    folder: Path
    printed: str = ""
    run: list[str] = field(default_factory=list[str])

    def take(self, kind: str, name: str, text: str) -> None:
        """Write the file of a block, run its commands, or compare its output."""
        if name:
            (self.folder / name).write_text(text, encoding="utf-8")
        elif kind == "sh":
            for line in text.splitlines():
                self.command(line)
        elif kind == "text":
            compare(text, self.printed)
        else:
            raise AssertionError(f"neither a file, commands nor output: {text}")

    def command(self, line: str) -> None:
        """Run one command; those of the program within this process."""
        if line.startswith("spallwatch "):
            done = run_command(*shlex.split(line)[1:], cwd=self.folder)
        else:
            done = subprocess.run(
                ["bash", "-c", line], cwd=self.folder, capture_output=True, text=True, check=False, timeout=60.0
            )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        self.printed = done.stdout
        self.run.append(line)


def compare(shown: str, printed: str) -> None:
    """Raise an AssertionError unless the lines shown are among those printed, in this order."""
    lines = iter(printed.splitlines())
    for line in shown.splitlines():
        assert any(agree(line.split(), other.split()) for other in lines), f"{line!r} is not in\n{printed}"


def agree(shown: list[str], printed: list[str]) -> bool:
    """Return whether words are equal and numbers nearly so; "..." stands for the rest of a line."""
    if "..." in shown:
        length = shown.index("...")
        shown, printed = shown[:length], printed[:length]
    return len(shown) == len(printed) and all(map(same, shown, printed))


def same(shown: str, printed: str) -> bool:
    try:
        return float(shown) == pytest.approx(float(printed), rel=TOLERANCE)
    except ValueError:
        return shown == printed


@pytest.mark.parametrize(
    ("shown", "agrees"),
    [("k 1.0 to", True), ("k 1.01 to", True), ("k 1.1 to", False), ("b 1 to", False), ("k 1", False), ("k ...", True)],
)
def test_output_is_compared_word_by_word(shown: str, agrees: bool) -> None:
    assert agree(shown.split(), ["k", "1.0", "to"]) is agrees


def test_lines_of_output_are_in_order() -> None:
    compare("a 1\nc 3\n", "a 1\nb 2\nc 3\n")
    with pytest.raises(AssertionError, match="'a 1' is not in"):
        compare("c 3\na 1\n", "a 1\nb 2\nc 3\n")


@pytest.mark.process
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(page: str, tmp_path: Path) -> None:
    session = Session(tmp_path)
    for kind, name, text in BLOCK.findall(read(DOCS / page)):
        session.take(kind, name, text)
    named = re.findall(r"^spallwatch .*$", read(DOCS / page), re.MULTILINE)
    assert [line for line in session.run if line.startswith("spallwatch ")] == named
    assert named


PYTHON_PAGES = ["reference/python.md"]


@pytest.mark.parametrize("page", PYTHON_PAGES)
def test_the_python_of_a_page_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, lines = bearing_lines("6205", 29.95)
    samples = impacts(np.random.default_rng(1), "outer", lines) / STANDARD_GRAVITY
    np.savetxt(tmp_path / "press.csv", samples, header="press", comments="")
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {}
    for kind, _, text in BLOCK.findall(read(DOCS / page)):
        assert kind == "python"
        exec(text, namespace)
    assert (tmp_path / "press.png").stat().st_size > 10_000

"""What the program answers to wrong configurations: one line of a table for each case of a file.

    python -m benchmarks.wrong_configurations [--write]

Cases: ``benchmarks/wrong_configurations.toml``. ``--write`` renews ``docs/evidence/wrong_configurations.md``.
"""

from __future__ import annotations

import re
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

from monitor.config.load import ConfigError, load_config

CASES = Path(__file__).with_suffix(".toml")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "wrong_configurations.md"
FILE = "fan.toml"


@dataclass(frozen=True)
class Case:
    """A wrong configuration, and what its message must say.

    Attributes:
        what: the mistake in words.
        text: of the whole file; ``new`` is the part of it that is wrong.
        line: number of the line that the message must name.
        key: that it must name.
        expected: words of what was expected, or of the line to write.
        came: words of what was found.
    """

    what: str
    text: str
    new: str
    line: int
    key: str
    expected: str
    came: str


def read_cases() -> list[Case]:
    """Return the cases of the file.

    Raises:
        ValueError: the text to replace is not once in the base.
    """
    values = tomllib.loads(CASES.read_text(encoding="utf-8"))
    found: list[Case] = []
    for case in values["case"]:
        old, new = case.pop("old"), case.pop("new")
        if values["base"].count(old) != 1:
            raise ValueError(f"{CASES}: {case['what']}: {old!r} is not once in the base")
        found.append(Case(text=values["base"].replace(old, new), new=new, **case))
    return found


def answer(case: Case, folder: Path) -> list[str]:
    """Return the lines of the message, none where the configuration is accepted; ``folder`` holds the file."""
    path = folder / FILE
    path.write_text(case.text, encoding="utf-8")
    try:
        load_config(path)
    except ConfigError as error:
        return str(error).replace(str(path), FILE).splitlines()
    return []


def _shortened(line: str) -> str:
    return re.sub(r"Allowed are .*", "Allowed are ...", line).replace("|", r"\\|")


def table(folder: Path) -> str:
    """Return the table of all cases in Markdown."""
    rows = ["| mistake | written | answer |", "|---|---|---|"]
    for case in read_cases():
        written = "<br>".join(f"`{line}`" for line in case.new.splitlines() if line) or "(left out)"
        lines = "<br>".join(f"`{_shortened(line)}`" for line in answer(case, folder))
        rows.append(f"| {case.what} | {written} | {lines} |")
    return "\n".join(rows)


def page(folder: Path) -> str:
    """Return the page with the table."""
    cases = read_cases()
    return f"""# Answers to wrong configurations

{len(cases)} wrong configurations and what `spallwatch check` prints of each. `python -m benchmarks.wrong_configurations
--write` makes this page of `benchmarks/wrong_configurations.toml`. A test asserts that every answer names the file, the
line, the key, what was expected or is to be written, and what came. All problems of a file are answered at once; of a
file that is not valid TOML, first the lines that are not. Lists of allowed keys are shortened here.

{table(folder)}
"""


def main() -> None:
    """Print the table, or write the page."""
    with tempfile.TemporaryDirectory() as folder:
        text = page(Path(folder))
    if "--write" in sys.argv[1:]:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()

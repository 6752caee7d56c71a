"""Wrong configurations, and what the program must answer: the cases of ``wrong_configurations.toml``."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

from monitor.config.load import ConfigError, load_config

CASES = Path(__file__).with_suffix(".toml")
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

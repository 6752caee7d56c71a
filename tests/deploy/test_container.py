"""The container file: it copies what the wheel is built of, and calls the program as it can be called.

No engine builds it here.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from tests.support.commands import run_command

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "deploy" / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")

(LOCK,) = re.findall(r"^ARG LOCK=(.*)$", TEXT, re.MULTILINE)
TEXT = TEXT.replace("${LOCK}", LOCK)


def instructions(name: str) -> list[str]:
    return re.findall(rf"^{name} (.*)$", TEXT, re.MULTILINE)


def test_it_copies_all_that_the_wheel_is_built_of() -> None:
    copied = {path for line in instructions("COPY") if "--from" not in line for path in line.split()[:-1]}
    assert all((ROOT / path).exists() for path in copied)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert {*wheel["packages"], *wheel["shared-data"], project["project"]["readme"], "LICENSE"} <= copied
    assert {"pyproject.toml", LOCK} <= copied
    assert LOCK == "deploy/requirements.lock"


def test_it_needs_no_more_than_the_locked_packages() -> None:
    assert "--require-hashes --requirement /tmp/requirements.lock" in TEXT
    assert "--no-deps /wheels/*.whl" in TEXT
    assert instructions("USER") == ["spallwatch"]


def test_its_commands_are_those_of_the_program() -> None:
    assert instructions("CMD") == ['["run", "--config", "/etc/spallwatch/machine.toml"]']
    for words in (("run",), ("status",), ("page",)):
        help_text = run_command(*words, "--help").stdout
        assert "--config" in help_text
    (check,) = instructions("HEALTHCHECK")
    assert "spallwatch status --config /etc/spallwatch/machine.toml --json" in check

"""The fenced blocks of the pages: each has a language, and is checked or run as what it is.

What runs as a whole is in ``test_docs_commands``. Here configurations are validated, commands have the options that the
program has, and what is JSON, YAML, INI or Python can be read as that. Commands that need root, a network or an hour
are not run.
"""

from __future__ import annotations

import ast
import configparser
import json
import re
import shlex
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import click
import pytest
import yaml

from monitor.cli import spallwatch
from monitor.config.load import validate
from monitor.fleet.manifest import read_manifest
from monitor.report.options import read_options
from monitor.report.runs import ReportError
from streams.files.sidecar import find_sidecar
from tests.support.docs import DOCS, FOR_USERS, ROOT, read

FENCE = re.compile(r"^```(\w*) ?(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    DOCS / "ARCHITECTURE.md",
    *sorted(page for folder in FOR_USERS for page in (DOCS / folder).glob("*.md")),
]
# Programs of others that the pages use.
OTHERS = {
    "dask",
    "certificates.sh",
    "docker",
    "openssl",
    "git",
    "cd",
    "sudo",
    "systemctl",
    "curl",
    "make",
    "chmod",
    "mkdir",
    "cp",
    "mv",
    "ls",
    "cat",
    "pip",
    "source",
    "eval",
    "sed",
}
BASE: dict[str, Any] = {
    "bearing": [{"name": "bearing", "designation": "6205"}],
    "operating": {"speed_hz": 25.0},
    "source": [{"name": "acq", "rate_hz": 25600.0}],
    "channel": [{"name": "horizontal", "source": "acq", "unit": "g", "bearing": "bearing"}],
}


class Block(NamedTuple):
    page: str
    line: int
    kind: str
    name: str
    text: str

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


def blocks() -> list[Block]:
    return [
        Block(str(page.relative_to(ROOT)), read(page)[: found.start()].count("\n") + 1, *found.groups())
        for page in PAGES
        for found in FENCE.finditer(read(page))
    ]


BLOCKS = blocks()


def of(*kinds: str) -> Any:
    chosen = [block for block in BLOCKS if block.kind in kinds]
    assert chosen, kinds
    return pytest.mark.parametrize("block", chosen, ids=lambda block: block.place)


def test_every_block_says_what_it_is() -> None:
    known = {"sh", "toml", "text", "json", "yaml", "ini", "python", "csv"}
    assert [block.place for block in BLOCKS if block.kind not in known] == []


def merged(base: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables over others; of a list of tables, the first is completed by that of the base."""
    found = dict(base)
    for key, value in given.items():
        there = found.get(key)
        if isinstance(value, dict) and isinstance(there, dict):
            found[key] = merged(there, value)
        elif isinstance(value, list) and isinstance(there, list) and value and isinstance(value[0], dict):
            found[key] = [merged(there[0], item) if key != "alarms" else item for item in value]
        else:
            found[key] = value
    return found


@of("toml")
def test_a_configuration_is_valid(block: Block, tmp_path: Path) -> None:
    values = tomllib.loads(block.text)
    if "report" in values:
        (tmp_path / "report.toml").write_text(block.text)
        # The map that it names is the last thing that is looked at.
        with pytest.raises(ReportError, match=r"press4\.nc: no such file"):
            read_options(tmp_path / "report.toml")
        return
    if isinstance(values.get("machine"), list):
        (tmp_path / "manifest.toml").write_text(block.text)
        for machine in values["machine"]:
            (tmp_path / machine["config"]).touch()
        assert [entry.machine for entry in read_manifest(tmp_path / "manifest.toml")]
        return
    whole = {"bearing", "source", "channel"} <= set(values)
    given = values if whole else merged(BASE, values)
    if not whole and "source" in values:
        # The channels of a page belong to its own source.
        given["channel"] = [{**channel, "source": given["source"][0]["name"]} for channel in given["channel"]]
    validate(given, tmp_path / "machine.toml")


def spallwatch_lines(text: str) -> list[list[str]]:
    """Return the arguments of each call of the program."""
    joined = text.replace("\\\n", " ")
    found = []
    for line in joined.splitlines():
        words = shlex.split(line, comments=True)
        while words and (words[0] == "sudo" or words[0].startswith("-") or words[0] in {"spallwatch-user"}):
            words = words[1:]
        if words[:1] == ["spallwatch"] and "spallwatch" in words[1:2]:
            words = words[1:]
        if words and words[0].rpartition("/")[2] == "spallwatch":
            found.append(words[1:])
    return found


def check_options(arguments: list[str]) -> None:
    """Raise a UsageError for a command or an option that does not exist, or a missing value."""
    group: click.Command = spallwatch
    context = click.Context(group, info_name="spallwatch")
    rest = list(arguments)
    while isinstance(group, click.Group):
        assert rest, "no command"
        name = rest.pop(0)
        found = group.get_command(context, name)
        assert found is not None, f"there is no command {name!r}"
        group, context = found, click.Context(found, parent=context, info_name=name)
    group.make_parser(context).parse_args([word for word in rest if word != "..."])


@of("sh")
def test_commands_have_the_options_of_the_program(block: Block) -> None:
    for arguments in spallwatch_lines(block.text):
        check_options(arguments)


@of("sh")
def test_targets_of_make_and_programs_exist(block: Block) -> None:
    targets = set(re.findall(r"^([\w-]+):", read(ROOT / "Makefile"), re.MULTILINE))
    for line in block.text.replace("\\\n", " ").splitlines():
        for part in re.split(r"&&|\|", re.sub(r"\s#.*$|^#.*$", "", line)):
            words = [word for word in shlex.split(part) if "=" not in word]
            words = words[1:] if words[:1] == ["sudo"] else words
            if not words or words[0].startswith("-"):
                continue
            if words[0] == "make":
                assert set(words[1:]) <= targets, line
            else:
                program = words[0].rpartition("/")[2]
                assert program in OTHERS | {"spallwatch", "spallwatchctl", "sudoedit", "install", "python", "run"}, line


@of("json")
def test_json_can_be_read(block: Block, tmp_path: Path) -> None:
    assert json.loads(block.text)
    if block.page.endswith("formats.md"):
        (tmp_path / "press.npy.json").write_text(block.text)
        assert find_sidecar(tmp_path, "press.npy", "UTC") is not None


def test_yaml_ini_and_python_can_be_read() -> None:
    for block in BLOCKS:
        if block.kind == "yaml":
            assert yaml.safe_load(block.text), block.place
        elif block.kind == "ini":
            parser = configparser.ConfigParser(inline_comment_prefixes=("#",), strict=False)
            parser.read_string(block.text)
            assert parser.sections(), block.place
        elif block.kind == "python":
            ast.parse(block.text)


@pytest.mark.parametrize("line", ["spallwatch replay x --outt y", "spallwatch replaay x", "spallwatch report a --out"])
def test_a_wrong_command_is_noticed(line: str) -> None:
    with pytest.raises((click.UsageError, AssertionError)):
        check_options(spallwatch_lines(line)[0])

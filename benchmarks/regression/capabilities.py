"""List every capability of a tree, one a line, so that two trees can be compared with ``diff``.

Run as ``python -m benchmarks.regression.capabilities [--tree DIR] [--against COMMIT]``. Listed are the commands with
their arguments and options, the keys of the configuration, the functions of the package with their parameters, the
columns of ``docs/reference`` (statuses, record variables, addresses, formats, kinds of events), the addresses and
metrics of the page, environment variables, the tables of the store, and the extras. With ``--against``, the list of
that commit is made in a worktree, and lines of one side only are printed; exit code 1 if there are any.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.regression.trees import ROOT, baseline_tree, full_hash

_FLOORS = ("models", "streams", "monitor", "spallwatch")
_TEXTS = {
    "address": r"(?:Route|Mount)\(\s*\"([^\"]+)\"",
    "variable of the environment": r"\"(SPALLWATCH_[A-Z_]+)\"",
    "metric": r"\"(spallwatch_[a-z_]+)\"",
    "table of the store": r"CREATE TABLE (?:IF NOT EXISTS )?(\w+)",
    "kind of event": r"\"(alarm_\w+|final_stage\w*|end_of_life|baseline_relearned|fault_changed|no_data|data_again|"
    r"records_kept|store_salvaged|file_poisoned|stream_reset|condition)\"",
}
"""Regular expressions over the product's text, by what they find."""
_INTROSPECTION = """
import inspect, json, sys, click
import spallwatch
from spallwatch.__main__ import main
from monitor.cli import spallwatch as root

def walk(command, name, context):
    yield f"command {name}"
    for parameter in command.params:
        words = "/".join([*parameter.opts, *parameter.secondary_opts])
        kind = parameter.type.name
        if isinstance(parameter.type, click.Choice):
            kind = "|".join(map(str, parameter.type.choices))
        many = " multiple" if getattr(parameter, "multiple", False) or parameter.nargs == -1 else ""
        yield f"option {name} {words} ({kind}{many})"
    if isinstance(command, click.Group):
        for each in command.list_commands(context):
            yield from walk(command.get_command(context, each), f"{name} {each}", context)

lines = list(walk(root, "spallwatch", click.Context(root)))
for name in spallwatch.__all__:
    thing = getattr(spallwatch, name)
    try:
        parameters = ", ".join(inspect.signature(thing).parameters)
    except (TypeError, ValueError):
        parameters = ""
    lines.append(f"python {name}({parameters})")
    if inspect.isclass(thing):
        lines += [f"python {name}.{each}" for each in dir(thing) if not each.startswith("_")]
print(json.dumps(lines))
"""


def list_capabilities(tree: Path) -> list[str]:
    """Return the sorted lines of a checkout, which is run with this interpreter."""
    lines = {*_introspected(tree), *_keys(tree), *_documented(tree), *_in_texts(tree), *_extras(tree)}
    return sorted(lines)


def _introspected(tree: Path) -> list[str]:
    found: list[str] = json.loads(_run(tree, "-c", _INTROSPECTION))
    return found


def _run(tree: Path, *words: str) -> str:
    return subprocess.run([sys.executable, *words], cwd=tree, check=True, capture_output=True, text=True).stdout


def _keys(tree: Path) -> Iterator[str]:
    """Yield the keys of the configuration from its JSON Schema, with their type and default."""
    program = "import sys; from spallwatch.__main__ import main; sys.argv = ['spallwatch', 'check', '--schema']; main()"
    schema = json.loads(_run(tree, "-c", program))
    yield from _of_schema(schema, schema, "")


def _of_schema(schema: dict[str, Any], node: dict[str, Any], path: str) -> Iterator[str]:
    for key, value in node.get("properties", {}).items():
        place = f"{path}.{key}".lstrip(".")
        kind = json.dumps(value.get("enum", value.get("type", "")))
        yield f"key {place} {kind} default {json.dumps(value.get('default'))}"
        for inner in _objects(schema, value):
            yield from _of_schema(schema, inner, place)


def _objects(schema: dict[str, Any], node: Any) -> Iterator[dict[str, Any]]:
    """Yield the descriptions of objects to which a value leads."""
    if isinstance(node, list):
        for item in node:
            yield from _objects(schema, item)
    elif isinstance(node, dict):
        if "$ref" in node:
            yield from _objects(schema, schema["$defs"][node["$ref"].rpartition("/")[2]])
        elif "properties" in node:
            yield node
        else:
            for key in ("anyOf", "allOf", "oneOf", "items", "additionalProperties"):
                yield from _objects(schema, node.get(key))


def _documented(tree: Path) -> Iterator[str]:
    """Yield the words in the first columns of the tables of the reference."""
    for page in sorted((tree / "docs" / "reference").glob("*.md")):
        for line in page.read_text(encoding="utf-8").splitlines():
            first = line.lstrip("| ").partition("|")[0]
            if "|" in line.replace(r"\|", ""):
                yield from (f"{page.stem} {word}" for word in re.findall(r"`([^`]+)`", first))


def _in_texts(tree: Path) -> Iterator[str]:
    for floor in _FLOORS:
        for path in sorted((tree / floor).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            for kind, pattern in _TEXTS.items():
                yield from (f"{kind} {word}" for word in re.findall(pattern, text))


def _extras(tree: Path) -> Iterator[str]:
    project = tomllib.loads((tree / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    yield from (f"extra {name}" for name in project["optional-dependencies"])


def main() -> None:
    """Print the list, or what differs from that of a commit."""
    parser = argparse.ArgumentParser(description="list every capability of a tree")
    parser.add_argument("--tree", type=Path, default=ROOT, metavar="DIR", help="checkout to list [this one]")
    parser.add_argument("--against", metavar="COMMIT", help="print what differs from this commit")
    options = parser.parse_args()
    present = list_capabilities(options.tree)
    if options.against is None:
        print("\n".join(present))
        return
    with (
        tempfile.TemporaryDirectory(prefix="capabilities-") as folder,
        baseline_tree(full_hash(options.against), Path(folder)) as tree,
    ):
        before = list_capabilities(tree.root)
    gone, new = sorted(set(before) - set(present)), sorted(set(present) - set(before))
    print("\n".join([*(f"- {line}" for line in gone), *(f"+ {line}" for line in new)]))
    print(f"{len(before)} before, {len(present)} now: {len(gone)} gone, {len(new)} new")
    sys.exit(bool(gone or new))


if __name__ == "__main__":
    main()

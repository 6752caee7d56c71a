"""Lines of keys against documents that were written line by line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.config.positions import Place, find_lines, line_of

ROOT = Path(__file__).resolve().parents[3]
TEXT = """# a comment with [a] = header
top = 1
[a]
x = "# no comment [b]" # a comment
'quoted key' = '''
y = 3
'''
list = [ # begins
  1,
  [2, 3],
]
[[b]]
x.y = { z = 1, "w" = [ { k = 2 } ] }
[[b]]
[b.c]
d = 1979-05-27 07:32:00
[[b.e]]
f = \"\"\"
\\\"\"\" = 1
\"\"\"
[[b.e]]
g=true
"""


def flat(value: Any, place: Place = ()) -> dict[Place, Any]:
    """Return every table, key and entry of a parsed document."""
    found: dict[Place, Any] = {} if place == () else {place: value}
    if isinstance(value, dict):
        pairs = list(value.items())
    else:
        pairs = list(enumerate(value)) if isinstance(value, list) else []
    for key, inner in pairs:
        found |= flat(inner, (*place, key))
    return found


def test_every_kind_of_key_has_its_line() -> None:
    lines = find_lines(TEXT)
    assert set(lines) == set(flat(tomllib.loads(TEXT)))
    expected = {
        ("top",): 2, ("a",): 3, ("a", "x"): 4, ("a", "quoted key"): 5, ("a", "list"): 8, ("a", "list", 0): 9,
        ("a", "list", 1): 10, ("a", "list", 1, 1): 10, ("b",): 12, ("b", 0): 12, ("b", 0, "x", "y", "z"): 13,
        ("b", 0, "x", "y", "w", 0, "k"): 13, ("b", 1): 14, ("b", 1, "c"): 15, ("b", 1, "c", "d"): 16,
        ("b", 1, "e", 0): 17, ("b", 1, "e", 0, "f"): 18, ("b", 1, "e", 1, "g"): 22,
    }  # fmt: skip
    assert {place: lines[place] for place in expected} == expected


@pytest.mark.parametrize(
    "path", [ROOT / "config.toml", *sorted((ROOT / "examples").glob("*.toml"))], ids=lambda p: p.stem
)
def test_shipped_files_have_a_line_for_each_value(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    lines, written = find_lines(text), text.splitlines()
    assert set(lines) == set(flat(tomllib.loads(text)))
    for place, line in lines.items():
        keys = [part for part in place if isinstance(part, str)]
        assert keys[-1] in written[line - 1] or isinstance(place[-1], int)


def test_what_is_not_there_has_the_line_of_its_table() -> None:
    lines = find_lines(TEXT)
    assert line_of(("b", 1, "nothing", 3), lines) == 14
    assert line_of(("nothing",), lines) == 1
    assert line_of(("nothing",), {}) is None


VALUES = st.one_of(
    st.integers(), st.booleans(), st.text(st.characters(codec="ascii", exclude_categories=("C",)), max_size=8)
)
KEYS = st.sampled_from(["a", "b", "c-d", "e_1", "7"])


def written(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return str(value)


@given(st.lists(st.tuples(KEYS, st.dictionaries(KEYS, VALUES, max_size=4), st.integers(0, 2)), max_size=6))
def test_keys_of_written_tables_are_on_their_lines(tables: list[tuple[str, dict[str, Any], int]]) -> None:
    out: list[str] = []
    expected: dict[Place, int] = {}
    counts: dict[str, int] = {}
    for name, pairs, blanks in tables:
        index = counts[name] = counts.get(name, -1) + 1
        out += ["# comment"] * blanks + [f"[[{name}]]"]
        expected.setdefault((name,), len(out))
        expected[(name, index)] = len(out)
        for key, value in pairs.items():
            out.append(f"{key} = {written(value)} # [x]")
            expected[(name, index, key)] = len(out)
    text = "\n".join(out)
    assert find_lines(text) == expected
    assert set(expected) == set(flat(tomllib.loads(text)))


@given(st.text(alphabet="[]{}=\"'#,.\\ab1\n ", max_size=60))
def test_any_text_ends(text: str) -> None:
    find_lines(text)

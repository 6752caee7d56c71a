"""The store of a machine can be replaced in one room: no other one has SQL or takes a connection from it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

_ROOT = Path(__file__).resolve().parents[2]
_FLOORS = ("models", "streams", "monitor", "spallwatch")
_ROOM = "monitor/records/"
_SQL = re.compile(r"\b(SELECT|INSERT INTO|INSERT OR|DELETE FROM|UPDATE|PRAGMA) ")
_OWN = {"monitor/fleet/index.py", "models/platform/portable.py"}
"""The index of an archive is a database of its own; a lock where the system has none is one, too."""
_LENT = {"rows", "connection", "transaction", "stored"}


@pytest.fixture(scope="module")
def trees() -> list[tuple[str, ast.Module]]:
    """The modules of other rooms, by their paths."""
    names = [path.relative_to(_ROOT).as_posix() for floor in _FLOORS for path in sorted((_ROOT / floor).rglob("*.py"))]
    others = [name for name in names if not name.startswith(_ROOM) and name not in _OWN]
    return [(name, ast.parse((_ROOT / name).read_bytes())) for name in others]


def _with_sql(tree: ast.Module) -> list[int]:
    texts = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return [node.lineno for node in texts if _SQL.search(str(node.value))]


def test_no_sql_stands_outside_the_room_of_records(trees) -> None:
    assert len(trees) > 300
    assert {name: lines for name, tree in trees if (lines := _with_sql(tree))} == {}


def test_sql_is_found_where_it_is() -> None:
    assert _with_sql(ast.parse("rows(f'SELECT {name} FROM blocks')")) == [1]


def _lent(tree: ast.Module) -> list[str]:
    """Return the calls that take rows or a connection from a store."""
    calls = (node.func for node in ast.walk(tree) if isinstance(node, ast.Call))
    return [ast.unparse(call) for call in calls if isinstance(call, ast.Attribute) and call.attr in _LENT]


def test_no_rows_or_connections_leave_the_room_of_records(trees) -> None:
    assert {name: calls for name, tree in trees if (calls := _lent(tree))} == {}


def test_a_loan_is_found_where_it_is() -> None:
    assert _lent(ast.parse("with machine.store.connection() as own: store.rows(1)")) != []

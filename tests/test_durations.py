"""What every run keeps of the time that its tests take."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.support.durations import Durations, costs_of_files


def report(name: str, *, processor_s: float, wall_s: float) -> pytest.TestReport:
    return cast(Any, SimpleNamespace(nodeid=name, duration=wall_s, user_properties=[("processor_s", processor_s)]))


def test_a_run_keeps_what_its_tests_took_and_what_others_took_before(tmp_path: Path) -> None:
    path = tmp_path / "cache" / "durations.json"
    for names in (("a.py::one", "b.py::two"), ("a.py::one", "a.py::three")):
        durations = Durations(path, steers=True)
        for name in names:
            for _ in ("setup", "call"):
                durations.pytest_runtest_logreport(report(name, processor_s=1.0, wall_s=2.0))
        durations.pytest_sessionfinish()
    kept = json.loads(path.read_text())
    assert kept["columns"] == ["processor_s", "wall_s"]
    assert kept["tests"] == {"a.py::one": [2.0, 4.0], "b.py::two": [2.0, 4.0], "a.py::three": [2.0, 4.0]}
    assert kept["files"] == {"a.py": [4.0, 8.0], "b.py": [2.0, 4.0]}


def test_workers_write_nothing_and_a_damaged_file_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "durations.json"
    for steers in (False, True):
        path.write_text("{")
        durations = Durations(path, steers=steers)
        durations.pytest_runtest_logreport(report("a.py::one", processor_s=1.0, wall_s=1.0))
        durations.pytest_sessionfinish()
        assert (path.read_text() == "{") is not steers


def test_the_dearest_file_comes_first() -> None:
    found = costs_of_files({"a.py::x": (1.0, 9.0), "b.py::x": (2.0, 1.0), "b.py::y": (2.0, 1.0)})
    assert found == {"b.py": (4.0, 2.0), "a.py": (1.0, 9.0)}
    assert list(found) == ["b.py", "a.py"]

"""What each test takes: written to .cache/durations.json by every run, the dearest files said at its end."""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

if TYPE_CHECKING:
    from _pytest.terminal import TerminalReporter

_PROPERTY = "processor_s"
_DEAREST = 10


def _processor_s() -> float:
    """Return the processor time of this process and of its children that have ended, s.

    What a fork server forked is no child of this process: a test that has daemons forked costs more than is counted.
    """
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Cost(NamedTuple):
    """Of a test or of the tests of a file, with their fixtures, s."""

    processor_s: float
    wall_s: float


class Durations:
    """A plugin that measures where a test runs, and gathers where the run is steered."""

    def __init__(self, path: Path, *, steers: bool) -> None:
        """Keep what tests take in the file ``path``, those of earlier runs included, where the run is steered."""
        self._path, self._steers = path, steers
        self._mark = 0.0
        self._spent = defaultdict[str, list[float]](lambda: [0.0, 0.0])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Iterator[None]:
        """Begin to count."""
        self._mark = _processor_s()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Iterator[Any]:
        """Note the processor time of a phase with its report, which is sent to where the run is steered."""
        report: Any = yield
        now = _processor_s()
        report.user_properties = [*report.user_properties, (_PROPERTY, now - self._mark)]
        self._mark = now
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a phase to what its test takes."""
        spent = self._spent[report.nodeid]
        spent[0] += sum(float(str(value)) for name, value in report.user_properties if name == _PROPERTY)
        spent[1] += report.duration

    def pytest_sessionfinish(self) -> None:
        """Write what the tests of this run took, and what others took in earlier ones."""
        if not (self._steers and self._spent):
            return
        try:
            kept = json.loads(self._path.read_text(encoding="utf-8"))["tests"]
        except (OSError, ValueError, KeyError, TypeError):
            kept = {}
        kept |= {name: [round(seconds, 3) for seconds in spent] for name, spent in self._spent.items()}
        written = {"columns": Cost._fields, "files": costs_of_files(kept), "tests": kept}
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._path.write_text(json.dumps(written), encoding="utf-8")

    def pytest_terminal_summary(self, terminalreporter: TerminalReporter) -> None:
        """Say which files are the dearest, where there are many."""
        files = costs_of_files(self._spent)
        if not self._steers or len(files) <= _DEAREST:
            return
        terminalreporter.section(f"dearest files of {len(files)}: processor time of the workers, and wall time")
        for name, cost in list(files.items())[:_DEAREST]:
            terminalreporter.write_line(f"{cost.processor_s:8.1f} s {cost.wall_s:8.1f} s  {name}")
        total = Cost(*map(sum, zip(*files.values(), strict=True)))
        terminalreporter.write_line(f"{total.processor_s:8.1f} s {total.wall_s:8.1f} s  in all")


def costs_of_files(tests: Mapping[str, Sequence[float]]) -> dict[str, Cost]:
    """Return what the tests of each file take, from costs by test; the dearest file first."""
    files = defaultdict[str, list[Sequence[float]]](list)
    for name, cost in tests.items():
        files[name.partition("::")[0]].append(cost)
    summed = {name: Cost(*map(sum, zip(*costs, strict=True))) for name, costs in files.items()}
    return dict(sorted(summed.items(), key=lambda item: -item[1].processor_s))

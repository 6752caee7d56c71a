"""The log: for people with the time, for the journal of systemd with priorities."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

from monitor.service.system import JournalFormatter, to_journal
from tests.support.daemons import ROOT, make_machine
from tests.support.waiting import stop, wait_until

pytestmark = pytest.mark.process


def test_a_line_for_the_journal_keeps_its_priority_in_front() -> None:
    formatter = JournalFormatter()
    marks = []
    for level in (logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR, logging.CRITICAL):
        record = logging.LogRecord("monitor", level, "file", 1, "one\ntwo %d", (2,), None)
        first, second = formatter.format(record).splitlines()
        assert (first[3:], second[3:]) == ("one", "two 2")
        assert first[:3] == second[:3]
        marks.append(first[:3])
    assert marks == ["<7>", "<6>", "<4>", "<3>", "<2>"]
    assert not to_journal({"JOURNAL_STREAM": "1:1"})


def test_the_journal_gets_priorities_and_notes_the_time_itself(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    with (tmp_path / "journal").open("w") as journal:
        stream = os.fstat(journal.fileno())
        environment = {**os.environ, "JOURNAL_STREAM": f"{stream.st_dev}:{stream.st_ino}"}
        process = subprocess.Popen(
            [sys.executable, "-c", "from monitor.cli import main; main()", "run", "--config", str(config)],
            cwd=ROOT,
            text=True,
            stderr=journal,
            env=environment,
        )
        try:
            wait_until(lambda: "ready, watching" in (tmp_path / "journal").read_text())
            stop(process)
            assert process.returncode == 0
        finally:
            process.kill()
            process.wait()
    lines = (tmp_path / "journal").read_text().splitlines()
    assert "<6>machine m: ready, watching s0" in lines
    assert all(line.startswith("<") for line in lines)

"""The tutorial of the first machine says what the program prints, and its records are what was written."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.common import effort_count
from benchmarks.service.first_machine import ANSWERS, MACHINES, PAGE, follow, table
from examples.loggers import LOGGERS

KINDS = ("wav", "hdf5", "tdms", "csv", "mat")
"""From the quickest on."""


def test_each_logger_needs_two_answers_at_most() -> None:
    assert set(ANSWERS) == set(MACHINES) == set(LOGGERS) == set(KINDS)
    assert max(map(len, ANSWERS.values())) <= 2


@pytest.mark.parametrize("kind", KINDS[: effort_count(quick=1, full=5)])
def test_transcripts_of_the_tutorial_are_what_is_printed(kind: str, tmp_path: Path) -> None:
    outcome = follow(kind, tmp_path)
    page = PAGE.read_text(encoding="utf-8")
    assert outcome.transcripts["init"] in page
    assert table({kind: outcome}).splitlines()[-1] in page
    if kind == "csv":
        assert outcome.configuration.rstrip() in page
        assert outcome.transcripts["check"] in page
        assert outcome.transcripts["replay"] in page
    assert outcome.records == 12
    assert outcome.start_error_s < 1e-3
    assert outcome.rms_error < 1e-4

"""The run that the tests of figures draw, read once."""

from __future__ import annotations

import pytest

from monitor.report.runs import Channel, Run
from tests.monitor.report.figures.drawing import START, run_of
from tests.oracles.lives import life


@pytest.fixture(scope="package")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run_of(tmp_path_factory.mktemp("life"), life(start=START), calibrated="yes")


@pytest.fixture(scope="package")
def channel(run: Run) -> Channel:
    return run.channels["horizontal"]

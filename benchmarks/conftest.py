"""Tests of what a benchmark draws and judges stand beside it; those marked ``real`` need the recordings."""

from __future__ import annotations

from pathlib import Path

import pytest

from reference import recordings_folder
from reference.once import folder_of_the_run as folder_of_the_run


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests on recordings where these are missing."""
    if item.get_closest_marker("real") is not None and not recordings_folder().is_dir():
        pytest.skip("the recordings are missing: SPALLWATCH_DATA names no folder")


@pytest.fixture
def data_dir() -> Path:
    """Return the folder of recordings, for tests marked ``real``."""
    return recordings_folder()

"""What all tests share: where the recordings are, and what happens where they are not."""

from __future__ import annotations

import functools
import os
import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests.broker import broker_program

_REPOSITORY = Path(__file__).resolve().parents[1]

# A busy machine is no failure: nothing here depends on the time that an example takes.
settings.register_profile(
    "any machine",
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("any machine")


def recordings_folder() -> Path:
    """Return the folder of recordings: SPALLWATCH_DATA, by default ../shared/data beside the repository."""
    return Path(os.environ.get("SPALLWATCH_DATA") or _REPOSITORY.parent / "shared" / "data")


def chromium_program() -> str | None:
    """Return the path of the browser Chromium, or None."""
    return shutil.which("chromium")


@functools.cache
def missing_for_pdf() -> str:
    """Return what is missing for a PDF, "" where nothing is."""
    from monitor.report.page import require_pdf
    from monitor.report.runs import ReportError

    try:
        require_pdf()
    except ReportError as error:
        return str(error)
    return ""


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test where what it needs is missing; under CI that is a failure."""
    reason = None
    if item.get_closest_marker("real") is not None and not recordings_folder().is_dir():
        reason = "the recordings are missing: SPALLWATCH_DATA names no folder"
    if item.get_closest_marker("broker") is not None and broker_program() is None:
        reason = "the MQTT broker mosquitto is missing (Debian package mosquitto)"
    if item.get_closest_marker("browser") is not None and chromium_program() is None:
        reason = "the browser Chromium is missing (Debian package chromium)"
    if item.get_closest_marker("pdf") is not None and (missing := missing_for_pdf()):
        reason = missing
    if reason is None:
        return
    if os.environ.get("CI"):
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


@pytest.fixture
def data_dir() -> Path:
    """The folder of recordings, for tests marked ``real``."""
    return recordings_folder()

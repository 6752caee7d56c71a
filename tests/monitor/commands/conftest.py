"""What the tests of several commands share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def machine(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A configuration file with the module's MACHINE."""
    path = tmp_path / "machine.toml"
    path.write_text(request.module.MACHINE)
    return path


@pytest.fixture
def empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty directory, in which no configuration is found."""
    monkeypatch.chdir(tmp_path)

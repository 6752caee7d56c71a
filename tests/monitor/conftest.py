"""What tests of commands and reports share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tests.support.effort import effort_count

ARRANGE = ConstrainedLayoutEngine.execute


@pytest.fixture(scope="module")
def plain_layout() -> Iterator[None]:
    """Quick effort leaves out the arrangement of axes and labels, two fifths of the time of a page.

    For tests of what pages say; those of figures arrange them.
    """
    with pytest.MonkeyPatch.context() as patch:
        if effort_count(quick=1, full=0):
            patch.setattr(ConstrainedLayoutEngine, "execute", lambda engine, figure: None)
        yield


@pytest.fixture
def arranged_layout(monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrange axes and labels in one test of a module with ``plain_layout``."""
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", ARRANGE)


@pytest.fixture
def blank_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Quick effort leaves the pictures of a page blank: figures are built and have their sizes, nothing is drawn.

    For tests of words and of paper, of whose pictures another test has the same ones drawn.
    """
    if effort_count(quick=1, full=0):
        monkeypatch.setattr(Figure, "draw", lambda figure, renderer: None)


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

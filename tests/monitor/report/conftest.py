"""What tests of reports share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.effort import effort_count


@pytest.fixture(scope="module")
def plain_layout() -> Iterator[None]:
    """Quick effort leaves out the arrangement of axes and labels, two fifths of the time of a page.

    For tests of what pages say; those of figures arrange them.
    """
    with pytest.MonkeyPatch.context() as patch:
        if effort_count(quick=1, full=0):
            patch.setattr("matplotlib.layout_engine.ConstrainedLayoutEngine.execute", lambda engine, figure: None)
        yield

"""The command that made the library that ships makes it again."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.common import effort_count
from benchmarks.forecast.growth_library import build, small
from monitor.service.libraries import shipped_library


@pytest.mark.skipif(effort_count(quick=0, full=1) == 0, reason="fits for half a minute")
def test_the_command_makes_the_file_again() -> None:
    again, kept = small(build()).fits["v_eq"], shipped_library().fits["v_eq"]
    assert again.said == pytest.approx(kept.said, abs=5e-3)
    assert again.error == pytest.approx(kept.error, abs=5e-3, nan_ok=True)
    assert np.array_equal(again.standing, kept.standing)

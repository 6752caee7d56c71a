"""The way of a scene from ``simulate`` to its RMS: how many files of the project it enters."""

from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType

from models.machine.scene import Defect, Scene
from models.solve.simulate import simulate

ROOT = Path(__file__).resolve().parents[3]
# The thirteenth is engine/over_time.py, which tells what a simulation over time is expected to cost.
MOST = 13


def test_a_scene_enters_few_files() -> None:
    """Kernels count with their files; modules are imported, and nothing of this scene is kept, beforehand."""
    entered: set[str] = set()

    def look(frame: FrameType, event: str, _: object) -> None:
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(ROOT / "models"):
            entered.add(path.relative_to(ROOT).as_posix())

    simulate(Scene(40.0, 4000.0, defect=Defect(0.1, 1e-5)))
    scene = Scene(41.0, 4100.0, defect=Defect(0.11, 1.1e-5))
    sys.setprofile(look)
    try:
        rms = simulate(scene).rms
    finally:
        sys.setprofile(None)
    assert rms > 0.0
    assert {name.split("/")[1] for name in entered} <= {"words", "machine", "path", "solve"}
    assert len(entered) <= MOST, sorted(entered)

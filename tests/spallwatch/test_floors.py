"""The program beside folders that have the names of its packages."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.process


@pytest.fixture
def crowded(tmp_path: Path) -> Path:
    """A folder with packages of our names, which raise when they are imported."""
    for name in ("models", "streams", "monitor"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('a stranger was imported')\n")
    np.save(tmp_path / "x.npy", np.random.default_rng(1).standard_normal(12000))
    (tmp_path / "x.csv").write_text("a_g\n" + "\n".join(map(str, np.random.default_rng(1).standard_normal(4000))))
    return tmp_path


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    # As an installed program: its folder comes after that of the script.
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_a_script_beside_such_folders_reads_and_analyses(crowded):
    """It has all names, none of which importing loads."""
    # A table is read in a child process.
    (crowded / "script.py").write_text(
        "import sys, spallwatch as sw\n"
        "assert not {'numpy', 'xarray', 'numba'} & set(sys.modules), 'too much'\n"
        "[getattr(sw, name) for name in sw.__all__]\n"
        "assert set(dir(sw)) == set(sw.__all__)\n"
        "signal = sw.read('x.csv', rate_hz=4000.0, unit='g')\n"
        "print(sw.features(signal, bearing='6205', speed_hz=10.0).rms.item())\n"
    )
    done = run(crowded, "script.py")
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 0.0


def test_the_command_line_works_beside_such_folders(crowded):
    done = run(crowded, "-m", "spallwatch", "bearing", "6205", "--speed-hz", "10", "--load-newton", "1000")
    assert done.returncode == 0, done.stderr
    assert "BPFO" in done.stdout


def test_a_stranger_that_was_imported_before_is_named(crowded):
    (crowded / "models" / "__init__.py").write_text("")
    done = run(crowded, "-c", "import models, spallwatch")
    assert done.returncode == 1
    assert "ImportError" in done.stderr
    assert str(crowded / "models") in done.stderr

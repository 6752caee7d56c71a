"""A folder of several formats: one is read, and every command names the rest with its reason."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.streams.table_makers import parquet_bytes, workbook
from tests.support.commands import run_command

NOISE = np.random.default_rng(3).normal(size=(2, 8192))
REASONS = {
    "3.xlsx": 'a file of xlsx, which a [[source]] with format = "xlsx" reads',
    "4.bin": "samples without a header, by its ending; a side-car",
    "5.parquet": 'which a [[source]] with format = "parquet" reads',
    "notes.txt": "of another format than csv (*.csv)",
    "report.pdf": "PDF document",
}


@pytest.fixture
def here(tmp_path: Path) -> Path:
    data = tmp_path / "data"
    data.mkdir()
    for number, row in enumerate(NOISE, start=1):
        lines = [*("Sampling rate: 4096", "Start: 2024-05-01 12:00:00", "de [g]"), *(f"{value:.6f}" for value in row)]
        lines[1] = lines[1].replace("12:00", f"12:{number:02d}")
        (data / f"{number}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (data / "3.xlsx").write_bytes(workbook({"Data": [["de [g]"], *([float(value)] for value in NOISE[0, :50])]}))
    (data / "4.bin").write_bytes(NOISE.tobytes())
    (data / "5.parquet").write_bytes(parquet_bytes({"de": NOISE[0]}))
    (data / "notes.txt").write_text("Notes of the test\n", encoding="utf-8")
    (data / "report.pdf").write_bytes(b"%PDF-1.7\n")
    return tmp_path


def test_what_is_not_read_is_named_by_init_check_and_replay(here: Path) -> None:
    answers = ("--bearing", "6205", "--speed-hz", "29.5", "--yes", "--out", "m.toml")
    made = run_command("init", "data", *answers, cwd=here)
    assert made.returncode == 0, made.stderr
    assert "left out, of another format: 3.xlsx (a file of xlsx" in made.stdout
    # The note has an ending of texts, and would be refused as a block.
    assert 'files = "*.csv"' in (here / "m.toml").read_text(encoding="utf-8")
    told = run_command("check", "--config", "m.toml", cwd=here)
    assert told.returncode == 0, told.stderr
    assert all(f"not read: {name}: " in told.stdout + told.stderr for name in REASONS)
    checked = json.loads(run_command("check", "--config", "m.toml", "--json", cwd=here).stdout)
    done = run_command("replay", "data", "--config", "m.toml", "--out", "o", "--no-report", "--json", cwd=here)
    summary = json.loads(done.stdout)
    assert (summary["accepted"], summary["refused"]) == (2, {})
    for ignored in (checked["dating"]["logger"]["ignored"], summary["ignored"]):
        assert set(ignored) == set(REASONS)
        assert all(REASONS[name] in reason for name, reason in ignored.items())

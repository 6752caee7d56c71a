"""A daemon in an address space that is too small for some files: these are refused with words, the others analysed."""

from __future__ import annotations

import io
import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from tests.support.daemons import machine_text, start_program, status
from tests.support.waiting import stop, wait_until

pytestmark = [pytest.mark.process, pytest.mark.skipif(shutil.which("prlimit") is None, reason="there is no prlimit")]
LIMIT = 1_200_000_000


def write(folder: Path, number: int, samples: int) -> None:
    """Write a file of noise and, beyond it, zeros that take no room on the disk."""
    head, noise = io.BytesIO(), np.random.default_rng(number).standard_normal(512).astype("<f4")
    np.lib.format.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": (samples,)})
    path = folder / f".f{number}.part"
    path.write_bytes(head.getvalue() + noise.tobytes())
    os.truncate(path, len(head.getvalue()) + 4 * samples)
    path.rename(folder / f"f{number}.npy")


def test_what_does_not_fit_the_memory_is_refused_and_the_next_blocks_are_analysed(tmp_path: Path) -> None:
    inbox = tmp_path / "in"
    inbox.mkdir()
    config = tmp_path / "m.toml"
    text = machine_text(inbox).replace('format = "csv"', 'format = "npy"').replace("block_s = 0.1", 'block_s = "file"')
    config.write_text(text)
    for number, samples in enumerate((512, 25_000_000, 512, 240_000_000, 512), 1):
        write(inbox, number, samples)
    prefix = ("prlimit", f"--as={LIMIT}")
    process = start_program(config, "--quiet", prefix=prefix)
    try:
        wait_until(lambda: process.poll() is not None or blocks(tmp_path) == 5, every=0.1)
        assert process.poll() is None
        wait_until(lambda: status(config).get("blocks") == 5)
        assert (status(config)["status"], status(config)["stalled"]) == ("running", [])
    finally:
        stop(process)
    with closing(sqlite3.connect(tmp_path / "state" / "state.db")) as store:
        found = store.execute("SELECT status, reason FROM blocks ORDER BY sequence").fetchall()
    assert [row[0] for row in found] == ["ok", "refused", "ok", "refused", "ok"]
    assert found[1][1] == "there is not enough memory to analyse its 100000000 bytes of samples"
    assert found[3][1] == "f4.npy: there is not enough memory for 960000128 bytes"


def blocks(folder: Path) -> int:
    try:
        with closing(sqlite3.connect(f"file:{folder / 'state' / 'state.db'}?mode=ro", uri=True)) as store:
            return store.execute("SELECT count(*) FROM blocks").fetchone()[0]
    except sqlite3.OperationalError:
        return 0

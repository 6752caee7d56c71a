"""Make the backups of earlier commits that ``test_upgrade.py`` brings up to date.

Run as ``python -m benchmarks.regression.older --out tests/data/older [--commit COMMIT ...]``. Each commit, in a git
worktree of its own with the packages of this environment, follows a folder with a daemon (a life with alarms, a
rejected file, an onset, V_eq, forecasts, a silence and an acknowledgement) and writes a backup. Then it takes some more
blocks. Kept are the backup, packed, and what the commit said of the blocks after it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import shutil
import sqlite3
import tarfile
import tempfile
from collections.abc import Mapping
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import netCDF4
import numpy as np

from benchmarks.regression.cases import CALIBRATED, LEVELS, Bench, build_map
from benchmarks.regression.live import Daemon
from benchmarks.regression.machines import BEGIN, BLOCK, RATE, life, machine_text, save_csv
from benchmarks.regression.observe import of_store
from benchmarks.regression.store import next_blocks
from benchmarks.regression.trees import Tree, baseline_tree, full_hash

COMMITS = {"f3e37456e": "thesis", "99a09a9a3": "filter", "e238cd1bd": "thesis"}
"""Commits, and how each tracks V_eq."""
BLOCKS, MORE = 60, 12
"""Blocks in the backup, unless more are asked for, and those after it."""
_DAMAGED = 25
"""Blocks of the backup from the beginning of the damage on."""
WHOLE, OLD_MAP = "e238cd1bd", "f3e37456e"
"""The commits of which the whole backup is kept, of the others the store, and of which the map of an earlier model."""
EQUAL = (
    "sequence",
    "content_hash",
    "status",
    "flags",
    "time",
    "x.stage",
    "x.t_fs",
    "x.t_fs_block",
    "x.t_fs_known_block",
)
CLOSE = ("x.rms", "x.h_or", "x.detect_threshold")
V_EQ = "x.v_eq"
"""Columns of the next blocks that are kept: those that are the same, and those that a transform may change a little."""
UNUSABLE = 25
"""Block of missing samples, which is rejected."""


def write_files(folder: Path, first: int, last: int, blocks: int) -> None:
    """Write blocks of a life, of which a backup has ``blocks``, each as a dated file.

    What is written again is equal, the dates of the files included.
    """
    folder.mkdir(parents=True, exist_ok=True)
    samples = np.split(life(blocks + MORE, blocks - _DAMAGED, 7), blocks + MORE)
    for number in range(first, last + 1):
        path, start = folder / f"f{number:04d}.csv", BEGIN + timedelta(seconds=10 * number)
        values = np.full(BLOCK, math.nan) if number == UNUSABLE else samples[number - 1]
        # Of the columns, the second is no channel.
        save_csv(path, {"x": values, "y": np.zeros(BLOCK)}, start)
        changed = start.timestamp() + 5.0
        os.utime(path, (changed, changed))


def configuration(folder: Path, method: str, **sections: Mapping[str, object]) -> str:
    """Return the machine that follows the files of :func:`write_files` in a folder, with the map ``map.nc``."""
    source = {"url": f"folder:{folder}", "block_s": "file", "format": "csv", "rate_hz": RATE, "settle_s": 0.2}
    channel = {"name": "x", "column": "x", "track": True, "map": "map.nc"}
    fixed = {"machine": {"spectra": 2}}
    tracking = {"track": {"method": method}, "forecast": {"method": "thesis", "threshold_mm2": [0.05, 0.1]}}
    return machine_text(source, channel, levels=LEVELS, **{**fixed, **tracking, **sections})


def make(tree: Tree, folder: Path, out: Path, commit: str, blocks: int) -> None:
    """Write ``COMMIT.tar.xz`` and ``COMMIT.json`` into ``out``."""
    bench = Bench(tree, folder, quick=False, kept=folder)
    method = COMMITS[commit[:9]]
    rig: Mapping[str, object] = {"calibrated": True} if commit.startswith("f3e37456e") else CALIBRATED
    build_map(bench, rig)
    inbox = folder / "in"
    write_files(inbox, 1, blocks, blocks)
    text = configuration(inbox, method, web={"enabled": True, "port": 0}, rig=rig)
    with Daemon(bench, text) as daemon:
        daemon.wait_for_blocks(blocks)
        daemon.wait_for("the page", lambda: daemon.status().get("page"))
        held = [event for event in daemon.ask("GET", "/api/events")["events"] if event["kind"] == "alarm_raised"][-1]
        daemon.ask("POST", f"/api/events/{held['id']}/acknowledge", {"who": "Ada", "note": "seen"})
        daemon.wait_for("a notice of silence", lambda: _notices(daemon.state / "state.db"), patience_s=120.0)
        backup = _backup(bench, daemon, whole=commit[:9] == WHOLE)
        write_files(inbox, blocks + 1, blocks + MORE, blocks)
        daemon.wait_for_blocks(blocks + MORE)
    observed = next_blocks(of_store("live/store", daemon.state / "state.db"), blocks)
    values = {
        "commit": commit,
        "blocks": blocks,
        "columns": {name: observed[f"blocks/{name}"] for name in (*EQUAL, *CLOSE, V_EQ)},
        "published": published(backup / "records", blocks),
    }
    (folder / "expected.json").write_text(json.dumps(values, allow_nan=False) + "\n", encoding="utf-8")
    out.mkdir(parents=True, exist_ok=True)
    with tarfile.open(out / f"{commit[:9]}.tar.xz", "w:xz", preset=9) as packed:
        packed.add(folder / "expected.json", arcname="expected.json")
        if commit[:9] == WHOLE:
            packed.add(backup, arcname="backup")
        else:
            packed.add(backup / "state.db", arcname="backup/state.db")
        if commit[:9] == OLD_MAP:
            packed.add(folder / "map.nc", arcname="old-map.nc")


def _backup(bench: Bench, daemon: Daemon, *, whole: bool) -> Path:
    """Return the folder of a backup beside the daemon: by the command, or of store and files alone."""
    if whole:
        bench.call("backup", bench.folder / "backups", "--config", bench.folder / "m.toml")
        return next(path for path in (bench.folder / "backups").iterdir() if path.is_dir())
    backup = bench.folder / "backup"
    shutil.copytree(bench.folder / "records", backup / "records")
    with (
        closing(sqlite3.connect(daemon.state / "state.db")) as one,
        closing(sqlite3.connect(backup / "state.db")) as other,
    ):
        one.backup(other)
    return backup


def published(folder: Path, blocks: int) -> dict[str, str]:
    """Return a digest of the values of each variable of the one published file of a folder, of its first blocks."""
    (path,) = folder.glob("*.nc")
    found: dict[str, str] = {}
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        for name, variable in file.variables.items():
            values = np.asarray(variable[:blocks] if variable.dimensions[:1] == ("time",) else variable[...])
            content = repr(values.tolist()).encode() if values.dtype == object else values.tobytes()
            found[name] = hashlib.blake2b(content, digest_size=8).hexdigest()
    return found


def _notices(database: Path) -> int:
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as connection:
        return connection.execute("SELECT count(*) FROM notices").fetchone()[0]


def main() -> None:
    """Make what was asked for."""
    parser = argparse.ArgumentParser(description="backups of earlier commits, for a test")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--commit", nargs="+", choices=COMMITS, default=list(COMMITS), metavar="COMMIT")
    parser.add_argument("--blocks", type=int, default=BLOCKS, help=f"in each backup [{BLOCKS}]")
    options = parser.parse_args()
    for commit in options.commit:
        with tempfile.TemporaryDirectory(prefix="older-") as temporary:
            with baseline_tree(commit, Path(temporary)) as tree:
                folder = Path(temporary) / "machine"
                folder.mkdir()
                make(tree, folder, options.out, full_hash(commit), options.blocks)
                tree.check_imports(folder)
            print(f"{commit}: {(options.out / f'{commit}.tar.xz').stat().st_size} bytes")


if __name__ == "__main__":
    main()

"""Several machines in a folder, and their supervisor as a process of its own."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from monitor.records.store import Store
from tests.faults.daemons import machine_text, start
from tests.streams.folders import csv_bytes, noise


def add_machine(folder: Path, name: str, web: str | None = "enabled = false") -> Path:
    """Write the configuration of a machine with one source, its folders beside it; return the configuration."""
    home = folder / name
    (home / "in0").mkdir(parents=True)
    text = machine_text(home / "in0").replace(
        '[machine]\nname = "m"\n',
        f'[machine]\nname = "{name}"\nstate_dir = "{name}/state"\nrecords_dir = "{name}/records"\n',
    )
    section = "" if web is None else f"[web]\n{web}\n"
    path = folder / f"{name}.toml"
    path.write_text(text.replace("[web]\nenabled = false\n", section))
    return path


def put(folder: Path, name: str, number: int) -> None:
    """Give a machine a file of two blocks."""
    path = folder / name / "in0" / f"f{number:04d}.csv"
    path.with_suffix(".tmp").write_bytes(csv_bytes(noise(512, number)))
    path.with_suffix(".tmp").rename(path)


def said(folder: Path, name: str) -> dict[str, Any]:
    """Return what the daemon of a machine says of itself, {} where it has said nothing yet."""
    try:
        return json.loads((folder / name / "state" / "status.json").read_text())
    except FileNotFoundError:
        return {}


def last(folder: Path, name: str) -> int:
    """Return the number of the last committed block of a machine."""
    with Store.open(folder / name / "state" / "state.db", read_only=True) as store:
        return store.last("s0")


def runs(folder: Path, name: str) -> bool:
    """Tell whether the daemon of a machine says that it is running."""
    return said(folder, name).get("status") == "running"


def supervise(folder: Path, **more: Any) -> subprocess.Popen[str]:
    """Start the supervisor of a folder."""
    return start(folder, **more)

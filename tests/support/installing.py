"""The files of deploy/, and how tests read and install them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SYSTEMD = ROOT / "deploy" / "systemd"
COMMON = SYSTEMD / "common.conf"
UNITS = ("spallwatch@.service", "spallwatch-page.service")
BACKUP, TIMER = "spallwatch-backup@.service", "spallwatch-backup@.timer"
INSTALLER = ROOT / "deploy" / "install.sh"


def directives(unit: Path) -> list[tuple[str, str]]:
    """Return the keys and values of a unit in order, comments aside; a section is a key without value."""
    found = []
    for line in unit.read_text().splitlines():
        if line.startswith("["):
            found.append((line, ""))
        elif line and not line.startswith("#"):
            key, _, value = line.partition("=")
            found.append((key, value))
    return found


def install(
    destination: Path, what: str = "install", more: Mapping[str, str] | None = None, code: int = 0
) -> subprocess.CompletedProcess[str]:
    """Run the installer, without the program unless the environment in ``more`` says otherwise."""
    known = {"PATH": os.environ["PATH"], "DESTDIR": str(destination), "PROGRAM": "no", "BUILDER": sys.executable}
    done = subprocess.run(
        [str(INSTALLER), what], env={**known, **(more or {})}, capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr
    return done

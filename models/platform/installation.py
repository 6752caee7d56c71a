"""Where this program is installed, for the processes that it starts."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
"""The folder that holds the packages of this program."""


def child_path() -> list[str]:
    """Return ``sys.path`` for a process that imports this program: its own folder first.

    The folder of a script or the working directory, which is first in the parent, may hold packages of our names.
    """
    own = str(ROOT)
    return [own, *(place for place in sys.path if place != own)]

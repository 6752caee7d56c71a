"""Recordings of this machine or a mounted file system: their paths, and the number of files in a folder."""

from __future__ import annotations

import os
from pathlib import Path

from streams.remote import is_remote


def local_path(url: str) -> Path | None:
    """Return the path that a recording of a manifest names, None where it names none."""
    if url.startswith("rig:") or is_remote(url):
        return None
    kind, colon, rest = url.partition(":")
    if colon and kind == "folder":
        return Path(rest)
    if colon and kind == "dataset":
        return Path(rest.partition(":")[2])
    return Path(url)


def count_files(url: str) -> int | None:
    """Return the number of files in the folder that a recording is, in those below it too; None of anything else."""
    path = local_path(url)
    if path is None or not path.is_dir():
        return None
    return sum(len(files) for _, _, files in os.walk(path))

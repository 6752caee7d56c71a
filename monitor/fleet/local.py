"""Recordings of this machine or a mounted file system: their paths, and the number of files in a folder."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import unquote, urlsplit

from streams.files.remote import is_remote


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


def without_file_scheme(url: str) -> str:
    """Return a ``file://`` URL as a path, so that a recording has one name however it is given; others as they are."""
    scheme, found, _ = url.partition("://")
    split = urlsplit(url) if found and scheme.lower() == "file" else None
    return url if split is None or split.netloc not in ("", "localhost") or not split.path else unquote(split.path)


def count_files(url: str) -> int | None:
    """Return the number of files in the folder that a recording is, in those below it too; None of anything else."""
    path = local_path(url)
    if path is None or not path.is_dir():
        return None
    return sum(len(files) for _, _, files in os.walk(path))

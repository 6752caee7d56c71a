"""Names of the files that are read together with a file of a recording: its side-car, and its pulses."""

from __future__ import annotations

from streams.types.listing import unpacked_name
from streams.types.spec import FILE_WORDS

FOLDER_NAMES = ("spallwatch.json", "spallwatch.toml")
"""Names of side-cars that are for all files of their folder."""


def sidecar_paths(path: str) -> tuple[str, ...]:
    """Return the paths that the side-car of a file may have; the first that is there counts."""
    folder, slash, _ = path.rpartition("/")
    return f"{path}.json", *(folder + slash + name for name in FOLDER_NAMES)


def is_beside(pattern: str | None) -> bool:
    """Return whether a pattern of pulses is that of files beside the recording."""
    return pattern is not None and any(word in pattern for word in FILE_WORDS)


def pulse_file_of(pattern: str | None, path: str) -> str | None:
    """Return the path of the file of pulses that belongs to a file of the recording; None: pulses are no files."""
    if pattern is None or not is_beside(pattern):
        return None
    folder, slash, name = path.rpartition("/")
    stem, dot, _ = unpacked_name(name).rpartition(".")
    return folder + slash + pattern.replace("{stem}", stem if dot else name).replace("{name}", name)

"""Text files of pulses beside the files of a recording: which belongs to which."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from zoneinfo import ZoneInfo

from streams.files.container import read_guarded
from streams.files.datasets import DataSet, FileFacts
from streams.files.formats.pulse_text import pulse_column
from streams.files.parse.child import isolated
from streams.files.sidecar import is_beside, pulse_file_of
from streams.types.large import Data
from streams.types.listing import unpacked_name
from streams.types.samples import ReaderError, Samples
from streams.types.spec import SourceSpec

_ENDINGS = tuple(f".{word}{end}" for word in ("pulses", "pulse", "tacho") for end in (".csv", ".txt", ""))
"""Endings of files of pulses that need no configuration to be told."""


def is_pulse_file(pattern: str | None, path: str) -> bool:
    """Return whether a file is one of pulses by its name."""
    if pattern is None or not is_beside(pattern):
        return False
    parts = re.split(r"\{(?:stem|name)\}", pattern)
    return re.fullmatch(".+".join(map(re.escape, parts)), path.rpartition("/")[2]) is not None


def pulse_pattern(paths: Sequence[str]) -> str | None:
    """Return the pattern of files of pulses that stand beside others by their names, None where there are none."""
    names = set(paths)
    stems = {unpacked_name(path).rpartition(".")[0] or path for path in names}
    for ending in _ENDINGS:
        own = {path for path in names if path.endswith(ending)}
        if own and own != names and all(path.removesuffix(ending) in stems for path in own):
            return "{stem}" + ending
    return None


def with_pulse_files(data_set: DataSet, spec: SourceSpec, root: Path) -> DataSet:
    """Return the data set with a reader that adds the pulses of the file beside, and without these files.

    A recording without such a file, or with one of no bytes, has no pulses.
    """

    def facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
        return None if is_pulse_file(spec.pulses, path) else data_set.facts(path, place, zone)

    def read(data: Data, path: str) -> Samples:
        samples = data_set.read(data, path)
        beside = pulse_file_of(spec.pulses, path)
        if beside is None or not os.path.lexists(f"{root}/{beside}"):
            return samples
        try:
            raw = read_guarded(root, beside)
            if not raw:
                return samples
            found = isolated(pulse_column, spec.timezone)(raw, beside)
        except ReaderError as error:
            # These words are of the recording: it has neither changed nor broken off.
            status = "unreadable" if error.status in ("changed", "incomplete", "empty") else error.status
            raise ReaderError(status, f"{path}: {error}") from error
        if found.pulses is None:
            return samples
        epoch, pulses = found.pulse_epoch, found.pulses
        if epoch is not None and samples.start is not None:
            pulses, epoch = pulses.shifted(epoch - samples.start), None
        return replace(samples, pulses=pulses, pulse_epoch=epoch)

    return replace(data_set, facts=facts, read=read)

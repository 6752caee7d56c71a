"""Histories of features: CSV with the RMS of every block of a run, healthy ones included."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from monitor.commands.common import InputError
from monitor.commands.history_files import csv_number, open_csv
from monitor.health.onset import LINES, DetectInput
from monitor.health.rest.learned.onset import Onset, find_onset, stated_onset
from streams.types.block import STANDARD_GRAVITY

_LINES = tuple(f"{name}_g" for name in LINES)
NAMES = ("elapsed_s", "rms_g", *_LINES, "outer_floor_g", "peak_g", "kurtosis", "v_eq_mm2")
"""Columns that are known; the first two are needed."""
_OF_AXIS = NAMES[1:]


@dataclass(frozen=True, eq=False)
class FeatureHistory:
    """A history of n blocks.

    Attributes:
        name: of the file, and of the axis where there is one.
        blocks: as the detector takes them; RMS in m/s2.
        v_eq: of each block, m2, NaN where absent.
        onset: of the final stage, or None.
    """

    name: str
    blocks: tuple[DetectInput, ...]
    v_eq: tuple[float, ...]
    onset: Onset | None

    @property
    def times(self) -> list[float]:
        """Elapsed time of each block, s."""
        return [block.time or 0.0 for block in self.blocks]


def read_features(
    path: Path,
    axes: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    *,
    t_fs: float | None = None,
    end: float | None = None,
) -> FeatureHistory:
    """Read a CSV file with ``elapsed_s,rms_g``, others of ``NAMES``, and date its onset.

    Args:
        path: the file; other columns are left out.
        axes: prefixes of all columns but the time, such as "h" for ``h_rms_g``; of several the axis whose final stage
            begins first.
        columns: names in the file by the names here, before the prefix is added.
        t_fs: start of the final stage, s on the axis of the file; by default as the detector dates it.
        end: of the run, s on that axis; what follows is not used.

    Raises:
        InputError: naming file, line and column, what was expected and what was found.
    """
    header, rows = _rows(path)
    read = [_history(path, header, rows, axis, columns or {}) for axis in axes or ("",)]
    read = [_dated(path, history, t_fs, end) for history in read]
    dated = [one for one in read if one.onset is not None]
    return min(dated, key=lambda one: one.onset.place if one.onset else 0) if dated else read[0]


def _rows(path: Path) -> tuple[list[str], list[tuple[int, dict[str, str]]]]:
    """Return the header, and each row with the number of its line."""
    reader, header = open_csv(path, "elapsed_s, rms_g")
    rows = [(reader.line_num, row) for row in reader]
    if not rows:
        raise InputError(f"{path}: no rows below the header")
    return header, rows


def _history(
    path: Path,
    header: Sequence[str],
    rows: Sequence[tuple[int, dict[str, str]]],
    axis: str,
    columns: Mapping[str, str],
) -> FeatureHistory:
    names = {name: _column(header, axis, name, columns) for name in NAMES}
    for name in NAMES[:2]:
        if names[name] not in header:
            raise InputError(
                f"{path}: column {names[name]} is missing; expected elapsed_s,rms_g (another axis: --axis h for "
                f"h_rms_g; other names: --column rms_g=NAME), found {', '.join(header)}"
            )
    found = {
        name: [csv_number(path, line, column, row.get(column), needed=name in NAMES[:2]) for line, row in rows]
        for name, column in names.items()
        if column in header
    }
    for (line, _), (before, after) in zip(rows[1:], pairwise(found["elapsed_s"]), strict=True):
        if after <= before:
            raise InputError(
                f"{path}: line {line}: {names['elapsed_s']} goes from {before:g} to {after:g}; it must increase"
            )
    if not any(value > 0.0 for value in found["rms_g"]):
        raise InputError(f"{path}: column {names['rms_g']}: no value above zero")
    blocks = tuple(_block(place, found) for place in range(len(rows)))
    v_eq = tuple(value * 1e-6 for value in found.get("v_eq_mm2", [math.nan] * len(rows)))
    return FeatureHistory(f"{path.name}:{axis}" if axis else path.name, blocks, v_eq, None)


def _dated(path: Path, history: FeatureHistory, t_fs: float | None, end: float | None) -> FeatureHistory:
    """Return a history up to its end, with its onset."""
    blocks = history.blocks
    if end is not None:
        blocks = tuple(block for block in blocks if block.time is not None and block.time <= end)
    if not blocks:
        raise InputError(f"--end-s {end:g}: lies before the first block of {path}, at {history.times[0]:g} s")
    onset = find_onset(blocks) if t_fs is None else stated_onset(blocks, t_fs)
    return replace(history, blocks=blocks, onset=onset)


def _column(header: Sequence[str], axis: str, name: str, columns: Mapping[str, str]) -> str:
    """Return the name in the file; ``time_s`` is taken for ``elapsed_s`` where only that is there."""
    prefix = f"{axis}_" if axis and name in _OF_AXIS else ""
    given = columns.get(name, name)
    if name == "elapsed_s" and name not in columns and name not in header and "time_s" in header:
        return "time_s"
    return given if given in header and name in columns else prefix + given


def _block(place: int, found: Mapping[str, Sequence[float]]) -> DetectInput:
    """Return a block as the detector takes it.

    The floor of the outer race stands for that of all lines; lines without it do not date an onset.
    """
    shown = {name: found[name][place] if name in found else math.nan for name in (*_LINES, "outer_floor_g", "peak_g")}
    floor, peak = shown["outer_floor_g"], shown["peak_g"]
    return DetectInput(
        sequence=place + 1,
        time=found["elapsed_s"][place],
        rms=found["rms_g"][place] * STANDARD_GRAVITY,
        prominence={name: shown[f"{name}_g"] / floor for name in LINES if shown[f"{name}_g"] > 0.0 and floor > 0.0},
        peak=peak * STANDARD_GRAVITY if peak > 0.0 else None,
    )

"""Calibrated WAV files of sound pressure: 24-bit samples, the pressure at full scale stated in the file.

The comment (``ICMT`` of the ``INFO`` list) reads ``spallwatch full_scale_pascal=2.0``. Nothing is normalised silently:
two files of one full scale can be compared by ear, and a pressure beyond it is refused.
"""

from __future__ import annotations

import math
import os
import struct
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models.words.checks import check_positive, check_whole
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_COUNTS = 1 << 23
_STATES = "spallwatch full_scale_pascal="
_MAX_BYTES = 0xFFFF_FFFF - 1024


class WavError(WrongInputError):
    """A pressure that a WAV file cannot hold, or a file that is none of this module's."""


@dataclass(frozen=True)
class Sound:
    """Pressure, Pa, shape (channels, samples), its rate, Hz, and the pressure at full scale, Pa."""

    pressure: NDArray[np.float64]
    rate: int
    full_scale: float


def full_scale_for(pressure: ArrayLike) -> float:
    """Return the least of 1, 2 and 5 times a power of ten, Pa, that exceeds the peak; 1 Pa for silence."""
    peak = float(np.max(np.abs(np.asarray(pressure, np.float64)), initial=0.0))
    if peak == 0.0:
        return 1.0
    decade = math.floor(math.log10(peak))
    steps = [digit * 10.0**power for power in (decade - 1, decade, decade + 1) for digit in (1.0, 2.0, 5.0)]
    return next(step for step in steps if peak <= step * (1.0 - 1.0 / _COUNTS))


def write_wav(path: Path | str, pressure: ArrayLike, rate: float, *, full_scale: float) -> None:
    """Write sound pressure as 24-bit WAV, replacing the file at once.

    Args:
        path: file to write.
        pressure: Pa, shape (samples,) or (channels, samples).
        rate: samples a second, a whole number.
        full_scale: Pa at full scale; ``full_scale_for`` has the next round one.

    Raises:
        WavError: if a value is not finite or beyond full scale, there are no samples, or more than a WAV holds.
        ValueError: if the rate is no whole number or full scale is not positive.
    """
    check_whole(rate, "rate", 1)
    check_positive(full_scale=full_scale)
    rows = np.atleast_2d(np.asarray(pressure, np.float64))
    if rows.ndim != 2 or rows.size == 0 or rows.shape[0] > 0xFFFF:
        raise WavError(f"{path}: expected pressures of shape (channels, samples), got {rows.shape}")
    peak = float(np.max(np.abs(rows)))
    if not math.isfinite(peak):
        raise WavError(f"{path}: expected finite pressures, got {peak}")
    if peak > full_scale * (1.0 - 1.0 / _COUNTS):
        raise WavError(f"{path}: the peak of {peak:.4g} Pa would clip at the full scale of {full_scale:.4g} Pa")
    if rows.size * 3 > _MAX_BYTES:
        raise WavError(f"{path}: a WAV file holds {_MAX_BYTES} bytes, these {rows.size} samples are more")
    counts = np.rint(rows.T * (_COUNTS / full_scale)).astype("<i4")
    data = np.ascontiguousarray(counts).view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
    _replace(Path(path), _riff(data, rows.shape[0], int(rate), full_scale))


def _riff(data: bytes, channels: int, rate: int, full_scale: float) -> bytes:
    form = struct.pack("<HHIIHH", 1, channels, rate, rate * channels * 3, channels * 3, 24)
    comment = f"{_STATES}{full_scale!r}".encode("ascii") + b"\0"
    info = b"INFO" + _chunk(b"ICMT", comment)
    return _chunk(b"RIFF", b"WAVE" + _chunk(b"fmt ", form) + _chunk(b"LIST", info) + _chunk(b"data", data))


def _chunk(name: bytes, content: bytes) -> bytes:
    return name + struct.pack("<I", len(content)) + content + b"\0" * (len(content) % 2)


def _replace(path: Path, content: bytes) -> None:
    """Write beside a file and move there, so that a reader sees the old one or the whole new one."""
    handle, beside = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        Path(beside).replace(path)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise


def read_wav(path: Path | str) -> Sound:
    """Read a file that ``write_wav`` wrote, in Pa.

    Raises:
        WavError: if the file is no such WAV, is cut short or does not state its full scale.
    """
    content = Path(path).read_bytes()
    if content[:4] != b"RIFF" or content[8:12] != b"WAVE":
        raise WavError(f"{path}: expected a WAV file, got {content[:12]!r}")
    chunks = _chunks(content, 12, str(path))
    comments = _chunks(chunks.get(b"LIST", b"INFO"), 4, str(path))
    comment = comments.get(b"ICMT", b"").rstrip(b"\0").decode("ascii", "replace")
    if not comment.startswith(_STATES):
        raise WavError(f"{path}: expected the comment '{_STATES}...' that states the full scale, got {comment!r}")
    if b"fmt " not in chunks or b"data" not in chunks or len(chunks[b"fmt "]) < 16:
        raise WavError(f"{path}: expected the chunks 'fmt ' and 'data', got {sorted(chunks)}")
    kind, channels, rate, _, _, bits = struct.unpack("<HHIIHH", chunks[b"fmt "][:16])
    if (kind, bits) != (1, 24):
        raise WavError(f"{path}: expected 24-bit integers (format 1), got {bits} bits of format {kind}")
    full_scale = _number(comment.removeprefix(_STATES), str(path))
    data = np.frombuffer(chunks[b"data"], np.uint8).reshape(-1, 3)
    counts = np.zeros((len(data), 4), np.uint8)
    counts[:, 1:] = data
    values = (counts.view("<i4").reshape(-1, channels) >> 8).T
    return Sound(np.asarray(values * (full_scale / _COUNTS), np.float64), rate, full_scale)


def _number(text: str, path: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise WavError(f"{path}: expected a positive full_scale_pascal in the comment, got {text!r}")
    return value


def _chunks(content: bytes, start: int, path: str) -> dict[bytes, bytes]:
    found: dict[bytes, bytes] = {}
    while start + 8 <= len(content):
        name, size = struct.unpack_from("<4sI", content, start)
        if start + 8 + size > len(content):
            raise WavError(f"{path}: the chunk {name!r} promises {size} bytes, {len(content) - start - 8} are there")
        found[name] = content[start + 8 : start + 8 + size]
        start += 8 + size + size % 2
    return found

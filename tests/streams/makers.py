"""Small recordings, as the rigs would have written them."""

from __future__ import annotations

import bz2
import functools
import gzip
import io
import lzma
import os
import tarfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io


@functools.lru_cache(maxsize=200)
def pronostia_csv(number: int, separator: str = ",", rows: int = 2560, constant: float | None = None) -> bytes:
    """A PRONOSTIA file whose horizontal samples begin with its number, and whose clock is of no use."""
    rng = np.random.default_rng(number)
    values = np.round(rng.normal(size=(rows, 2)), 3) if constant is None else np.full((rows, 2), constant)
    values[0, 0] = number
    lines = (f"9,10,{number % 60},{k * 39.0 % 1e6:.4e},{a:.3f},{b:.3f}" for k, (a, b) in enumerate(values))
    return ("\n".join(lines).replace(",", separator) + "\n").encode()


def ims_text(columns: int, rows: int = 20480) -> bytes:
    """An IMS file: tabs, no header."""
    values = np.round(np.random.default_rng(columns).normal(size=(rows, columns)), 3)
    return ("\n".join("\t".join(f"{v:.3f}" for v in row) for row in values) + "\n").encode()


def mat_file(path: Path, values: dict[str, Any]) -> Path:
    """Write a MAT file."""
    scipy.io.savemat(path, values)
    return path


def tar_file(path: Path, members: Iterable[tuple[str, bytes | tarfile.TarInfo]]) -> Path:
    """Write a tar archive with its members in the order given; a TarInfo stands for a link or a device."""
    plain = io.BytesIO()
    with tarfile.open(fileobj=plain, mode="w") as archive:
        for name, content in members:
            if isinstance(content, tarfile.TarInfo):
                archive.addfile(content)
                continue
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    compress = {".xz": lzma.compress, ".bz2": bz2.compress, ".gz": gzip.compress}.get(path.suffix, bytes)
    path.write_bytes(compress(plain.getvalue()))
    return path


def packed(path: Path, data: bytes) -> Path:
    """Write a file compressed by xz."""
    path.write_bytes(lzma.compress(data))
    return path


def fifo(path: Path) -> Path:
    """Make a pipe, which would block for ever whoever opens it to read."""
    os.mkfifo(path)
    return path

"""Acoustic transfer vectors as ``.npz`` and CSV, as other programs write them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from models.gears.sound.transfer_vectors import TransferVectors

NEEDED = "microphone,point,frequency_hz,real_pascal_per_m_per_s,imag_pascal_per_m_per_s"
PLACES = {
    "microphone_position": "microphone_x_m,microphone_y_m,microphone_z_m",
    "point_position": "point_x_m,point_y_m,point_z_m",
    "normal": "normal_x,normal_y,normal_z",
}


def write_transfer_vectors(path: Path, vectors: TransferVectors) -> None:
    """Write transfer vectors, ``.npz`` or else CSV with all digits."""
    if path.suffix == ".npz":
        names = ("frequency", "h", "microphones", "points", "sound_speed", "over_plane", *PLACES)
        arrays = {name: getattr(vectors, name) for name in names if getattr(vectors, name) is not None}
        np.savez_compressed(path, version=1, **arrays)
    else:
        path.write_text("\n".join(_csv_lines(vectors)) + "\n")


def _csv_lines(vectors: TransferVectors) -> Iterator[str]:
    yield "# acoustic transfer vectors, exp(+i omega t), normals into the air"
    yield f"# sound_speed_m_per_s,{vectors.sound_speed!r}"
    if vectors.over_plane:
        yield "# over_plane,z=0"
    known = [name for name in PLACES if getattr(vectors, name) is not None]
    yield ",".join((NEEDED, *(PLACES[name] for name in known)))
    for j, microphone in enumerate(vectors.microphones):
        for k, point in enumerate(vectors.points):
            rows = {name: getattr(vectors, name)[j if name == "microphone_position" else k] for name in known}
            tail = "".join(f",{float(value)!r}" for row in rows.values() for value in row)
            for f, value in zip(vectors.frequency, vectors.h[:, j, k], strict=True):
                yield f"{microphone},{point},{float(f)!r},{float(value.real)!r},{float(value.imag)!r}{tail}"

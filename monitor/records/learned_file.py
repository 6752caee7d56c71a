"""Learned models as files: JSON, or ``.npz`` with the same text and no other array."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from models.words.errors import WrongInputError
from monitor.health.rest.learned.model import LearnedModel
from monitor.records.database import replacing

SCHEMA_VERSION = 1
SUFFIXES = (".npz", ".json")
_KIND = "spallwatch learned library"
_MAX_MIB = 16
_ZIP = b"PK"


class LearnedFileError(WrongInputError, ValueError):
    """A file of a learned model cannot be used; the message names file and cause."""


def save_learned(model: LearnedModel, path: Path) -> None:
    """Replace a file atomically, as JSON or as ``.npz`` by its suffix; may raise OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    values = {"kind": _KIND, "schema_version": SCHEMA_VERSION, "hash": model.hash, **model.to_dict()}
    text = json.dumps(values, indent=1, sort_keys=True, allow_nan=False)
    with replacing(path) as temporary:
        if path.suffix == ".npz":
            with temporary.open("wb") as stream:
                np.savez_compressed(stream, allow_pickle=False, header=np.array(text))
        else:
            temporary.write_text(text + "\n", encoding="utf-8")


def is_learned(path: Path) -> bool:
    """Return whether a file is one of a learned model, of any version; False where it cannot be read."""
    try:
        return _read(path).get("kind") == _KIND
    except LearnedFileError:
        return False


def load_learned(path: Path) -> LearnedModel:
    """Return the model in a file; LearnedFileError for another version or a content without its hash."""
    values = _read(path)
    kind, version = values.pop("kind", None), values.pop("schema_version", None)
    if (kind, version) != (_KIND, SCHEMA_VERSION):
        raise LearnedFileError(
            f"{path}: {_KIND} of version {SCHEMA_VERSION} expected, got {kind!r} of version {version!r}; "
            "make one with: spallwatch library learn RUNS... --out FILE"
        )
    stated = values.pop("hash", None)
    try:
        model = LearnedModel.from_dict(values)
        found = model.hash
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise LearnedFileError(f"{path}: not a usable model: {type(error).__name__}: {error}") from error
    if found != stated:
        raise LearnedFileError(
            f"{path}: its content is not what was written: hash {str(stated)[:16]} expected, found {found[:16]}; "
            "learn it anew"
        )
    return model


def _read(path: Path) -> dict[str, Any]:
    """Return the values of a file as they stand there."""
    try:
        size = path.stat().st_size
        if size > _MAX_MIB * 2**20:
            raise LearnedFileError(f"{path}: larger than {_MAX_MIB} MiB, so it is no learned library")
        with path.open("rb") as file:
            zipped = file.read(len(_ZIP)) == _ZIP
            file.seek(0)
            if zipped:
                with np.load(file, allow_pickle=False) as archive:
                    text = str(archive["header"])
            else:
                text = file.read().decode("utf-8")
        values = json.loads(text)
    except FileNotFoundError:
        raise LearnedFileError(
            f"{path}: no such file; make one with: spallwatch library learn RUNS... --out {path}"
        ) from None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise LearnedFileError(f"{path}: not a learned library (JSON, or .npz with a header)") from error
    if not isinstance(values, dict):
        raise LearnedFileError(f"{path}: not a learned library: an object expected")
    return values

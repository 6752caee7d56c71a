"""Libraries as files without pickles: of simulated lives as ``.npz`` of plain arrays, learned models as text.

Both have a header in JSON; a learned model is that text alone, as ``.json`` or in an ``.npz``.
"""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from models.words.errors import WrongInputError
from monitor.health.rest.learned.model import LearnedModel
from monitor.health.size.library.model import LINES, FeatureFit, Library, Regression, arrays_of, header_of
from monitor.health.size.library.plausible import Limits
from monitor.records.durable import replacing

SCHEMA_VERSION = 3
_KIND = "spallwatch library"


class LibraryError(WrongInputError, ValueError):
    """A library file cannot be used; the message names file and cause."""


def save_library(library: Library, path: Path | str) -> None:
    """Replace a library file atomically; may raise OSError."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"kind": _KIND, "schema_version": SCHEMA_VERSION, "hash": library.hash, **header_of(library)}
    arrays: dict[str, Any] = {"header": np.array(json.dumps(header, sort_keys=True, allow_nan=False))}
    for name, fit in library.fits.items():
        arrays |= {f"{name}/{key}": value for key, value in arrays_of(fit).items()}
    handle, part = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    temporary = Path(part)
    try:
        with os.fdopen(handle, "wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **arrays)
        # mkstemp makes files that only their owner can read.
        temporary.chmod(0o640)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def load_library(path: Path | str) -> Library:
    """Return the library in a file; LibraryError for another version or a content without its hash."""
    path = Path(path)
    if not path.is_file():
        raise LibraryError(f"{path}: no such library; make one with: spallwatch library build --out {path}")
    try:
        # Opened here: numpy leaves a damaged archive open that it opened itself.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        # The message of numpy advises to unpickle it.
        raise LibraryError(f"{path}: not a readable .npz of plain arrays") from error
    except AttributeError:
        raise LibraryError(f"{path}: a single array, expected an .npz archive") from None
    try:
        header = json.loads(str(arrays.pop("header")))
        kind, version = header["kind"], header["schema_version"]
    except (KeyError, TypeError, ValueError):
        raise LibraryError(f"{path}: has no header, so it is no library of simulated lives") from None
    if (kind, version) != (_KIND, SCHEMA_VERSION):
        raise LibraryError(
            f"{path}: {_KIND} of version {SCHEMA_VERSION} expected, got {kind!r} of version {version!r}; build it anew"
        )
    try:
        library = _library(header, arrays)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise LibraryError(f"{path}: not a usable library: {type(error).__name__}: {error}") from error
    if library.hash != header["hash"]:
        raise LibraryError(
            f"{path}: its content is not what was written: hash {header['hash'][:16]} expected, "
            f"found {library.hash[:16]}; build it anew"
        )
    return library


def _library(header: dict[str, Any], arrays: dict[str, Any]) -> Library:
    fits = {name: _fit(name, header["fits"][name], arrays) for name in LINES if name in header["fits"]}
    plain = ("load_spread", "speed_spread", "prior", "made_of", "scores", "calibration")
    low_load, high_load = header["load"]
    low_speed, high_speed = header["speed"]
    return Library(
        thresholds=tuple(header["thresholds"]),
        load=(low_load, high_load),
        speed=(low_speed, high_speed),
        fits=fits,
        **{name: header[name] for name in plain},
    )


def _fit(name: str, header: dict[str, Any], arrays: dict[str, Any]) -> FeatureFit:
    own = {key.removeprefix(f"{name}/"): value for key, value in arrays.items() if key.startswith(f"{name}/")}
    regression = Regression(**_part("regression", Regression, own))
    limits = Limits(**_part("limits", Limits, own)) if "limits.rise" in own else None
    return FeatureFit(
        features=name,
        interval=header["interval"],
        longest=header["longest"],
        regression=regression,
        limits=limits,
        **own,
    )


def _part(name: str, kind: type[Regression | Limits], own: dict[str, Any]) -> dict[str, Any]:
    """Take the arrays of a part of a fit from ``own``."""
    return {field.name: own.pop(f"{name}.{field.name}") for field in fields(kind)}


_LEARNED_VERSION = 1
SUFFIXES = (".npz", ".json")
_LEARNED_KIND = "spallwatch learned library"
_MAX_MIB = 16
_ZIP = b"PK"


class LearnedFileError(WrongInputError, ValueError):
    """A file of a learned model cannot be used; the message names file and cause."""


def save_learned(model: LearnedModel, path: Path) -> None:
    """Replace a file atomically, as JSON or as ``.npz`` by its suffix; may raise OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    values = {"kind": _LEARNED_KIND, "schema_version": _LEARNED_VERSION, "hash": model.hash, **model.to_dict()}
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
        return _read_learned(path).get("kind") == _LEARNED_KIND
    except LearnedFileError:
        return False


def load_learned(path: Path) -> LearnedModel:
    """Return the model in a file; LearnedFileError for another version or a content without its hash."""
    values = _read_learned(path)
    kind, version = values.pop("kind", None), values.pop("schema_version", None)
    if (kind, version) != (_LEARNED_KIND, _LEARNED_VERSION):
        raise LearnedFileError(
            f"{path}: {_LEARNED_KIND} of version {_LEARNED_VERSION} expected, got {kind!r} of version {version!r}; "
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


def _read_learned(path: Path) -> dict[str, Any]:
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

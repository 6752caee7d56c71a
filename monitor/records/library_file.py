"""Libraries of simulated lives as files: ``.npz`` of plain arrays without pickles, with a JSON header."""

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
from monitor.health.size.library.model import LINES, FeatureFit, Library, Regression, arrays_of, header_of
from monitor.health.size.library.plausible import Limits

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
        temporary.chmod(0o644)
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

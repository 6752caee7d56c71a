"""RMS maps as files: load and save, or build on first use and keep.

A map file is netCDF-4 with dimensions load, speed, h_d, dphi_d and bpfo_harmonic, SI units. Reading one needs no numba.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from platformdirs import user_cache_dir

from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.nodes import Progress
from models.maps.plan import AXES, SCHEMA_VERSION, MapError, MapPlan
from models.solve.response import HARMONICS, STATUSES
from models.work.runner import SERIAL

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.work.runner import Runner

_HARMONIC = "bpfo_harmonic"
_CONTENT = "content_hash"
_UNITS = {"load": "N", "speed": "Hz", "h_d": "m", "dphi_d": "rad"}
_LONG_NAMES = {
    "load": "radial load",
    "speed": "shaft speed",
    "h_d": "depth of the defect",
    _HARMONIC: "multiple of the frequency that the attribute lines_of names",
    "dphi_d": "angular extent of the defect",
    "rms": "RMS of the acceleration along the load, at the sensor that the attribute sensor names",
    "rms_std": "standard deviation of the RMS over floors, or over periods or turns where there is one floor",
    "rms_se": "standard error of the RMS as a mean over floors, or over turns where there is one floor",
    "rms_error": "estimated numerical error of the RMS",
    "harmonic_amplitude": "single-sided amplitude of the lines of the damaged part",
    "harmonic_std": "standard deviation of these amplitudes over floors",
    "harmonic_se": "standard error of these amplitudes as means over floors",
    "harmonic_error": "estimated numerical error of these amplitudes",
    "rms_rig_std": "standard deviation of the RMS over uncertain parameters of the rig",
    "harmonic_rig_std": "standard deviation of these amplitudes over uncertain parameters of the rig",
}
_MARKED: tuple[Literal["h_d", "dphi_d"], ...] = ("h_d", "dphi_d")
_VALUES = ("rms", "rms_std", "rms_se", "rms_error", "rms_rig_std")
_LINES = ("harmonic_amplitude", "harmonic_std", "harmonic_se", "harmonic_error", "harmonic_rig_std")


def save_map(rms_map: RmsMap, path: Path | str) -> None:
    """Write a map, replacing ``path`` atomically.

    Raises:
        OSError: if the folder cannot be written to.
    """
    from netCDF4 import Dataset

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        with Dataset(temporary, "w", format="NETCDF4") as dataset:
            _write(dataset, rms_map)
    except RuntimeError as error:
        # The library does not say why, as on a disk that is full.
        free = shutil.disk_usage(path.parent).free
        raise OSError(errno.EIO, f"{error}, with {1e-6 * free:.1f} MB free") from None
    else:
        # mkstemp makes files that only their owner can read.
        temporary.chmod(0o640)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def content_hash(rms_map: RmsMap) -> str:
    """Return a hash of the plan and of all values of a map."""
    digest = hashlib.sha256(rms_map.plan.hash().encode())
    for name in (*AXES, *_VALUES, *_LINES, "status"):
        digest.update(np.ascontiguousarray(getattr(rms_map, name)).tobytes())
    return digest.hexdigest()


def _write(dataset: Any, rms_map: RmsMap) -> None:
    dataset.setncatts(rms_map.attributes | {_CONTENT: content_hash(rms_map)})
    for axis in AXES:
        values = getattr(rms_map, axis)
        dataset.createDimension(axis, len(values))
        _variable(dataset, axis, "f8", (axis,), values, _UNITS[axis])
    dataset.createDimension(_HARMONIC, HARMONICS)
    _variable(dataset, _HARMONIC, "i4", (_HARMONIC,), np.arange(1, HARMONICS + 1), "1")
    for name in _VALUES:
        _variable(dataset, name, "f8", AXES, getattr(rms_map, name), "m s-2")
    for name in _LINES:
        _variable(dataset, name, "f8", (*AXES, _HARMONIC), getattr(rms_map, name), "m s-2")
    status = dataset.createVariable("status", "i1", AXES)
    status.long_name = "how the simulation of a node ended"
    status.flag_values = np.arange(len(STATUSES), dtype=np.int8)
    status.flag_meanings = " ".join(STATUSES)
    status[...] = rms_map.status
    _write_marks(dataset, rms_map)


def _write_marks(dataset: Any, rms_map: RmsMap) -> None:
    """Write where the map is not monotone, for other readers; ``load_map`` ignores it."""
    for axis in _MARKED:
        marks = dataset.createVariable(f"not_monotone_{axis}", "i1", AXES)
        marks.long_name = f"whether the RMS falls to the next node along {axis}, beyond its errors"
        marks.flag_values = np.arange(2, dtype=np.int8)
        marks.flag_meanings = "not_falling falling"
        marks[...] = rms_map.falling(axis).astype(np.int8)


def _variable(dataset: Any, name: str, kind: Any, dims: tuple[str, ...], values: NDArray[Any], units: str) -> None:
    variable = dataset.createVariable(name, kind, dims)
    variable.units = units
    variable.long_name = _LONG_NAMES[name]
    variable[...] = values


def load_map(path: Path | str) -> RmsMap:
    """Return the map in a file.

    Raises:
        MapError: naming the file and the problem: missing, unreadable, not a map, of another schema, incomplete, or
            changed since it was made.
    """
    from netCDF4 import Dataset

    path = Path(path)
    if not path.is_file():
        raise MapError(f"{path}: no such file")
    try:
        dataset = Dataset(path, "r")
    except (OSError, RuntimeError, UnicodeError) as error:
        raise MapError(f"{path}: not a readable netCDF file: {error}") from error
    with dataset:
        try:
            return _read(dataset)
        except MapError as error:
            raise MapError(f"{path}: {error}") from error
        except (KeyError, IndexError, TypeError, ValueError, RuntimeError, AttributeError, OSError) as error:
            raise MapError(f"{path}: not a usable RMS map: {type(error).__name__}: {error}") from error


def _read(dataset: Any) -> RmsMap:
    attributes = {name: _plain(dataset.getncattr(name)) for name in dataset.ncattrs()}
    if attributes.get("schema_version") != SCHEMA_VERSION:
        found = attributes.get("schema_version", "none")
        what = "not an RMS map" if found == "none" else "a map of another version, build it anew"
        raise MapError(f"schema_version is {found}, expected {SCHEMA_VERSION}: {what}")
    missing = [n for n in (*AXES, *_VALUES, *_LINES, "status") if n not in dataset.variables]
    if missing:
        raise MapError(f"variables missing: {', '.join(missing)}")
    axes = {name: np.asarray(dataset[name][:], dtype=float) for name in AXES}
    plan = MapPlan.from_json(str(attributes.get("parameters", "")))
    for name in AXES:
        if not np.array_equal(axes[name], getattr(plan, name)):
            raise MapError(f"axis {name} is not the one that the parameters name")
    arrays = {name: np.ma.filled(dataset[name][...], np.nan).astype(float) for name in (*_VALUES, *_LINES)}
    status = np.ma.filled(dataset["status"][...], -1).astype(np.int8)
    _check_values(plan, arrays, status)
    if attributes.get("hash") != plan.hash():
        raise MapError("the hash does not belong to the parameters and this version of the model; build the map anew")
    read = RmsMap(**axes, **arrays, status=status, attributes=attributes)
    if attributes.get(_CONTENT) != content_hash(read):
        raise MapError("its values are not those that were written (their hash differs); build the map anew")
    return read


def _check_values(plan: MapPlan, arrays: dict[str, NDArray[np.float64]], status: NDArray[np.int8]) -> None:
    usable = status != STATUSES.index("not_converged")
    if status.shape != plan.shape or not np.all((status >= 0) & (status < len(STATUSES))):
        raise MapError(f"status has shape {status.shape} or unknown values, expected shape {plan.shape}")
    for name, values in arrays.items():
        shape = plan.shape if name in _VALUES else (*plan.shape, HARMONICS)
        if values.shape != shape:
            raise MapError(f"{name} has shape {values.shape}, expected {shape}")
        if not np.all(np.isfinite(values[usable])) or np.any(values[usable] < 0.0):
            raise MapError(f"{name} holds values that are not finite or negative")


def _plain(value: Any) -> Any:
    """Return an attribute as plain Python: numpy scalars and arrays of netCDF become numbers and lists."""
    return cast("Any", value).tolist() if isinstance(value, np.generic | np.ndarray) else value


def default_map_path(plan: MapPlan, cache_dir: Path | str | None = None) -> Path:
    """Return where the map of a plan is kept: by its hash, in ``cache_dir`` or the user's cache folder."""
    folder = Path(cache_dir) if cache_dir is not None else Path(user_cache_dir("spallwatch")) / "maps"
    return folder / f"rms-map-{plan.hash()[:16]}.nc"


def cached_map(
    plan: MapPlan, cache_dir: Path | str | None = None, *, runner: Runner = SERIAL, progress: Progress | None = None
) -> RmsMap:
    """Return the map of a plan, built on first use and read afterwards; a damaged one is rebuilt."""
    path = default_map_path(plan, cache_dir)
    try:
        kept = load_map(path)
        if kept.hash == plan.hash():
            return kept
    except MapError:
        pass
    built = build_map(plan, runner=runner, progress=progress)
    save_map(built, path)
    return built

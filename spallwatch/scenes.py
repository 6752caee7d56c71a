"""The model of a bearing: scenes, their vibration, and maps of RMS over defects."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path

import numpy as np
import xarray as xr

from models.machine.bearing import Bearing
from models.machine.scene import Defect, Part, Scene
from models.maps.build import build_map as build_plan
from models.maps.build import build_refined_map
from models.maps.data import RmsMap
from models.maps.file import load_map
from models.maps.file import save_map as write_map
from models.maps.plan import MapPlan
from models.solve.response import Response
from models.words.request import Sensor
from models.work.choose import local_runner
from spallwatch._arguments import configuration
from spallwatch.recordings import to_signal

_BENCH = "1205 ETN9"
_EXTENTS, _DEPTHS = tuple(map(float, range(51))), tuple(map(float, range(33)))


def scene(
    *,
    bearing: Bearing | str = _BENCH,
    speed_hz: float = 40.0,
    load_newton: float = 4000.0,
    dphi_deg: float = 0.0,
    h_d_um: float = 0.0,
    fault: Part = "outer",
    clearance_um: float = 0.0,
    model: str = "auto",
) -> Scene:
    """Return a scene that ``simulate`` takes: by default the healthy bearing of the thesis on its test bench.

    ``dataclasses.replace`` adds what else ``Scene`` has: a rough floor, waviness, slip, further defects, another rig.

    Args:
        bearing: geometry, or a designation of the catalogue.
        speed_hz: of the shaft.
        load_newton: radial load.
        dphi_deg, h_d_um: extent and depth of a defect; 0: none.
        fault: the damaged part.
        clearance_um: radial clearance.
        model: "auto" takes the cheapest model that describes the scene.

    Raises:
        ConfigError, ValueError: a value is not allowed, or the geometry does not give the contact stiffness.
    """
    config = configuration(
        [{"name": "sensor", "unit": "m/s2"}],
        bearing=bearing,
        operating={"speed_hz": speed_hz, "load_newton": load_newton},
    )
    entry = config.bearing[0].to_entry()
    damaged = dphi_deg != 0.0 and h_d_um != 0.0
    return Scene(
        speed=speed_hz,
        load=load_newton,
        bearing=entry.bearing,
        rig=config.rig_of(entry),
        defect=Defect(math.radians(dphi_deg), h_d_um * 1e-6, part=fault) if damaged else None,
        clearance=clearance_um * 1e-6,
        model=model,
    )


def acceleration(
    response: Response, *, rate_hz: float = 25600.0, duration_s: float | None = None, sensor: Sensor | None = None
) -> xr.DataArray:
    """Return the acceleration that a recorder would sample of a simulated scene.

    Args:
        response: of ``simulate``.
        rate_hz: sampling rate; lines above 0.9 of half of it are left out, as by an anti-alias filter.
        duration_s: length, by default 1 s; of a motion that does not repeat at most what was simulated, by default all.
        sensor: by default the first acceleration of the model.

    Returns:
        As ``to_signal``, with one channel that has the name of the sensor.

    Raises:
        ValueError: rate or duration are not positive, or the response has no such signal.
    """
    chosen = sensor or response.accelerometer
    record = response.record
    whole = 1.0 if record is None else record.signal.shape[1] / record.rate
    values = response.acceleration(rate_hz, whole if duration_s is None else duration_s, sensor=chosen)
    return to_signal(values, rate_hz=rate_hz, unit="m/s2", channels=(chosen,))


def build_map(
    *,
    bearing: Bearing | str = _BENCH,
    load_newton: float | Sequence[float],
    speed_hz: float | Sequence[float],
    dphi_deg: Sequence[float] = _EXTENTS,
    h_d_um: Sequence[float] = _DEPTHS,
    fault: Part = "outer",
    clearance_um: float = 0.0,
    rms_band_hz: tuple[float, float] | None = None,
    interpolation_tolerance: float = 0.01,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> RmsMap:
    """Simulate a map of RMS over extent and depth of a defect, on the test bench of the thesis.

    Args:
        bearing: geometry, or a designation of the catalogue.
        load_newton, speed_hz: one or several, ascending.
        dphi_deg, h_d_um: extents and depths, ascending; 51 times 33 by default.
        fault: the damaged part.
        clearance_um: radial clearance.
        rms_band_hz: band of the RMS, the same as that of the recordings; by default all frequencies.
        interpolation_tolerance: the axes are refined until the error between nodes, rms over the largest RMS, is below
            this; 0: they are left as they are.
        workers: on this machine; 0: one a core.
        progress: called with nodes done and nodes in all.

    Returns:
        ``attributes`` state its errors; ``map_dataset`` gives it as a dataset.

    Raises:
        MapError, ConfigError: a value is not allowed.
    """
    loads, speeds = (
        tuple(np.atleast_1d(np.asarray(given, dtype=np.float64)).tolist()) for given in (load_newton, speed_hz)
    )
    first = scene(bearing=bearing, speed_hz=speeds[0], load_newton=loads[0], clearance_um=clearance_um, model="six_dof")
    plan = MapPlan(
        load=loads,
        speed=speeds,
        h_d=tuple(depth * 1e-6 for depth in h_d_um),
        dphi_d=tuple(math.radians(extent) for extent in dphi_deg),
        bearing=first.bearing,
        rig=first.rig,
        clearance=first.clearance,
        rms_band=rms_band_hz,
        part=fault,
    )
    with local_runner(workers) as runner:
        if interpolation_tolerance == 0.0:
            return build_plan(plan, runner=runner, progress=progress)
        return build_refined_map(plan, interpolation_tolerance, runner=runner, progress=progress)


def open_map(path: str | PathLike[str]) -> RmsMap:
    """Read a map of ``spallwatch map build`` or ``save_map``; MapError where the file is none."""
    return load_map(Path(path))


def save_map(rms_map: RmsMap, path: str | PathLike[str]) -> None:
    """Write a map (netCDF), as a monitor and the command line read it; OSError where that fails."""
    write_map(rms_map, Path(path))


def map_dataset(rms_map: RmsMap) -> xr.Dataset:
    """Return a map as a dataset, SI and radians.

    Returns:
        Dimensions (load, speed, h_d, dphi_d): ``rms``, its numerical error ``rms_error``; and ``v_eq`` (h_d, dphi_d),
        the equivalent damaged volume per width (Gabrielli's thesis, Eq. 90).
    """
    axes = {
        "load": ("N", "radial load"),
        "speed": ("Hz", "speed of the shaft"),
        "h_d": ("m", "depth of the defect"),
        "dphi_d": ("rad", "extent of the defect"),
    }
    dims, attributes = tuple(axes), {"units": "m s-2"}
    found = xr.Dataset(
        {
            "rms": (dims, rms_map.rms, {**attributes, "long_name": "RMS of the acceleration"}),
            "rms_error": (dims, rms_map.rms_error, {**attributes, "long_name": "numerical error of the RMS"}),
        },
        {
            name: (name, getattr(rms_map, name), {"units": unit, "long_name": text})
            for name, (unit, text) in axes.items()
        },
        {name: value for name, value in rms_map.attributes.items() if value is not None},
    )
    volume = rms_map.part_radius * found.h_d * found.dphi_d
    return found.assign(v_eq=volume.assign_attrs(units="m2", long_name=f"V_eq = {rms_map.volume_words}"))

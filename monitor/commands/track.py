"""``spallwatch track``: V_eq from a history of features, by a map or by a library of simulated lives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from models.maps.file import OutsideMapError, RmsMap, load_map
from monitor.commands.common import InputError, emit, output_options
from monitor.commands.histories import check_out, number, read_readings, write_out
from monitor.health.damage import tracker as damage
from monitor.health.damage.library.forecaster import LibrarySettings
from monitor.health.damage.library.model import Library
from monitor.health.damage.thesis import edv
from monitor.health.damage.thesis.prognosis import rms_from_map, rms_from_model, rms_history
from monitor.records.library_file import load_library
from monitor.service.setup import filter_settings, map_lookup, spread_lookup
from streams.block import STANDARD_GRAVITY


@dataclass(frozen=True)
class _Other:
    """The other condition under which the tracked defect is asked for.

    Attributes:
        load: N, or None for the one tracked under.
        speed: Hz, or None likewise.
        direct: whether it is simulated too.
    """

    load: float | None
    speed: float | None
    direct: bool

    @property
    def asked(self) -> bool:
        return self.load is not None or self.speed is not None


@click.command("track")
@click.argument("input_path", metavar="INPUT", type=click.Path(path_type=Path))
@click.option("--map", "map_path", type=click.Path(path_type=Path), help="RMS map (netCDF); the library needs none.")
@click.option(
    "--method",
    type=click.Choice(["thesis", "filter", "library"]),
    help="By default library where --library names one, else thesis.",
)
@click.option("--library", "library_path", type=click.Path(path_type=Path), help="Library of simulated lives (.npz).")
@click.option("--features", type=click.Choice(["rms", "rms+harmonics"]), help="By default all that INPUT has.")
@click.option(
    "--interval", type=click.FloatRange(0.5, 0.98), default=0.8, show_default=True, help="Level of intervals."
)
@click.option("--channel", help="Channel of the records, where several have a final stage.")
@click.option("--smoothing-blocks", type=click.IntRange(min=1), default=6, show_default=True, help="Thesis only.")
@click.option("--stop-outside-map", is_flag=True, help="End at the first RMS outside the map, as the thesis does.")
@click.option("--other-load-newton", type=click.FloatRange(min=0, min_open=True), help="Also the RMS at this load.")
@click.option("--other-speed-hz", type=click.FloatRange(min=0, min_open=True), help="Also the RMS at this speed.")
@click.option("--direct", is_flag=True, help="Simulate the other condition too, beside the map.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Write the rows too: .csv, .json or .nc.")
@output_options
def command(
    input_path: Path,
    map_path: Path | None,
    method: damage.TrackMethod | None,
    library_path: Path | None,
    features: str | None,
    interval: float,
    channel: str | None,
    smoothing_blocks: int,
    stop_outside_map: bool,
    other_load_newton: float | None,
    other_speed_hz: float | None,
    direct: bool,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Track V_eq through INPUT from t_fs on.

    INPUT is a CSV file with time_s,rms_g and, where it has them, harmonic_1_g to harmonic_6_g, load_newton and
    speed_hz; or records as replay and demo publish them: a netCDF file or a folder of such.

    With --other-load-newton or --other-speed-hz, each tracked defect is also given to the map under that condition (the
    thesis' first prognostic model, section 5.2.3.1): how loud the bearing would be there with this damage.
    """
    check_out(out)
    method = method or ("thesis" if library_path is None else "library")
    other = _Other(other_load_newton, other_speed_hz, direct)
    if not input_path.exists():
        raise InputError(f"{input_path}: no such file or folder")
    rms_map = None if map_path is None else load_map(map_path)
    if rms_map is None and (method != "library" or other.asked):
        raise InputError("--map FILE is missing: only --method library does without a map")
    if direct and not other.asked:
        raise InputError("--direct belongs to --other-load-newton or --other-speed-hz")
    times, readings = read_readings(input_path, channel, load=_only(rms_map, "load"), speed=_only(rms_map, "speed"))
    chosen = features or ("rms" if any(reading.harmonics is None for reading in readings) else "rms+harmonics")
    settings = damage.DamageSettings(
        track_method=method,
        forecast_method="library" if method == "library" else "thesis",
        map_at=None if rms_map is None else map_lookup(rms_map),
        spread_at=None if rms_map is None else spread_lookup(rms_map),
        filter=None if rms_map is None else filter_settings(rms_map, chosen.split("+"), interval),
        edv=edv.EdvSettings(smoothing_blocks=smoothing_blocks, stop_outside_map=stop_outside_map),
        **library_settings(method, library_path, chosen, interval),
    )
    found = _track(readings, settings)
    others = _others(rms_map, found, readings, other) if rms_map is not None and other.asked else {}
    rows = [
        {
            "time_s": time,
            "v_eq_mm2": number(one.v_eq * 1e6),
            "v_eq_lower_mm2": number(one.v_eq_lower * 1e6),
            "v_eq_upper_mm2": number(one.v_eq_upper * 1e6),
            "dphi_deg": number(math.degrees(one.dphi_d)),
            "h_d_um": number(one.h_d * 1e6),
            "status": one.status,
            **{name: number(values[i] / STANDARD_GRAVITY) for name, values in others.items()},
        }
        for i, (time, one) in enumerate(zip(times, found, strict=True))
    ]
    told = {
        "method": method,
        "interval": None if method == "thesis" else interval,
        "prior": prior_of(settings.library) or settings.prior,
        "map_hash": None if rms_map is None else rms_map.hash,
        "calibrated": rms_map is not None and rms_map.plan.rig.calibrated,
        "rows": rows,
    }
    if out is not None:
        write_out(out, told, {"time": times, "columns": _columns(found, others), "attributes": attributes_of(told)})
    emit(told, _lines(rows, tuple(others)), as_json=as_json)


def library_settings(
    method: str, path: Path | None, features: str, interval: float, window: float | None = None
) -> dict[str, Any]:
    """Return what a command with ``--method library`` adds to the settings; nothing for other methods.

    Raises:
        InputError: the library was not named, or is named for a method that needs none.
    """
    if method != "library":
        if path is not None:
            raise InputError(f"--library {path}: belongs to --method library")
        return {}
    if path is None:
        raise InputError("--library FILE is missing; make one with: spallwatch library build --out FILE")
    try:
        library = load_library(path)
        library.fit_for(features)
    except ValueError as error:
        raise InputError(f"--library {error}") from None
    return {"library": library, "asking": LibrarySettings(features=features, interval=interval, window=window)}


def prior_of(library: Library | None) -> str | None:
    """Return in words what the answers of a library lean on."""
    return None if library is None else f"{library.prior} (library {library.hash[:16]})"


def _only(rms_map: RmsMap | None, name: str) -> float | None:
    """Return the one value of an axis of the map, None where there are several or no map: then the input says it."""
    axis = [] if rms_map is None else getattr(rms_map, name).tolist()
    return axis[0] if len(axis) == 1 else None


def _track(readings: Sequence[damage.Reading], settings: damage.DamageSettings) -> list[damage.Damage]:
    state, found = damage.DamageState(), []
    for reading in readings:
        state, one, _ = damage.step(state, reading, damage.Stage(), settings)
        found.append(one)
    return found


def _others(
    rms_map: RmsMap, found: Sequence[damage.Damage], readings: Sequence[damage.Reading], other: _Other
) -> dict[str, Any]:
    """Return the histories of the RMS under the other condition, m/s2, by the name of their column."""
    load = other.load if other.load is not None else readings[0].load
    speed = other.speed if other.speed is not None else readings[0].speed
    if load is None or speed is None:
        raise InputError("the input does not say load and speed; give --other-load-newton and --other-speed-hz")
    sizes = np.array([one.dphi_d for one in found]), np.array([one.h_d for one in found])
    try:
        histories = {"other_rms_g": rms_history(*sizes, rms_from_map(rms_map, load, speed))}
    except OutsideMapError as error:
        raise InputError(f"--other-load-newton, --other-speed-hz: {error}") from None
    if other.direct:
        try:
            histories["other_rms_direct_g"] = rms_history(*sizes, rms_from_model(rms_map.plan, load, speed))
        except ValueError as error:
            raise InputError(f"--direct: {error}") from None
    return histories


def attributes_of(told: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a result says besides its rows as attributes of a file."""
    values = {key: value for key, value in told.items() if key not in ("rows", "by_threshold")}
    words = {True: "yes", False: "no", None: "none"}
    return {key: words[value] if value is None or isinstance(value, bool) else value for key, value in values.items()}


def _columns(found: Sequence[damage.Damage], others: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of the netCDF file, SI."""
    named = ("v_eq", "v_eq_lower", "v_eq_upper", "dphi_d", "h_d", "rms_smoothed")
    columns: dict[str, Any] = {name: [getattr(one, name) for one in found] for name in named}
    return {
        **columns,
        "edv_status": [one.status for one in found],
        **{name.removesuffix("_g"): values for name, values in others.items()},
    }


def _lines(rows: list[dict[str, Any]], others: Sequence[str]) -> Iterator[str]:
    columns = [
        ("v_eq_mm2", "V_eq", "mm3/mm"),
        ("v_eq_lower_mm2", "lower", "mm3/mm"),
        ("v_eq_upper_mm2", "upper", "mm3/mm"),
    ]
    columns += [("dphi_deg", "extent", "deg"), ("h_d_um", "depth", "um")]
    columns += [(name, "other" if name == "other_rms_g" else "direct", "g") for name in others]
    shown = [column for column in columns if any(row[column[0]] is not None for row in rows)] or columns[:1]
    yield f"{'time':>12}  {'  '.join(f'{name:>9}' for _, name, _ in shown)}  status"
    yield f"{'s':>12}  {'  '.join(f'{unit:>9}' for _, _, unit in shown)}"
    for row in rows:
        cells = ["-".rjust(9) if row[key] is None else f"{row[key]:9.4g}" for key, _, _ in shown]
        yield f"{row['time_s']:12.6g}  {'  '.join(cells)}  {row['status']}"

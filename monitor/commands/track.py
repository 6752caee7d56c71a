"""``spallwatch track``: V_eq from a history of features, by a map or by a library of simulated lives."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from models.machine.rig import Calibration, RigParameters
from models.maps.data import RmsMap
from models.maps.file import load_map
from monitor.commands import option
from monitor.commands.common import InputError, check_suffix, finite, input_errors
from monitor.commands.history_files import SUFFIXES, library_settings, prior_of, read_readings, write_out
from monitor.config.stages import method_or_best
from monitor.health import tracker as damage
from monitor.health.size import Damage, DamageInput, edv
from monitor.health.size.edv import rms_from_map, rms_from_model, rms_history
from monitor.health.size.library.model import Library
from monitor.service.setup import part_map
from monitor.service.summary import rig_of_library, weakest_calibration
from monitor.words.calibration import uncalibrated_sentence
from streams.types.block import STANDARD_GRAVITY

_Column = tuple[str, str, str]
_COLUMNS: tuple[_Column, ...] = (
    ("v_eq_mm2", "V_eq", "mm3/mm"),
    ("v_eq_lower_mm2", "lower", "mm3/mm"),
    ("v_eq_upper_mm2", "upper", "mm3/mm"),
)
_RELATIVE: tuple[_Column, ...] = (("v_eq_relative", "V_eq", "x first"),)


@dataclass(frozen=True)
class _Other:
    """Operating condition for which the RMS of the tracked defect is computed: N and Hz, None as tracked.

    ``direct`` adds a simulation of it.
    """

    load: float | None
    speed: float | None
    direct: bool

    @property
    def given(self) -> bool:
        return self.load is not None or self.speed is not None


@click.command("track")
@click.argument("input_path", metavar="INPUT", type=option.FILE)
@click.option("--map", "map_path", type=option.FILE, help="RMS map (netCDF); not needed with --method library.")
@option.method("thesis", "filter", "library")
@option.library
@click.option("--features", type=click.Choice(["rms", "rms+harmonics"]), help="Default: all that INPUT has.")
@option.interval
@option.channel
@click.option("--smoothing-blocks", type=click.IntRange(min=1), default=6, help="Thesis only.")
@click.option("--stop-outside-map", is_flag=True, help="Stop at the first RMS outside the map, as in the thesis.")
@click.option("--other-load-newton", type=option.POSITIVE, help="Also the RMS at this load.")
@click.option("--other-speed-hz", type=option.POSITIVE, help="Also the RMS at this speed.")
@click.option("--direct", is_flag=True, help="Simulate the other condition too, beside the map.")
@option.rows
@option.output
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
) -> option.Result:
    """Track V_eq through INPUT from t_fs on.

    INPUT is a CSV file with time_s,rms_g and optionally harmonic_1_g to harmonic_6_g, load_newton and speed_hz; or
    records as replay and demo publish them: a netCDF file or a folder of them.

    With --other-load-newton or --other-speed-hz, the RMS that each tracked defect would cause under that operating
    condition is given too (first prognostic model of the thesis, section 5.2.3.1).
    """
    check_suffix("--out", out, SUFFIXES)
    method = method_or_best(method, library_path)
    other = _Other(other_load_newton, other_speed_hz, direct)
    if not input_path.exists():
        raise InputError(f"{input_path}: no such file or folder")
    rms_map = _map_for(map_path, method, other)
    times, readings = read_readings(input_path, channel, load=_only(rms_map, "load"), speed=_only(rms_map, "speed"))
    chosen = features or ("rms" if any(reading.harmonics is None for reading in readings) else "rms+harmonics")
    given = library_settings(method, library_path, chosen, interval)
    calibrated, rig = _calibration(rms_map, given.get("library"))
    settings = damage.DamageSettings(
        track_method=method,
        forecast_method="library" if method == "library" else "thesis",
        maps={} if rms_map is None else {rms_map.part: part_map(rms_map, chosen.split("+"), interval)},
        edv=edv.EdvSettings(smoothing_blocks=smoothing_blocks, stop_outside_map=stop_outside_map),
        **given,
    )
    settings = replace(settings, calibrated=calibrated is not False)
    found = _track(readings, settings)
    others = _others(rms_map, found, readings, other) if rms_map is not None and other.given else {}
    rows = _rows(times, found, others)
    values = {
        "method": method,
        "interval": None if method == "thesis" else interval,
        "prior": prior_of(settings.library) or settings.prior,
        "fault": None if rms_map is None else rms_map.part,
        "v_eq": None if rms_map is None else rms_map.volume_words,
        "model": _model(rms_map, settings.library),
        "map_hash": None if rms_map is None else rms_map.hash,
        "calibrated": calibrated,
        "rows": rows,
    }
    if out is not None:
        write_out(out, values, {"time": times, "columns": _columns(found, others)})
    lines = _lines(rows, _COLUMNS if calibrated is not False else _RELATIVE, tuple(others))
    head = [] if calibrated is not False else [uncalibrated_sentence(rig, issued=True)]
    return values, itertools.chain(head, lines)


def _map_for(path: Path | None, method: damage.TrackMethod, other: _Other) -> RmsMap | None:
    """Return the map of a file, None without one; InputError where the method or another condition needs one."""
    rms_map = None if path is None else load_map(path)
    if rms_map is None and (method != "library" or other.given):
        raise InputError("--map FILE is missing: only --method library works without a map")
    if other.direct and not other.given:
        raise InputError("--direct belongs to --other-load-newton or --other-speed-hz")
    return rms_map


def _calibration(rms_map: RmsMap | None, library: Library | None) -> tuple[Calibration, RigParameters | str]:
    """Return the weakest claim of map and library, and the rig that makes it, or why there is none."""
    rigs = [None if library is None else rig_of_library(library), None if rms_map is None else rms_map.plan.rig]
    known = [rig for rig in rigs if rig is not None]
    if not known:
        return False, "the library does not name its rig"
    claims: list[Calibration] = [rig.calibrated for rig in known]
    found = weakest_calibration(*claims)
    return found, next(rig for rig in known if rig.calibrated == found)


def _model(rms_map: RmsMap | None, library: Library | None) -> str | None:
    """Return the model of a map, else of a library, None where that does not name it."""
    rig = None if library is None else rig_of_library(library)
    return rms_map.plan.model if rms_map is not None else None if rig is None else rig.model


def _only(rms_map: RmsMap | None, name: str) -> float | None:
    """Return the value of an axis of the map if it has only one, else None."""
    axis = [] if rms_map is None else getattr(rms_map, name).tolist()
    return axis[0] if len(axis) == 1 else None


def _track(readings: Sequence[DamageInput], settings: damage.DamageSettings) -> list[Damage]:
    state, found = damage.DamageState(), []
    for reading in readings:
        state, one, _ = damage.step(state, reading, damage.DamageGate(), settings)
        found.append(one)
    return found


def _others(rms_map: RmsMap, found: Sequence[Damage], readings: Sequence[DamageInput], other: _Other) -> dict[str, Any]:
    """Return the histories of the RMS under the other condition, m/s2, by the name of their column."""
    load = other.load if other.load is not None else readings[0].load
    speed = other.speed if other.speed is not None else readings[0].speed
    if load is None or speed is None:
        raise InputError("the input has no load and speed; give --other-load-newton and --other-speed-hz")
    sizes = np.array([one.dphi_d for one in found]), np.array([one.h_d for one in found])
    with input_errors("--other-load-newton, --other-speed-hz"):
        histories = {"other_rms_g": rms_history(*sizes, rms_from_map(rms_map, load, speed))}
    if other.direct:
        with input_errors("--direct"):
            histories["other_rms_direct_g"] = rms_history(*sizes, rms_from_model(rms_map.plan, load, speed))
    return histories


def _rows(times: Sequence[float], found: Sequence[Damage], others: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "time_s": time,
            "v_eq_mm2": finite(one.v_eq * 1e6),
            "v_eq_lower_mm2": finite(one.v_eq_lower * 1e6),
            "v_eq_upper_mm2": finite(one.v_eq_upper * 1e6),
            "v_eq_relative": finite(one.v_eq_relative),
            "p_no_growth": finite(one.p_no_growth),
            "dphi_deg": finite(math.degrees(one.dphi_d)),
            "h_d_um": finite(one.h_d * 1e6),
            "status": one.status,
            **{name: finite(rms[i] / STANDARD_GRAVITY) for name, rms in others.items()},
        }
        for i, (time, one) in enumerate(zip(times, found, strict=True))
    ]


def _columns(found: Sequence[Damage], others: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of the netCDF file, SI."""
    named = ("v_eq", "v_eq_lower", "v_eq_upper", "v_eq_relative", "p_no_growth", "dphi_d", "h_d", "rms_smoothed")
    columns: dict[str, Any] = {name: [getattr(one, name) for one in found] for name in named}
    return {
        **columns,
        "edv_status": [one.status for one in found],
        **{name.removesuffix("_g"): values for name, values in others.items()},
    }


def _lines(rows: list[dict[str, Any]], volumes: Sequence[_Column], others: Sequence[str]) -> Iterator[str]:
    columns = [*volumes]
    columns += [("dphi_deg", "extent", "deg"), ("h_d_um", "depth", "um")]
    columns += [(name, "other" if name == "other_rms_g" else "direct", "g") for name in others]
    shown = [column for column in columns if any(row[column[0]] is not None for row in rows)] or columns[:1]
    yield f"{'time':>12}  {'  '.join(f'{name:>9}' for _, name, _ in shown)}  status"
    yield f"{'s':>12}  {'  '.join(f'{unit:>9}' for _, _, unit in shown)}"
    for row in rows:
        cells = ["-".rjust(9) if row[key] is None else f"{row[key]:9.4g}" for key, _, _ in shown]
        yield f"{row['time_s']:12.6g}  {'  '.join(cells)}  {row['status']}"

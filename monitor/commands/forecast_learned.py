"""``spallwatch forecast --method learned`` and ``combined``: the time to the end, as recorded runs ended."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from monitor.commands.common import InputError, input_errors
from monitor.commands.feature_files import read_features
from monitor.commands.history_files import Volumes, is_records, library_settings, read_readings, read_volumes
from monitor.health import tracker as damage
from monitor.health.rest.learned.forecaster import LearnedState, step
from monitor.health.rest.learned.model import LearnedModel
from monitor.health.size import DamageInput, Remaining, RemainingSettings, TtStatus
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState
from monitor.health.size.library.forecaster import step as library_step
from monitor.records.library_file import LearnedFileError, is_learned, load_learned
from monitor.service.libraries import shipped_library
from monitor.service.summary import is_calibrated


def forecast_shipped(
    history: Volumes, thresholds: Sequence[float], settings: LibrarySettings
) -> list[tuple[Remaining, ...]]:
    """Return the forecasts at each point of a history, one per threshold (m2), from the points up to it.

    Raises:
        ValueError: a volume below zero, named by its row.
    """
    for row, v_eq in enumerate(history.v_eq, 1):
        if v_eq < 0.0:
            raise ValueError(f"row {row}: v_eq must be a volume, got {v_eq * 1e6:g} mm3/mm")
    with input_errors("the library that ships"):
        library = shipped_library()
    gaps = [after - before for before, after in pairwise(history.running) if after > before]
    library = library.at_interval(median(gaps)) if gaps else library
    own = library.thresholds[0]
    columns = []
    for threshold in thresholds:
        state, found = LibraryState(), []
        for t, v_eq in zip(history.running, history.v_eq, strict=True):
            block = DamageInput(t, v_eq=v_eq * own / threshold)
            state, _, (one,) = library_step(state, block, library, settings, thresholds=(own,))
            found.append(replace(one, threshold=threshold))
        columns.append(found)
    return list(zip(*columns, strict=True))


METHODS = ("learned", "combined")


@dataclass(frozen=True)
class Asked:
    """What is asked of an input.

    Attributes:
        method: the other methods than "learned" and "combined" take no axes, columns and t_fs.
        libraries: files: a learned one or none, and for "combined" one of simulated lives.
        settings: of the learned forecasts.
        channel: of records, or None.
        axes, columns: of CSV (``read_features``).
        t_fs: start of the final stage of CSV, s, or None as detected.
        threshold: of V_eq, m2, for the library of "combined".
    """

    method: damage.ForecastMethod
    libraries: Sequence[Path]
    settings: RemainingSettings
    channel: str | None = None
    axes: Sequence[str] = ()
    columns: Mapping[str, str] | None = None
    t_fs: float | None = None
    threshold: float = math.nan


class LearnedForecasts(NamedTuple):
    """The forecasts at each point of an input, and what they rest on.

    Attributes:
        times: on the axis of the input, s.
        running: damage times, s.
        issued: one forecast each.
        values: additional keys of the answer.
    """

    times: list[float]
    running: list[float]
    issued: list[tuple[Remaining, ...]]
    values: dict[str, Any]


def learned_among(paths: Sequence[Path]) -> bool:
    """Return whether one of some files was learned from recorded runs."""
    return any(is_learned(path) for path in paths)


def forecast_learned(path: Path, asked: Asked) -> LearnedForecasts:
    """Forecast through an input, from the points of its final stage up to each of them.

    ``path`` is records, CSV of features (``read_features``), or, without a learned file, CSV of V_eq from t_fs on.

    Raises:
        InputError: the input or a file cannot be used; naming it, and what was expected.
    """
    model, physical = _libraries(asked)
    if asked.method == "combined" and not is_records(path):
        raise InputError(
            f"{path}: --method combined needs records, which have load, speed and lines for the library; "
            "for CSV: --method learned"
        )
    if is_records(path):
        answer = _on_records(path, asked, model, physical)
    elif _is_volumes(path) and not model.runs:
        history = read_volumes(path, asked.channel)
        # Without recorded runs only the time is used.
        points = [DamageInput(t, rms=1.0) for t in history.running]
        answer = LearnedForecasts(history.times, history.running, list(_taken(points, asked, model, None)), {})
    else:
        answer = _on_features(path, asked, model)
    own = {"runs": len(model.runs), "learned_hash": model.hash if model.runs else None, "forecast_end": "recorded runs"}
    if asked.method == "combined":
        own["forecast_end"] = "recorded runs or threshold"
        own["weights"] = {"learned": 1.0 - model.library_weight, "library": model.library_weight}
    return answer._replace(values={**answer.values, **own, "prior": model.prior})


def _libraries(asked: Asked) -> tuple[LearnedModel, Path | None]:
    """Return what was learned, and the file of simulated lives."""
    learned = [path for path in asked.libraries if is_learned(path)]
    others = [path for path in asked.libraries if path not in learned]
    if len(learned) > 1:
        raise InputError("--library: two files were learned from recorded runs; give one of them")
    if asked.method == "learned" and others:
        try:
            load_learned(others[0])
        except LearnedFileError as error:
            raise InputError(f"--library {error}") from None
    if asked.method == "combined" and len(others) != 1:
        raise InputError(
            "--method combined needs a library of simulated lives (library build), and one of recorded runs "
            f"(library learn) beside it: --library twice; got {len(others)} of the first, {len(learned)} of the other"
        )
    try:
        model = load_learned(learned[0]) if learned else LearnedModel()
    except LearnedFileError as error:
        raise InputError(f"--library {error}") from None
    return model, others[0] if others else None


def _is_volumes(path: Path) -> bool:
    """Return whether a CSV file has V_eq and no RMS."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = [name.strip() for name in next(csv.reader(file), [])]
    except (OSError, UnicodeDecodeError):
        return False
    return "v_eq_mm2" in header and not any(name.endswith("rms_g") for name in header)


def _on_features(path: Path, asked: Asked, model: LearnedModel) -> LearnedForecasts:
    history = read_features(path, asked.axes, asked.columns, t_fs=asked.t_fs)
    times, onset = history.times, history.onset
    if onset is None:
        not_yet = (Remaining(asked.threshold, TtStatus.NOT_FINAL_STAGE),)
        return LearnedForecasts(times[-1:], times[-1:], [not_yet], {"t_fs_s": None, "t_fs_known_s": None})
    baseline = math.exp(onset.ln_baseline) if math.isfinite(onset.ln_baseline) else None
    points = [DamageInput(block.time or 0.0, rms=block.rms) for block in history.blocks[onset.place :]]
    known = None if onset.known is None else times[onset.known]
    found = {"t_fs_s": times[onset.place], "t_fs_known_s": known}
    after = times[onset.place :]
    return LearnedForecasts(after, after, list(_taken(points, asked, model, baseline)), found)


def _taken(
    points: Sequence[DamageInput], asked: Asked, model: LearnedModel, baseline: float | None
) -> Iterator[tuple[Remaining, ...]]:
    """Yield the forecast after each of some points, from t_fs on."""
    state = LearnedState()
    for point in points:
        state, found = step(state, point, model, asked.settings, baseline=baseline, threshold=asked.threshold)
        yield (found,)


def _on_records(path: Path, asked: Asked, model: LearnedModel, physical: Path | None) -> LearnedForecasts:
    from monitor.records.histories import read_history

    if asked.t_fs is not None:
        raise InputError(f"--t-fs-s: {path} is records, which state t_fs; give it for CSV only")
    history = read_history(path, asked.channel)
    baseline = history.baseline if history.baseline > 0.0 else None
    times, readings = read_readings(path, asked.channel, load=None, speed=None)
    found = {"t_fs_s": times[0] if times else None}
    if physical is None:
        issued = list(_taken(readings, asked, model, baseline))
        return LearnedForecasts(times, [one.time for one in readings], issued, found)
    own = asked.settings
    of_library = library_settings("library", physical, "rms+harmonics", own.interval, own.window)
    settings = damage.DamageSettings(
        track_method="library",
        forecast_method=asked.method,
        thresholds=(asked.threshold,),
        calibrated=is_calibrated(of_library["library"]),
        learned=model,
        learned_settings=own,
        **of_library,
    )
    issued = issued_by_tracker(readings, settings, damage.DamageGate(baseline=baseline))
    return LearnedForecasts(times, [one.time for one in readings], issued, found)


def issued_by_tracker(
    readings: Sequence[DamageInput], settings: damage.DamageSettings, gate: damage.DamageGate
) -> list[tuple[Remaining, ...]]:
    """Return the forecasts of the tracker at each of some readings; InputError where its library has none."""
    state, issued = damage.DamageState(), []
    for reading in readings:
        with input_errors("--library"):
            state, _, forecasts = damage.step(state, reading, gate, settings)
        issued.append(forecasts)
    return issued

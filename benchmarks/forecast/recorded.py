"""Forecasts on recorded runs to failure (PRONOSTIA), scored as they were issued.

    python -m benchmarks.forecast.recorded [--quick] [--json benchmarks/results/score_real.json]

Each recording goes through the program block by block, with the examples' settings and both channels tracked, into a
store; the forecasts are read back from its archive. The truth is the time that is left to the last file. Nothing of a
run is known to its own forecasts:

- The threshold is the geometric mean of the V_eq at which the other runs ended.
- The lifetimes of the naive forecasts are the final stages of the other runs.
- The library's population was set before any of its forecasts on these runs was seen: lives of one minute to seven
  hours (the challenge speaks of tests of one to seven hours) to 0.05 mm3/mm, at the loads and speeds of all three
  operating conditions, under a background of 0.1 to 1 g (these rigs idle at 0.3 to 0.45 g). It is fitted for the
  thresholds, and in one variant calibrated on the other runs.

The map is uncalibrated: PRONOSTIA's bearing with the lumped parameters of another bench. Its V_eq is a label for a
level of vibration, and no volume.
"""

from __future__ import annotations

import json
import math
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import arguments, print_table, write_json
from benchmarks.forecast.lives import cached_lives
from models.lives.population import Population
from models.maps.data import RmsMap
from models.maps.file import cached_map
from models.maps.plan import MapPlan
from models.path.defect import race_radius
from monitor.config.load import Config, validate
from monitor.health.record import Record
from monitor.health.size.library.calibrate import RecordedRun, calibrate
from monitor.health.size.library.fit import FitSettings, fit_library
from monitor.health.size.library.model import Library
from monitor.records.store import Store
from monitor.report.score.forecasts import Issued, read_issued
from monitor.report.score.scoring import End, mean_of_runs, score_run
from monitor.service.libraries import prior_words
from monitor.service.setup import open_configured, source_settings
from reference import recordings_folder
from reference.recordings import EXAMPLES, RUNS, Run
from reference.steps import Steps
from streams.types.block import Block, Rejected

Floats = NDArray[np.float64]

CHANNELS: tuple[str, ...] = ("horizontal", "vertical")
LIVES = 100
V_TH = 0.05e-6
"""Where the nominal lives of the library end, m2."""
DURATIONS = (60.0, 7 * 3600.0)
BACKGROUND = (0.1 * 9.80665, 1.0 * 9.80665)
LOADS, SPEEDS = (4000.0, 5000.0), (25.0, 30.0)
EXTENTS = (math.radians(6.0), math.radians(34.0))
"""Extents where the nominal lives end, those of the default population."""
CALIBRATED = "library, RMS, calibrated on the other runs"
METHODS: Mapping[str, Mapping[str, Any]] = {
    "thesis": {"track": {"method": "thesis"}, "forecast": {"method": "thesis"}},
    "library, RMS": {
        "track": {"method": "library", "features": ["rms"]},
        "forecast": {"method": "library"},
    },
    CALIBRATED: {
        "track": {"method": "library", "features": ["rms"]},
        "forecast": {"method": "library"},
    },
    "library, RMS and harmonics": {
        "track": {"method": "library", "features": ["rms", "harmonics"]},
        "forecast": {"method": "library"},
    },
}
NAIVE = ("constant", "climatology", "elapsed_alone", "doubling", "linear", "exponential")
FIGURES = ("crps_s", "crps_share", "cra", "prognostic_horizon_s", "coverage", "width_s", "answered")


@dataclass
class Recording:
    """A run to failure, read once.

    Attributes:
        run: which.
        items: its blocks.
        end: time of the last file, s.
        ends: last V_eq of each channel that has one, m2.
        life: from the first t_fs of a channel to the end, s; NaN where no final stage was found.
        history: the channel whose final stage began first, from there to the end, or None.
        background: RMS of both channels while they were learned, m/s2.
    """

    run: Run
    items: list[Block | Rejected]
    end: float
    ends: dict[str, float] = field(default_factory=dict)
    life: float = math.nan
    history: RecordedRun | None = None
    background: list[float] = field(default_factory=list)


_RIG: dict[str, float] = {}


def assume_rig(values: Mapping[str, float]) -> None:
    """Set keys of ``[rig]`` for all configurations from now on, in place of those set before."""
    _RIG.clear()
    _RIG.update(values)


def configuration(run: Run, threshold: float, method: Mapping[str, Any]) -> Config:
    """Return the example's configuration with both channels tracked, for one threshold (m2) and method."""
    path = EXAMPLES / f"{run.config}.toml"
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    values["channel"] = [{**channel, "track": True} for channel in values["channel"]]
    values["rig"] = {**values.get("rig", {}), **_RIG}
    values["track"] = dict(method["track"])
    # The map is uncalibrated: without being asked for, no TT would be issued.
    values["forecast"] = {**method["forecast"], "threshold_mm2": threshold * 1e6, "uncalibrated_threshold": True}
    return validate(values, path)


def map_of(config: Config) -> RmsMap:
    """Return the RMS map of the example's bearing, load and speed, with the lumped parameters of the thesis' bench."""
    load, speed = config.operating.load_newton, config.operating.speed_hz
    assert load is not None
    assert speed is not None
    return cached_map(
        MapPlan(
            load=(load,),
            speed=(speed,),
            h_d=tuple(2e-6 * i for i in range(33)),
            dphi_d=tuple(math.radians(i) for i in range(51)),
            bearing=config.bearing_of(config.channel[0]),
            rig=config.rig_of(config.entry_of(config.channel[0])),
            rms_band=None,
        ),
    )


def library_of(config: Config, thresholds: Sequence[float], lives: int) -> Library:
    """Return a library for the rig, whatever its load and speed, fitted for some thresholds (m2)."""
    bearing = config.bearing_of(config.channel[0])
    radius = race_radius(bearing)
    low, high = BACKGROUND
    population = Population(
        bearing=bearing,
        rig=config.rig_of(config.entry_of(config.channel[0])),
        load=LOADS,
        speed=SPEEDS,
        durations=DURATIONS,
        threshold=V_TH,
        until=1.5 * V_TH,
        h_threshold=(V_TH / (radius * EXTENTS[1]), V_TH / (radius * EXTENTS[0])),
        rms_band=None,
        background_rms=BACKGROUND,
        background_harmonic=(low / 10.0, high / 10.0),
        interval=10.0,
        seed=2012,
    )
    # The lives are kept rather than the library: they are what takes minutes, and a fit is always that of this program.
    return fit_library(
        cached_lives(population, lives),
        thresholds=tuple(sorted(thresholds)),
        interval=population.interval,
        prior=prior_words(population, lives),
        made_of={"population": json.loads(population.as_json()), "population_hash": population.hash(), "runs": lives},
        settings=FitSettings(seed=population.seed),
    )


def records_of(
    recording: Recording, config: Config, rms_map: RmsMap, library: Library | None = None
) -> tuple[list[Record], dict[str, Any]]:
    """Take a recording through the program; return its records and what the store is to say of them."""
    section = config.source[0]
    maps = dict.fromkeys(CHANNELS, rms_map)
    libraries = {} if library is None else dict.fromkeys(CHANNELS, library)
    steps = Steps(source_settings(config, section, maps, libraries))
    made_with = {
        "config_hash": config.hash,
        "map_hash": rms_map.hash,
        "library_hash": "" if library is None else library.hash,
        "interval_level": config.forecast.interval,
    }
    return [steps.take(item) for item in recording.items], made_with


def issued_in(records: Sequence[Record], made_with: Mapping[str, Any]) -> list[Issued]:
    """Return the forecasts as they stand in the archive of a store."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state.db"
        with Store.open(path, machine="pronostia") as store:
            store.describe(made_with)
            store.commit_many([(record, {}) for record in records])
        return read_issued(path)


def read(run: Run, folder: Path) -> Recording:
    """Read a recording, and take it through once to know how it ended."""
    config = configuration(run, 0.05e-6, METHODS["thesis"])
    items = list(open_configured(config, config.source[0], str(folder / run.file)))
    elapsed = [item.elapsed for item in items if isinstance(item, Block) and item.elapsed is not None]
    recording = Recording(run, items, max(elapsed))
    records, _ = records_of(recording, config, map_of(config))
    onsets: dict[str, float] = {}
    for channel in CHANNELS:
        values = [record.channels[channel] for record in records if channel in record.channels]
        v_eq = [value["v_eq"] for value in values if value.get("v_eq")]
        if v_eq:
            recording.ends[channel] = v_eq[-1]
        if values[-1].get("t_fs") is not None:
            onsets[channel] = values[-1]["t_fs"]
        learned = [value["rms"] for value in values if value["stage"] == "learning"]
        recording.background.append(float(np.median(learned)))
    if onsets:
        first = min(onsets, key=lambda channel: onsets[channel])
        recording.life = recording.end - onsets[first]
        recording.history = history_of(run.name, records, first, onsets[first], recording.end)
    return recording


def history_of(name: str, records: Sequence[Record], channel: str, onset: float, end: float) -> RecordedRun:
    """Return the final stage of a channel as a library can be calibrated on it."""
    rows = [
        (record.elapsed, record.channels[channel])
        for record in records
        if record.accepted and record.elapsed is not None and record.elapsed >= onset
    ]

    def column(key: str) -> Floats:
        return np.array([values[key] for _, values in rows], dtype=np.float64)

    return RecordedRun(
        name=name,
        t=np.array([elapsed for elapsed, _ in rows]),
        rms=column("rms"),
        harmonics=column("bpfo_amplitude"),
        load=column("load"),
        speed=column("speed"),
        end=end,
    )


def threshold_for(recording: Recording, recordings: Sequence[Recording]) -> float:
    """Return the geometric mean of the V_eq at which the other runs ended, all their channels, m2."""
    ends = [v_eq for other in recordings if other is not recording for v_eq in other.ends.values()]
    return round(float(np.exp(np.mean(np.log(ends)))), 12)


def score(recording: Recording, recordings: Sequence[Recording], fitted: Library | None) -> dict[str, Any]:
    """Return the scores of each method on one run, by channel; without a library, of the thesis alone."""
    others = [other for other in recordings if other is not recording]
    threshold = threshold_for(recording, others)
    lifetimes = [other.life for other in others if math.isfinite(other.life)]
    scored: dict[str, list[dict[str, Any]]] = {}
    for name in METHODS:
        if name != "thesis" and fitted is None:
            continue
        config = configuration(recording.run, threshold, METHODS[name])
        library = None if name == "thesis" else fitted
        if library is not None and name == CALIBRATED:
            known = [other.history for other in others if other.history is not None]
            library = calibrate(library, known, features="rms", threshold=threshold)
        records, made_with = records_of(recording, config, map_of(config), library)
        scored[name] = [
            {**score_run(issued, End(issued.to_clock(recording.end), "given"), lifetimes=lifetimes)}
            | {"records": recording.run.name, "status": _counts(issued)}
            for issued in issued_in(records, made_with)
        ]
    return {
        "run": recording.run.name,
        "threshold_mm2": threshold * 1e6,
        "v_eq_at_end_mm2": {name: 1e6 * value for name, value in recording.ends.items()},
        "life_s": recording.life,
        "lifetimes_of_others_s": lifetimes,
        "methods": scored,
    }


def _counts(issued: Issued) -> dict[str, int]:
    names, numbers = np.unique(issued.status.astype(str), return_counts=True)
    return dict(zip(names.tolist(), numbers.tolist(), strict=True))


def run_table(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a row a channel and method: the methods first, then the naive forecasts at the same moments."""
    rows = []
    for name, channels in result["methods"].items():
        rows += [_row(run, name, run) for run in channels]
    for run in result["methods"]["thesis"]:
        rows += [_row(run, f"- {name}", run["baselines"][name]) for name in NAIVE]
    return rows


def _row(run: Mapping[str, Any], name: str, figures: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "channel": run["channel"],
        "method": name,
        "forecasts": run["forecasts"],
        **{key: figures[key] for key in FIGURES},
        "alpha_lambda": {True: "pass", False: "fail", None: None}[figures["alpha_lambda"]],
    }


def mean_table(results: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return a row a method: means over runs with standard errors, channels averaged within a run first."""
    means = {
        method: mean_of_runs([run for result in results for run in result["methods"][method]])
        for method in results[0]["methods"]
    }
    naive = [_mean_row(f"- {name}", means["thesis"], f"baselines.{name}.") for name in NAIVE]
    return [_mean_row(method, mean, "") for method, mean in means.items()] + naive


def _mean_row(name: str, mean: Mapping[str, Mapping[str, Any]], prefix: str) -> dict[str, Any]:
    row: dict[str, Any] = {"method": name, "runs": mean.get(f"{prefix}crps_s", {}).get("runs", 0)}
    for key in (*FIGURES, "alpha_lambda"):
        figure = mean.get(prefix + key, {})
        row[key] = figure.get("mean")
        if key in ("crps_s", "crps_share", "coverage"):
            row[f"{key} +-"] = figure.get("standard_error")
    return row


def main() -> None:
    """Read, replay, score, print."""
    options = arguments(__doc__ or "")
    folder = recordings_folder()
    runs = [run for run in RUNS if not (options.quick and run.name == "Bearing1_1")]
    recordings = [read(run, folder) for run in runs]
    library = None
    if not options.quick:
        thresholds = [threshold_for(recording, recordings) for recording in recordings]
        library = library_of(configuration(runs[0], thresholds[0], METHODS["thesis"]), thresholds, LIVES)
    results = [score(recording, recordings, library) for recording in recordings]
    for result in results:
        print_table(
            f"{result['run']}: final stage {result['life_s']:g} s, threshold {result['threshold_mm2']:.3g} mm3/mm "
            f"(ended at {', '.join(f'{value:.3g}' for value in result['v_eq_at_end_mm2'].values())})",
            run_table(result),
        )
    means = mean_table(results)
    print_table("means over runs, channels averaged first", means)
    print("\nThe map is uncalibrated for this rig: V_eq is a label for a level of vibration.")
    write_json(options.json, {"calibrated": {"map": "no"}, "runs": results, "means": means})


if __name__ == "__main__":
    main()

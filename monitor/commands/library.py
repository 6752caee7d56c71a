"""``spallwatch library``: simulate a population of lives for a rig and fit the forecaster on it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from models.lives.laws import LAWS
from models.lives.population import Population
from models.machine.rig import Rig
from models.solve.registry import RIGS
from monitor.commands import library_learn, option
from monitor.commands.cluster_options import Sharing, sharing
from monitor.commands.common import (
    InputError,
    check_suffix,
    check_writable,
    find_entry,
    input_errors,
    output_errors,
    read_machine,
    say,
)
from monitor.config.load import Config
from monitor.health.size.library.calibrate import RecordedRun, calibrate
from monitor.health.size.library.model import Library
from monitor.records.library_file import save_library
from monitor.service.libraries import build_library
from monitor.words.calibration import rig_line

_SENSED = ("rms", "rms+harmonics")
_SLIP = (0.0, 0.01)
"""Range of the largest slip angle of the balls in the lives, rad; none where the speed changes or without balls."""
_AROUND = 0.1
"""Relative width, either way, of the default range around a configured load or speed."""


def _variation(quantity: str, words: str) -> Any:
    """Add the option of a known variation, %."""
    return click.option(
        f"--{quantity}-variation-percent", type=click.FloatRange(min=0, max=50), default=0.0, help=words
    )


@click.group("library")
def command() -> None:
    """Libraries of simulated lives or recorded runs, from which V_eq and TT are estimated with intervals."""


command.add_command(library_learn.command)


@command.command("build")
@option.config
@option.bearing
@click.option("--model", type=click.Choice(list(RIGS)), default=Rig.model, help="Other models take [shaft].")
@click.option("--runs", type=click.IntRange(min=20), default=1000, help="Lives to simulate.")
@click.option("--seed", type=option.WHOLE, default=0, help="Seed of all random draws.")
@option.thresholds(click.FloatRange(min=0.01, max=1.0))
@click.option("--load-newton", type=option.Range(positive=True), help="Default: 10 % around the configured load.")
@click.option("--speed-hz", type=option.Range(positive=True), help="Default: 10 % around the configured speed.")
@_variation("load", "Known change of the load from block to block, either way.")
@_variation("speed", "Known change of the speed from block to block, either way; needed from 1 %.")
@click.option("--duration-min", type=option.Range(positive=True), default="120:1200", help="Onset to threshold.")
@click.option("--interval-s", type=option.POSITIVE, default=300.0, help="Time between blocks.")
@click.option(
    "--law",
    "laws",
    multiple=True,
    metavar="NAME=WEIGHT",
    help=f"Growth law and its weight, repeatable; then no other. Laws: {', '.join(LAWS)}.",
)
@click.option("--rms-band-hz", type=option.Range(), help="Band of the RMS. Default: 0 to 9500 Hz.")
@click.option(
    "--calibrate",
    type=option.FILE,
    multiple=True,
    help="Records (file or folder) of a run of this rig, recorded until its end, which counts as the threshold.",
)
@click.option("--channel", help="Channel of these records, where several have a final stage.")
@sharing("Threads")
@click.option("--out", type=option.OUT_FILE, required=True, help="The library (.npz).")
@option.output
def build(
    config_path: Path | None, name: str | None, sharing: Sharing, out: Path, quiet: bool, **options: Any
) -> option.Result:
    """Simulate lives of bearings on the configured rig, fit the forecaster, and write it with its settings."""
    check_suffix("--out", out, (".npz",))
    thresholds = [value * 1e-6 for value in options["threshold_mm2"]]
    if options["calibrate"] and len(thresholds) > 1:
        raise InputError("--calibrate: a run has one end; give one --threshold-mm2 with it")
    recorded = [_recorded(path, options["channel"]) for path in options["calibrate"]]
    with input_errors("library build"):
        population = _population(read_machine(config_path), name, thresholds, options)
    check_writable("--out", out)
    began = time.perf_counter()
    with input_errors("library build"), sharing.open(out, quiet=quiet) as shared:
        library = build_library(population, runs=options["runs"], thresholds=thresholds, runner=shared.runner)
        for features in _SENSED if recorded else ():
            library = calibrate(library, recorded, features=features, threshold=thresholds[0])
        with output_errors("--out", out):
            save_library(library, out)
    say(f"library: {out}", quiet=quiet)
    values = _values(library, options["runs"], time.perf_counter() - began, out)
    values |= {"model": population.rig.model, "calibrated": population.rig.calibrated, "rig": rig_line(population.rig)}
    values |= {"rig_spread_over": population.rig_spread_words, "cluster": shared.values()}
    return values, [*_lines(values), *shared.lines()]


def _recorded(path: Path, channel: str | None) -> RecordedRun:
    """Return a run from published records; its last block counts as its end."""
    from monitor.records.histories import HistoryError, read_history

    try:
        history = read_history(path, channel)
    except HistoryError as error:
        raise InputError(f"--calibrate {error}") from None
    return RecordedRun(
        name=str(path),
        t=history.running,
        rms=history.rms,
        harmonics=history.harmonics,
        load=history.load,
        speed=history.speed,
        end=float(history.running[-1]),
    )


def _population(config: Config, name: str | None, thresholds: list[float], options: Mapping[str, Any]) -> Population:
    entry, clearance = find_entry(config, name)
    nominal, model = Population(), options["model"]
    rig = config.parameters_of(RIGS[model], entry)
    if model != Rig.model:
        spread = dict.fromkeys(rig.uncertain, 0.035)
        nominal = replace(nominal, rig=rig, rig_spread=tuple(spread.items()))
    low, high = options["duration_min"]
    return replace(
        nominal,
        bearing=entry.bearing,
        rig=rig,
        rig_posterior=config.posterior_of(entry) if model == Rig.model else None,
        clearance=clearance,
        load=options["load_newton"] or _around(config.operating.load_newton, nominal.load),
        speed=options["speed_hz"] or _around(config.operating.speed_hz, nominal.speed),
        load_variation=options["load_variation_percent"] / 100.0,
        speed_variation=options["speed_variation_percent"] / 100.0,
        durations=(60.0 * low, 60.0 * high),
        until=max(nominal.threshold, *thresholds),
        rms_band=options["rms_band_hz"] or nominal.rms_band,
        slip=(0.0, 0.0) if options["speed_variation_percent"] or model != Rig.model else _SLIP,
        laws=_laws(options["laws"]) or nominal.laws,
        interval=options["interval_s"],
        seed=options["seed"],
    )


def _laws(given: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """Return growth laws and weights from NAME=WEIGHT."""
    found: dict[str, float] = {}
    for text in given:
        law, _, number = text.partition("=")
        if law not in LAWS:
            raise InputError(f"--law {text}: unknown law {law!r}; expected one of {', '.join(LAWS)}")
        try:
            weight = float(number)
        except ValueError:
            weight = math.nan
        if not 0.0 < weight < math.inf:
            raise InputError(f"--law {text}: expected NAME=WEIGHT with a weight above 0, got {number!r}")
        found[law] = weight
    return tuple(found.items())


def _around(value: float | None, otherwise: tuple[float, float]) -> tuple[float, float]:
    return otherwise if not value else ((1.0 - _AROUND) * value, (1.0 + _AROUND) * value)


def _values(library: Library, runs: int, seconds: float, out: Path) -> dict[str, Any]:
    """Return the keys of the interface; scores are of RMS and harmonics, first threshold, half of the life."""
    first = next(iter(library.scores["rms+harmonics"].values()))["0.5"]
    return {
        "runs": runs,
        "lives_used": library.made_of["lives"],
        "seconds": seconds,
        "out": str(out),
        "hash": library.hash,
        "coverage": first["coverage"],
        "crps_s": first["crps_s"],
        "scores": library.scores,
        "prior": library.prior,
        "calibration": library.calibration,
    }


def _lines(values: Mapping[str, Any]) -> Iterator[str]:
    yield f"{values['lives_used']} lives in {values['seconds']:.1f} s; unseen lives, nominal 80 % intervals:"
    yield f"{'':28}{'V_eq':>16}{'':8}{'TT':>6}"
    header = ("threshold", "of time", "coverage", "rms ln", "coverage", "CRPS", "climatology")
    yield f"{'features':16}" + "".join(f"{word:>12}" for word in header)
    for features, thresholds in values["scores"].items():
        if features in ("climatology", "no_growth"):
            continue
        for threshold, shares in thresholds.items():
            for share, score in shares.items():
                naive = values["scores"]["climatology"][threshold][share]["crps_s"]
                figures = (score["v_eq_coverage"], score["v_eq_rms_ln_error"], score["coverage"])
                cells = "".join(f"{figure:12.2f}" for figure in figures)
                cells += f"{score['crps_s'] / 60:8.1f} min{naive / 60:8.1f} min"
                yield f"{features:16}{threshold:>12}{share:>12}{cells}"
    for features, score in values["scores"]["no_growth"].items():
        yield (
            f"{features:16}p_no_growth from one half at {score['found']:.0%} of the moments without growth and at "
            f"{score['false']:.1%} of the others"
        )
    for name, change in values["calibration"].items():
        yield (
            f"calibrated ({name}) on {change['runs']} recorded runs, {change['left_out']} outside: times "
            f"{math.exp(change['shift']):.2f} times as long, spread {change['stretch']:.2f} times as wide"
        )
    yield values["rig"]
    yield f"rigs: {values['rig_spread_over']}"
    yield f"hash {values['hash'][:16]}; prior: {values['prior']}"

"""``spallwatch identify``: the unknown parameters of a rig from tests with known defects."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from models.identify.evidence import Evidence
from models.identify.limits import INTERVALS, AdmissibleLimits, wide_limits
from models.identify.run import Identification, IdentifyOptions, identify
from models.identify.space import ALIASES, DEFAULT_FREE, FREE_WITHOUT_TESTS, ORDER, Space, contact_ratios
from models.identify.trials import FEATURES, Trials, gather, no_trials
from models.work.choose import local_runner
from models.work.runner import Runner
from monitor.commands import option
from monitor.commands.cluster_options import Sharing, sharing
from monitor.commands.common import (
    InputError,
    check_suffix,
    check_writable,
    counter,
    emit,
    finite,
    input_errors,
    output_errors,
    read_machine,
    say,
)
from monitor.config.load import Config
from monitor.identify import evidence_files, rig_table
from monitor.identify.trial_files import HEALTHY, Measuring, TrialFile, tracked_channel, with_race_radius
from monitor.identify.trial_folder import read_tests
from monitor.records.durable import replacing
from streams.types.block import STANDARD_GRAVITY

_REASONS = {
    "wide": "the ends of its interval differ by more than a factor of four",
    "within its limits": "its interval takes more than half of what its limits allow",
}
_MAX_FRONT = 100


class _Command(click.Command):
    """Takes names in succession, with commas, or with the option repeated."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse with the option before each name."""
        parameters = {*ORDER, *rig_table.NAMES}
        return super().parse_args(
            ctx, list(option.spread_names(args, {"--free": parameters, "--objectives": FEATURES}))
        )


class _Names(click.ParamType):
    """Names separated by commas."""

    name = "NAME[,NAME...]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the names."""
        if isinstance(value, tuple):
            return value
        names = tuple(part.strip() for part in str(value).split(",") if part.strip())
        return names or self.fail(f"{value!r}: expected names with commas between them", param, ctx)


class _Limit(click.ParamType):
    """NAME:LO:HI in SI units."""

    name = "NAME:LO:HI"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (name, (lo, hi))."""
        if isinstance(value, tuple):
            return value
        name, _, rest = str(value).partition(":")
        try:
            low, high = (float(part) for part in rest.split(":"))
        except ValueError:
            self.fail(f"{value!r} is not NAME:LO:HI, such as f_r:4500:9500", param, ctx)
        if name not in INTERVALS:
            self.fail(f"{value!r}: {name!r} has no limits; expected one of {', '.join(INTERVALS)}", param, ctx)
        return name, (low, high)


@click.command("identify", cls=_Command)
@click.argument("tests", metavar="[TESTS]", type=option.FILE, required=False)
@option.config
@evidence_files.options
@click.option("--channel", help="Channel of the recordings and of the RMS band. Default: the tracked one.")
@click.option(
    "--names", help="Names in a folder: {defect}{specimen}_{load_newton}N_{speed_hz}Hz.txt, with * for any text."
)
@click.option("--free", type=_Names(), multiple=True, help=f"Unknown parameters. Default: {', '.join(DEFAULT_FREE)}.")
@click.option("--objectives", type=_Names(), multiple=True, help=f"Default: {', '.join(FEATURES)}.")
@click.option(
    "--limit", "limits", type=_Limit(), multiple=True, help="Other limits than Table 16, SI; may be repeated."
)
@click.option("--method", type=click.Choice(["search", "nsga2"]), default="search", help="nsga2 needs pymoo.")
@click.option("--level", type=click.FloatRange(0.5, 0.999), default=0.95, help="Level of the intervals.")
@click.option("--seed", type=option.WHOLE, default=0, help="Seed of all random draws.")
@click.option("--rms-band-hz", type=option.Range(), help="Band of the RMS. Default: that of the channel.")
@click.option(
    "--race-radius-mm", type=option.POSITIVE, help="Of the outer race, for defect_mm. Default: the bearing's."
)
@sharing("Threads")
@click.option("--out", type=option.OUT_FILE, help="Write a [rig] table (TOML) with its hash.")
@click.option("--report", type=option.OUT_FILE, help="Write a page of what was found, .html or .pdf.")
@option.output
def command(
    tests: Path | None, config_path: Path | None, sharing: Sharing, as_json: bool, quiet: bool, **options: Any
) -> None:
    """Find parameters of the rig from TESTS, resonances and priors, and say which of them these do not determine.

    TESTS is a CSV file with load_newton, speed_hz, defect_deg or defect_mm, and either rms_g and a_star_g or recording
    (a file); optionally h_d_um (default: deeper than an element reaches), fault (default: outer; none: the machine is
    healthy, and its level an upper limit of the model's) and repetition. Or it is a folder of recordings: with a table
    tests.csv, or with names that state defect, load and speed (--names; without it those of the published stationary
    tests). Without known defects, the rig is calibrated only where the rest tells V_eq.
    """
    out: Path | None = options["out"]
    page: Path | None = options["report"]
    _check_files(out, page, resume=sharing.resume)
    config = read_machine(config_path)
    channel = tracked_channel(config, options["channel"])
    entry = config.entry_of(channel)
    band = options["rms_band_hz"] or channel.rms_band_hz
    radius = options["race_radius_mm"]
    measured = with_race_radius(entry.bearing, None if radius is None else radius * 1e-3)
    measuring = Measuring(config, channel, measured, band)
    table = TrialFile((), None, 0)
    if tests is not None:
        table = read_tests(tests, measuring, options["names"], counter("tests", quiet=quiet))
    with input_errors("identify"):
        rig = config.rig_of(entry)
        source = evidence_files.EvidenceSubject(measuring, entry, rig)
        evidence = evidence_files.read_evidence(source, options, table.healthy, lambda name: _names([(name,)])[0])
        trials = gather(table.trials) if table.trials else no_trials()
        _check_told(trials, evidence, page)
        section = next(section for section in config.bearing if section.name == channel.bearing)
        loads = {condition.load for condition in trials.conditions} | set(evidence.loads)
        known = Space(rig, entry.bearing, tuple(sorted(loads)), section.clearance_um / rig_table.MICRO)
        space = _with_unknowns(known, options, damaged=bool(np.any(trials.damaged)))
        settings = _settings(options, band)
        with _of_candidates(sharing).open(out, quiet=quiet, progress=False) as shared:
            state = None if out is None else out.with_name(out.name + ".state")
            run: dict[str, Any] = {"runner": shared.runner, "progress": _progress(quiet=quiet)}
            with _near(sharing) as run["near"], _resumable(state):
                found = identify(trials, space, settings, evidence, state=state, resume=sharing.resume, **run)
            verdict = rig_table.judge(found, config, entry, shared.runner)
            values = _values(found, settings, table) | verdict.values(rig_table.is_calibration(found))
            values["cluster"] = shared.values()
            values["warnings"] = [
                *table.warnings,
                *rig_table.find_warnings(found, config, entry),
                *values["why_uncalibrated"],
            ]
            # While other commands with this OUT are refused.
            if out is not None:
                for kind, path in _write_rig(out, found, config, channel.bearing, values):
                    say(f"{kind}: {path}", quiet=quiet)
    written = {name: None if path is None else str(path) for name, path in (("out", out), ("report", page))}
    if page is not None:
        from monitor.identify.report.page import write_identification
        from monitor.identify.report.subject import Subject

        subject = Subject(
            found=found,
            options=settings,
            trials=table.trials,
            keys={name: rig_table.key_of(name, space.rig.element) for name in space.free},
            reasons=_REASONS,
            machine=config.machine.name,
            recordings=table.recordings,
            race_radius=table.race_radius,
            rig_file="" if out is None else out.name,
            calibrated=values["calibrated"],
            warnings=tuple(values["warnings"]),
        )
        write_identification(subject, page)
        say(f"report: {page}", quiet=quiet)
    emit({**values, **written}, [*_lines(values), *shared.lines()], as_json=as_json)


def _with_unknowns(known: Space, options: Mapping[str, Any], *, damaged: bool) -> Space:
    """Return a space with its unknown parameters and their limits; ``damaged``: there are tests with known defects."""
    return replace(
        known,
        free=_free(options["free"]) or (DEFAULT_FREE if damaged else FREE_WITHOUT_TESTS),
        limits=(AdmissibleLimits() if damaged else wide_limits()).with_intervals(dict(options["limits"])),
    )


def _settings(options: Mapping[str, Any], band: tuple[float, float] | None) -> IdentifyOptions:
    return IdentifyOptions(
        objectives=_names(options["objectives"]) or FEATURES,
        band=band,
        seed=options["seed"],
        level=options["level"],
        method=options["method"],
    )


def _of_candidates(sharing: Sharing) -> Sharing:
    """Return how candidates are shared: on this machine their state file is enough to resume."""
    return sharing if sharing.cluster is not None or sharing.chunks is not None else replace(sharing, resume=False)


def _near(sharing: Sharing) -> AbstractContextManager[Runner | None]:
    """Return threads for batches of candidates that are too small to be sent; None where nothing is sent."""
    if sharing.cluster is None:
        return nullcontext() if sharing.chunks is None else local_runner(sharing.workers)
    return local_runner(0)


def _check_files(out: Path | None, page: Path | None, *, resume: bool) -> None:
    """Raise an InputError where a file could not be written, or there is none to go on from."""
    if out is not None:
        check_suffix("--out", out, (".toml",))
        check_writable("--out", out)
    if page is not None:
        from monitor.identify.report.page import check_page

        check_page(page)
        check_writable("--report", page)
    if resume and out is None:
        raise InputError("--resume needs --out FILE: the state of a run stands beside it")


def _check_told(trials: Trials, evidence: Evidence, page: Path | None) -> None:
    """Raise an InputError where nothing tells a rig, or a page would not show what does."""
    damaged = np.any(trials.damaged)
    if page is not None and not (damaged and np.all(trials.damaged)):
        raise InputError(f"--report shows tests with known defects alone; leave it, or rows with {HEALTHY!r}, out")
    if not damaged and not evidence.peaks:
        raise InputError("there is nothing to identify from: give TESTS with defects, --peaks, --frf or --run-up")


def _write_rig(
    out: Path, found: Identification, config: Config, bearing: str, values: dict[str, Any]
) -> Iterator[tuple[str, Path]]:
    """Write the draws of a calibrated rig, noted in ``values``, and its table; yield what was written."""
    if values["calibrated"]:
        posterior = out.with_suffix(".posterior.csv")
        # The table refers to the draws, so it is written after them.
        _write(posterior, found.posterior.text())
        values["posterior"]["out"] = str(posterior)
        yield "posterior", posterior
    _write(out, rig_table.rig_toml(found, config, bearing, values))
    yield "rig", out


def _free(groups: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the names of --free.

    Raises:
        InputError: for a name that is none, with the nearest ones.
    """
    names = _names(groups)
    known = (*ORDER, *ALIASES)
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, [*known, *rig_table.NAMES], n=1)
            hint = f"; did you mean {near[0]}?" if near else ";"
            raise InputError(f"--free {name}: cannot be free{hint} expected {', '.join(known)}, or their keys in [rig]")
    return names


def _names(groups: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the names of an option that may be repeated; keys of the configuration stand for their parameters."""
    return tuple(rig_table.NAMES.get(name, name) for group in groups for name in group)


@contextmanager
def _resumable(state: Path | None) -> Iterator[None]:
    """Say after an interruption how the run goes on."""
    try:
        yield
    except KeyboardInterrupt:
        if state is not None and state.exists():
            click.echo(f"\nthe candidates so far are in {state}; the same command with --resume goes on", err=True)
        raise


def _progress(*, quiet: bool) -> Callable[[str, int, int, float], None]:
    """Return a callback that shows the candidates and the time that is left, on a terminal."""
    show = counter("identify", quiet=quiet)
    import time

    last = [time.monotonic()]

    def note(stage: str, done: int, planned: int, left: float) -> None:
        if time.monotonic() - last[0] < 1.0:
            return
        last[0] = time.monotonic()
        show(done, planned)
        if not quiet and os.isatty(2):
            click.echo(f" candidates ({stage}), about {left:.0f} s left ", nl=False, err=True)

    return note


def _values(found: Identification, settings: IdentifyOptions, table: TrialFile) -> dict[str, Any]:
    """Return the keys of the interface, and what else is known."""
    space = found.space
    keys = {name: rig_table.key_of(name, space.rig.element) for name in space.free}

    def keyed(values: Mapping[str, float]) -> dict[str, float]:
        return {key: values[name] * (rig_table.MICRO if name == "clearance" else 1.0) for name, key in keys.items()}

    zeta_1, zeta_2 = contact_ratios(found.best.values, space.limits)
    low, high = (keyed({name: getattr(i, end) for name, i in found.intervals.items()}) for end in ("low", "high"))
    reasons = {keys[name]: i.reason for name, i in found.intervals.items()}
    front = found.front[:: max(1, -(-len(found.front) // _MAX_FRONT))]
    return {
        "front": [{"parameters": keyed(values), "objectives": objectives} for values, objectives in front],
        "best": keyed(found.best.values),
        "intervals": {key: [low[key], high[key]] for key in low},
        "undetermined": [key for key, reason in reasons.items() if reason],
        "evaluations": found.evaluations,
        "seconds": found.seconds,
        "level": settings.level,
        "reasons": {key: _REASONS[reason] for key, reason in reasons.items() if reason},
        "at_limit": {keys[name]: list(i.at_limit) for name, i in found.intervals.items() if any(i.at_limit)},
        # By the Fisher information: relative, of the clearance in um, of alpha_c in 1/s.
        "sd": {key: finite(sd) for key, sd in keyed({name: i.sd for name, i in found.intervals.items()}).items()},
        "objectives": found.deviations,
        "noise": finite(found.noise),
        "f_r_hz": list(found.resonances),
        "zeta_1": zeta_1,
        "zeta_2": zeta_2,
        "conditions": len(found.features),
        "tests": len(table.trials),
        "recordings": table.recordings,
        "lines_not_found": table.lines_not_found,
        "not_periodic": found.not_periodic,
        "features": [
            {"rms_g": row[0] / STANDARD_GRAVITY, "a_star_g": row[1] / STANDARD_GRAVITY}
            for row in found.features.tolist()
        ],
        "race_radius_mm": None if table.race_radius is None else table.race_radius * 1e3,
        "rms_band_hz": None if settings.band is None else list(settings.band),
        "method": settings.method,
        "seed": settings.seed,
        "identification": found.hash,
        "posterior": {
            "draws": len(found.posterior.rows),
            "candidates": found.posterior.candidates,
            "effective": found.posterior.effective,
            "out": None,
        },
    }


def _write(out: Path, text: str) -> None:
    with output_errors("--out", out), replacing(out) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _lines(values: Mapping[str, Any]) -> Iterator[str]:
    yield f"{values['evaluations']} candidates in {values['seconds']:.1f} s, {values['conditions']} conditions"
    if values["race_radius_mm"] is not None:
        yield f"widths of defects divided by a race radius of {values['race_radius_mm']:.4g} mm"
    yield f"{'':22}{'best':>12}{'lower':>12}{'upper':>12}"
    for key, value in values["best"].items():
        low, high = values["intervals"][key]
        word = "  undetermined: " + values["reasons"][key] if key in values["undetermined"] else ""
        ends = [name for name, at in zip(("lower", "upper"), values["at_limit"].get(key, ()), strict=False) if at]
        limit = f"  ({' and '.join(ends)} end: a limit, not the tests)" if ends and not word else ""
        yield f"{key:22}{value:12.5g}{low:12.5g}{high:12.5g}{word}{limit}"
    resonances = values["f_r_hz"]
    yield f"f_r {np.min(resonances):.0f} to {np.max(resonances):.0f} Hz over loads and directions"
    for name, value in values["objectives"].items():
        yield f"mean difference of {name} {value:.3g} %"
    if values["noise"] is not None:
        yield f"scatter of the tests about the model {100 * values['noise']:.3g} %"
    yield f"{len(values['front'])} candidates on the front"
    if values["not_periodic"]:
        yield f"{values['not_periodic']} conditions do not repeat with the ball passage; their levels are means"
    yield from rig_table.verdict_lines(values)
    yield from (f"warning: {text}" for text in values["warnings"])
    posterior = values["posterior"]
    yield (
        f"posterior: {posterior['draws']} draws from {posterior['candidates']} candidates, "
        f"{posterior['effective']:.0f} of them effective"
    )
    hash_ = "" if values["identification"] is None else f" {values['identification'][:16]}"
    yield f"identification{hash_}" + ("" if values["calibrated"] else ", not calibrated")

"""The page of an identification, and what it says: headline, findings, statuses and provenance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from models.identify.limits import INTERVALS
from models.identify.space import ORDER
from models.identify.trials import FEATURES
from models.machine.bearing import kinematics
from monitor.commands.common import check_suffix
from monitor.identify.report import tables
from monitor.identify.report.features import feature_parts
from monitor.identify.report.front import alone_parts, front_parts
from monitor.identify.report.profiles import profile_part
from monitor.identify.report.regions import region_parts
from monitor.identify.report.subject import ENDS, TITLES, Parameter, Subject
from monitor.report.figures.drawing import Picture
from monitor.report.figures.sheet import Part
from monitor.report.options import Options
from monitor.report.page import require_pdf, write_page
from monitor.report.readings import Finding
from monitor.report.tables import Table
from monitor.words.calibration import rig_words
from monitor.words.numbers import count, duration, figure

_METHODS = {"search": "global search, then least squares and profiles", "nsga2": "NSGA-II, then least squares"}


def grade(subject: Subject) -> str:
    """Return "good" where all parameters are determined, else "watch"; "bad" for none, or a model that does not fit."""
    if not subject.calibrated:
        return "bad"
    missing = len(subject.found.undetermined)
    return "good" if not missing else "bad" if missing == len(subject.parameters) else "watch"


def headline(subject: Subject) -> str:
    """Return how many parameters the tests determine, and which not; or that this is no calibration."""
    if not subject.calibrated:
        return (
            f"This is no calibration; the tests scatter by {figure(100.0 * subject.found.noise, 2)} % about the model"
        )
    whole, missing = len(subject.parameters), subject.found.undetermined
    if not missing:
        words = {1: "The free parameter is", 2: "Both free parameters are"}
        return f"{words.get(whole, f'All {whole} free parameters are')} determined"
    if len(missing) == whole:
        words = {1: "the free parameter", 2: "either free parameter"}
        return f"The tests do not determine {words.get(whole, f'any of the {whole} free parameters')}"
    return f"{whole - len(missing)} of {whole} parameters are determined; not {_listed(subject, missing)}"


def _listed(subject: Subject, names: Sequence[str]) -> str:
    words = [subject.parameter(name).symbol for name in names]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def findings(subject: Subject) -> list[Finding]:
    """Return the questions that the first screen answers."""
    found = subject.found
    known = [p for p in subject.parameters if p.name not in found.undetermined]
    missing = [p for p in subject.parameters if p.name in found.undetermined]
    level = f"{100.0 * subject.options.level:g} %"
    low, high = subject.middle(subject.drawn_modes)
    values = [f"{p.symbol} {p.write(found.best.values[p.name])} ({_interval(subject, p)})" for p in known]
    return [
        Finding("What was found?", "; ".join(values) or "Nothing that may be relied on.",
                f"From {subject.tests_words}; in brackets the {level} intervals.", bool(known)),
        Finding("What was not?", ", ".join(p.symbol for p in missing) or "Every free parameter was.",
                " ".join(f"{p.symbol}: {_reason(subject, p)}." for p in missing)),
        Finding("Resonance?", f"f_r {_span(found.resonances)} Hz in the best fit",
                f"Over loads and directions. {level} of the posterior: {figure(low, 4)} to {figure(high, 4)} Hz, mean "
                "over both."),
        Finding("Does it fit?", ", ".join(f"Δ{TITLES[name]} {figure(value)} %" for name, value in
                found.deviations.items()), _scatter(subject)),
        Finding("What follows?", _claim(subject), _limits_words(subject)),
    ]  # fmt: skip


def _interval(subject: Subject, parameter: Parameter) -> str:
    interval = subject.found.intervals[parameter.name]
    return f"{parameter.number(interval.low)} to {parameter.number(interval.high)}"


def _span(values: Sequence[float]) -> str:
    low, high = figure(min(values), 4), figure(max(values), 4)
    return low if low == high else f"{low} to {high}"


def _reason(subject: Subject, parameter: Parameter) -> str:
    return subject.reasons[subject.found.intervals[parameter.name].reason]


def _scatter(subject: Subject) -> str:
    found, trials = subject.found, subject.problem.trials
    words = f"Mean differences (Eq. 56). The tests scatter by {figure(100.0 * found.noise, 2)} % about the model"
    repeated = [
        f"{TITLES[name]} {figure(100.0 * float(trials.scatter[FEATURES.index(name)]), 2)} %"
        for name in subject.objectives
        if math.isfinite(float(trials.scatter[FEATURES.index(name)]))
    ]
    words += f"; repetitions of one test by {', '.join(repeated)}." if repeated else "; nothing was repeated."
    if found.not_periodic:
        one = found.not_periodic == 1
        words += f" {count(found.not_periodic, 'condition')} {'does' if one else 'do'} not repeat with the ball "
        words += f"passage and {'counts' if one else 'count'} less."
    return words


def _claim(subject: Subject) -> str:
    if not subject.calibrated:
        return "The rig is not calibrated by these tests; the warnings below say why."
    if grade(subject) == "bad":
        return "Do not rely on these values: other tests, more conditions or fewer free parameters are needed."
    words = "The rig may be marked calibrated"
    return words + (
        ", for what the determined parameters decide." if subject.found.undetermined else " with these parameters."
    )


def _limits_words(subject: Subject) -> str:
    """Return what the claim rests on, and ends of intervals that are limits of the search."""
    words = (
        "The intervals include how the tests scatter about the model; what the model has wrong in the same way at all "
        "conditions they cannot show."
    )
    ends = [
        f"the {ENDS[i]} end of {p.symbol}"
        for p in subject.parameters
        for i, at in enumerate(subject.found.intervals[p.name].at_limit)
        if at and not subject.found.intervals[p.name].reason
    ]
    if ends:
        words += f" {', '.join(ends).capitalize()} {'is a limit' if len(ends) == 1 else 'are limits'} of the search, "
        words += "not of the tests."
    return words


def status_words(subject: Subject) -> list[tuple[str, str]]:
    """Return what the words of the table mean."""
    level = f"{100.0 * subject.options.level:g} %"
    return [
        ("determined", f"the {level} interval is narrow enough: its ends differ by no more than a factor of four, and "
         "it takes no more than half of what the limits allow (α_c and the clearance as they are, others in "
         "logarithms)."),
        ("undetermined", "it is not. The best value is one of many that fit as well; use the interval."),
        ("end is a limit", "at that end the search stopped, not the tests: wider limits could give a wider interval."),
        ("posterior", f"the middle {level} of the draws, which maps and libraries take. It counts how many sets of "
         "parameters fit; the interval takes the best case at each value."),
        ("local SD", "standard deviation by the Fisher information at the best fit alone. It knows nothing of other "
         "valleys, so the interval counts."),
        ("allowed", "the least and largest value that the limits leave anywhere, with all couplings (Eq. 80)."),
    ]  # fmt: skip


def facts(subject: Subject) -> list[tuple[str, str]]:
    """Return labels and texts of how the result was made."""
    found, space, options = subject.found, subject.found.space, subject.options
    bearing = space.bearing
    lines = kinematics(bearing, 1.0)
    fixed = [name for name in ORDER if name not in space.free]
    texts = [f"{subject.parameter(name).symbol} {subject.parameter(name).write(space.known[name])}" for name in fixed]
    limits = [
        f"{name} {figure(low)} to {figure(high) if math.isfinite(high) else '∞'}"
        for name in INTERVALS
        for low, high in (getattr(space.limits, name),)
    ]
    made = [
        ("Machine", subject.machine),
        ("Bearing", f"{bearing.designation}, BPFO {figure(lines.bpfo, 4)} × shaft"),
        ("Tests", subject.tests_words + (f", {count(subject.recordings, 'recording')}" if subject.recordings else "")),
        ("Features compared", ", ".join(TITLES[name] for name in subject.objectives)),
        ("Band", "full" if options.band is None else f"{options.band[0]:g} to {options.band[1]:g} Hz"),
    ]
    if subject.race_radius is not None:
        made.append(
            ("Race radius", f"{figure(1e3 * subject.race_radius, 4)} mm, by which widths of defects are divided")
        )
    return [
        *made,
        ("Held", ", ".join(texts)),
        ("Rig before", rig_words(space.rig)),
        ("Limits (SI)", ", ".join(limits)),
        ("Method", f"{_METHODS[options.method]}; seed {options.seed}"),
        ("Candidates", f"{found.evaluations:,} simulated in {duration(found.seconds)}; none for this page"),
        ("Posterior", _posterior(subject)),
        ("Identification", found.hash),
        *([("[rig] written to", subject.rig_file)] if subject.rig_file else []),
    ]


def _posterior(subject: Subject) -> str:
    posterior = subject.found.posterior
    return (
        f"{count(len(posterior.rows), 'draw')}, worth {figure(posterior.effective, 3)} independent ones; "
        f"{count(posterior.candidates, 'candidate')} simulated for them"
    )


def check_page(path: Path) -> None:
    """Refuse a name of another ending, or a PDF that cannot be written, before anything is computed.

    Raises:
        InputError: of the name.
        ReportError: a requirement of PDF is missing.
    """
    check_suffix("--report", path, (".html", ".pdf"))
    if path.suffix.lower() == ".pdf":
        require_pdf()


@dataclass(frozen=True)
class Section:
    """A heading of the page, a sentence below it, pictures and tables."""

    title: str
    lead: str
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = field(default_factory=tuple[Table, ...])


def write_identification(subject: Subject, out: Path) -> None:
    """Write the report of an identification as HTML, or as PDF if the name ends in .pdf; replace the file atomically.

    Nothing is simulated: all values were found by the run.

    Raises:
        ReportError: the file cannot be written, or a requirement of PDF is missing.
    """
    title = f"Identification of {subject.machine}" if subject.machine else "Identification of a rig"
    write_page(
        out,
        "identification.html.j2",
        title=title,
        grade=grade(subject),
        headline=headline(subject),
        tests=subject.tests_words,
        findings=findings(subject),
        warnings=[f"Warning: {text}." for text in subject.warnings],
        parameters=tables.parameter_table(subject),
        statuses=status_words(subject),
        sections=_sections(subject),
        facts=facts(subject),
        options=Options(),
    )


def _sections(subject: Subject) -> list[Section]:
    numbers = itertools.count(1)

    def drawn(parts: Sequence[Part]) -> list[Picture]:
        return [part.picture(numbers) for part in parts]

    found = [
        Section(
            "What the tests tell of each parameter",
            "A best value says little where other values fit as well: read the profiles.",
            drawn([profile_part(subject)]),
            [tables.ratio_table(subject), tables.mode_table(subject)],
        ),
        Section(
            "Model against tests",
            _features_lead(subject),
            drawn(feature_parts(subject)),
            [tables.condition_table(subject)],
        ),
    ]
    given = tables.evidence_tables(subject)
    if given:
        lead = "Resonances and priors that enter the likelihood beside the tests, and the best fit beside them."
        found.append(Section("What else was given", lead, (), given))
    alone = tables.alone_table(subject)
    if alone is not None:
        lead = "Whether the defects, taken one by one, ask for the same parameters."
        found.append(Section("One defect at a time", lead, drawn(alone_parts(subject)), [alone]))
    return [
        *found,
        Section("Between the features", _front_lead(subject), drawn(front_parts(subject))),
        Section("Where the parameters may lie", _region_lead(subject), drawn(region_parts(subject))),
    ]


def _region_lead(subject: Subject) -> str:
    if region_parts(subject):
        return "The regions that the limits leave (Eq. 80) and the candidates that were simulated in them."
    return (
        "The free parameters have no coupled limits that a plane could show; their limits are in the table and at the "
        "ends of the profiles."
    )


def _front_lead(subject: Subject) -> str:
    names = [TITLES[name] for name in subject.objectives]
    if len(names) < 2:
        return (
            f"{names[0]} alone was compared, so there is no trade-off: of the simulated candidates the one with the "
            "least mean difference is the whole front."
        )
    if len(subject.found.front) == 1:
        return "One candidate is best in both features at once, so nothing is to be weighed."
    return "No candidate is best in both features at once; the front holds those that none betters in both."


def _features_lead(subject: Subject) -> str:
    if len(subject.damaged) == 1:
        return (
            "All tests with a defect are at one condition, so the model cannot be seen to follow load, speed or defect."
        )
    speeds, loads = ({getattr(c, name) for c in subject.damaged} for name in ("speed", "load"))
    held = [name for name, values in (("speed", speeds), ("load", loads)) if len(values) == 1]
    if len(subject.extents) == 1:
        held.append("defect")
    words = "Measured features and those of the best fit."
    return words + (f" The tests have one {' and one '.join(held)} only." if held else "")

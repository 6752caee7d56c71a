"""Tables of a report of an identification."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from models.identify.evidence import modes
from models.identify.intervals import ParameterInterval
from models.identify.limits import Interval
from models.identify.space import bearing_directions, contact_ratios
from models.identify.trials import FEATURES
from monitor.identify.report.features import residuals, sorted_conditions
from monitor.identify.report.front import one_at_a_time
from monitor.identify.report.subject import ENDS, TITLES, Extent, Parameter, Subject
from monitor.report.tables import Cell, Column, Table
from monitor.words.numbers import count, figure
from streams.types.block import STANDARD_GRAVITY


def parameter_table(subject: Subject) -> Table:
    """Return the free parameters with status, best value, interval and limits."""
    found = subject.found
    level = f"{100.0 * subject.options.level:g} %"
    columns = (
        Column("parameter", "parameter"),
        Column("status", "status"),
        Column("best", "best", "1", words=str),
        Column("unit", "unit"),
        Column("interval", f"{level} interval", "1", words=str),
        Column("posterior", f"{level} of the posterior", "1", words=str),
        Column("sd", "local SD", "1", words=str),
        Column("allowed", "allowed", "1", words=str),
        Column("before", "configured before", "1", words=str),
    )
    rows: list[list[Cell]] = []
    for p in subject.parameters:
        interval = found.intervals[p.name]
        rows.append(
            [
                f"{p.symbol}, {p.meaning}",
                _status(interval),
                p.number(found.best.values[p.name]),
                p.unit,
                _span(p, (interval.low, interval.high)),
                _span(p, subject.middle(subject.draws[p.name])),
                _sd(subject, p, interval),
                _span(p, subject.bounds(p.name)),
                p.number(found.space.known[p.name]),
            ]
        )
    return Table("parameters", "Free parameters", columns, rows)


def _span(parameter: Parameter, interval: Interval) -> str:
    return f"{parameter.number(interval[0])} to {parameter.number(interval[1])}"


def _sd(subject: Subject, parameter: Parameter, interval: ParameterInterval) -> str:
    if not math.isfinite(interval.sd):
        return "infinite"
    if subject.found.space.is_linear(parameter.name):
        return parameter.write(interval.sd)
    return f"{figure(100.0 * interval.sd, 2)} %"


def _status(interval: ParameterInterval) -> str:
    if interval.reason:
        return "undetermined"
    ends = [name for name, at in zip(ENDS, interval.at_limit, strict=True) if at]
    return "determined" + (f"; {' and '.join(ends)} end a limit" if ends else "")


def ratio_table(subject: Subject) -> Table:
    """Return the damping ratios of the best fit beside those configured."""
    space, limits = subject.found.space, subject.found.space.limits
    columns = (
        Column("quantity", "damping ratio"),
        Column("best", "best fit (%)", "1"),
        Column("before", "configured before (%)", "1"),
    )
    both = (subject.found.best.values, space.known)
    ratios = [contact_ratios(values, limits) for values in both]
    rows: list[list[Cell]] = [
        [f"ζ_1, contact at {limits.f_1:g} Hz", *(100.0 * first for first, _ in ratios)],
        [f"ζ_2, contact at {limits.f_2:g} Hz", *(100.0 * second for _, second in ratios)],
    ]
    for which, frequency, words in (("i", limits.f_i, "shaft"), ("r", limits.f_d, "resonator")):
        factor = 100.0 * math.pi * frequency
        own: list[Cell] = [factor * values[f"c_{which}"] / values[f"k_{which}"] for values in both]
        rows.append([f"ζ_{which}, {words} at {frequency:g} Hz", *own])
    return Table("ratios", "Damping ratios (Eqs. 70, 75, 76)", columns, rows)


def mode_table(subject: Subject) -> Table:
    """Return the natural frequencies of the best fit, and f_r of the rig as it was configured."""
    space = subject.found.space
    columns = (
        Column("load", "load (N)", "N", words=_plain),
        Column("direction", "direction"),
        Column("first", "first (Hz)", "Hz"),
        Column("second", "second (Hz)", "Hz"),
        Column("f_r", "f_r (Hz)", "Hz", words=_hertz),
        Column("before", "f_r configured before (Hz)", "Hz", words=_hertz),
    )
    best, before = space.modes(subject.found.best.values), space.modes(space.known)
    rows: list[list[Cell]] = [
        [load, ("across", "along")[way], *best[2 * place + way].tolist(), float(before[2 * place + way, -1])]
        for place, load in enumerate(space.loads)
        for way in (0, 1)
    ]
    return Table("modes", "Natural frequencies of the best fit (Eqs. 59, 60)", columns, rows)


def _hertz(value: float) -> str:
    return figure(value, 4)


def alone_table(subject: Subject) -> Table | None:
    """Return the candidate of each defect alone (Table 19), None with fewer than two defects."""
    found = one_at_a_time(subject)
    if len(found) < 2:
        return None
    columns = [Column("defect", "defect")]
    columns += [Column(p.name, p.label, "1", words=str) for p in subject.parameters]
    columns.append(Column("f_r", "f_r (Hz)", "Hz", words=_hertz))
    columns += [Column(f"delta_{name}", f"Δ{TITLES[name]} (%)", "1") for name in subject.objectives]

    def row(words: str, values: dict[str, float], objectives: Sequence[float]) -> list[Cell]:
        f_r = float(np.mean(subject.found.space.resonances(values)))
        return [words, *(p.number(values[p.name]) for p in subject.parameters), f_r, *objectives]

    rows = [
        row(
            subject.extent_words(one.extent),
            subject.candidates.values_of(one.nearest),
            one.objectives[one.nearest].tolist(),
        )
        for one in found
    ]
    best = subject.found.best.values
    rows.append(row("all, best fit", best, list(subject.found.deviations.values())))
    note = (
        "For each defect, of all simulated candidates that which is nearest to the origin in the differences at its "
        "conditions alone. Where the rows disagree by more than the intervals, no single set of parameters explains "
        "all defects. Values that the tests do not determine differ at will."
    )
    return Table("one_defect", "One defect at a time (Table 19)", columns, rows, note)


def condition_table(subject: Subject) -> Table:
    """Return measured and modelled features at all conditions."""
    columns = [
        Column("speed", "speed (Hz)", "Hz", words=_plain),
        Column("load", "load (N)", "N", words=_plain),
        Column("defect", "defect"),
        Column("tests", "tests", "1"),
    ]
    for name in FEATURES:
        title = TITLES[name]
        columns += [
            Column(f"{name}_measured", f"{title} measured (g)", "m s-2", scale=1.0 / STANDARD_GRAVITY),
            Column(f"{name}_model", f"{title} model (g)", "m s-2", scale=1.0 / STANDARD_GRAVITY),
            Column(
                f"{name}_difference", "difference (%)", "percent", words=lambda value: f"{value:+.1f}".replace("-", "−")
            ),
        ]
    left = {name: residuals(subject, name)[0] for name in FEATURES}
    counts = subject.problem.trials.count
    rows: list[list[Cell]] = []
    for n in sorted_conditions(subject):
        c = subject.conditions[n]
        cells: list[Cell] = [c.speed, c.load, subject.extent_words(Extent.of(c)), int(counts[n].max())]
        for name in FEATURES:
            cells += [float(subject.measured(name)[n]), float(subject.modelled(name)[n]), float(left[name][n])]
        rows.append(cells)
    unused = [TITLES[name] for name in FEATURES if name not in subject.objectives]
    note = f"{' and '.join(unused)} was not compared." if unused else ""
    damaged = [not c.healthy for c in subject.conditions]
    if not all(damaged):
        note += " The level of a healthy machine is an upper limit of the model's."
    missing = int(np.count_nonzero(~subject.problem.known[damaged]))
    if missing:
        note += f" – stands for {count(missing, 'feature')} that no test has, such as an A* below the noise."
    return Table("conditions", "All conditions", columns, rows, note.strip())


def evidence_tables(subject: Subject) -> list[Table]:
    """Return resonances and priors that were given, beside the best fit; none where nothing was given."""
    evidence = subject.problem.evidence
    return [_peak_table(subject)] * bool(evidence.peaks) + [_prior_table(subject)] * bool(evidence.priors)


def _peak_table(subject: Subject) -> Table:
    space, best = subject.found.space, subject.found.best.values
    columns = (
        Column("load", "load (N)", "N", words=_plain),
        Column("direction", "direction"),
        Column("frequency", "measured (Hz)", "Hz", words=_hertz),
        Column("frequency_sd", "SD (Hz)", "Hz"),
        Column("model", "nearest of the model (Hz)", "Hz", words=_hertz),
        Column("damping", "damping (%)", "1", scale=100.0),
        Column("model_damping", "of the model (%)", "1", scale=100.0),
    )
    rows: list[list[Cell]] = []
    for peak in sorted(subject.problem.evidence.peaks, key=lambda peak: (peak.load, peak.direction, peak.frequency)):
        stiffness = dict(
            zip(
                ("across", "along"),
                bearing_directions(space.bearing, peak.load, best["k_c"], best["clearance"]),
                strict=True,
            )
        )
        k_b = np.array([value for name, value in stiffness.items() if peak.direction in ("", name)])
        found = modes(space.rig_of(best), space.bearing, k_b)
        nearest = int(np.argmin(np.abs(found.frequency.ravel() - peak.frequency)))
        own = float(found.frequency.ravel()[nearest]), float(found.damping.ravel()[nearest])
        words = (peak.direction or "not known") + (", extracted" if peak.extracted else "")
        rows.append([peak.load, words, peak.frequency, peak.frequency_sd, own[0], peak.damping, own[1]])
    note = "Extracted: found in a recording by the program, so it may be no resonance of this model." * any(
        peak.extracted for peak in subject.problem.evidence.peaks
    )
    return Table("peaks", "Resonances", columns, rows, note)


def _prior_table(subject: Subject) -> Table:
    columns = (
        Column("parameter", "parameter"),
        Column("prior", "prior", "1", words=str),
        Column("sd", "SD (%)", "1", scale=100.0),
        Column("best", "best fit", "1", words=str),
        Column("unit", "unit"),
        Column("source", "source"),
    )
    rows: list[list[Cell]] = []
    for prior in subject.problem.evidence.priors:
        p = subject.parameter(prior.name)
        value = ("at least " if prior.at_least else "") + p.number(prior.value)
        rows.append([p.symbol, value, prior.sd, p.number(subject.found.best.values[prior.name]), p.unit, prior.source])
    return Table("priors", "Priors", columns, rows)


def _plain(value: float) -> str:
    return f"{value:g}"

"""The page of an identification."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from monitor.commands.common import check_suffix
from monitor.identify.report import tables, words
from monitor.identify.report.features import feature_parts
from monitor.identify.report.front import alone_parts, front_parts
from monitor.identify.report.profiles import profile_part
from monitor.identify.report.regions import region_parts
from monitor.identify.report.subject import TITLES, Subject
from monitor.report.figures.drawing import Picture
from monitor.report.figures.sheet import Part
from monitor.report.options import Options
from monitor.report.page import require_pdf, write_page
from monitor.report.tables import Table


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
        grade=words.grade(subject),
        headline=words.headline(subject),
        tests=subject.tests_words,
        findings=words.findings(subject),
        warnings=[f"Warning: {text}." for text in subject.warnings],
        parameters=tables.parameter_table(subject),
        statuses=words.status_words(subject),
        sections=_sections(subject),
        facts=words.facts(subject),
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

"""The page of an identification, as the command writes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from models.identify.run import Identification, IdentifyOptions
from monitor.commands.common import check_suffix
from monitor.commands.trial_files import TrialFile


@dataclass(frozen=True)
class ReportWords:
    """What the page calls things: machine, keys of the free parameters, words of reasons, file of the ``[rig]``."""

    machine: str
    keys: Mapping[str, str]
    reasons: Mapping[str, str]
    rig_file: str | None


def check_page(path: Path) -> None:
    """Refuse a name of another ending, or a PDF that cannot be written, before anything is computed.

    Raises:
        InputError: of the name.
        ReportError: a requirement of PDF is missing.
    """
    check_suffix("--report", path, (".html", ".pdf"))
    if path.suffix.lower() == ".pdf":
        from monitor.report.page import require_pdf

        require_pdf()


def write_report(
    path: Path, found: Identification, options: IdentifyOptions, table: TrialFile, words: ReportWords
) -> None:
    """Write the page of an identification; ReportError if it cannot be written."""
    from monitor.report.identification.page import write_identification
    from monitor.report.identification.subject import Subject

    subject = Subject(
        found=found,
        options=options,
        trials=table.trials,
        keys=words.keys,
        reasons=words.reasons,
        machine=words.machine,
        recordings=table.recordings,
        race_radius=table.race_radius,
        rig_file=words.rig_file or "",
    )
    write_identification(subject, path)

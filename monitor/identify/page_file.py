"""The page of an identification, as the command writes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from models.identify.run import Identification, IdentifyOptions
from monitor.commands.common import check_suffix
from monitor.identify.trial_files import TrialFile


@dataclass(frozen=True)
class ReportWords:
    """What the page is told beside the result.

    Attributes:
        machine: its name.
        keys: of the free parameters in the configuration.
        reasons: why a parameter is undetermined, in words.
        rig_file: file of the ``[rig]``, None for none.
        warnings: what speaks against the result, in sentences.
        calibrated: whether the result may be called so.
    """

    machine: str
    keys: Mapping[str, str]
    reasons: Mapping[str, str]
    rig_file: str | None
    warnings: Sequence[str] = ()
    calibrated: bool = True


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
    from monitor.identify.report.page import write_identification
    from monitor.identify.report.subject import Subject

    subject = Subject(
        found=found,
        options=options,
        trials=table.trials,
        keys=words.keys,
        reasons=words.reasons,
        machine=words.machine,
        recordings=table.recordings,
        race_radius=table.race_radius,
        rig_file=Path(words.rig_file).name if words.rig_file else "",
        calibrated=words.calibrated,
        warnings=tuple(words.warnings),
    )
    write_identification(subject, path)

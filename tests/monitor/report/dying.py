"""A report whose process is killed: a module of its own, because processes that run it import it."""

from __future__ import annotations

import os

from monitor.commands.report_batch import Pages, ReportOutcome, ReportTask


def dies(_pages: Pages, task: ReportTask) -> ReportOutcome:
    """Take the place of a report whose process is killed."""
    if task.run.name == "b":
        os._exit(9)
    return ReportOutcome(task.run, ())

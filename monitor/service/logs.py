"""The log on standard error: with the time for people, with priorities for the journal of systemd."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Mapping

_PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))


def set_up_log(level: int) -> None:
    """Write the log of this program to standard error.

    Args:
        level: lowest level that is written; of other packages, warnings and errors are.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        JournalFormatter() if to_journal() else logging.Formatter("%(asctime)s %(levelname)s %(message)s")
    )
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    for package in ("monitor", "streams"):
        logging.getLogger(package).setLevel(level)


def to_journal(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether standard error is the journal, which notes the time itself.

    Args:
        environment: ``JOURNAL_STREAM`` names device and inode of the journal's stream (systemd.exec(5)); a program
            that redirects its output inherits the variable, too.
    """
    try:
        found = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError, AttributeError):
        return False
    return environment.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


class JournalFormatter(logging.Formatter):
    """Begins each line with its priority, as sd-daemon(3) has it, so that ``journalctl --priority`` finds it."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the lines of a record."""
        priority = next((value for level, value in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines())

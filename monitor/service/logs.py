"""The log on standard error: for people with the time, for the journal of systemd with the priority instead."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Mapping

_PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))


def set_up_log(level: int) -> None:
    """Let the loggers of this program write to standard error.

    Args:
        level: from which on; of other packages' loggers warnings and errors are written.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        JournalFormatter() if to_journal() else logging.Formatter("%(asctime)s %(levelname)s %(message)s")
    )
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    for package in ("monitor", "streams"):
        logging.getLogger(package).setLevel(level)


def to_journal(environment: Mapping[str, str] = os.environ) -> bool:
    """Tell whether what is written to standard error goes to the journal, which notes the time itself.

    Args:
        environment: ``JOURNAL_STREAM`` names device and inode of the journal's stream (systemd.exec(5)); a program
            that redirects its output inherits the variable all the same.
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

"""The protocol of sd_notify(3) and the log on standard error: with priorities in the journal, else with the time."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Mapping
from contextlib import suppress

from models.platform.portable import local_datagrams

_PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))


class ServiceManager:
    """The service manager named by the environment (``NOTIFY_SOCKET``, ``WATCHDOG_USEC``); does nothing without one."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Read address and period."""
        address = environment.get("NOTIFY_SOCKET", "")
        # A leading @ stands for the zero byte of the abstract name space.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        watchdog = environment.get("WATCHDOG_USEC", "")
        self._every = int(watchdog) / 4e6 if watchdog.isdigit() else None
        self._due = float("-inf")

    def send(self, *lines: str) -> None:
        """Send lines such as ``READY=1``; errors of the connection are ignored."""
        if not self._address:
            return
        with suppress(OSError), local_datagrams() as link:
            link.setblocking(False)
            link.sendto("\n".join(lines).encode(), self._address)

    def feed_watchdog(self, now: float) -> None:
        """Feed the watchdog, four times in its period; ``now`` is of a monotonic clock."""
        if self._every is not None and now >= self._due:
            self._due = now + self._every
            self.send("WATCHDOG=1")


def set_up_log(level: int) -> None:
    """Write the log of this program from a level on, and warnings of other packages, to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        JournalFormatter() if to_journal() else logging.Formatter("%(asctime)s %(levelname)s %(message)s")
    )
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    for package in ("monitor", "streams"):
        logging.getLogger(package).setLevel(level)


def to_journal(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether standard error is the journal: the stream in ``JOURNAL_STREAM`` (systemd.exec(5))."""
    # A program that redirects its output inherits the variable, so device and inode are compared.
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

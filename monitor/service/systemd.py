"""What systemd wants to be told: ready, alive, stopping; without it, nothing happens."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress


class Notifier:
    """Tells the service manager of the environment (``NOTIFY_SOCKET``, ``WATCHDOG_USEC``; see sd_notify(3))."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Take the address, if there is one."""
        address = environment.get("NOTIFY_SOCKET", "")
        # A leading @ stands for the zero byte of the abstract name space.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        watchdog = environment.get("WATCHDOG_USEC", "")
        self._every = int(watchdog) / 4e6 if watchdog.isdigit() else None
        self._due = float("-inf")

    def tell(self, *lines: str) -> None:
        """Send lines such as ``READY=1``; a manager that does not listen is no trouble of ours."""
        if not self._address:
            return
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as link:
            link.setblocking(False)
            link.sendto("\n".join(lines).encode(), self._address)

    def alive(self, now: float) -> None:
        """Feed the watchdog, four times in its period; ``now`` is of a monotonic clock."""
        if self._every is not None and now >= self._due:
            self._due = now + self._every
            self.tell("WATCHDOG=1")

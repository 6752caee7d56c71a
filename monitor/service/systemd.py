"""The protocol of sd_notify(3): ready, alive, stopping."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress


class ServiceManager:
    """The service manager named by the environment (``NOTIFY_SOCKET``, ``WATCHDOG_USEC``); does nothing without one."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Take the address, if there is one."""
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
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as link:
            link.setblocking(False)
            link.sendto("\n".join(lines).encode(), self._address)

    def feed_watchdog(self, now: float) -> None:
        """Feed the watchdog, four times in its period; ``now`` is of a monotonic clock."""
        if self._every is not None and now >= self._due:
            self._due = now + self._every
            self.send("WATCHDOG=1")

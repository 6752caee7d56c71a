"""The dead-man signal: an address that is requested for as long as blocks can be committed.

A service outside of this computer notices when the requests end: with the computer, the daemon or its thread.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from urllib.parse import urlsplit

from monitor.config.outputs import NotifySection
from monitor.service.notify.channels import NotifyError, request

_LOG = logging.getLogger(__name__)


class Heartbeat:
    """Requests the configured address when the thread that commits calls, at most once in the interval.

    The request itself is made by a thread of its own, so that a slow answer delays nothing.
    """

    def __init__(self, settings: NotifySection, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Keep address and interval; without an address, nothing is ever requested."""
        self._url = None if settings.heartbeat_url is None else urlsplit(settings.heartbeat_url)
        self._interval, self._monotonic = settings.heartbeat_interval_s, monotonic
        self._due = float("-inf")
        self._wake = threading.Condition()
        self._asked = self._ending = False
        self.problem: str | None = None
        """Why the last request failed, or None."""
        if self._url is not None:
            threading.Thread(target=self._work, name="heartbeat", daemon=True).start()

    def beat(self, healthy: Callable[[], bool]) -> None:
        """Have the address requested if that is due and ``healthy``; returns at once."""
        now = self._monotonic()
        if self._url is None or now < self._due or not healthy():
            return
        self._due = now + self._interval
        with self._wake:
            self._asked = True
            self._wake.notify()

    def close(self) -> None:
        """Request nothing more; an answer that is waited for is left to its timeout."""
        with self._wake:
            self._ending = True
            self._wake.notify()

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._asked or self._ending)
                if self._ending:
                    return
            self._request()
            with self._wake:
                # What was asked for meanwhile is late: the thread that asked may hang by now.
                self._asked = False

    def _request(self) -> None:
        assert self._url is not None
        try:
            request("heartbeat", "GET", self._url)
        except NotifyError as error:
            if self.problem is None:
                _LOG.error("%s", error)
            self.problem = str(error)
        except Exception as error:  # A fault of one request must not end the signal.
            self.problem = f"heartbeat: {type(error).__name__}"
            _LOG.exception("the heartbeat fails")
        else:
            self.problem = None

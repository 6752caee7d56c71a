"""A worker thread that publishes over one connection after the other."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from monitor.records.database import StoreError
from monitor.service.broker import BrokerError
from monitor.service.notify.channels import NotifyError

_LOG = logging.getLogger(__name__)
_MIN_PAUSE_S, _MAX_PAUSE_S = 1.0, 60.0


class Sessions:
    """Base of what publishes to a broker; a failure is a :attr:`problem`, never an exception.

    A subclass gives ``_session``, one connection until its loss or the end, and calls :meth:`_start`.
    """

    _expected: tuple[type[Exception], ...] = (BrokerError, NotifyError, StoreError)
    """What a session may raise; anything else is logged with its trace."""

    def __init__(self, name: str, over: str, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Set up without a thread; ``name`` is that of the thread, ``over`` completes "publishing ..." in the log."""
        self.problem: str | None = None
        """Why nothing is published, or None."""
        self._name, self._over_what, self._monotonic = name, over, monotonic
        self._thread: threading.Thread | None = None
        self._connected = False
        self._wake = threading.Condition()
        self._news, self._ending, self._until = True, False, float("inf")

    def changed(self) -> None:
        """Note that there is more to publish; returns at once."""
        if self._thread is None:
            return
        with self._wake:
            self._news = True
            self._wake.notify()

    def close(self, seconds: float = 0.5) -> None:
        """Publish for at most so many seconds more, then end."""
        if self._thread is None:
            return
        with self._wake:
            self._ending, self._until = True, self._monotonic() + seconds
            self._wake.notify()
        self._thread.join(seconds)

    def _start(self) -> None:
        self._thread = threading.Thread(target=self._work, name=self._name, daemon=True)
        self._thread.start()

    def _session(self) -> None:
        """Publish over one connection, until the end or its loss."""
        raise NotImplementedError

    def _over(self) -> bool:
        """Return whether no further session begins."""
        return self._ending

    def _work(self) -> None:
        pause = _MIN_PAUSE_S
        while not self._over():
            try:
                self._session()
            except self._expected as error:
                self._fail(str(error))
            except Exception as error:  # A fault must not end the thread unnoticed.
                _LOG.exception("publishing %s fails", self._over_what)
                self._fail(type(error).__name__)
            else:
                return
            with self._wake:
                if self._wake.wait_for(lambda: self._ending, pause):
                    return
            pause = _MIN_PAUSE_S if self._connected else min(2.0 * pause, _MAX_PAUSE_S)

    def _fail(self, problem: str) -> None:
        if self.problem is None and not self._ending:
            _LOG.error("publishing %s fails, it is tried again: %s", self._over_what, problem)
        self.problem = problem

    def _works(self) -> None:
        """Note that the connection is made."""
        if self.problem is not None:
            _LOG.warning("publishing %s works again", self._over_what)
        self._connected, self.problem = True, None

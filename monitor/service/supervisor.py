"""The supervisor: a daemon a machine, each a process of its own, and one page for all of them."""

from __future__ import annotations

import logging
import os
import select
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Protocol

from monitor.records.database import StoreError
from monitor.service.companions import LAST_PUBLICATION
from monitor.service.fleet import Fleet
from monitor.service.supervised import Supervised
from monitor.service.supervision import Supervision
from monitor.service.systemd import Notifier

_LOG = logging.getLogger(__name__)
_TURN = 0.2
_LONGEST_START = 60.0
_ENDS_WITHIN = 4.6
_LONGEST_STATUS = 800
_PUBLISHING_AT_ONCE = 2


class Page(Protocol):
    """The page of all machines, in a process of its own."""

    @property
    def url(self) -> str | None:
        """Its address once it answers."""

    @property
    def problem(self) -> str | None:
        """What keeps it from answering, in one sentence."""

    def tick(self) -> None:
        """Start it, start it again; never waits."""

    def close(self) -> None:
        """End it."""


class Supervisor:
    """Keeps the daemons of several machines running, in the calling thread; use :meth:`run` once.

    Its word to the manager of services means that it goes round by itself and that every daemon either gives signs of
    life or is being dealt with: one that hangs is killed here, and the others never notice.
    """

    def __init__(
        self,
        fleet: Fleet,
        *,
        page: Page | None = None,
        options: Sequence[str] = (),
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take the machines; nothing is started yet.

        Args:
            fleet: the machines.
            page: their common page, or None.
            options: of each daemon, such as ``--quiet``.
            monotonic: seconds that never go back.
        """
        self._page, self._monotonic = page, monotonic
        self._fleet = fleet
        self._most_starting = os.cpu_count() or 1
        # All publish at once when they stop, and have five seconds in all.
        share = min(1.0, _PUBLISHING_AT_ONCE * self._most_starting / len(fleet.machines))
        self.daemons = tuple(
            Supervised(machine, options, monotonic, share * LAST_PUBLICATION) for machine in fleet.machines
        )
        self._notifier = Notifier()
        self._supervisions: dict[str, Supervision] = {}
        self._said: tuple[str, str | None] | None = None

    def run(self, stop: threading.Event) -> None:
        """Keep all daemons running until ``stop`` is set, then end them all and return, within five seconds.

        Raises:
            StoreError: another supervisor has one of the machines, or a state folder cannot be written; all are named.
        """
        with ExitStack() as opened:
            self._supervise(opened)
            try:
                self._follow(stop)
                self._notifier.tell("STOPPING=1")
                self._end()
            finally:
                for daemon in self.daemons:
                    daemon.kill()
                for daemon in self.daemons:
                    daemon.forget()

    def status(self) -> str:
        """Return how many daemons run and which do not, in one line."""
        failing = [f"{daemon.machine.name}: {daemon.problem}" for daemon in self.daemons if daemon.problem is not None]
        running = sum(daemon.ready for daemon in self.daemons)
        words = [f"{running} of {len(self.daemons)} machines run", *failing]
        if self._page is not None and self._page.problem is not None:
            words.append(f"page: {self._page.problem}")
        return "; ".join(words)[:_LONGEST_STATUS]

    def _supervise(self, opened: ExitStack) -> None:
        problems = []
        for machine in self._fleet.machines:
            try:
                supervision = self._supervisions[machine.name] = Supervision(machine.state_dir)
            except StoreError as error:
                problems.append(f"{machine.path}: {error}")
                continue
            opened.callback(supervision.close)
        if problems:
            raise StoreError("\n".join(problems))

    def _follow(self, stop: threading.Event) -> None:
        began, told = self._monotonic(), False
        _LOG.info("supervising %s", ", ".join(machine.name for machine in self._fleet.machines))
        while not stop.is_set():
            for daemon in self.daemons:
                # As many at once as there are processors: the first are ready sooner, and the last no later.
                daemon.tick(may_start=sum(other.starting() for other in self.daemons) < self._most_starting)
            if self._page is not None:
                self._page.tick()
            self._say()
            now = self._monotonic()
            # A manager of services waits for the start only so long, and a machine may have much to recover.
            if not told and (all(daemon.settled for daemon in self.daemons) or now - began > _LONGEST_START):
                told = True
                self._notifier.tell("READY=1", f"STATUS={self.status()}")
                _LOG.info("ready: %s", self.status())
            self._notifier.alive(now)
            self._wait()

    def _say(self) -> None:
        """Tell the manager of services and whoever asks for the status of a machine, where something changed."""
        status, page = self.status(), None if self._page is None else self._page.url
        if (status, page) == self._said:
            return
        self._said = (status, page)
        self._notifier.tell(f"STATUS={status}")
        for daemon in self.daemons:
            self._supervisions[daemon.machine.name].say(
                {"pid": os.getpid(), "starts": daemon.starts, "problem": daemon.problem, "page": page}
            )

    def _wait(self, seconds: float = _TURN) -> None:
        """Wait until a daemon says something, a moment at most."""
        poll = select.poll()
        for daemon in self.daemons:
            for item in daemon.waitable:
                poll.register(item, select.POLLIN)
        poll.poll(1e3 * seconds)

    def _end(self) -> None:
        until = time.monotonic() + _ENDS_WITHIN
        _LOG.info("stopping %d machines", len(self.daemons))
        for daemon in self.daemons:
            daemon.ask_to_stop()
        if self._page is not None:
            self._page.close()
        left = list(self.daemons)
        while left := [daemon for daemon in left if not daemon.gone()]:
            if time.monotonic() > until:
                names = ", ".join(daemon.machine.name for daemon in left)
                _LOG.warning("%s did not end in time and is killed; what was committed is safe", names)
                return
            self._wait(0.05)
        _LOG.info("stopped")

"""The daemon: follows all sources of a machine until it is told to stop, and says all the while how it is doing."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from monitor.config.load import Config
from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.events import EventLog
from monitor.records.recover.salvage import open_or_salvage
from monitor.service.acknowledging import Acknowledgements
from monitor.service.companions import Companions
from monitor.service.disk import DiskGuard, free_bytes
from monitor.service.ingest import Ingest
from monitor.service.machine_status import MachineStatus
from monitor.service.silence import SilenceLog
from monitor.service.status_file import StatusFile
from monitor.service.summary import run_attributes
from monitor.service.systemd import ServiceManager
from monitor.words.events import event_text

_LOG = logging.getLogger(__name__)
_STATUS_EVERY = 1.0
_LOOK_EVERY = 1.0
_STATUS_SHARE = 50.0
_STATUS_AT_LEAST = 5.0
"""s: whoever reads it takes a status that is three times as old for that of a daemon that hangs."""
_PAUSE = 0.5


class Daemon:
    """One machine, watched in the calling thread; use :meth:`run` once."""

    def __init__(
        self,
        config: Config,
        path: Path | None = None,
        *,
        monotonic: Callable[[], float] = time.monotonic,
        clock: Callable[[], float] = time.time,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        """Take the configuration; nothing is opened yet.

        Args:
            config: the machine.
            path: its file, where the daemon is to have a page.
            monotonic: seconds that never go back, for everything that is waited for.
            clock: UTC seconds since 1970, against which the times of blocks are held.
            free: gives the free bytes of a folder's file system.
        """
        self._config, self._path = config, path
        self._monotonic, self._clock, self._free = monotonic, clock, free
        self._manager = ServiceManager()
        self._began = monotonic()
        self._since = clock()
        self._status_due = self._look_due = float("-inf")
        self._status_problem: str | None = None
        self._log_problem: str | None = None
        self._held_up = False

    def run(self, stop: threading.Event) -> None:
        """Follow the sources until ``stop`` is set, then publish a last time and return, within five seconds.

        Raises:
            ConfigError: a source, a map or a library cannot be opened as configured.
            StoreError: the store cannot be opened, or another daemon has it.
        """
        machine = self._config.machine
        with ExitStack() as opened:
            self._file = opened.enter_context(StatusFile.open(machine.state_dir))
            database, name = machine.state_dir / "state.db", machine.name
            # What a salvage saved and lost is in the log, and in the event log, which is told from there.
            self._store, _ = open_or_salvage(
                database, machine=name, records_dir=machine.records_dir, clock=self._clock, beat=self._starting
            )
            opened.callback(self._store.close)
            self._disk = DiskGuard(machine.state_dir, self._free, round(1e6 * machine.min_free_mb))
            self._companions = Companions(self._config, self._store, self._path, self._monotonic)
            opened.callback(self._companions.close)
            self._log = opened.enter_context(EventLog(self._store.path))
            self._ingest = opened.enter_context(Ingest.open(self._config, self._store, self._clock, self._stuck))
            settings = self._ingest.settings
            channels = {name: channel for source in settings.values() for name, channel in source.channels.items()}
            self._store.describe(run_attributes(self._config, channels))
            self._status = MachineStatus(
                *(self._config, self._store, self._ingest, self._monotonic, self._clock),
                began=self._began,
                since=self._since,
            )
            self._acknowledgements = Acknowledgements(self._store, self._log, self._ingest)
            by_source = {source: tuple(found.channels) for source, found in settings.items()}
            self._silences = SilenceLog(self._store, self._log, by_source, self._clock)
            self._manager.send("READY=1", f"STATUS=watching {', '.join(settings)}")
            _LOG.info("machine %s: ready, watching %s", machine.name, ", ".join(settings))
            self._follow(stop)
            self._manager.send("STOPPING=1")
            _LOG.info("stopping after %d blocks", self._status.blocks)
            self._end()

    def _starting(self) -> None:
        # A service manager would end, and start again for ever, what takes longer to start than usual.
        self._manager.send("EXTEND_TIMEOUT_USEC=60000000", "STATUS=saving what can be read of a damaged store")

    def _follow(self, stop: threading.Event) -> None:
        while not stop.is_set():
            if not self._beat():
                # Nothing is taken, so nothing is acknowledged: senders and folders keep what they have.
                self._held_up = True
                stop.wait(_PAUSE)
                continue
            if self._held_up:
                self._held_up = False
                self._status.resumed()
            self._look()
            record = self._ingest.step(stop)
            if record is not None:
                self._seen(record)

    def _end(self) -> None:
        self._companions.end(room=self._disk.problem is None)
        self._write_status("stopped")
        _LOG.info("stopped; %d blocks were committed", self._status.blocks)

    def _seen(self, record: Record) -> None:
        self._status.seen(record)
        self._companions.committed(events=bool(record.events))
        for event in record.events:
            said = event_text(event, absolute=self._status.absolute(event.get("channel")))
            _LOG.warning("%s: block %d: %s: %s", record.source, record.sequence, event.get("channel"), said)
        if not record.accepted:
            _LOG.warning("%s: block %d rejected: %s: %s", record.source, record.sequence, record.status, record.reason)
        else:
            _LOG.debug("%s: block %d: %s", record.source, record.sequence, record.status)

    def _stuck(self) -> None:
        """Go on with all else while the store cannot commit."""
        self._held_up = True
        self._beat()

    def _beat(self) -> bool:
        """Do what is due; return whether there is room on the disk to go on."""
        now = self._monotonic()
        self._manager.feed_watchdog(now)
        before = self._disk.problem
        room = self._disk.check(now)
        if self._disk.problem is not None and before is None:
            _LOG.error("nothing more is taken: %s", self._disk.problem)
        elif room and before is not None:
            _LOG.warning("there is room on the disk again; going on")
        self._companions.tick(room=room)
        if now >= self._status_due:
            began = time.thread_time()
            self._write_status("running")
            spent = time.thread_time() - began
            self._status_due = now + min(max(_STATUS_EVERY, _STATUS_SHARE * spent), _STATUS_AT_LEAST)
        return room

    def _look(self) -> None:
        """See now and then what was acknowledged, and which sources fell silent."""
        now = self._monotonic()
        if now < self._look_due:
            return
        self._look_due = now + _LOOK_EVERY
        try:
            self._acknowledgements.poll()
        except StoreError as error:
            if self._log_problem is None:
                _LOG.error("what was acknowledged cannot be read: %s", error)
            self._log_problem = str(error)
        else:
            self._log_problem = None
        self._status.unacknowledged = self._acknowledgements.unacknowledged
        if self._silences.update(self._status.flows()):
            self._companions.notify()

    def _write_status(self, status: str) -> None:
        try:
            self._status.page = None if status == "stopped" else self._companions.url
            self._file.write(self._status.values(status, self.problems()))
        except Exception as error:  # Whatever cannot be said of the machine must not end what listens to it.
            reason = getattr(error, "strerror", None) or error
            problem = f"{self._file.path}: cannot be written ({reason})"
            if problem != self._status_problem:
                _LOG.error("%s", problem, exc_info=None if isinstance(error, OSError) else error)
            self._status_problem = problem
            return
        self._status_problem = None

    def problems(self) -> dict[str, str]:
        """Return what is wrong by now, in one sentence each, by the name of a source or of what else it is."""
        others = {"disk": self._disk.problem, "events": self._log_problem or self._silences.problem}
        failing = self._ingest.problems() | self._companions.problems()
        return failing | {name: problem for name, problem in others.items() if problem is not None}

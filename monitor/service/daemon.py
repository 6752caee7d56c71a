"""The daemon: follows all sources of a machine until it is stopped, and writes its status."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from models.platform.supervision import Restarts
from monitor.config.load import Config, ConfigError
from monitor.health.alarms import AlarmAcknowledgement
from monitor.health.record import Record
from monitor.records.compact import settle_layout
from monitor.records.database import StoreError
from monitor.records.durable import free_bytes
from monitor.records.events import EventLog
from monitor.records.queries import LogMarks, log_marks
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Store
from monitor.service.companions import Companions
from monitor.service.ingest import Ingest
from monitor.service.machine_status import MachineStatus, SilenceLog
from monitor.service.neighbours.condition import ConditionProcess
from monitor.service.progress import boot_id
from monitor.service.retention import Retention
from monitor.service.start import inspect, refuse_implausible
from monitor.service.summary import run_attributes, uncalibrated_lines
from monitor.service.system import DiskGuard, ServiceManager, StatusFile, full_disk, is_running
from monitor.words.events import event_text
from streams.types.source import POISONED

_LOG = logging.getLogger(__name__)
_MIN_STATUS_S, _MAX_STATUS_S = 1.0, 5.0
"""Seconds between two writes of the status file; readers take one of 15 s for that of a daemon that hangs."""
_STATUS_SHARE = 50.0
"""Least ratio of the time between two writes to the processor time of one."""
_POLL_LOG_S = 1.0
_PAUSE_S = 0.5
_COUNT_SHARE = 50.0
"""Least ratio of the time between two counts of unacknowledged events to the duration of one."""
_STUCK = frozenset(("disk", "store", "events"))
"""Problems with which no block is committed or no acknowledgement taken."""


class Acknowledgements:
    """Passes acknowledgements from the event log to the ingest; one that is passed twice has no effect.

    The first poll takes them all, also those given while no daemon ran.
    """

    def __init__(self, store: Store, log: EventLog, ingest: Ingest) -> None:
        """Keep store, log and ingest of one database."""
        self._store, self._log, self._ingest = store, log, ingest
        self._seen = 0
        self._count_due = float("-inf")
        self._marks: LogMarks | None = None
        self.unacknowledged = 0
        """Events and notices that are not acknowledged, as of the latest count."""

    def poll(self) -> None:
        """Take new acknowledgements; raise StoreError where the database cannot be read."""
        marks = log_marks(self._store)
        if marks == self._marks:
            return
        if marks.acknowledgements > self._seen:
            self._take()
            self._seen = max(self._seen, marks.acknowledgements)
        began = time.monotonic()
        if began >= self._count_due:
            self.unacknowledged = self._log.unacknowledged()
            # Counting takes a while in a log with very many events, and blocks wait for it.
            self._count_due = time.monotonic() + _COUNT_SHARE * (time.monotonic() - began)
            self._marks = marks

    def _take(self) -> None:
        for number, utc, event in self._log.acknowledged_alarms(self._seen):
            self._seen = number
            source, body, block = event.source or "", event.body, event.block or 0
            if source not in self._ingest.settings:
                continue
            given = AlarmAcknowledgement(body["channel"], body["rule"], body["severity"], block, utc)
            if self._ingest.acknowledge(source, given):
                _LOG.info("%s: %s of %s since block %d is acknowledged", source, given.severity, given.rule, block)


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
        """Keep the configuration; nothing is opened yet. Without its file ``path``, there is no page."""
        self._config, self._path = config, path
        self._monotonic, self._clock, self._free = monotonic, clock, free
        self._manager = ServiceManager()
        self._began, self._boot = monotonic(), boot_id()
        self._since = clock()
        self._status_due = self._poll_due = float("-inf")
        self._status_problem: str | None = None
        self._log_problem: str | None = None
        self._held_up = False
        self._idle = True
        self._notices: list[dict[str, Any]] = []
        self._stalled: list[str] = []

    def run(self, stop: threading.Event) -> None:
        """Follow the sources until ``stop`` is set, then publish a last time and return, within five seconds.

        Raises:
            ConfigError: a source, a map or a library cannot be opened as configured.
            StoreError: the store cannot be opened, or another daemon has it.
        """
        machine = self._config.machine
        found = inspect(self._config, running=is_running(machine.state_dir))
        if found.refusals:
            raise ConfigError("\n".join(found.refusals))
        for doubt in refuse_implausible(self._config):
            _LOG.warning("%s", doubt)
        with ExitStack() as opened:
            self._file = opened.enter_context(StatusFile.open(machine.state_dir))
            database, name = machine.state_dir / "state.db", machine.name
            if settle_layout(database, self._free, self._starting):
                _LOG.warning("%s: was rebuilt, so that it can be shortened while it is in use", database)
            # A recovery writes what it saved and lost to the log and the event log.
            self._store, recovered = open_or_salvage(
                database, machine=name, records_dir=machine.records_dir, clock=self._clock, beat=self._starting
            )
            opened.callback(self._store.close)
            self._companions = Companions(self._config, self._store, self._path, self._monotonic)
            opened.callback(self._companions.close)
            self._log = opened.enter_context(EventLog(self._store.path))
            self._retention = Retention(
                self._config.retention, self._store, self._log, monotonic=self._monotonic, clock=self._clock
            )
            least = round(1e6 * machine.min_free_mb)
            self._disk = DiskGuard(machine.state_dir, self._free, least, self._retention.reusable_bytes)
            section = self._config.operating.opcua
            self._condition = None if section is None else ConditionProcess(section, machine.state_dir, self._monotonic)
            if self._condition is not None:
                opened.callback(self._condition.close)
            ingest = Ingest.open(
                self._config, self._store, self._clock, self._stuck, found.settings, condition=self._condition
            )
            self._ingest = opened.enter_context(ingest)
            settings = self._ingest.settings
            channels = {name: channel for source in settings.values() for name, channel in source.channels.items()}
            self._store.describe(run_attributes(self._config, channels))
            for line in uncalibrated_lines(self._config, channels):
                _LOG.warning("%s", line)
            self._status = MachineStatus(
                *(self._config, self._store, self._ingest, self._monotonic, self._clock),
                began=self._began,
                since=self._since,
                recovered=None if recovered is None else recovered.text,
            )
            self._acknowledgements = Acknowledgements(self._store, self._log, self._ingest)
            by_source = {source: tuple(found.channels) for source, found in settings.items()}
            self._silences = SilenceLog(self._store, self._log, by_source, self._clock)
            self._manager.send("READY=1", f"STATUS=watching {', '.join(settings)}")
            _LOG.info("machine %s: ready, watching %s", machine.name, ", ".join(settings))
            self._follow(stop)
            self._manager.send("STOPPING=1")
            _LOG.info("stopping after %d blocks", self._status.blocks)
            self._companions.end(room=self._disk.problem is None)
            self._write_status("stopped")
            _LOG.info("stopped; %d blocks were committed", self._status.blocks)

    def _starting(self) -> None:
        # A service manager restarts a service whose start takes longer than usual.
        self._manager.send("EXTEND_TIMEOUT_USEC=60000000", "STATUS=repairing or rebuilding the store")
        self._file.touch()

    def _follow(self, stop: threading.Event) -> None:
        while not stop.is_set():
            if not self._beat():
                # Nothing is taken, so nothing is acknowledged: senders and folders keep what they have.
                self._held_up = True
                stop.wait(_PAUSE_S)
                continue
            if self._held_up:
                self._held_up = False
                self._status.resumed()
            self._poll_log()
            record = self._ingest.step(stop)
            self._idle = record is None
            if record is not None:
                self._note_record(record)

    def _note_record(self, record: Record) -> None:
        self._status.note(record)
        self._companions.committed(events=bool(record.events))
        for event in record.events:
            text = event_text(event, absolute=self._status.absolute(event.get("channel")))
            _LOG.warning("%s: block %d: %s: %s", record.source, record.sequence, event.get("channel"), text)
        if not record.accepted:
            _LOG.warning("%s: block %d rejected: %s: %s", record.source, record.sequence, record.status, record.reason)
            if record.status == POISONED:
                self._note_poisoned(record)
        else:
            _LOG.debug("%s: block %d: %s", record.source, record.sequence, record.status)

    def _note_poisoned(self, record: Record) -> None:
        text = f"{record.reason}; once the cause is gone: spallwatch release {record.name}"
        notice = {"kind": "file_poisoned", "source": record.source, "file": record.name, "text": text}
        try:
            self._log.notice(self._clock(), notice)
        except StoreError as error:
            _LOG.error("%s: the event cannot be logged: %s", record.source, error)
        self._companions.notify()

    def _stuck(self) -> None:
        """Do all other work while the store cannot commit."""
        self._held_up = True
        self._beat()

    def _beat(self) -> bool:
        """Do what is due; return whether there is room on the disk to go on."""
        now = self._monotonic()
        self._ingest.tend()
        before = self._disk.problem
        room = self._disk.check(now)
        # On a full disk nothing is taken, and a restart would not help.
        stalled = self._ingest.stalled() if room else []
        if not stalled:
            self._manager.feed_watchdog(now)
        if stalled != self._stalled:
            _LOG.error("blocks wait and are not committed: %s", ", ".join(stalled) or "none any more")
            self._stalled = stalled
        if self._disk.problem is not None and before is None:
            _LOG.error("nothing more is taken: %s", self._disk.problem)
        elif room and before is not None:
            _LOG.warning("there is room on the disk again; going on")
        self._companions.tick(room=room, to_delete=self._retention.to_delete)
        if self._condition is not None:
            self._condition.tick()
        self._retention.tick(self._companions.files, idle=self._idle, disk=self._disk.shortage)
        if self._retention.take_news():
            self._companions.notify()
        self._companions.beat(self._can_commit)
        if now >= self._status_due:
            began = time.thread_time()
            self._write_status("running")
            spent = time.thread_time() - began
            self._status_due = now + min(max(_MIN_STATUS_S, _STATUS_SHARE * spent), _MAX_STATUS_S)
        return room

    def _poll_log(self) -> None:
        """Log what is new of the sources, read acknowledgements and log silent sources, once a second."""
        now = self._monotonic()
        if now < self._poll_due:
            return
        self._poll_due = now + _POLL_LOG_S
        self._notices += self._ingest.notices()
        self._notices += [
            {"kind": "stays_down", "text": news}
            for restarts in self._restarts().values()
            if (news := restarts.take_news()) is not None
        ]
        try:
            while self._notices:
                self._log.notice(self._clock(), self._notices[0])
                del self._notices[0]
                self._companions.notify()
            self._acknowledgements.poll()
        except StoreError as error:
            if self._log_problem is None:
                _LOG.error("the event log cannot be used: %s", error)
            self._log_problem = str(error)
        else:
            self._log_problem = None
        self._status.unacknowledged = self._acknowledgements.unacknowledged
        if self._silences.update(self._status.flows()):
            self._companions.notify()

    def _write_status(self, status: str) -> None:
        try:
            self._status.page = None if status == "stopped" else self._companions.url
            progress = {"progress_age_s": self._ingest.progress.ages(), "stalled": self._stalled, "boot": self._boot}
            restarts = {name: found.values() for name, found in self._restarts().items() if found.failures}
            values = self._status.values(status, self.problems())
            self._file.write({**values, **progress, "restarts": restarts})
        except Exception as error:  # A status that cannot be composed must not end the daemon.
            reason = getattr(error, "strerror", None) or error
            problem = f"{self._file.path}: cannot be written ({reason})"
            if problem != self._status_problem:
                _LOG.error("%s", problem, exc_info=None if isinstance(error, OSError) else error)
            self._status_problem = problem
            return
        self._status_problem = None

    def _restarts(self) -> dict[str, Restarts]:
        condition = {} if self._condition is None else {"operating.opcua": self._condition.restarts}
        return self._ingest.restarts() | self._companions.restarts() | condition

    def _can_commit(self) -> bool:
        room = full_disk(self._config.machine.state_dir, 0, self._free) is None
        return room and not self._stalled and _STUCK.isdisjoint(self.problems())

    def problems(self) -> dict[str, str]:
        """Return the present problems, one sentence each, by the name of the source or the part."""
        others = {
            "disk": self._disk.problem,
            "retention": self._retention.problem,
            "events": self._log_problem or self._silences.problem,
            "operating.opcua": None if self._condition is None else self._condition.problem,
        }
        failing = self._ingest.problems() | self._companions.problems()
        return failing | {name: problem for name, problem in others.items() if problem is not None}

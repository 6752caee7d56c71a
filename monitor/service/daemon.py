"""The daemon: follows all sources of a machine until it is stopped, and writes its status."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from models.platform.supervision import Restarts
from models.words.errors import SpallwatchError
from monitor.config.load import Config, ConfigError
from monitor.health.record import Record
from monitor.records.compact import settle_layout
from monitor.records.durable import free_bytes
from monitor.records.events import EventLog
from monitor.records.failures import (
    DATABASE_ERRORS,
    Failures,
    Kind,
    StoreDamagedError,
    StoreError,
    error_text,
    kind_of,
)
from monitor.records.recover.loss import damage_in_use
from monitor.records.recover.salvage import open_or_salvage
from monitor.service.acknowledgements import Acknowledgements
from monitor.service.companions import Companions
from monitor.service.ingest import Ingest
from monitor.service.machine_status import MachineStatus, SilenceLog
from monitor.service.neighbours.condition import ConditionProcess
from monitor.service.progress import boot_id
from monitor.service.retention import Retention
from monitor.service.start import Inspection, inspect, refuse_implausible, refuse_small_quota
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
_START_S, _START_PAUSE_S = 60.0, 1.0
"""Seconds for which a start is repeated that fails by something that may end, and between two attempts."""
_STUCK = frozenset(("disk", "store", "daemon", "events"))
"""Problems with which no block is committed or no acknowledgement taken."""


class StoppedError(SpallwatchError):
    """The daemon cannot go on, or cannot start now; it may after a while. The message says why."""


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
        self._database = config.machine.state_dir / "state.db"
        self._monotonic, self._clock, self._free = monotonic, clock, free
        self._manager = ServiceManager()
        self._began, self._boot = monotonic(), boot_id()
        self._since = clock()
        self._status_due = self._poll_due = float("-inf")
        self._status_problem: str | None = None
        self._recovered: str | None = None
        damage = partial(damage_in_use, self._database)
        self._log_failures = Failures("the event log cannot be used", "the event log works again", damage, clock)
        self._loop_failures = Failures("a turn of the daemon fails", "the daemon goes on", damage, clock)
        self._held_up = False
        self._idle = True
        self._notices: list[dict[str, Any]] = []
        self._stalled: list[str] = []

    def run(self, stop: threading.Event) -> None:
        """Follow the sources until ``stop`` is set, then publish a last time and return, within five seconds.

        Raises:
            ConfigError: a source, a map or a library cannot be opened as configured.
            StoreError: the store cannot be opened, or another daemon has it.
            StoppedError: the system refuses what is needed to start for a minute, or the daemon cannot go on.
        """
        machine = self._config.machine
        found = inspect(self._config, running=is_running(machine.state_dir))
        if found.refusals:
            raise ConfigError("\n".join(found.refusals))
        for doubt in refuse_implausible(self._config):
            _LOG.warning("%s", doubt)
        opened = self._start(found, stop)
        if opened is None:
            return
        with opened:
            sources = ", ".join(self._ingest.settings)
            self._manager.send("READY=1", f"STATUS=watching {sources}")
            _LOG.info("machine %s: ready, watching %s", machine.name, sources)
            try:
                self._follow(stop)
            except SpallwatchError as error:
                self._write_status("running")
                # Exit code 1, not that of a wrong configuration: a service manager starts it again.
                raise StoppedError(f"stopped after {self._status.blocks} blocks: {error}") from error
            self._manager.send("STOPPING=1")
            _LOG.info("stopping after %d blocks", self._status.blocks)
            self._companions.end(room=self._disk.problem is None)
            self._write_status("stopped")
            _LOG.info("stopped; %d blocks were committed", self._status.blocks)

    def _start(self, found: Inspection, stop: threading.Event) -> ExitStack | None:
        """Open all, for a minute again where the system refuses what it may give later; None where ``stop`` is set.

        Raises:
            ConfigError, StoreError: it will not do in a minute either.
            StoppedError: it still does not.
        """
        until = self._monotonic() + _START_S
        while True:
            with ExitStack() as opened:
                try:
                    self._open(found, opened)
                except (SpallwatchError, OSError, *DATABASE_ERRORS) as error:
                    if kind_of(error) is not Kind.TRANSIENT:
                        raise
                    reason = f"cannot start: {error_text(error)}"
                    _LOG.error("%s", reason)
                    if self._monotonic() >= until:
                        raise StoppedError(reason) from error
                    self._manager.send("EXTEND_TIMEOUT_USEC=60000000", f"STATUS={reason}")
                    self._write_reason(reason)
                else:
                    return opened.pop_all()
            if stop.wait(_START_PAUSE_S):
                return None

    def _open(self, found: Inspection, opened: ExitStack) -> None:
        """Open store, sources and outputs, to be closed by ``opened``."""
        machine, database = self._config.machine, self._database
        self._file = opened.enter_context(StatusFile.open(machine.state_dir))
        if settle_layout(database, self._free, self._starting):
            _LOG.warning("%s: was rebuilt, so that it can be shortened while it is in use", database)
        # A recovery writes what it saved and lost to the log and the event log.
        self._store, recovered = open_or_salvage(
            database, machine=machine.name, records_dir=machine.records_dir, clock=self._clock, beat=self._starting
        )
        opened.callback(self._store.close)
        self._recovered = self._recovered if recovered is None else recovered.text
        refuse_small_quota(self._config, self._store)
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
            recovered=self._recovered,
        )
        self._acknowledgements = Acknowledgements(self._store, self._log, self._ingest)
        by_source = {source: tuple(found.channels) for source, found in settings.items()}
        self._silences = SilenceLog(self._store, self._log, by_source, self._clock)

    def _write_reason(self, reason: str) -> None:
        """Write why the daemon has not started yet, where its lock could be taken."""
        try:
            self._file.write({"status": "starting", "problems": {"start": reason}})
        except (AttributeError, OSError) as error:
            _LOG.debug("the status cannot be written: %s", error)

    def _starting(self) -> None:
        # A service manager restarts a service whose start takes longer than usual.
        self._manager.send("EXTEND_TIMEOUT_USEC=60000000", "STATUS=repairing or rebuilding the store")
        self._file.touch()

    def _follow(self, stop: threading.Event) -> None:
        while not stop.is_set():
            try:
                self._turn(stop)
            except (StoreError, OSError, MemoryError) as error:
                if kind_of(error) is Kind.LASTING or isinstance(error, StoreDamagedError):
                    raise
                self._loop_failures.note(error)
                self._held_up = True
                stop.wait(_PAUSE_S)
            else:
                self._loop_failures.end()

    def _turn(self, stop: threading.Event) -> None:
        """Do what is due, then take a block, where there is one and room on the disk."""
        if not self._beat():
            # Nothing is taken, so nothing is acknowledged: senders and folders keep what they have.
            self._held_up = True
            stop.wait(_PAUSE_S)
            return
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
        try:
            self._beat()
        except (StoreError, OSError, MemoryError) as error:
            # The block in hand is what matters, and the next turn meets the same.
            if isinstance(error, StoreDamagedError):
                raise
            self._loop_failures.note(error)

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
            self._log_failures.note(error)
        else:
            self._log_failures.end()
        self._status.unacknowledged = self._acknowledgements.unacknowledged
        if self._silences.update(self._status.flows()):
            self._companions.notify()

    def _write_status(self, status: str) -> None:
        try:
            self._status.page = None if status == "stopped" else self._companions.url
            progress = {"progress_age_s": self._ingest.progress.ages(), "stalled": self._stalled, "boot": self._boot}
            restarts = {name: found.values() for name, found in self._restarts().items() if found.failures}
            values = self._status.values(status, self.problems(), self._failures())
            listeners = self._ingest.listeners() | self._companions.listeners()
            beside = {"restarts": restarts, "listeners": listeners, "retention": self._retention.values()}
            self._file.write({**values, **progress, **beside})
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

    def _failures(self) -> dict[str, dict[str, Any]]:
        """Return the failures since the start, also those that are over, by the name of the part."""
        parts = {
            "store": self._ingest.failures,
            "daemon": self._loop_failures,
            "events": self._log_failures,
            "retention": self._retention.failures,
        }
        return {name: part.history for name, part in parts.items() if part.history is not None}

    def _can_commit(self) -> bool:
        room = full_disk(self._config.machine.state_dir, 0, self._free) is None
        return room and not self._stalled and _STUCK.isdisjoint(self.problems())

    def problems(self) -> dict[str, str]:
        """Return the present problems, one sentence each, by the name of the source or the part."""
        others = {
            "disk": self._disk.problem,
            "retention": self._retention.problem,
            "daemon": self._loop_failures.problem,
            "events": self._log_failures.problem or self._silences.problem,
            "operating.opcua": None if self._condition is None else self._condition.problem,
        }
        failing = self._ingest.problems() | self._companions.problems()
        return failing | {name: problem for name, problem in others.items() if problem is not None}

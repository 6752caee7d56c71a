"""The daemon: follows all sources of a machine until it is told to stop, and says all the while how it is doing."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from monitor.config import Config
from monitor.records.record import Record
from monitor.records.store import Store, StoreError
from monitor.service.disk import DiskGuard, free_bytes
from monitor.service.ingest import Ingest
from monitor.service.machine_status import MachineStatus
from monitor.service.notify.notifier import Notifier as EventNotifier
from monitor.service.publisher import Publisher
from monitor.service.status_file import StatusFile
from monitor.service.summary import run_attributes
from monitor.service.systemd import Notifier

_LOG = logging.getLogger(__name__)
_STATUS_EVERY = 1.0
_STATUS_SHARE = 50.0
_PAUSE = 0.5
_LAST_PUBLICATION = 3.0
_LAST_NOTIFICATION = 0.5
_CHECKED_BYTES = 64 << 20


class Daemon:
    """One machine, watched in the calling thread; use :meth:`run` once."""

    def __init__(
        self,
        config: Config,
        *,
        monotonic: Callable[[], float] = time.monotonic,
        clock: Callable[[], float] = time.time,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        """Take the configuration; nothing is opened yet.

        Args:
            config: the machine.
            monotonic: seconds that never go back, for everything that is waited for.
            clock: UTC seconds since 1970, against which the times of blocks are held.
            free: gives the free bytes of a folder's file system.
        """
        self._config = config
        self._monotonic, self._clock, self._free = monotonic, clock, free
        self._notifier = Notifier()
        self._began = monotonic()
        self._since = clock()
        self._status_due = float("-inf")
        self._status_problem: str | None = None

    def run(self, stop: threading.Event) -> None:
        """Follow the sources until ``stop`` is set, then publish a last time and return, within five seconds.

        Raises:
            ConfigError: a source, a map or a library cannot be opened as configured.
            StoreError: the store cannot be opened, or another daemon has it.
        """
        machine = self._config.machine
        with ExitStack() as opened:
            self._file = opened.enter_context(StatusFile.open(machine.state_dir))
            self._store = opened.enter_context(Store.open(machine.state_dir / "state.db", machine=machine.name))
            _refuse_damaged(self._store)
            self._disk = DiskGuard(machine.state_dir, self._free, round(1e6 * machine.min_free_mb))
            every = self._config.publish.interval_s
            self._publisher = Publisher(self._store, machine.records_dir, every, self._monotonic)
            opened.callback(self._publisher.close)
            self._events = EventNotifier.from_settings(machine.name, self._config.notify)
            opened.callback(self._events.close, _LAST_NOTIFICATION)
            self._ingest = opened.enter_context(Ingest.open(self._config, self._store, self._clock, self._beat))
            watchers = self._ingest.watchers
            setups = {name: setup for watcher in watchers.values() for name, setup in watcher.channels.items()}
            self._store.describe(run_attributes(self._config, setups))
            self._status = MachineStatus(
                *(self._config, self._store, self._ingest, self._monotonic, self._clock),
                began=self._began,
                since=self._since,
            )
            self._notifier.tell("READY=1", f"STATUS=watching {', '.join(watchers)}")
            _LOG.info("machine %s: ready, watching %s", machine.name, ", ".join(watchers))
            self._follow(stop)
            self._notifier.tell("STOPPING=1")
            _LOG.info("stopping after %d blocks", self._status.blocks)
            self._end()

    def _follow(self, stop: threading.Event) -> None:
        while not stop.is_set():
            if not self._beat():
                # Nothing is taken, so nothing is acknowledged: senders and folders keep what they have.
                stop.wait(_PAUSE)
                continue
            record = self._ingest.step(stop)
            if record is not None:
                self._seen(record)

    def _end(self) -> None:
        if self._disk.problem is None and not self._publisher.finish(_LAST_PUBLICATION):
            _LOG.warning("the last records are not published yet; they are safe, and will be at the next start")
        self._write_status("stopped")
        _LOG.info("stopped; %d blocks were committed", self._status.blocks)

    def _seen(self, record: Record) -> None:
        self._status.seen(record)
        self._publisher.changed()
        for event in record.events:
            self._events.tell({"source": record.source, **event})
            _LOG.warning("%s: block %d: %s", record.source, record.sequence, event)
        if not record.accepted:
            _LOG.warning("%s: block %d rejected: %s: %s", record.source, record.sequence, record.status, record.reason)
        else:
            _LOG.debug("%s: block %d: %s", record.source, record.sequence, record.status)

    def _beat(self) -> bool:
        """Do what is due; return whether there is room on the disk to go on."""
        now = self._monotonic()
        self._notifier.alive(now)
        before = self._disk.problem
        room = self._disk.check(now)
        if self._disk.problem is not None and before is None:
            _LOG.error("nothing more is taken: %s", self._disk.problem)
        elif room and before is not None:
            _LOG.warning("there is room on the disk again; going on")
        if room:
            self._publisher.tick()
        if now >= self._status_due:
            began = time.monotonic()
            self._write_status("running")
            self._status_due = now + max(_STATUS_EVERY, _STATUS_SHARE * (time.monotonic() - began))
        return room

    def _write_status(self, status: str) -> None:
        try:
            self._file.write(self._status.values(status, self.problems()))
        except OSError as error:
            problem = f"{self._file.path}: cannot be written ({error.strerror or error})"
            if problem != self._status_problem:
                _LOG.error("%s", problem)
            self._status_problem = problem
            return
        self._status_problem = None

    def problems(self) -> dict[str, str]:
        """Return what is wrong by now, in one sentence each, by the name of a source or of what else it is."""
        others = {"disk": self._disk.problem, "publisher": self._publisher.problem}
        failing = self._ingest.problems() | self._events.problems()
        return failing | {name: problem for name, problem in others.items() if problem is not None}


def _refuse_damaged(store: Store) -> None:
    """Read a store of usual size once; whoever goes on with a damaged one commits to what may be lost.

    Raises:
        StoreError: naming what is wrong, and what to do.
    """
    if store.path.stat().st_size > _CHECKED_BYTES:
        _LOG.info("%s: is larger than %d MB and is not read at the start", store.path, _CHECKED_BYTES >> 20)
        return
    problems = store.check()
    if problems:
        raise StoreError(
            f"{store.path}: is damaged ({problems[0]}); move it and the files named after it to another folder, "
            "restore a copy if there is one, and start again: what is still in the sources is then taken anew"
        )

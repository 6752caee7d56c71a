"""Outputs beside the thread that commits: files, page, notifications, records over MQTT, Sparkplug B and OPC UA."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from models.platform.supervision import Restarts
from monitor.config.load import Config
from monitor.records.store import Store
from monitor.service.children import ServerProcess, Worker, page_server
from monitor.service.neighbours.sparkplug import Sparkplug
from monitor.service.notify.channels import Heartbeat
from monitor.service.notify.notifier import Notifier
from monitor.service.publisher import PublishedFiles, Publisher
from monitor.service.record_mqtt import RecordMqtt

_LOG = logging.getLogger(__name__)
_LAST_PUBLICATION_S = 3.0
_LAST_MESSAGE_S = 0.5
_OPCUA = "monitor.service.neighbours.opcua_server:child"


class Companions:
    """Outputs of the store; a failure of one is a problem in the status, never an exception.

    All methods are called from the thread that owns the store.
    """

    def __init__(
        self,
        config: Config,
        store: Store,
        path: Path | None = None,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start notifications and records over MQTT for a store that is open for writing.

        The page and the OPC UA server read the configuration from the file ``path``; without one there are none.

        Raises:
            ConfigError: a notification channel cannot be set up as configured.
            StoreError: the store cannot be read.
        """
        with ExitStack() as opened:
            machine = config.machine
            self._publisher = Publisher(store, machine.records_dir, config.publish.interval_s, monotonic)
            opened.callback(self._publisher.close)
            self._events = Notifier.from_settings(config, store.path)
            self._ending: list[Callable[[], None]] = [partial(self._events.close, _LAST_MESSAGE_S)]
            opened.callback(self._ending[0])
            self._heartbeat = Heartbeat(config.notify, monotonic)
            self._ending.append(self._heartbeat.close)
            self._records = RecordMqtt.open(config)
            self._ending.append(partial(self._records.close, _LAST_MESSAGE_S))
            self._sparkplug = Sparkplug.open(config)
            self._ending.append(partial(self._sparkplug.close, _LAST_MESSAGE_S))
            self._servers: dict[str, ServerProcess] = {}
            if path is not None and config.web.enabled:
                self._servers["page"] = page_server(path, config.web, machine.state_dir, monotonic)
            if path is not None and config.publish.opcua is not None:
                request = {"config": str(path.absolute())}
                self._servers["publish.opcua"] = ServerProcess("the OPC UA server", _OPCUA, request, monotonic)
            self._ending += [server.close for server in self._servers.values()]
            self._workers: dict[str, Worker] = {
                **self._events.workers(),
                "notify.heartbeat": self._heartbeat,
                "publish.mqtt": self._records,
                "publish.sparkplug": self._sparkplug,
            }
            opened.pop_all()

    @property
    def url(self) -> str | None:
        """Address of the page once it answers, or None."""
        return self._servers["page"].url if "page" in self._servers else None

    def listeners(self) -> dict[str, Mapping[str, Any]]:
        """Return the counts of connections of the servers that report them, by name."""
        return {name: server.listener for name, server in self._servers.items() if server.listener is not None}

    def committed(self, *, events: bool) -> None:
        """Note that a block was committed, and whether the event log has something new."""
        self._publisher.changed()
        self._records.changed()
        self._sparkplug.changed()
        if events:
            self.notify()

    def notify(self) -> None:
        """Note that the event log has something new."""
        self._events.wake()

    @property
    def files(self) -> PublishedFiles:
        """What the latest publication found of the files."""
        return self._publisher.files

    def tick(self, *, room: bool, to_delete: int = 0) -> None:
        """Do what is due; files are written where there is room on the disk, and so many bytes of them deleted."""
        self._publisher.to_delete = to_delete
        if room:
            self._publisher.tick()
        for owned in self._servers.values():
            owned.tick()
        for worker in self._workers.values():
            worker.tend()

    def restarts(self) -> dict[str, Restarts]:
        """Return what is known of the failures of each thread and child, by its name."""
        owned = {**self._workers, **self._servers, "publisher": self._publisher}
        return {name: found.restarts for name, found in owned.items()}

    def beat(self, healthy: Callable[[], bool]) -> None:
        """Send the dead-man signal if it is due and ``healthy``."""
        self._heartbeat.beat(healthy)

    def problems(self) -> dict[str, str]:
        """Return the problem of each that has one, by its name."""
        servers = {name: server.problem for name, server in self._servers.items()}
        found = {
            "publisher": self._publisher.problem,
            "records": "; ".join(self._publisher.kept.values()) or None,
            **{name: worker.trouble() for name, worker in self._workers.items()},
            "publish.opcua": servers.get("publish.opcua"),
            "page": servers.get("page"),
        }
        return {name: problem for name, problem in found.items() if problem is not None}

    def end(self, *, room: bool) -> None:
        """Publish, where there is room on the disk, and notify a last time; end all within four seconds."""
        ending = [threading.Thread(target=end, daemon=True) for end in self._ending]
        for thread, end in zip(ending, self._ending, strict=True):
            try:
                thread.start()
            except RuntimeError:  # The system gives no more threads.
                end()
        if room and not self._publisher.finish(_LAST_PUBLICATION_S):
            _LOG.warning("the last records are not published yet; they are safe, and will be at the next start")
        for thread in ending:
            if thread.ident is not None:
                thread.join()
        self._ending.clear()

    def close(self) -> None:
        """End what has not ended; closing twice does nothing."""
        for end in self._ending:
            end()
        self._ending.clear()
        self._publisher.close()

"""Publication of record files by a child process, at the request of the thread that commits.

Only the child loads xarray and netCDF. It answers each line of its input with one JSON object.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any, NamedTuple, cast

from models.platform.portable import lower_priority
from models.platform.supervision import Restarts
from monitor.records.database import StoreError
from monitor.records.durable import locked
from monitor.records.events import EventLog
from monitor.records.quota import note_days_given_up
from monitor.records.store import Published, Store
from monitor.service.children import Child

_LOG = logging.getLogger(__name__)
_ENTRY = "monitor.service.publisher:child"
_LOCK = "publisher.lock"
_MAX_PUBLICATION_S = 600.0
_MIN_PAUSE_FACTOR = 20.0
_CHECK_TURNS = 10
_MAX_ANSWERS = 200
"""Publications after which a new child takes over: the libraries leak some kilobytes with every file."""


class PublishedFiles(NamedTuple):
    """What the latest publication found.

    Attributes:
        complete: whether the files have all blocks that the store noted as published.
        size: of all files of the machine, bytes.
        missing: names of files that are lost, with records that the store has no more.
    """

    complete: bool = False
    size: int = 0
    missing: tuple[str, ...] = ()


class Publisher:
    """Publishes at intervals, in the thread that owns the store; a failure is a :attr:`problem`, never an exception."""

    def __init__(
        self,
        store: Store,
        records_dir: Path,
        every: float = 60.0,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Keep a store that is open for writing, and the least seconds ``every`` from publication to publication."""
        self._store, self._records_dir = store, records_dir
        self._every, self._monotonic = every, monotonic
        self._child: Child | None = None
        self.restarts = Restarts("the publisher", monotonic)
        self._answers = 0
        self._retired: Child | None = None
        self._requested_at: float | None = None
        self._due = monotonic()
        # Files may have been lost or damaged since the last run.
        self._changed = True
        self._idle_turns = 0
        self.problem: str | None = None
        """Why files are not published, or None."""
        self.files = PublishedFiles()
        self.to_delete = 0
        """Bytes of the oldest days to delete with the next publication."""
        self.kept: dict[str, str] = {}
        """What is said of files that were kept since the start, because they hold more, by name."""

    @property
    def busy(self) -> bool:
        """Whether a publication is under way."""
        return self._requested_at is not None

    @property
    def pid(self) -> int | None:
        """Number of the child process, or None where none is running."""
        return None if self._child is None else self._child.pid

    def changed(self) -> None:
        """Note that there is more to publish."""
        self._changed = True

    def tick(self) -> None:
        """Read an answer that has come, and send a request when it is due."""
        now = self._monotonic()
        if self.busy:
            self._collect(0.0)
            if self._requested_at is not None and now - self._requested_at > _MAX_PUBLICATION_S:
                self._fail(f"publishing takes longer than {_MAX_PUBLICATION_S:.0f} s")
        elif now >= self._due and self.restarts.due:
            self._idle_turns += 1
            if self._changed or self._idle_turns >= _CHECK_TURNS:
                self._request()
            else:
                self._due = now + self._every

    def finish(self, seconds: float) -> bool:
        """Publish everything within so many seconds; return whether it succeeded."""
        until = time.monotonic() + seconds
        while self.busy and time.monotonic() < until:
            self._collect(until - time.monotonic())
        if self.busy:
            return False
        if self._changed:
            self._request()
        while self.busy and time.monotonic() < until:
            self._collect(until - time.monotonic())
        return not self.busy and self.problem is None

    def close(self) -> None:
        """End the child; a file that it was replacing keeps its old content."""
        self._requested_at = None
        earlier, self._retired = self._retired, None
        self._retire()
        later, self._retired = self._retired, None
        for child in (earlier, later):
            if child is not None:
                child.end()

    def _retire(self) -> None:
        """Let the child end after its present publication."""
        child, self._child, self._answers = self._child, None, 0
        if child is not None:
            self._retired = child
            child.close_pipes()

    def _request(self) -> None:
        self._requested_at, self._changed, self._idle_turns = self._monotonic(), False, 0
        try:
            if self._child is None:
                store, records_dir = self._store.path.absolute(), self._records_dir.absolute()
                self._child = Child(_ENTRY, str(store), str(records_dir))
                self.restarts.started()
            self._child.write(b"%d\n" % self.to_delete)
        except OSError as error:
            self._fail(f"the publisher cannot be asked: {error.strerror or error}")

    def _collect(self, timeout: float) -> None:
        """Read the child's answer, waiting at most ``timeout`` seconds."""
        assert self._child is not None
        lines = self._child.read_lines(timeout)
        if lines is None:
            self._fail("the publisher ended unexpectedly")
        for line in lines or ():
            self._take(json.loads(line))

    def _take(self, answer: dict[str, Any]) -> None:
        """Note what was written; what cannot be noted is published again."""
        self.restarts.runs()
        took = float(answer["seconds"])
        self._requested_at = None
        self._due = self._monotonic() + max(self._every, _MIN_PAUSE_FACTOR * took)
        try:
            for done in answer["published"]:
                self._store.note_published(Published(*done))
            if answer["deleted"]:
                note_days_given_up(self._store, time.time())
        except StoreError as error:
            _LOG.warning("what was published cannot be noted: %s", error)
            self._changed = True
        for notice in answer["kept"]:
            self._note_kept(notice)
        if answer["published"]:
            _LOG.info("published %s in %.1f s", ", ".join(str(done[0]) for done in answer["published"]), took)
        if answer["deleted"]:
            _LOG.warning("deleted for max_gb: %s", ", ".join(answer["deleted"]))
        self.to_delete = 0
        self.files = PublishedFiles(answer["problem"] is None, answer["size"], tuple(answer["missing"]))
        self._set_problem(answer["problem"])
        self._answers += 1
        if self._answers >= _MAX_ANSWERS and (self._retired is None or self._retired.ended):
            self._retire()

    def _note_kept(self, notice: dict[str, Any]) -> None:
        self.kept[notice["aside"]] = notice["text"]
        _LOG.error("%s", notice["text"])
        try:
            with EventLog(self._store.path) as log:
                log.notice(time.time(), notice)
        except StoreError as error:
            _LOG.warning("that is not in the event log: %s", error)

    def _fail(self, problem: str) -> None:
        self.close()
        self._due = self._monotonic() + self._every
        self.restarts.failed(problem)
        self._set_problem(self.restarts.problem() or problem)

    def _set_problem(self, problem: str | None) -> None:
        if problem is not None:
            self._changed = True
        if problem != self.problem:
            if problem is None:
                _LOG.warning("publishing works again")
            else:
                _LOG.error("publishing fails: %s", problem)
        self.problem = problem


def child() -> None:
    """Publish once for each line of standard input, the number of bytes to delete.

    The arguments are the store and the folder of the files.
    """
    store, records_dir = Path(sys.argv[1]), Path(sys.argv[2])
    # The thread that commits has priority.
    lower_priority()
    if "xarray" not in sys.modules:
        # Where dask is installed, xarray would load it to ask whether arrays are dask's: 0.4 s and 40 MB.
        sys.modules.setdefault("dask", cast("Any", None))
    # A broken pipe means that the daemon has ended.
    with _alone(store), suppress(BrokenPipeError):
        for line in sys.stdin:
            print(json.dumps(_publish(store, records_dir, int(line))), flush=True)
    # The orderly end of an interpreter with these libraries costs a tenth of a second.
    os._exit(0)


def _alone(store: Path) -> AbstractContextManager[None]:
    """Wait for any other publisher: that of a killed daemon may still be writing, under the same temporary names."""
    return locked(store.with_name(_LOCK))


def publish_now(store: Store, records_dir: Path) -> str | None:
    """Publish from a command, which has the store open for writing; return why that failed, or None.

    What a command changes is in the published snapshot then, and is not lost with the store before the next start.
    """
    from monitor.records.publish import PublishError, publish
    from monitor.records.published_folder import MovedDaysError

    try:
        with _alone(store.path):
            publish(store, records_dir)
    except (MovedDaysError, PublishError, StoreError, OSError) as error:
        return str(error)
    return None


def _publish(path: Path, records_dir: Path, to_delete: int) -> dict[str, Any]:
    """Publish, and delete the oldest days where so many bytes are too many.

    Returns:
        ``published`` (a list of :class:`Published`), ``kept`` (notices of files kept because they hold more),
        ``deleted`` and ``missing`` (names of files), ``size`` (bytes of
        all files), ``problem`` (or None) and ``seconds``.
    """
    from monitor.records.publish import PublishError, delete_oldest, missing_files, publish, published_bytes
    from monitor.records.published_folder import MovedDaysError

    began = time.monotonic()
    answer: dict[str, Any] = {"published": [], "kept": [], "deleted": [], "missing": [], "size": 0, "problem": None}
    try:
        with Store.open(path, create=False, read_only=True) as store:
            publish(
                *(store, records_dir),
                note=answer["published"].append,
                note_kept=lambda kept: answer["kept"].append(kept.notice()),
            )
            answer["deleted"] = delete_oldest(store, records_dir, to_delete, time.time())
            answer["missing"] = missing_files(store, records_dir)
            answer["size"] = published_bytes(records_dir, store.machine)
    except (MovedDaysError, PublishError, StoreError) as error:
        answer["problem"] = str(error)
    return {**answer, "seconds": time.monotonic() - began}

"""Events of the file system: they trigger a scan and name finished files."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from models.platform.supervision import Restarts
from streams.types.listing import NETWORK_FILE_SYSTEMS, file_system_type

_LOG = logging.getLogger(__name__)
_MAX_NAMES = 10_000
"""Names kept between two polls; files beyond are found by the next scan, a settling time later."""

_OVERFLOW_MASK = 0x00000008 | 0x00000080 | 0x00000100 | 0x02000000 | 0x20000000
"""IN_CLOSE_WRITE, IN_MOVED_TO, IN_CREATE, IN_DONT_FOLLOW, and IN_MASK_ADD, which keeps the mask of the observer."""


class FolderWatch:
    """Watches a folder and all below it; a network share has no events."""

    def __init__(self, wake: Callable[[], None], name: str = "the watch of a folder") -> None:
        """Take the function to call, from another thread, on every event; ``name`` is that of its failures."""
        self._wake = wake
        self.restarts = Restarts(name)
        self._lock = threading.Lock()
        self._finished: set[str] = set()
        self._observer: Any = None
        self._failed = False
        self._root = ""
        self.overflows = 0
        """How often the kernel dropped events."""

    def start(self, root: Path) -> None:
        """Watch a folder in place of the one before; a failure is only logged."""
        self.stop()
        # A share may have been mounted here meanwhile.
        kind = file_system_type(root)
        if kind in NETWORK_FILE_SYSTEMS:
            _LOG.info("%s lies on a network share (%s): found by scanning only", root, kind)
            return
        from watchdog.events import FileClosedEvent, FileCreatedEvent, FileMovedEvent
        from watchdog.observers import Observer

        self._root = str(root)
        observer: Any = Observer()
        try:
            events = [FileClosedEvent, FileCreatedEvent, FileMovedEvent]
            observer.schedule(_Handler(self), self._root, recursive=True, event_filter=events)
            observer.start()
        except (OSError, RuntimeError) as error:
            # Mostly too many watches or instances; the scan still finds all files, later.
            _LOG.warning("%s cannot be watched (%s): found by scanning only", root, error)
            with contextlib.suppress(RuntimeError):
                observer.stop()
            if self._failed:
                self.restarts.failed(str(error))
            return
        self._observer, self._failed = observer, False
        self.restarts.started()
        _Overflow(self.note_overflow).listen(observer, self._root)

    @property
    def listening(self) -> bool:
        """Whether an observer is running."""
        return self._observer is not None

    def alive(self) -> bool:
        """Return whether events are reported; an observer outlives its dead emitters."""
        observer = self._observer
        return observer is None or (
            observer.is_alive() and bool(observer.emitters) and all(emitter.is_alive() for emitter in observer.emitters)
        )

    def tend(self) -> bool:
        """Return whether to start it again now: it has failed. Meanwhile, and while it stays down, scans find all."""
        if self.alive():
            if self._observer is not None:
                self.restarts.runs()
            return self._failed and self.restarts.due
        self.restarts.failed("its threads ended")
        self.stop()
        self._failed = True
        return self.restarts.due

    def finished(self) -> set[str]:
        """Return the paths of files closed or moved in since the last call."""
        with self._lock:
            found, self._finished = self._finished, set()
        return found

    def note(self, path: str, finished: bool) -> None:
        """Record an event; called by the thread of the observer."""
        if finished:
            with self._lock:
                if len(self._finished) < _MAX_NAMES:
                    self._finished.add(os.path.relpath(path, self._root))
        self._wake()

    def note_overflow(self) -> None:
        """Record that events were dropped; called by the thread of the observer."""
        self.overflows += 1
        self._wake()

    def stop(self) -> None:
        """Stop watching."""
        observer, self._observer = self._observer, None
        if observer is not None:
            observer.stop()
            observer.join(timeout=5.0)
        with self._lock:
            self._finished.clear()


class _Handler:
    """Event handler of the observer."""

    def __init__(self, watch: FolderWatch) -> None:
        self._watch = watch

    def dispatch(self, event: Any) -> None:
        """Record an event; a file closed after writing, or moved in, is finished."""
        moved = event.event_type == "moved"
        path = os.fsdecode(event.dest_path if moved else event.src_path)
        self._watch.note(path, finished=moved or event.event_type == "closed")


class _Overflow:
    """A ``WatchCallback`` of watchdog's inotify: for overflows it calls no handler."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call = call

    def listen(self, observer: Any, root: str) -> None:
        """Register with the queue of an observer, where it has callbacks."""
        queue = vars(observer).get("_inotify_fd")
        if hasattr(queue, "add_callback"):
            with contextlib.suppress(OSError):
                queue.add_callback(os.fsencode(root), _OVERFLOW_MASK, self, id(self))

    def on_event(self, event: Any) -> None:
        """Ignore it; the observer reports single events."""

    def on_watch_deleted(self, place: Any) -> None:
        """Ignore it; the scan finds removed folders."""

    def on_queue_overflow(self) -> None:
        """Report an overflow."""
        self._call()

"""A child process of readers that outlives its owner, so that tests of folders do not each start one."""

from __future__ import annotations

import os
from typing import ClassVar

from streams.readers.child import ReaderProcess


class KeptReader(ReaderProcess):
    """A reader process whose child, if idle when it is closed, serves the next one.

    A child costs the imports of its parsers, about half a second of processor time. One that is reading, was killed or
    has died ends as always.
    """

    _spare: ClassVar[list[KeptReader]] = []

    def close(self) -> None:
        """Close it; an idle child is kept."""
        if not self._lock.acquire(blocking=False):
            super().close()
            return
        try:
            self._closed = True
            if self._process is None or self._process.poll() is not None:
                self._stop()
            else:
                self._spare.append(self)
        finally:
            self._lock.release()

    def _start(self) -> None:
        while self._spare and not self._closed:
            other = self._spare.pop()
            if other._process is not None and other._process.poll() is None:
                self._process, self._handles, self._files = other._process, other._handles, other._files
                other._process, other._handles = None, []
                return
            other._stop()
        super()._start()

    @classmethod
    def end(cls) -> None:
        """End the children that are kept."""
        while cls._spare:
            cls._spare.pop()._stop()


# The children belong to the parent of a forked process.
os.register_at_fork(after_in_child=KeptReader._spare.clear)

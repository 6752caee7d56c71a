"""A child process of readers that outlives its owner, so that tests of folders do not each start one."""

from __future__ import annotations

from typing import ClassVar

from models.platform.portable import after_fork
from streams.files.parse.child import ReaderProcess, _Pipes


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

    def _start(self) -> _Pipes:
        while self._spare and not self._closed:
            other = self._spare.pop()
            if other._pipes is not None and other._process is not None and other._process.poll() is None:
                self._process, self._pipes, self._files = other._process, other._pipes, other._files
                other._process, other._pipes = None, None
                return self._pipes
            other._stop()
        return super()._start()

    @classmethod
    def end(cls) -> None:
        """End the children that are kept."""
        while cls._spare:
            cls._spare.pop()._stop()


# The children belong to the parent of a forked process.
after_fork(KeptReader._spare.clear)

"""HTTP/1.1 with time limits against clients that are slow on purpose."""

from __future__ import annotations

import asyncio

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_CONNECTIONS = 256
HEAD_S = 10.0
_MAX_STUCK = 3


class LimitedProtocol(H11Protocol):
    """Closes connections without a request or with an answer that is not taken, and limits their number."""

    head_within = HEAD_S
    """Seconds for the head of a request, from its first byte or from the connection."""
    _head: asyncio.TimerHandle | None = None
    _watch: asyncio.TimerHandle | None = None
    _pending = 0
    _stuck = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]  # as the class above does
        """Start the timers."""
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            transport.abort()
            return
        self._head = self.loop.call_later(self.head_within, self._give_up)
        self._watch = self.loop.call_later(self.head_within, self._check_progress)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timers."""
        for timer in (self._head, self._watch):
            if timer is not None:
                timer.cancel()
        self._head = self._watch = None
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Process data; a head that has begun must be complete in time."""
        super().data_received(data)
        incomplete = self.conn.their_state is h11.IDLE and not self.transport.is_closing()
        if not incomplete and self._head is not None:
            self._head.cancel()
            self._head = None
        elif incomplete and self._head is None and self.timeout_keep_alive_task is None:
            self._head = self.loop.call_later(self.head_within, self._give_up)

    def _give_up(self) -> None:
        self._head = None
        if not self.transport.is_closing():
            self.transport.abort()

    def _check_progress(self) -> None:
        """End the connection if waiting data has not moved for a while."""
        pending = self.transport.get_write_buffer_size()
        self._stuck = self._stuck + 1 if pending and pending == self._pending else 0
        self._pending = pending
        if self._stuck >= _MAX_STUCK:
            self.transport.abort()
            return
        self._watch = self.loop.call_later(self.head_within, self._check_progress)

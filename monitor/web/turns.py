"""Whose password is checked next: a few at a time, clients in turn, and a reserve for those who are known."""

from __future__ import annotations

import asyncio
import itertools
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

from models.words.errors import SpallwatchError
from streams.link.front import Guesses

CHECKS = 2
"""Passwords that are checked at the same time."""
MAX_WAITING, MAX_KNOWN, MAX_OF_KEY = 64, 16, 4
"""Attempts that wait: of strangers, of those who are known, and with the same key."""
_MAX_REMEMBERED = 1000


class SignInError(SpallwatchError):
    """A sign-in that is refused: HTTP status and one sentence."""

    def __init__(self, status: int, sentence: str) -> None:
        """Take status and sentence."""
        super().__init__(sentence)
        self.status, self.sentence = status, sentence


@dataclass(eq=False)
class _Attempt:
    client: str
    key: str
    number: int
    turn: asyncio.Future[None]


class SignInTurns:
    """Queues of attempts in one event loop.

    Attempts of one key are checked one after another, each when the delay of the guesses before it is over. A place is
    taken from whom most wait of, then from who guessed wrong most, so that the flood of one client leaves room for
    others. The known have a queue of their own, and every second turn.
    """

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Nobody waits."""
        self.guesses = Guesses(monotonic)
        self._known: list[_Attempt] = []
        self._strangers: list[_Attempt] = []
        self._known_next = True
        self._busy: set[str] = set()
        self._served: dict[str, int] = {}
        self._numbers = itertools.count(1)
        self._timer: asyncio.TimerHandle | None = None

    @asynccontextmanager
    async def turn(self, client: str, key: str, *, known: bool) -> AsyncIterator[None]:
        """Wait for the turn of an attempt, and hold it.

        Raises:
            SignInError: 429, too many wait.
        """
        lane, most = (self._known, MAX_KNOWN) if known else (self._strangers, MAX_WAITING)
        attempt = _Attempt(client, key, next(self._numbers), asyncio.get_running_loop().create_future())
        self._make_place(lane, most, attempt)
        lane.append(attempt)
        self._start()
        try:
            await attempt.turn
        except BaseException:
            if attempt in lane:
                lane.remove(attempt)
            elif not attempt.turn.cancelled() and attempt.turn.exception() is None:
                self._end(key)
            raise
        try:
            yield
        finally:
            self._end(key)

    def _end(self, key: str) -> None:
        self._busy.discard(key)
        self._start()

    def _make_place(self, lane: list[_Attempt], most: int, attempt: _Attempt) -> None:
        if sum(found.key == attempt.key for found in lane) >= MAX_OF_KEY:
            wait = max(self.guesses.delay(attempt.key), 1.0)
            raise SignInError(429, f"too many wrong passwords; try again in {wait:.0f} s")
        if len(lane) < most:
            return

        def greed(found: _Attempt) -> tuple[int, int]:
            return sum(found.client == other.client for other in lane), self.guesses.count(found.key)

        greediest = max(lane, key=greed)
        own, guesses = greed(attempt)
        if greed(greediest) <= (own + 1, guesses):
            raise SignInError(429, "too many try to sign in; try again later")
        lane.remove(greediest)
        greediest.turn.set_exception(SignInError(429, "too many try to sign in; try again later"))

    def _start(self) -> None:
        """Give turns while there are places, and look again when the next delay is over."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        while len(self._busy) < CHECKS:
            lanes = (self._known, self._strangers) if self._known_next else (self._strangers, self._known)
            ready = (self._next(lane) for lane in lanes)
            attempt = next((found for found in ready if found is not None), None)
            if attempt is None:
                break
            lane = self._known if attempt in self._known else self._strangers
            lane.remove(attempt)
            self._known_next = lane is self._strangers
            self._busy.add(attempt.key)
            self._remember(attempt)
            attempt.turn.set_result(None)
        waits = [self.guesses.delay(found.key) for found in (*self._known, *self._strangers)]
        if any(wait > 0.0 for wait in waits):
            soonest = min(wait for wait in waits if wait > 0.0)
            self._timer = asyncio.get_running_loop().call_later(soonest + 0.001, self._start)

    def _next(self, lane: list[_Attempt]) -> _Attempt | None:
        """Return the attempt of the client and the key whose last turn was longest ago."""
        ready = [
            found
            for found in lane
            if not found.turn.done() and found.key not in self._busy and self.guesses.delay(found.key) <= 0.0
        ]
        order = self._served
        return min(
            ready,
            key=lambda found: (order.get(found.client, 0), order.get(f"{found.key} ", 0), found.number),
            default=None,
        )

    def _remember(self, attempt: _Attempt) -> None:
        number = next(self._numbers)
        for name in (attempt.client, f"{attempt.key} "):
            self._served.pop(name, None)
            self._served[name] = number
        while len(self._served) > _MAX_REMEMBERED:
            self._served.pop(next(iter(self._served)))

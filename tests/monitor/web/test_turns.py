"""Whose password is checked next: no flood of one client keeps another out, and the known have a reserve."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from monitor.web.turns import CHECKS, MAX_KNOWN, MAX_OF_KEY, MAX_WAITING, SignInError, SignInTurns


class Hall:
    """Attempts that hold their turn until they are let go, in the order in which they got it."""

    def __init__(self) -> None:
        """Nobody has come."""
        self.turns = SignInTurns()
        self.began: list[str] = []
        self.refused: list[str] = []
        self._tasks: list[asyncio.Task[None]] = []
        self._go_on: dict[str, asyncio.Event] = {}

    async def come(self, client: str, key: str, *, known: bool = False) -> None:
        """Let an attempt come."""
        self._tasks.append(asyncio.create_task(self._attempt(client, key, known)))
        for _ in range(3):
            await asyncio.sleep(0)

    async def _attempt(self, client: str, key: str, known: bool) -> None:
        try:
            async with self.turns.turn(client, key, known=known):
                self.began.append(key)
                await self._go_on.setdefault(key, asyncio.Event()).wait()
        except SignInError:
            self.refused.append(key)

    async def end(self, key: str) -> None:
        """Let one attempt go, and the next begin."""
        self._go_on.setdefault(key, asyncio.Event()).set()
        for _ in range(5):
            await asyncio.sleep(0)

    async def close(self) -> None:
        """Send all home; afterwards nobody waits and no place is taken."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        assert not self.turns._busy
        assert not self.turns._known
        assert not self.turns._strangers


def in_hall(act: Callable[[Hall], Any]) -> None:
    async def run() -> None:
        hall = Hall()
        await act(hall)
        await hall.close()

    asyncio.run(run())


def test_a_few_are_checked_at_a_time_and_one_of_each_key() -> None:
    async def act(hall: Hall) -> None:
        for key in ("a", "a", "b", "c"):
            await hall.come("x", key)
        assert hall.began == ["a", "b"]
        assert len(hall.began) == CHECKS
        await hall.end("b")
        assert hall.began == ["a", "b", "c"]

    in_hall(act)


def test_clients_take_turns_however_many_one_sends() -> None:
    async def act(hall: Hall) -> None:
        for number in range(20):
            await hall.come("flood", f"f{number}")
        await hall.come("owner", "owner")
        assert hall.began == ["f0", "f1"]
        await hall.end("f0")
        assert hall.began[-1] == "owner"

    in_hall(act)


def test_a_full_queue_takes_the_place_of_the_greediest() -> None:
    async def act(hall: Hall) -> None:
        for number in range(MAX_WAITING + CHECKS):
            await hall.come("flood", f"f{number}")
        assert hall.refused == []
        await hall.come("flood", "late")
        assert hall.refused == ["late"]
        await hall.come("owner", "owner")
        assert len(hall.refused) == 2
        assert "owner" not in hall.refused
        await hall.end("f0")
        assert hall.began[-1] == "owner"

    in_hall(act)


def test_of_clients_with_one_attempt_each_who_guessed_wrong_goes_first() -> None:
    async def act(hall: Hall) -> None:
        for number in range(MAX_WAITING + CHECKS):
            await hall.come(f"c{number}", f"k{number}")
        await hall.come("late", "late")
        assert hall.refused == ["late"]
        hall.turns.guesses.wrong("k40")
        hall.turns.guesses.wrong("k40")
        await hall.come("owner", "owner")
        assert hall.refused == ["late", "k40"]

    in_hall(act)


def test_the_known_have_every_second_turn_and_places_of_their_own() -> None:
    async def act(hall: Hall) -> None:
        for number in range(MAX_WAITING + CHECKS):
            await hall.come(f"c{number}", f"k{number}")
        await hall.come("owner", "owner", known=True)
        await hall.come("second", "second", known=True)
        assert hall.refused == []
        await hall.end("k0")
        await hall.end("k1")
        assert "owner" in hall.began[-2:]
        for number in range(MAX_KNOWN + 4):
            await hall.come("known", f"n{number}", known=True)
        assert 0 < len(hall.refused) <= 5

    in_hall(act)


def test_a_key_waits_for_its_delay_and_has_few_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("streams.link.front._FIRST_DELAY_S", 0.2)
    monkeypatch.setattr("streams.link.front._MAX_DELAY_S", 0.2)

    async def act(hall: Hall) -> None:
        for _ in range(5):
            hall.turns.guesses.wrong("a")
        for _ in range(MAX_OF_KEY + 1):
            await hall.come("x", "a")
        assert (hall.began, hall.refused) == ([], ["a"])
        await hall.come("x", "b")
        assert hall.began == ["b"]
        async with asyncio.timeout(30):
            while hall.began != ["b", "a"]:
                await asyncio.sleep(0.01)

    in_hall(act)

"""What listeners share: who is one client, which connection makes room, how fast, and how long a guess waits."""

from __future__ import annotations

import random
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streams.link.front import (
    FORGET_S,
    FREE_GUESSES,
    Bucket,
    Cause,
    Door,
    FullError,
    Guesses,
    OftenError,
    Visits,
    client_of,
)


@pytest.mark.parametrize(
    ("address", "client"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::9", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("/run/socket", "/run/socket"),
        ("", ""),
    ],
)
def test_a_client_is_an_address_or_the_network_of_one_machine(address: str, client: str) -> None:
    assert client_of(address) == client


def test_the_greediest_client_makes_room_and_its_oldest_connection() -> None:
    door: Door[str] = Door(4, 4, lambda name: None if name == "busy" else (0, float(name[1:])))
    for name, address in (("a1", "10.0.0.1"), ("b0", "10.0.0.2"), ("a3", "10.0.0.1"), ("busy", "10.0.0.1")):
        assert door.room_for(address) is None
        door.add(name, address)
    # Though the connection of 10.0.0.2 is idle for longer.
    assert door.room_for("10.0.0.3") == "a1"
    door.remove("a1")
    door.remove("a1")
    assert door.room_for("10.0.0.3") is None
    assert len(door) == 3
    assert door.counts() == {
        "connections": 3,
        "accepted": 4,
        "received_bytes": 0,
        "refused": dict.fromkeys(get_args(Cause), 0),
    }


def test_a_client_beyond_its_own_limit_replaces_its_own_connection() -> None:
    door: Door[str] = Door(9, 2, lambda name: None if name == "busy" else (0, 0.0))
    door.add("other", "10.0.0.2")
    door.add("busy", "10.0.0.1")
    door.add("idle", "10.0.0.1")
    assert door.room_for("10.0.0.1") == "idle"
    door.remove("idle")
    door.add("busy2", "10.0.0.1")
    assert door.room_for("10.0.0.2") is None
    locked: Door[str] = Door(1, 1, lambda _: None)
    locked.add("busy", "10.0.0.1")
    with pytest.raises(FullError, match="one connection too many"):
        locked.room_for("10.0.0.2")
    assert locked.counts()["refused"] == {**dict.fromkeys(get_args(Cause), 0), "full": 1}


@given(st.lists(st.integers(0, 3), max_size=60), st.integers(1, 6), st.integers(1, 4))
def test_there_are_never_more_than_allowed(clients: list[int], in_all: int, per_client: int) -> None:
    door: Door[int] = Door(in_all, per_client, lambda number: (number % 2, float(number)))
    open_now: dict[int, str] = {}
    for number, client in enumerate(clients):
        address = f"10.0.0.{client}"
        idlest = door.room_for(address)
        if idlest is not None:
            door.remove(idlest)
            del open_now[idlest]
        door.add(number, address)
        open_now[number] = address
        assert len(door) == len(open_now) <= in_all
        assert list(open_now.values()).count(address) <= per_client


def test_a_bucket_lets_a_burst_through_and_then_so_many_a_second() -> None:
    now = [0.0]
    bucket = Bucket(10.0, 5.0, lambda: now[0])
    assert [bucket.take() for _ in range(5)] == [0.0] * 5
    assert bucket.take() == pytest.approx(0.1)
    now[0] = 0.3
    assert [bucket.take() for _ in range(2)] == [0.0, 0.0]
    now[0] = 100.0
    assert [bucket.take() for _ in range(6)] == [0.0] * 5 + [pytest.approx(0.1)]


def test_a_client_that_connects_too_often_is_refused() -> None:
    now = [0.0]
    visits = Visits(10.0, 1000.0, lambda: now[0])
    assert sum(visits.admit("a") for _ in range(100)) == 20
    taken = 0
    for step in range(1000):
        now[0] = 10.0 + 0.01 * step
        taken += visits.admit("a")
    assert 100 <= taken <= 125
    assert visits.admit("b")
    door: Door[int] = Door(100, 100, lambda _: None, Visits(1.0, 2.0, lambda: now[0]))
    assert [door.room_for("10.0.0.1") for _ in range(2)] == [None, None]
    with pytest.raises(OftenError, match="too often"):
        door.room_for("10.0.0.1")


@pytest.mark.parametrize(("crowd", "each"), [(3, 400.0), (15, 100.0), (100, 20.0), (100, 1000.0)])
def test_in_a_crowd_those_are_taken_that_come_rarely(crowd: int, each: float) -> None:
    now, drawn = [0.0], random.Random(1)
    visits = Visits(100.0, 200.0, lambda: now[0])
    taken, total, refused = 0, 0, 0
    for step in range(20_000):
        now[0] += drawn.expovariate(crowd * each)
        took = visits.admit(f"c{drawn.randrange(crowd)}")
        if step >= 10_000:
            total, taken = total + 1, taken + took
        # One that opens two connections every few seconds, all along.
        if step % max(1, round(3.0 * crowd * each)) < 2:
            refused += not visits.admit("sender")
    seconds = total / (crowd * each)
    assert taken / seconds <= 1.25 * 200.0
    assert refused == 0
    # Once they have gone, it is as if they had never come.
    now[0] += 10.0
    assert all(visits.admit("user") for _ in range(50))


def test_guesses_are_free_at_first_and_then_wait_longer_and_longer() -> None:
    now = [1000.0]
    guesses = Guesses(lambda: now[0])
    waits = []
    for _ in range(FREE_GUESSES + 8):
        waits.append(guesses.delay("a"))
        guesses.wrong("a")
    assert waits == [0.0] * FREE_GUESSES + [1.0, 2.0, 4.0, 5.0, 5.0, 5.0, 5.0, 5.0]
    assert guesses.delay("b") == 0.0
    now[0] += 4.0
    assert guesses.delay("a") == 1.0
    guesses.right("a")
    assert (guesses.count("a"), guesses.delay("a")) == (0, 0.0)
    for _ in range(FREE_GUESSES):
        guesses.wrong("a")
    now[0] += FORGET_S
    assert (guesses.count("a"), guesses.delay("a")) == (0, 0.0)

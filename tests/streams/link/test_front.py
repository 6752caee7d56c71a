"""What listeners share: who is one client, which connection makes room, how fast, and how long a guess waits."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streams.link.front import FORGET_S, FREE_GUESSES, Bucket, Door, FullError, Guesses, client_of


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
    assert door.events == {"taken": 4, "replaced": 1}


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
    with pytest.raises(FullError, match=r"10\.0\.0\.2"):
        locked.room_for("10.0.0.2")
    assert locked.events["refused"] == 1


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

"""Deaths of the process are blamed on the files that it handled; what is poisoned can be released."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from monitor.records.ledger import ReleaseError, StoreLedger, release, write_progress
from monitor.records.store import Store
from streams.types.source import FileProgress


@contextmanager
def process(folder: Path, *, dies: bool = False) -> Iterator[tuple[Store, StoreLedger]]:
    """Open store and ledger as a process does; one that dies leaves its notes."""
    with Store.open(folder / "state.db", machine="m") as store:
        ledger = StoreLedger(store)
        yield store, ledger
        notes = (folder / "handling").read_bytes()
        ledger.close()
    if dies:
        (folder / "handling").write_bytes(notes)


def progress(path: str, verdict: str) -> FileProgress:
    return FileProgress(path, 1, 2, 3, verdict=verdict)


def test_a_proper_end_blames_nothing(tmp_path: Path) -> None:
    with process(tmp_path) as (_, ledger):
        ledger.handle("s", ["a.csv"])
    with process(tmp_path) as (_, ledger):
        assert ledger.deaths("s", "a.csv") == 0


def test_deaths_are_counted_until_a_verdict(tmp_path: Path) -> None:
    for deaths in range(3):
        with process(tmp_path, dies=True) as (_, ledger):
            assert ledger.deaths("s", "a.csv") == deaths
            assert ledger.deaths("t", "a.csv") == 0
            ledger.handle("t", ["b.csv"])
            ledger.handle("t", ())
            ledger.handle("s", ["a.csv"])
    with process(tmp_path) as (_, ledger):
        ledger.survive("s", [progress("a.csv", "pending"), progress("b.csv", "accepted")])
        assert ledger.deaths("s", "a.csv") == 3
        ledger.survive("s", [progress("a.csv", "unreadable")])
        assert ledger.deaths("s", "a.csv") == 0
    with process(tmp_path) as (_, ledger):
        assert ledger.deaths("s", "a.csv") == 0


def test_what_was_analysed_is_blamed_before_what_was_read_meanwhile(tmp_path: Path) -> None:
    with process(tmp_path, dies=True) as (_, ledger):
        ledger.handle("s", ["a.csv"])
        ledger.analyse("t", ["b.csv", "c.csv"], 1 << 30)
    with process(tmp_path, dies=True) as (_, ledger):
        assert [ledger.deaths(*file) for file in (("s", "a.csv"), ("t", "b.csv"), ("t", "c.csv"))] == [0, 1, 1]
        # An analysis of milliseconds is met by any kill; it counts half.
        ledger.analyse("t", ["b.csv"], 100)
    with process(tmp_path) as (_, ledger):
        assert [ledger.deaths("t", file) for file in ("b.csv", "c.csv")] == [1.5, 1]


@pytest.mark.parametrize("notes", [b"\0" * 9000, b"{]\n", b"[1]\n", b'["s", 3, "x", 1]\n', b'["s", ["a.csv"', b""])
def test_notes_of_any_content_do_not_stop_a_start(notes: bytes, tmp_path: Path) -> None:
    (tmp_path / "handling").write_bytes(notes)
    with process(tmp_path) as (store, ledger):
        assert ledger.deaths("s", "a.csv") == 0
        assert store.check() == []


def test_names_too_long_to_note_are_left_out(tmp_path: Path) -> None:
    with process(tmp_path, dies=True) as (_, ledger):
        ledger.handle("s", ["x" * 5000])
    with process(tmp_path) as (_, ledger):
        assert ledger.deaths("s", "x" * 5000) == 0


def test_release_by_path_or_name(tmp_path: Path) -> None:
    names = ("day/a.csv", "day/b.csv", "a.csv", "good.csv")
    with process(tmp_path) as (store, ledger), store.transaction() as connection:
        files = [progress(name, "accepted" if name == "good.csv" else "poisoned") for name in names]
        write_progress(connection, "s", files)
    with process(tmp_path) as (_, ledger):
        assert ledger.poisoned() == [("s", "a.csv"), ("s", "day/a.csv"), ("s", "day/b.csv")]
        assert release(tmp_path / "state.db", "day/a.csv") == [("s", "day/a.csv")]
        assert ledger.released("s") == ["day/a.csv"]
        assert release(tmp_path / "state.db", "b.csv") == [("s", "day/b.csv")]
    with pytest.raises(ReleaseError, match=r"called 'good.csv'; poisoned are: a.csv \(s\)") as caught:
        release(tmp_path / "state.db", "good.csv")
    assert caught.value.exit_code == 1
    release(tmp_path / "state.db", "a.csv")
    with pytest.raises(ReleaseError, match="poisoned are: none"):
        release(tmp_path / "state.db", "a.csv")

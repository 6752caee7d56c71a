"""Very many files, there already and arriving while the handler is slow: none is missed, none comes twice."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from streams.files.groups import NameGroups, name_groups
from streams.folder.register import MAX_COMPARED
from streams.types.block import Block, Rejected
from tests.streams.folders import Rig
from tests.support.effort import effort_count

COUNT = effort_count(quick=300, full=30_000)


def write(folder: Path, number: int) -> None:
    """Write a file; one in a hundred is damaged, one is a copy of the one before, one has no bytes."""
    path = folder / f"f{number:06d}.csv"
    kind = number % 100
    if kind == 7:
        path.write_bytes(b"1.0\nwords\n")
    elif kind == 9:
        path.write_bytes(b"")
    else:
        own = number - 1 if kind == 1 and number > 1 else number
        path.write_bytes(f"0.5\n{own}.25\n-1.5\n{own}.5\n".encode())


def expected(last: int) -> dict[str, str]:
    verdicts = {7: "unreadable", 9: "empty", 1: "duplicate"}
    found = {f"f{number:06d}.csv": verdicts.get(number % 100, "accepted") for number in range(1, last + 1)}
    return found | {"f000001.csv": "accepted"}


def verdicts_of(rig: Rig) -> dict[str, str]:
    names = [item.name for item in rig.items]
    assert len(set(names)) == len(names)
    return {item.name: item.status if isinstance(item, Rejected) else "accepted" for item in rig.items}


def test_files_that_are_there_already(tmp_path: Path) -> None:
    for number in range(1, COUNT + 1):
        write(tmp_path, number)
    rig = Rig(tmp_path, format="csv", settle_s=20.0)
    while rig.run(700.0):
        pass
    assert verdicts_of(rig) == expected(COUNT)
    accepted = [item for item in rig.items if isinstance(item, Block)]
    assert [item.sequence for item in accepted] == sorted(item.sequence for item in accepted)
    backlog = rig.source.backlog()
    assert (backlog.offered, backlog.pending) == (COUNT, 0)
    rig.restart()
    assert rig.run(700.0) == []
    assert rig.source.backlog().offered == COUNT


def test_files_that_arrive_while_the_handler_is_slow_and_events_are_lost(tmp_path: Path) -> None:
    generator = np.random.default_rng(11)
    rig = Rig(tmp_path, format="csv", settle_s=20.0)
    written = 0
    while written < COUNT:
        for _ in range(min(COUNT - written, int(generator.integers(1, COUNT // 20)))):
            written += 1
            write(tmp_path, written)
            # Half of the events never come.
            if generator.random() < 0.5:
                rig.watch.closed.add(f"f{written:06d}.csv")
        rig.run(30.0, most=COUNT // 200)
        backlog = rig.source.backlog()
        assert backlog.offered == backlog.accepted + backlog.rejected + backlog.pending <= written
        if generator.random() < 0.1:
            rig.restart()
    assert rig.source.backlog().oldest_age_s > 0.0
    while rig.run(1500.0):
        pass
    assert verdicts_of(rig) == expected(COUNT)
    assert rig.source.backlog().offered == COUNT


def test_a_block_costs_the_same_however_many_files_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names are compared when files come, and of a long row a sample: no block goes through all that wait."""
    compared: list[int] = []

    def counted(paths: Sequence[str]) -> NameGroups | None:
        compared.append(len(paths))
        return name_groups(paths)

    monkeypatch.setattr("streams.folder.source.name_groups", counted)
    waiting = effort_count(quick=3000, full=20_000)
    for number in range(waiting):
        (tmp_path / f"f{number:06d}.csv").write_text(f"0.5\n{number}.25\n-1.5\n")
    rig = Rig(tmp_path, format="csv", settle_s=20.0)
    while not rig.items:
        rig.run(30.0, most=1)
    assert max(compared) <= 3 * MAX_COMPARED
    compared.clear()
    rig.run(300.0, most=40)
    assert len(rig.items) > 20
    assert compared == []
    assert rig.source.backlog().pending == waiting - len(rig.items)

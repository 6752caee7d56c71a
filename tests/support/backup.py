"""Makers and checks that tests of backup share."""

from __future__ import annotations

from pathlib import Path

from monitor.records.backup import Contents
from monitor.records.restore import Places
from monitor.records.store import Store
from tests.support.store_kill import block

UTC = 1795338000.0


def fill(state: Path, blocks: int, first: int = 1) -> Path:
    """Commit blocks to the store of machine m in a folder; return its path."""
    state.mkdir(parents=True, exist_ok=True)
    with Store.open(state / "state.db", machine="m") as store:
        store.commit_many([(block(number), {"detect:x": {"seen": number}}) for number in range(first, first + blocks)])
    return state / "state.db"


def contents_of(folder: Path, machine: str = "m") -> Contents:
    """Return what is to be backed up of a machine with its state and records below a folder."""
    (folder / "m.toml").write_text("[machine]\n")
    (folder / "records").mkdir(exist_ok=True)
    return Contents(machine, folder / "state" / "state.db", folder / "records", {"config/m.toml": folder / "m.toml"})


def publish(folder: Path, name: str, content: bytes) -> Path:
    """Publish a file as the publisher does; its content does not matter here."""
    path = folder / "records" / name
    path.parent.mkdir(exist_ok=True)
    path.with_suffix(".tmp").write_bytes(content)
    path.with_suffix(".tmp").replace(path)
    return path


def places_in(folder: Path) -> Places:
    return Places(folder / "state" / "state.db", folder / "records")


def blocks_in(path: Path) -> int:
    """Return how many blocks a store holds, which must be whole."""
    with Store.open(path, machine="m") as store:
        assert store.check() == []
        found = list(store.records())
        assert found == [block(number) for number in range(1, len(found) + 1)]
        assert store.load_states() == ({"detect:x": {"seen": len(found)}} if found else {})
        return len(found)

"""What every kind of store does with files, for the tests of each."""

from __future__ import annotations

from models.work.task import FileStore


def check_files(store: FileStore) -> None:
    """Write, read, list and delete files in an empty store; chunks/01/y and run.json stay."""
    assert store.read("chunks/00/x") is None
    assert list(store.names()) == []
    store.write("chunks/00/x", b"one")
    store.write("chunks/00/x", b"two")
    store.write("chunks/01/y", b"")
    store.write("run.json", b"{}")
    assert (store.read("chunks/00/x"), store.read("chunks/01/y"), store.read("chunks/00/z")) == (b"two", b"", None)
    assert sorted(store.names()) == ["chunks/00/x", "chunks/01/y", "run.json"]
    assert list(store.names("chunks/01")) == ["chunks/01/y"]
    assert list(store.names("chunks/00/")) == ["chunks/00/x"]
    assert sorted(store.names("c")) == ["chunks/00/x", "chunks/01/y"]
    assert list(store.names("chunks/2/")) == []
    for _ in range(2):
        store.delete("chunks/00/x")
    assert sorted(store.names()) == ["chunks/01/y", "run.json"]

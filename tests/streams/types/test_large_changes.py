"""A large file that changes or cannot be read while a recording reads it is one rejection; the others are read."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streams.files import container as files
from streams.files import load
from streams.open import open_source
from streams.recording import source as recording
from streams.types import large
from streams.types.block import Block, Rejected
from streams.types.source import Source
from streams.types.spec import ChannelSpec, SourceSpec

pytestmark = pytest.mark.process
CHANGED = "a1.npy: changed while it was read"


@pytest.fixture(autouse=True)
def small_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "MAX_IN_MEMORY", 1000)
    monkeypatch.setattr(large, "PIECE_BYTES", 999)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in (1, 2):
        np.save(tmp_path / f"a{number}.npy", np.random.default_rng(number).standard_normal(1000).astype(np.float32))
    return tmp_path


def opened(folder: Path) -> Source:
    channels = (ChannelSpec("a", column=1, unit="g"),)
    return open_source(SourceSpec("s", str(folder), block_s="file", channels=channels, rate=1000.0, start=0.0))


def verdicts(source: Source) -> list[tuple[str, str]]:
    items: list[Block | Rejected] = list(iter(source))
    return [("read", i.name) if isinstance(i, Block) else (i.status, i.reason) for i in items]


def cut_off(path: Path) -> None:
    os.truncate(path, 0)


def appended_to(path: Path) -> None:
    with path.open("ab") as file:
        file.write(bytes(100))


@pytest.mark.parametrize("change", [cut_off, appended_to])
@pytest.mark.parametrize("moment", ["before it is hashed", "before its header is read", "before it is parsed"])
def test_a_large_file_that_changes_meanwhile_is_rejected(
    change: Callable[[Path], None], moment: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, name = {
        "before it is hashed": (recording, "hash_of_file"),
        "before its header is read": (load, "declared_size"),
        "before it is parsed": (load.Loader, "load_undated"),
    }[moment]
    call, source = getattr(module, name), opened(folder)

    def changed(*arguments: Any) -> Any:
        raw, path = arguments[1:3] if name == "load_undated" else arguments
        if path == "a1.npy" and (folder / path).stat().st_size == len(raw):
            change(folder / path)
        return call(*arguments)

    monkeypatch.setattr(module, name, changed)
    assert verdicts(source) == [("changed", CHANGED), ("read", "a2.npy")]


@pytest.mark.parametrize("change", [cut_off, appended_to])
def test_so_is_one_that_changes_once_its_size_was_looked_at(
    change: Callable[[Path], None], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, checked = opened(folder), files._checked

    def changed(handle: int, path: str, allowed: int) -> os.stat_result:
        status = checked(handle, path, allowed)
        if path == "a1.npy":
            change(folder / path)
        return status

    monkeypatch.setattr(files, "_checked", changed)
    assert verdicts(source) == [("changed", CHANGED), ("read", "a2.npy")]


def test_a_large_file_that_cannot_be_read_is_rejected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    size, read_at = (folder / "a1.npy").stat().st_size, large.read_at
    np.save(folder / "a2.npy", np.sin(np.arange(2000, dtype=np.float32)))
    source = opened(folder)

    def broken(handle: int, count: int, begin: int) -> bytes:
        if os.fstat(handle).st_size == size:
            raise OSError(errno.EIO, "Input/output error")
        return read_at(handle, count, begin)

    monkeypatch.setattr(large, "read_at", broken)
    assert verdicts(source) == [("unreadable", "a1.npy: cannot be read (Input/output error)"), ("read", "a2.npy")]
    monkeypatch.setattr(recording, "hash_of_file", lambda raw, name: str(len(raw)))
    assert verdicts(source) == [("unreadable", "a1.npy: the reader failed (OSError)"), ("read", "a2.npy")]

"""One cluster of two processes for the tests of a module."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from models.fleet.connect import Local
from models.fleet.executor import ClusterExecutor
from models.work.folder_store import FolderStore


class Borrowed(Local):
    """A cluster that is used by several executors, one after another."""

    def close(self) -> None:
        """Leave it running."""

    def end(self) -> None:
        """End it."""
        super().close()


@pytest.fixture(scope="package")
def cluster() -> Iterator[Borrowed]:
    found = Borrowed(2)
    yield found
    found.end()


@pytest.fixture
def store(tmp_path: Path) -> FolderStore:
    return FolderStore(tmp_path / "chunks")


@pytest.fixture
def executor(cluster: Borrowed, store: FolderStore) -> Iterator[ClusterExecutor]:
    found = ClusterExecutor(cluster, store, print)
    yield found
    found.close()

"""A store that several tests of condensing fill alike."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from monitor.records.publish import publish
from monitor.records.store import Store
from tests.monitor.records.condensed import fill


@pytest.fixture(scope="session")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of four days and its files, made once."""
    folder = tmp_path_factory.mktemp("template")
    with Store.open(folder / "state.db", machine="m") as store:
        store.describe({"config_hash": "c1"})
        fill(store)
        publish(store, folder / "records")
    return folder


@pytest.fixture
def filled(template: Path, tmp_path: Path) -> Iterator[Store]:
    shutil.copytree(template, tmp_path, dirs_exist_ok=True)
    with Store.open(tmp_path / "state.db", machine="m") as opened:
        opened.describe({"config_hash": "c1"})
        yield opened

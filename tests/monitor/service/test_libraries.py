"""A kept library: built once, read afterwards, built anew where it is damaged or asked for otherwise."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from unittest import mock

import pytest

from models.lives.population import Population
from monitor.health.damage.library.fit import FitSettings
from monitor.service import libraries
from monitor.service.libraries import cached_library, library_path

POPULATION = Population(load=(3900.0, 4100.0), speed=(39.0, 41.0), durations=(2400.0, 4800.0))
THRESHOLDS = (0.05e-6,)


def test_a_library_is_built_once_and_read_afterwards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(libraries, "FitSettings", partial(FitSettings, columns=60))
    counted: list[tuple[int, int]] = []
    built = cached_library(
        POPULATION, 20, THRESHOLDS, tmp_path, progress=lambda done, total: counted.append((done, total))
    )
    assert counted[-1] == (20, 20)
    with mock.patch.object(libraries, "build_library", side_effect=AssertionError("built again")):
        assert cached_library(POPULATION, 20, THRESHOLDS, tmp_path).hash == built.hash
    path = library_path(POPULATION, 20, THRESHOLDS, tmp_path)
    path.write_bytes(path.read_bytes()[:1000])
    assert cached_library(POPULATION, 20, THRESHOLDS, tmp_path).hash == built.hash


def test_its_name_follows_all_that_makes_it(tmp_path: Path) -> None:
    names = {
        library_path(POPULATION, 20, THRESHOLDS, tmp_path),
        library_path(POPULATION, 21, THRESHOLDS, tmp_path),
        library_path(POPULATION, 20, (0.03e-6, 0.05e-6), tmp_path),
        library_path(replace(POPULATION, seed=1), 20, THRESHOLDS, tmp_path),
    }
    assert len(names) == 4

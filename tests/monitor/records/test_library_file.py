"""Files of libraries: they come back as they were, and what is none is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from monitor.records.library_file import LibraryError, load_library, save_library
from tests.oracles.toy_lives import toy_library, toy_life
from tests.support.followed_lives import blocks_of, follow


def test_a_library_comes_back_from_its_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "new" / "toy.npz"
    save_library(toy_library(), path)
    again = load_library(path)
    assert again.hash == toy_library().hash
    assert again.prior == "toy lives"
    assert again.scores == toy_library().scores
    blocks = blocks_of(toy_life(2008))
    assert repr(follow(blocks, again)[1]) == repr(follow(blocks, toy_library())[1])
    assert [p.name for p in path.parent.iterdir()] == ["toy.npz"]


def test_files_that_are_no_library_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    with pytest.raises(LibraryError, match=r"x\.npz: no such library"):
        load_library(path)
    path.write_text("not an archive")
    with pytest.raises(LibraryError, match=r"x\.npz: not a readable \.npz"):
        load_library(path)
    np.savez(path, a=np.zeros(3))
    with pytest.raises(LibraryError, match=r"x\.npz: has no header"):
        load_library(path)
    np.savez(path, header=np.array(json.dumps({"kind": "other", "schema_version": 1})))
    with pytest.raises(LibraryError, match="got 'other' of version 1"):
        load_library(path)
    np.savez(path, header=np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(LibraryError, match=r"x\.npz: not a readable \.npz"):
        load_library(path)


def test_a_library_that_was_tampered_with_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "toy.npz"
    save_library(toy_library(), path)
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays["rms/shift"] = arrays["rms/shift"] + 0.1
    np.savez(path, **arrays)
    with pytest.raises(LibraryError, match="its content is not what was written"):
        load_library(path)
    del arrays["rms/shift"]
    np.savez(path, **arrays)
    with pytest.raises(LibraryError, match="not a usable library"):
        load_library(path)

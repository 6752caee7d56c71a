import json
import os
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from models.fe.cache import CacheEntry, FeCache, computation

KEY = {"geometry": {"race_radius": 0.0287}, "load": 500.0, "mesh": "default"}


def entry(value: float = 1.0, count: int = 4) -> CacheEntry:
    return CacheEntry({"force": np.full(count, value), "header": np.eye(2)}, {"status": "ok"})


def never() -> CacheEntry:
    raise AssertionError("computed although it is kept")


def age(path: Path | None, seconds: float) -> None:
    assert path is not None
    times = path.stat().st_mtime - seconds
    os.utime(path, (times, times))


def test_an_entry_is_computed_once(tmp_path: Path) -> None:
    first = FeCache(tmp_path / "fe").get(KEY, lambda: entry(3.0))
    again = FeCache(tmp_path / "fe").get(dict(reversed(KEY.items())), never)
    assert sorted(again.arrays) == sorted(first.arrays) == ["force", "header"]
    for name, values in first.arrays.items():
        np.testing.assert_array_equal(again.arrays[name], values)
    assert again.values == first.values
    assert [path.suffix for path in (tmp_path / "fe").iterdir()] == [".npz"]


@pytest.mark.parametrize("change", [{"load": 500.1}, {"mesh": "fine"}, {"geometry": {"race_radius": 0.0288}}])
def test_another_key_is_another_entry(tmp_path: Path, change: dict[str, object]) -> None:
    kept = FeCache(tmp_path)
    kept.get(KEY, lambda: entry(1.0))
    assert kept.get(KEY | change, lambda: entry(2.0)).arrays["force"][0] == 2.0
    assert (kept.found, kept.made) == (0, 2)


def test_another_version_of_the_computation_is_another_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    FeCache(tmp_path).get(KEY, lambda: entry(1.0))
    monkeypatch.setattr("models.fe.cache.computation", lambda: computation()[::-1])
    assert FeCache(tmp_path).get(KEY, lambda: entry(2.0)).arrays["force"][0] == 2.0


def cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def flip(content: bytes) -> bytes:
    """Change a byte of an array, where the format itself stays whole."""
    place = content.index(np.full(4, 1.0).tobytes())
    return content[:place] + bytes([content[place] ^ 255]) + content[place + 1 :]


@pytest.mark.parametrize("harm", [cut, flip, lambda content: b"", lambda content: b"not an archive"])
def test_a_damaged_entry_is_computed_anew_and_reported(tmp_path: Path, harm: Callable[[bytes], bytes]) -> None:
    said: list[str] = []
    kept = FeCache(tmp_path, report=said.append)
    kept.get(KEY, lambda: entry(1.0))
    path = kept.path(KEY)
    assert path is not None
    path.write_bytes(harm(path.read_bytes()))
    assert kept.get(KEY, lambda: entry(2.0)).arrays["force"][0] == 2.0
    assert kept.get(KEY, never).arrays["force"][0] == 2.0
    assert len(said) == 1
    assert said[0].startswith(f"{path}: cannot be read (")


def test_an_entry_of_another_computation_is_computed_anew_and_reported(tmp_path: Path) -> None:
    said: list[str] = []
    kept = FeCache(tmp_path, report=said.append)
    kept.get(KEY | {"load": 1.0}, lambda: entry(1.0))
    foreign, own = kept.path(KEY | {"load": 1.0}), kept.path(KEY)
    assert foreign is not None
    assert own is not None
    foreign.rename(own)
    assert kept.get(KEY, lambda: entry(2.0)).arrays["force"][0] == 2.0
    assert said == [f"{own}: belongs to another computation; computed anew"]


def test_pickled_objects_are_not_loaded(tmp_path: Path) -> None:
    kept = FeCache(tmp_path)
    path = kept.path(KEY)
    assert path is not None
    np.savez(path, header=np.array([{"key": 1}], dtype=object))
    assert kept.get(KEY, lambda: entry(2.0)).arrays["force"][0] == 2.0


def test_the_folder_is_bounded_and_what_was_used_last_stays(tmp_path: Path) -> None:
    kept, foreign = FeCache(tmp_path / "fe", max_bytes=30_000), tmp_path / "fe" / "measured.npz"
    foreign.parent.mkdir()
    foreign.write_bytes(bytes(40_000))
    age(foreign, 10_000.0)
    for load in range(6):
        kept.get({"load": load}, lambda: entry(1.0, 1000))
        age(kept.path({"load": load}), 100.0 - load)
        if load == 1:
            age(kept.path({"load": 0}), 1000.0)
            kept.get({"load": 0}, never)
    assert foreign.exists()
    paths = [path for path in foreign.parent.iterdir() if path != foreign]
    assert sum(path.stat().st_size for path in paths) <= 30_000
    assert {kept.path({"load": 0}), kept.path({"load": 5})} <= set(paths)
    assert kept.path({"load": 1}) not in paths


def test_an_entry_beyond_the_bound_is_returned_and_not_kept(tmp_path: Path) -> None:
    kept = FeCache(tmp_path, max_bytes=1000)
    assert kept.get(KEY, lambda: entry(1.0, 1000)).arrays["force"].size == 1000
    assert list(tmp_path.iterdir()) == []


def test_unfinished_files_of_killed_processes_go(tmp_path: Path) -> None:
    for name, seconds in ((".old_file.part", 100_000.0), (".new_file.part", 0.0), ("film.part", 100_000.0)):
        (tmp_path / name).write_bytes(b"")
        age(tmp_path / name, seconds)
    FeCache(tmp_path).get(KEY, entry)
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix == ".part") == [".new_file.part", "film.part"]


def test_without_a_folder_nothing_is_kept() -> None:
    kept = FeCache(None)
    kept.get(KEY, entry)
    assert kept.get(KEY, lambda: entry(2.0)).arrays["force"][0] == 2.0


def test_a_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    said: list[str] = []
    (tmp_path / "file").write_text("")
    assert FeCache(tmp_path / "file" / "fe", report=said.append).get(KEY, entry).values == {"status": "ok"}
    assert len(said) == 1
    assert "nothing is kept there" in said[0]


def test_nothing_is_kept_of_a_computation_that_fails(tmp_path: Path) -> None:
    def fails() -> CacheEntry:
        raise ValueError("no equilibrium")

    with pytest.raises(ValueError, match="no equilibrium"):
        FeCache(tmp_path).get(KEY, fails)
    assert list(tmp_path.iterdir()) == []


def test_writers_and_readers_at_once_see_whole_entries(tmp_path: Path) -> None:
    """Many write the same entry and evict, while others read it: each result is whole, none is reported."""
    said: list[str] = []
    wrong: list[object] = []

    def work(number: int) -> None:
        for turn in range(20):
            kept = FeCache(tmp_path, max_bytes=20_000, report=said.append)
            key = KEY if turn % 2 else KEY | {"load": float(number)}
            values = kept.get(key, lambda: entry(5.0, 500)).arrays["force"]
            if values.shape != (500,) or not np.all(values == 5.0):
                wrong.append(values)
            path = kept.path(key)
            if turn % 4 == 1 and path is not None:
                path.unlink(missing_ok=True)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    assert said == []


def test_the_version_is_that_of_the_sources() -> None:
    json.dumps(computation())
    assert len(computation()) == 16

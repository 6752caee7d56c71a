"""A store in a folder: whole files by name, each written in one step."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from models.words.errors import WrongInputError
from models.work.folder_store import FolderStore, open_store
from tests.models.work.store_files import check_files


def test_files_come_back_by_name(tmp_path):
    store = FolderStore(tmp_path / "a" / "b")
    check_files(store)
    assert store.read("run.json/x") is None
    assert not (tmp_path / "a/b/chunks/00").exists()
    store.delete("chunks/01/y")
    store.delete("run.json")
    store.remove_if_empty()
    assert not (tmp_path / "a/b").exists()


def test_a_folder_with_foreign_files_stays(tmp_path):
    store = FolderStore(tmp_path)
    store.write("a/b", b"")
    (tmp_path / "a" / "mine").write_text("x")
    store.delete("a/b")
    store.remove_if_empty()
    assert (tmp_path / "a" / "mine").read_text() == "x"


@pytest.mark.parametrize("name", ["", "/a", "a//b", "../a", "a/..", "a/.part-1"])
def test_names_stay_in_the_folder(tmp_path, name):
    with pytest.raises(ValueError, match="joined by"):
        FolderStore(tmp_path).write(name, b"")


def test_a_write_that_fails_leaves_the_old_file_and_no_part(tmp_path, monkeypatch):
    store = FolderStore(tmp_path)
    store.write("a", b"old")

    def fail(_handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="No space"):
        store.write("a", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert store.read("a") == b"old"


def test_a_part_of_a_killed_writer_is_not_listed(tmp_path):
    (tmp_path / ".part-1-0123abcd").write_bytes(b"half")
    store = FolderStore(tmp_path)
    assert list(store.names()) == []
    store.write("a/b", b"")
    (tmp_path / "a" / ".part-1-0123abcd").write_bytes(b"half")
    store.delete("a/b")
    assert (tmp_path / "a").exists()
    (tmp_path / ".part-1-of-others").write_bytes(b"x")
    store.remove_parts()
    assert [path.name for path in tmp_path.iterdir()] == [".part-1-of-others"]


def test_writers_and_deleters_of_one_folder_do_not_disturb_each_other(tmp_path):
    store = FolderStore(tmp_path)
    failures = []

    def work(number):
        try:
            for _ in range(30):
                store.write(f"started/key/{number}", b"x")
                store.delete(f"started/key/{number}")
        except OSError as error:
            failures.append(error)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    assert list(store.names()) == []


def test_urls_name_stores(tmp_path, monkeypatch):
    assert open_store(tmp_path).url == str(tmp_path)
    assert open_store((tmp_path / "a b").as_uri()).url == str(tmp_path / "a b")
    monkeypatch.chdir(tmp_path)
    assert open_store("chunks").url == str(Path("chunks").absolute())
    with pytest.raises(WrongInputError, match="expected file:///FOLDER"):
        open_store("file://host/a")

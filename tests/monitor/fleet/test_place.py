"""The index of an archive in an object storage: written by the holder of the lease alone."""

from __future__ import annotations

import sqlite3
import uuid
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import pytest

from models.fleet.lease import LEASE_NAME, Holder, LeaseHeldError, LeaseLostError, Times, leased
from models.fleet.object_store import ObjectStore
from monitor.fleet import place
from monitor.fleet.manifest import ManifestError
from monitor.fleet.place import INDEX_NAME, open_index
from tests.monitor.fleet.fleet_files import CONFIG, write_files
from tests.support.commands import run_command

pytest.importorskip("fsspec", reason="needs the extra cluster")

OTHER = Holder("other", "far", 7, "2026-01-01T00:00:00+00:00").to_json()


@pytest.fixture
def url(monkeypatch):
    """An archive of no recordings; leases are renewed at once."""
    monkeypatch.setattr(place, "leased", partial(leased, times=Times(renew_s=0.005, stale_s=1000.0, poll_s=0.001)))
    url = f"memory://{uuid.uuid4()}/out"
    with open_index(url) as opened:
        opened.index.set_meta(manifest="m")
    assert set(ObjectStore(url).names()) == {INDEX_NAME}
    return url


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    (tmp_path / "m.toml").write_text(CONFIG)
    write_files(tmp_path / "one", 1)
    (tmp_path / "fleet.toml").write_text('[[machine]]\nname = "a"\nconfig = "m.toml"\nrecordings = ["one"]\n')
    return tmp_path


def test_the_index_is_copied_and_the_lease_removed(url):
    with open_index(url) as opened:
        assert opened.index.planned
        opened.confirm()
        assert not opened.noted()
        opened.index.set_meta(one="1")
    assert set(ObjectStore(url).names()) == {INDEX_NAME}
    with open_index(url, read_only=True) as opened:
        assert opened.index.meta()["one"] == "1"


def test_nothing_is_left_of_an_archive_that_was_not_planned(url):
    with open_index(f"{url}-2"):
        pass
    assert list(ObjectStore(f"{url}-2").names()) == []
    with pytest.raises(ManifestError, match="holds no archive"), open_index(f"{url}-2", read_only=True):
        pass


def foreign(path: Path, kind: str) -> bytes:
    """Write a file that is no index, and return it."""
    if kind == "text":
        path.write_bytes(b"no database, but as long as the header of one, which is " + b"x" * 100)
    else:
        with closing(sqlite3.connect(path)) as connection:
            connection.executescript("CREATE TABLE x (a); INSERT INTO x VALUES (1)")
    return path.read_bytes()


@pytest.mark.parametrize("read_only", [False, True])
@pytest.mark.parametrize("kind", ["text", "database"])
def test_another_file_in_the_place_of_the_index_is_refused_and_left_as_it_is(tmp_path, kind, read_only):
    data = foreign(tmp_path / INDEX_NAME, kind)
    said = f"{tmp_path}: its {INDEX_NAME} is no index of an archive that this version reads"
    with pytest.raises(ManifestError, match=said), open_index(str(tmp_path), read_only=read_only):
        pass
    assert (tmp_path / INDEX_NAME).read_bytes() == data
    assert {path.name for path in tmp_path.iterdir()} <= {INDEX_NAME, f"{INDEX_NAME}.lock"}
    # A copy of it has another name.
    url = f"memory://{uuid.uuid4()}/out"
    ObjectStore(url).write(INDEX_NAME, data)
    with pytest.raises(ManifestError, match=f"{url}: its {INDEX_NAME}"), open_index(url, read_only=read_only):
        pass
    assert ObjectStore(url).read(INDEX_NAME) == data


def test_what_is_kept_of_a_local_index_is_in_its_file(tmp_path):
    with open_index(str(tmp_path)) as opened:
        opened.index.set_meta(manifest="m")
        opened.keep()
        with closing(sqlite3.connect(f"{(tmp_path / INDEX_NAME).as_uri()}?mode=ro&immutable=1", uri=True)) as file:
            assert file.execute("SELECT value FROM meta").fetchall() == [("m",)]


def test_an_index_that_a_killed_process_had_not_made_yet_is_made(tmp_path):
    with closing(sqlite3.connect(tmp_path / INDEX_NAME)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
    with open_index(str(tmp_path)) as opened:
        opened.index.set_meta(manifest="m")
    with open_index(str(tmp_path), read_only=True) as opened:
        assert opened.index.planned


def test_a_second_process_is_refused(url, fleet):
    with open_index(url):
        with pytest.raises(LeaseHeldError, match=r"is being written by process \d+ on "), open_index(url):
            pass
        ended = run_command("archive", "replay", "fleet.toml", "--out", url, "--resume", "--workers", 1, cwd=fleet)
    assert ended.returncode == 2
    assert "waiting up to 1000 s" in ended.stderr
    assert ended.stderr.splitlines()[-1].startswith(f"spallwatch: {url}: is being written by process ")


def test_a_process_that_was_overtaken_does_not_write_the_index(url):
    store = ObjectStore(url)
    with ExitStack() as stack:
        opened = stack.enter_context(open_index(url))
        before = store.read(INDEX_NAME)
        store.write(LEASE_NAME, OTHER)
        opened.index.set_meta(one="1")
        with pytest.raises(LeaseLostError, match="process 7 on far"):
            opened.confirm()
        with pytest.raises(LeaseLostError):
            opened.noted()
        with pytest.raises(LeaseLostError):
            stack.close()
    assert store.read(INDEX_NAME) == before
    assert store.read(LEASE_NAME) == OTHER


def test_an_index_that_another_one_wrote_is_not_written_over(url):
    """As where the process stands still between the confirmation and its write."""
    store = ObjectStore(url)
    with ExitStack() as stack:
        opened = stack.enter_context(open_index(url))
        opened.index.set_meta(one="1")
        store.write(INDEX_NAME, b"another")
        with pytest.raises(LeaseLostError, match="was written by another process"):
            stack.close()
    assert store.read(INDEX_NAME) == b"another"


def test_an_index_that_is_refused_though_no_other_one_wrote_it_is_written_again(url, monkeypatch):
    monkeypatch.setattr("models.fleet.lease.PAUSES_S", (0.0, 0.0, 0.0))
    with open_index(url) as opened:
        opened.index.set_meta(one="1")
        write, refused = ObjectStore.write_kept, [INDEX_NAME]

        def conflicting(store, name, data, tag):
            if name in refused:
                refused.remove(name)
                return None
            return write(store, name, data, tag)

        monkeypatch.setattr(ObjectStore, "write_kept", conflicting)
        opened.keep()
    assert refused == []
    with open_index(url, read_only=True) as opened:
        assert opened.index.meta()["one"] == "1"


def test_a_command_that_was_overtaken_ends_with_one_line_and_deletes_nothing(url, fleet, monkeypatch):
    from monitor.fleet import run

    url = f"{url}-3"
    store = ObjectStore(url)
    replay_waiting = run.replay_waiting

    def overtaken(*arguments):
        counts = replay_waiting(*arguments)
        store.write(LEASE_NAME, OTHER)
        return counts

    monkeypatch.setattr(run, "replay_waiting", overtaken)
    ended = run_command("archive", "replay", "fleet.toml", "--out", url, "--workers", 1, cwd=fleet)
    assert ended.returncode == 1
    assert len(ended.stderr.splitlines()) == 1
    assert f"spallwatch: {url}: {LEASE_NAME} is held by process 7 on far" in ended.stderr
    names = set(store.names())
    assert any(name.startswith("archive-work/inputs/") for name in names)
    assert "fleet.html" not in names

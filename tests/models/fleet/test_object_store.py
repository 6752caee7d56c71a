"""A store in an object storage: whole objects by name, and one line for each thing that can be wrong with it."""

from __future__ import annotations

import importlib
import sys
import threading
import time
import uuid

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.fleet.object_store import ObjectStore
from models.words.errors import WrongInputError
from models.work.errors import ObjectStorageError
from models.work.filesystem import filesystem
from models.work.folder_store import open_store
from tests.models.work.store_files import check_files
from tests.support.object_storage import BUCKET, use_account
from tests.support.proxy import Proxy

pytest.importorskip("fsspec", reason="needs the extra cluster")

PARTS = st.sampled_from(["a", "ab", "b", "0f", "run.json"])
NAMES = st.lists(PARTS, min_size=1, max_size=3).map("/".join)


@pytest.fixture
def owner(storage, monkeypatch):
    use_account(storage.environment, monkeypatch)
    return storage


def test_objects_in_memory_come_back_by_name():
    check_files(open_store(f"memory://{uuid.uuid4()}/run/"))


@given(st.dictionaries(NAMES, st.binary(max_size=4)), st.sets(NAMES), st.text("ab0f/r", max_size=4))
def test_names_and_contents_are_those_that_were_written(files, deleted, prefix):
    # A name that is a folder too is no case of chunks: such an object has no place in a folder.
    files = {name: data for name, data in files.items() if not any(other.startswith(f"{name}/") for other in files)}
    store = ObjectStore(f"memory://{uuid.uuid4()}")
    for name, data in files.items():
        store.write(name, data)
    for name in deleted & files.keys():
        store.delete(name)
    left = {name: data for name, data in files.items() if name not in deleted}
    assert {name: store.read(name) for name in store.names()} == left
    assert sorted(store.names(prefix)) == sorted(name for name in left if name.startswith(prefix))


@pytest.mark.parametrize("name", ["", "/a", "a//b", "../a", "a/..", "a\\b"])
def test_names_stay_below_the_prefix(name):
    with pytest.raises(ValueError, match="joined by"):
        ObjectStore("memory://bucket").write(name, b"")


@pytest.mark.parametrize(
    ("url", "message"),
    [
        (
            "s3://name:planted@bucket/x",
            r"^s3://\*\*\*@bucket/x: credentials in a URL; expected them in the environment",
        ),
        ("s3://bucket/x?versionId=3", "without '::' and without a query"),
        ("simplecache::s3://bucket/x", "does not write a file in one step"),
        ("https://host/x", "https:// does not write a file in one step; expected a folder or one of s3://"),
        ("s3://", "expected a bucket"),
    ],
)
def test_a_url_that_is_none_of_a_store_is_refused(url, message):
    with pytest.raises(WrongInputError, match=message) as caught:
        open_store(url)
    assert "planted" not in str(caught.value)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "s3fs", None)
    # fsspec keeps the kinds that it has loaded.
    monkeypatch.delitem(importlib.import_module("fsspec.registry")._registry, "s3", raising=False)
    with pytest.raises(WrongInputError, match=r'pip install "spallwatch\[s3\]"'):
        open_store("s3://bucket/x")
    with pytest.raises(WrongInputError, match="nosuch:// is not a kind of object storage"):
        filesystem("nosuch://bucket/x")
    real = importlib.import_module

    def without_fsspec(name):
        if name == "fsspec":
            raise ModuleNotFoundError("No module named 'fsspec'", name="fsspec")
        return real(name)

    monkeypatch.setattr(importlib, "import_module", without_fsspec)
    with pytest.raises(WrongInputError, match=r'pip install "spallwatch\[cluster\]" \(fsspec\)'):
        filesystem("memory://bucket/x")


@pytest.mark.cluster
def test_objects_on_a_server_come_back_by_name(owner):
    check_files(open_store(owner.url("run/")))


@pytest.mark.cluster
def test_markers_of_folders_are_no_objects(owner):
    store = ObjectStore(owner.url("marked"))
    files, root = filesystem(store.url)
    for name in ("", "chunks/", "chunks/00/"):
        # As consoles and other programs make "folders".
        files.call_s3("put_object", Bucket=BUCKET, Key=f"marked/{name}", Body=b"")
    store.write("chunks/00/x", b"one")
    assert root == f"{BUCKET}/marked"
    assert list(store.names()) == ["chunks/00/x"]


@pytest.mark.cluster
def test_more_names_than_one_answer_holds(owner):
    """Amazon lists 1,000 names an answer, this server 20."""
    store = ObjectStore(owner.url("many"))
    files, root = filesystem(store.url)
    files.pipe({f"{root}/chunks/00/{number:02}": b"x" for number in range(25)})
    assert sorted(store.names("chunks/")) == [f"chunks/00/{number:02}" for number in range(25)]


@pytest.mark.cluster
@pytest.mark.parametrize(
    ("account", "url", "cause"),
    [
        ({}, "s3://nobucket/run", "NoSuchBucket: The specified bucket does not exist"),
        ({"AWS_SECRET_ACCESS_KEY": "planted/secret+of+40+characters"}, f"s3://{BUCKET}/run", "SignatureDoesNotMatch: "),
        ({"AWS_ACCESS_KEY_ID": "AKIAPLANTED0PLANTED0"}, f"s3://{BUCKET}/run", "InvalidAccessKeyId: "),
        (
            {"AWS_ENDPOINT_URL": "http://127.0.0.1:1"},
            f"s3://{BUCKET}/run",
            "EndpointConnectionError: Could not connect",
        ),
        ({"AWS_ACCESS_KEY_ID": "", "AWS_SECRET_ACCESS_KEY": ""}, f"s3://{BUCKET}/run", "NoCredentialsError: "),
    ],
)
def test_what_is_wrong_is_said_in_one_line_with_the_url(storage, account, url, cause, monkeypatch):
    use_account({**storage.environment, **account, "AWS_MAX_ATTEMPTS": "1"}, monkeypatch)
    store = ObjectStore(url)
    actions = {
        "read": lambda: store.read("a/b"),
        "written": lambda: store.write("a/b", b""),
        "deleted": lambda: store.delete("a/b"),
        "listed": lambda: list(store.names("a/")),
    }
    for done, action in actions.items():
        with pytest.raises(ObjectStorageError) as caught:
            action()
        message = str(caught.value)
        place = "a" if done == "listed" else "a/b"
        assert message.startswith(f"{url}/{place} cannot be {done}: {cause}")
        assert len(message.splitlines()) == 1
        assert not [secret for secret in (*storage.secrets(), "planted", "PLANTED") if secret in message]


@pytest.mark.cluster
def test_a_reader_may_read_and_not_write(owner, monkeypatch):
    ObjectStore(owner.url("shown")).write("a", b"1")
    use_account(owner.reader, monkeypatch)
    store = ObjectStore(owner.url("shown"))
    assert store.read("a") == b"1"
    assert store.read("b") is None
    with pytest.raises(ObjectStorageError, match=r"/a cannot be written: AccessDenied: Access Denied$"):
        store.write("a", b"2")


@pytest.mark.cluster
def test_requests_that_break_off_are_repeated(owner, monkeypatch):
    with Proxy(owner.port) as proxy:
        use_account({**owner.environment, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{proxy.port}"}, monkeypatch)
        store = ObjectStore(owner.url("broken"))
        store.write("a", b"1")
        proxy.lets_through = False
        proxy.cut(reset=True)

        def repair():
            time.sleep(0.05)
            proxy.lets_through = True

        thread = threading.Thread(target=repair)
        thread.start()
        assert store.read("a") == b"1"
        thread.join()

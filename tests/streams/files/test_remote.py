"""Recordings in object storage and behind HTTP are fetched whole or refused, and leave nothing behind."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from models.fleet.object_store import ObjectStore
from streams.files import download as http
from streams.files.download import RemoteError
from streams.files.remote import bare, expand, fetched, is_remote, remote_files
from streams.types.spec import SourceError
from tests.support.object_storage import use_account

pytest.importorskip("fsspec", reason="needs the extra cluster")

FILES = {"press/a1.csv": b"1\n", "press/a10.csv": b"10\n" * 50, "press/a9.csv": b"9\n", "fan/x.wav": b"wav"}


@pytest.fixture
def fleet():
    """The URL of a prefix with two recordings."""
    store = ObjectStore(f"memory://{uuid.uuid4()}/fleet")
    for name, data in FILES.items():
        store.write(name, data)
    return store.url


def contents(path: Path) -> dict[str, bytes]:
    return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("s3://bucket/x", True),
        ("dataset:ims:https://host/x?sig=1", True),
        ("folder:gs://bucket/x", True),
        ("file:///a/b", True),
        ("tcp://host:1", False),
        ("mqtt://host/topic", False),
        ("rig:ferrara?seed=1", False),
        ("dataset:ims:/a/b", False),
        ("/a/b://c", False),
        ("C:\\a", False),
    ],
)
def test_what_is_remote(url, expected):
    assert is_remote(url) is expected


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("https://u:planted@host:8/a/b.wav?X-Amz-Signature=planted#x", "https://host:8/a/b.wav"),
        ("dataset:ims:https://host/a?sig=planted", "dataset:ims:https://host/a"),
        ("s3://name:planted@bucket/a?b#c", "s3://bucket/a?b#c"),
        ("/a/b", "/a/b"),
    ],
)
def test_a_recording_is_named_without_its_signature(url, expected):
    assert bare(url) == expected


def test_a_prefix_becomes_a_folder_of_its_name_and_goes_again(fleet, tmp_path):
    with fetched(f"{fleet}/press", tmp_path) as recording:
        assert recording.path.name == "press"
        assert recording.url == str(recording.path)
        assert contents(recording.path) == {name[6:]: data for name, data in FILES.items() if name.startswith("press")}
        assert recording.size == sum(len(data) for data in contents(recording.path).values())
        kept = recording.path
    assert not kept.exists()
    assert not list(tmp_path.iterdir())


def test_an_object_keeps_its_name_and_the_kind_of_the_source_is_kept(fleet, tmp_path):
    with fetched(f"dataset:ims:{fleet}/fan/x.wav", tmp_path / "made") as recording:
        assert recording.path.name == "x.wav"
        assert recording.path.read_bytes() == b"wav"
        assert recording.url == f"dataset:ims:{recording.path}"


def test_what_breaks_off_inside_leaves_nothing(fleet, tmp_path):
    with pytest.raises(KeyError), fetched(fleet, tmp_path):
        raise KeyError
    assert not list(tmp_path.iterdir())


def test_patterns_are_expanded_in_natural_order(fleet):
    assert expand(f"{fleet}/press/a*.csv") == [f"{fleet}/press/a{number}.csv" for number in (1, 9, 10)]
    assert expand(f"dataset:ims:{fleet}/*") == [f"dataset:ims:{fleet}/{name}" for name in ("fan", "press")]
    assert expand(f"{fleet}/nothing") == [f"{fleet}/nothing"]
    assert expand("https://host/a*") == ["https://host/a*"]
    with pytest.raises(SourceError, match=r"/b\*: nothing fits this pattern$"):
        expand(f"{fleet}/b*")


def test_a_file_is_not_copied(tmp_path):
    place = tmp_path / "a b.csv"
    place.write_text("1")
    assert expand((tmp_path / "*.csv").as_uri().replace("%2A", "*").replace("%20", " ")) == [place.as_uri()]
    with fetched(place.as_uri(), tmp_path / "scratch") as recording:
        assert (recording.path, recording.size) == (place, 0)
    assert place.exists()
    assert not (tmp_path / "scratch").exists()
    for url, message in (("file://host/a", "expected file:///PATH"), ("file:///nowhere/a", "there is no such file")):
        with pytest.raises(SourceError, match=message), fetched(url, tmp_path):
            pass


def test_what_is_larger_than_the_scratch_folder_is_refused_beforehand(fleet, tmp_path):
    message = r"/press \(3 files\): 154 bytes, the scratch folder may hold 153$"
    with pytest.raises(SourceError, match=message), fetched(f"{fleet}/press", tmp_path, 153):
        pass
    with fetched(f"{fleet}/press", tmp_path, 154):
        pass
    assert not list(tmp_path.iterdir())


def test_a_file_that_changes_meanwhile_is_no_recording(fleet, tmp_path, monkeypatch):
    kind = type(ObjectStore(fleet)._files)
    real = kind.get_file

    def grows(self: Any, source: str, target: str, **options: Any) -> None:
        self.pipe_file(source, b"longer than before")
        real(self, source, target, **options)

    monkeypatch.setattr(kind, "get_file", grows)
    message = r"x\.wav: changed while it was fetched \(3 bytes before, at least 18 came\)"
    with pytest.raises(RemoteError, match=message), fetched(f"{fleet}/fan", tmp_path):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "message"), [("a/../../b", "no such object, and none below"), ("a\\b", "cannot be that of a file")]
)
def test_a_name_that_leads_elsewhere_is_not_fetched(name, message, fleet, tmp_path):
    files = ObjectStore(fleet)._files
    files.store[f"{fleet.removeprefix('memory:/')}/evil/{name}"] = files.store[
        f"{fleet.removeprefix('memory:/')}/fan/x.wav"
    ]
    with pytest.raises(SourceError, match=message), fetched(f"{fleet}/evil", tmp_path):
        pass


@dataclass
class Server:
    """What a web server does: ``answers`` are taken in turn, the last one for good."""

    url: str = ""
    answers: list[Callable[[BaseHTTPRequestHandler], None]] = field(default_factory=list)
    ranges: list[str | None] = field(default_factory=list)


DATA = bytes(range(256)) * 40


def whole(handler: BaseHTTPRequestHandler) -> None:
    part(handler, len(DATA))


def part(handler: BaseHTTPRequestHandler, end: int, etag: str = '"one"', data: bytes = DATA) -> None:
    """Send the bytes that were asked for, but only those before ``end``."""
    asked = handler.headers.get("Range")
    start = int(asked.removeprefix("bytes=").rstrip("-")) if asked and handler.headers["If-Range"] == etag else 0
    handler.send_response(206 if start else 200)
    if start:
        handler.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
    handler.send_header("Content-Length", str(len(data) - start))
    handler.send_header("ETag", etag)
    handler.send_header("Last-Modified", "Mon, 23 Nov 2026 10:00:00 GMT")
    handler.end_headers()
    handler.wfile.write(data[start:end])
    handler.close_connection = True


def refusal(code: int, body: bytes = b"") -> Callable[[BaseHTTPRequestHandler], None]:
    def answer(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(code)
        handler.send_header("Content-Length", str(len(body)))
        handler.end_headers()
        handler.wfile.write(body)

    return answer


def endless(handler: BaseHTTPRequestHandler) -> None:
    handler.send_response(200)
    handler.end_headers()
    handler.wfile.write(DATA)
    handler.close_connection = True


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr(http, "_FIRST_PAUSE_S", 0.0)
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    state = Server()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            state.ranges.append(self.headers.get("Range"))
            answer = state.answers.pop(0) if len(state.answers) > 1 else state.answers[0]
            answer(self)

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as listening:
        thread = threading.Thread(target=listening.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        state.url = f"http://127.0.0.1:{listening.server_port}/a/run%201.npy?sig=planted"
        yield state
        listening.shutdown()
        thread.join()


def test_a_file_behind_http_keeps_name_and_date(server, tmp_path):
    server.answers = [whole]
    with fetched(server.url, tmp_path) as recording:
        assert recording.path.name == "run 1.npy"
        assert recording.path.read_bytes() == DATA
        assert recording.path.stat().st_mtime == 1795428000.0
        assert (recording.size, recording.etags) == (len(DATA), {"run 1.npy": "one"})
    assert not list(tmp_path.iterdir())


def test_what_breaks_off_is_continued(server, tmp_path):
    server.answers = [lambda to: part(to, 1000), refusal(503), lambda to: part(to, 5000), whole]
    with fetched(server.url, tmp_path) as recording:
        assert recording.path.read_bytes() == DATA
    # An answer with an error states no tag: what was there is not trusted.
    assert server.ranges == [None, "bytes=1000-", None, "bytes=5000-"]


def test_a_file_that_was_exchanged_meanwhile_is_begun_anew(server, tmp_path):
    new = DATA[::-1]
    server.answers = [lambda to: part(to, 1000), lambda to: part(to, len(new), '"two"', new)]
    with fetched(server.url, tmp_path) as recording:
        assert recording.path.read_bytes() == new


@pytest.mark.parametrize(
    ("answer", "kind", "message"),
    [
        (refusal(404), SourceError, r"/a/run%201\.npy: HTTP 404 Not Found$"),
        (
            refusal(403, b"<Error><Code>AccessDenied</Code><Message>Request has expired</Message></Error>"),
            RemoteError,
            r": HTTP 403 Forbidden \(AccessDenied: Request has expired\)$",
        ),
        (refusal(500), RemoteError, r": HTTP 500 Internal Server Error \(5 tries\)$"),
        (lambda to: part(to, 10), RemoteError, rf": broke off after 10 of {len(DATA)} bytes \(5 tries\)$"),
        (endless, RemoteError, "states no length"),
        (lambda to: to.wfile.write(b"nonsense\r\n\r\n"), RemoteError, r"BadStatusLine: nonsense"),
    ],
)
def test_what_cannot_be_fetched_is_said_in_one_line(answer, kind, message, server, tmp_path):
    server.answers = [answer]
    with pytest.raises(kind, match=message) as caught, fetched(server.url, tmp_path):
        pass
    assert "planted" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_file_behind_http_is_not_larger_than_the_scratch_folder(server, tmp_path):
    server.answers = [whole]
    with pytest.raises(SourceError, match=f"{len(DATA)} bytes, the scratch folder may hold 99"):
        fetched(server.url, tmp_path, 99).__enter__()
    assert not list(tmp_path.iterdir())


def test_credentials_do_not_belong_into_urls(tmp_path):
    for url in ("https://u:planted@host/x", "s3://u:planted@bucket/x"):
        with pytest.raises(SourceError, match="credentials in a URL") as caught, fetched(url, tmp_path):
            pass
        assert "planted" not in str(caught.value)


@pytest.mark.cluster
def test_recordings_of_an_object_storage(storage, monkeypatch, tmp_path):
    use_account(storage.environment, monkeypatch)
    store = ObjectStore(storage.url("fleet"))
    for name, data in FILES.items():
        store.write(name, data)
    files = remote_files(storage.url("fleet/press"))
    assert [file.name for file in files] == ["a1.csv", "a9.csv", "a10.csv"]
    with fetched(expand(storage.url("fl*/press"))[0], tmp_path) as recording:
        assert contents(recording.path) == {name[6:]: data for name, data in FILES.items() if name.startswith("press")}
        assert recording.etags == {file.name: file.etag for file in files}
        assert {file.name: (recording.path / file.name).stat().st_mtime for file in files} == {
            file.name: file.changed for file in files
        }
    with fetched(storage.presigned("fleet/fan/x.wav"), tmp_path) as recording:
        assert recording.path.read_bytes() == b"wav"
    with pytest.raises(RemoteError, match=r"x\.wav: HTTP 403 FORBIDDEN \(SignatureDoesNotMatch: ") as caught:
        fetched(storage.presigned("fleet/fan/x.wav")[:-4] + "0000", tmp_path).__enter__()
    assert "?" not in str(caught.value)
    with pytest.raises(RemoteError, match=r"FORBIDDEN \(AccessDenied: "):
        fetched(storage.presigned("fleet/fan/x.wav", -1), tmp_path).__enter__()
    for url in ("fleet/none", "fleet/fan/x"):
        with pytest.raises(SourceError, match="there is no such object, and none below it"):
            fetched(storage.url(url), tmp_path).__enter__()
    with pytest.raises(SourceError, match="NoSuchBucket"):
        fetched("s3://nobucket/x", tmp_path).__enter__()
    use_account({**storage.environment, "AWS_SECRET_ACCESS_KEY": "planted/secret"}, monkeypatch)
    with pytest.raises(RemoteError, match=r"^s3://archive/fleet cannot be listed: SignatureDoesNotMatch: "):
        fetched(storage.url("fleet"), tmp_path).__enter__()
    assert not list(tmp_path.iterdir())

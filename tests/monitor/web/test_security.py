"""Who is let in: names, origins, tokens, sizes and patience, tried against the real server."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.config.load import ConfigError, load_config
from monitor.config.outputs import WebSection
from monitor.web.auth import Doorkeeper, TokenError, load_token
from monitor.web.security import Doors
from monitor.web.server import LimitedProtocol
from tests.support.daemons import make_machine
from tests.support.pages import Page, page_of
from tests.support.security import EVIL, machine_with_event
from tests.support.waiting import wait_until

STRANGER = {
    "authorized": False,
    "needs_token": False,
    "can_acknowledge": False,
    "user": None,
    "role": None,
    "users": False,
    "desk": False,
}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with page_of(machine_with_event(tmp_path_factory.mktemp("m"))) as found:
        yield found


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page that asks for a token for everything."""
    config = machine_with_event(tmp_path_factory.mktemp("m"))
    web = WebSection(allow_remote=True, allowed_hosts=("plant.example", "proxy.example:443"))
    with page_of(config, web=web) as found:
        yield found


def test_only_its_own_names_are_answered(page: Page) -> None:
    port = page.port
    for host in (f"localhost:{port}", f"127.0.0.1:{port}", f"[::1]:{port}", f"LOCALHOST:{port}"):
        assert page.ask("/api/session", headers={"host": host}).status == 200, host
    for host in (
        *("localhost", "127.0.0.1", f"evil.example:{port}", f"localhost:{port + 1}", f"localhost.evil:{port}", ""),
        *(f"10.0.0.1:{port}", f"127.0.0.1:{port}@evil", f"evil:{port}:{port}", EVIL),
    ):
        reply = page.ask("/api/session", headers={"host": host})
        assert reply.status in (400, 421), host
        assert b"img" not in reply.body


def test_a_request_without_or_with_two_hosts_is_refused(page: Page) -> None:
    for hosts in (b"", b"Host: localhost:%d\r\nHost: evil\r\n" % page.port):
        with page.dial() as connection:
            connection.sendall(b"GET /api/session HTTP/1.1\r\n" + hosts + b"\r\n")
            assert connection.recv(100).startswith((b"HTTP/1.1 400", b"HTTP/1.1 421"))


def test_further_names_are_those_that_are_configured(guarded: Page) -> None:
    for host in (f"plant.example:{guarded.port}", "proxy.example", "proxy.example:443"):
        assert guarded.ask("/api/session", headers={"host": host}).status == 200, host
    for host in ("plant.example", f"proxy.example:{guarded.port}", f"sub.plant.example:{guarded.port}"):
        assert guarded.ask("/api/session", headers={"host": host}).status == 421, host


@given(st.text(alphabet="abcdefghijklmnopqrstuvwxyz0123456789.:-[]@/", max_size=30))
def test_no_other_name_is_admitted(name: str) -> None:
    doors = Doors.of(WebSection(), 8710)
    own = {"localhost:8710", "127.0.0.1:8710", "[::1]:8710"}
    assert doors.admits_host(name, "127.0.0.1") == (name in own)
    assert doors.admits_host(name, "192.168.1.5") == (name in own | {"192.168.1.5:8710"})


def test_the_usual_port_may_be_left_out() -> None:
    assert Doors.of(WebSection(), 443).admits_host("localhost", None)
    assert Doors.of(WebSection(host="::1"), 8710).admits_host("[::1]:8710", None)
    assert not Doors.of(WebSection(), 8710).admits_host("localhost", None)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://localhost:1", "file://", "http://localhost"])
def test_another_origin_reads_nothing(page: Page, origin: str) -> None:
    for path in ("/", "/api/machines", "/api/stream"):
        reply = page.ask(path, headers={"origin": origin})
        assert reply.status == 403
        assert "access-control-allow-origin" not in reply.headers
    own = {"origin": f"http://127.0.0.1:{page.port}"}
    assert page.ask("/api/machines", headers=own).status == 200


def test_every_answer_tells_browsers_what_they_may(page: Page) -> None:
    for path in ("/", "/api/machines", "/nothing", "/static/nothing", "/healthz", "/api/channels/m/x0/records"):
        headers = page.ask(path).headers
        assert headers["content-security-policy"].startswith("default-src 'self'"), path
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cross-origin-resource-policy"] == "same-origin"
        assert headers["cross-origin-opener-policy"] == "same-origin"
        assert "server" not in headers
        assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "POST"])
def test_reading_is_all_that_is_answered(page: Page, method: str) -> None:
    headers = {"content-type": "application/json", "authorization": page.bearer}
    assert page.ask("/api/machines", method, headers).status in (400, 405)


def acknowledge(page: Page, **headers: str) -> int:
    return page.post("/api/events/m:n1/acknowledge", {"who": "Ada", "note": ""}, **headers).status


def test_acknowledging_needs_the_token(page: Page) -> None:
    waiting = page.get("/api/events")["unacknowledged"]
    assert acknowledge(page) == 401
    assert acknowledge(page, authorization="Bearer wrong") == 401
    assert acknowledge(page, authorization=f"Basic {page.token}") == 401
    assert acknowledge(page, authorization="Bearer ") == 401
    assert acknowledge(page, authorization=page.bearer, content_type="text/plain") == 415
    assert acknowledge(page, authorization=page.bearer, origin="http://evil.example") == 403
    assert page.get("/api/events")["unacknowledged"] == waiting
    assert page.get("/api/session") == STRANGER
    assert acknowledge(page, authorization=page.bearer) == 200


def log_in(page: Page) -> str:
    reply = page.post("/login", {"token": page.token})
    assert (reply.status, reply.body) == (204, b"")
    cookie, *rules = (part.strip() for part in reply.headers["set-cookie"].split(";"))
    assert {"HttpOnly", "SameSite=strict", "Path=/"} <= set(rules)
    assert cookie.startswith(f"spallwatch-{page.port}=")
    assert page.token not in cookie
    return cookie


def test_a_session_stands_for_the_token_until_it_is_closed(page: Page) -> None:
    cookie, own = log_in(page), f"http://localhost:{page.port}"
    session = page.ask("/api/session", headers={"cookie": cookie}).json
    assert session == STRANGER | {"authorized": True, "can_acknowledge": True, "role": "admin"}
    host = {"host": f"localhost:{page.port}"}
    assert acknowledge(page, cookie=cookie, origin=own, **host) == 200
    # A form or a script of another port of this computer sends the cookie, too.
    assert acknowledge(page, cookie=cookie, origin="http://localhost:1", **host) == 403
    assert acknowledge(page, cookie=cookie) == 403
    assert acknowledge(page, cookie=cookie, origin=own, content_type="text/plain", **host) == 415
    assert page.post("/logout", {}, cookie=cookie, origin=own, **host).status == 204
    assert acknowledge(page, cookie=cookie, origin=own, **host) == 401


def test_a_wrong_login_is_refused(page: Page) -> None:
    for value in ({"token": "wrong"}, {"token": ""}):
        assert page.post("/login", value).status == 401
    for value in ({}, [], {"token": 5}, "x"):
        assert page.post("/login", value).status == 400
    assert page.ask("/login", "POST", {"content-type": "application/json"}, b"{").status == 400
    assert page.post("/login", {"token": page.token}, origin="http://evil.example").status == 403
    assert page.post("/login", {"token": page.token}, cookie='a="; x; spallwatch-1=\\').status == 204


def test_where_others_can_come_in_everything_needs_the_token(guarded: Page) -> None:
    for path in ("/api/machines", "/api/events", "/api/stream", "/api/channels/m/x0", "/metrics", "/records/m.nc"):
        reply = guarded.ask(path)
        assert (reply.status, list(reply.json)) == (401, ["error"]), path
    assert guarded.ask("/healthz").status == 401
    assert guarded.get("/api/session") == STRANGER | {"needs_token": True}
    assert guarded.ask("/static/main.js").status in (200, 404)
    assert guarded.ask("/readyz").status == 200
    assert guarded.ask("/api/machines", headers={"authorization": guarded.bearer}).status == 200
    assert guarded.ask("/api/machines", headers={"cookie": log_in(guarded)}).status == 200


@pytest.mark.parametrize(
    "path",
    [
        *("/records/..%2fstate%2fstate.db", "/records/../state/state.db", "/records/%2e%2e/m.toml", "/records/m.toml"),
        *("/static/../app.py", "/static/%2e%2e/app.py", "/static//etc/passwd", "/static/%2fetc%2fpasswd"),
        *("/static/..%5capp.py", "/records/link-20200101.nc", "/records/m-20200101.nc", "/records/m-undated.nc%00"),
        *("/static/main.js%00", "/records/", "/static/", "//etc/passwd", "/records/m-2020010%31.nc/"),
    ],
)
def test_no_file_but_those_that_are_named_is_given(page: Page, path: str) -> None:
    reply = page.ask(path)
    assert reply.status == 404
    assert b"root:" not in reply.body


def test_a_link_among_the_published_files_is_not_followed(tmp_path: Path) -> None:
    config = machine_with_event(tmp_path)
    (tmp_path / "records").mkdir()
    (tmp_path / "records" / "m-20200101.nc").symlink_to(tmp_path / "m.toml")
    (tmp_path / "records" / "m-20200102.nc").mkdir()
    os.mkfifo(tmp_path / "records" / "m-20200103.nc")
    (tmp_path / "records" / "other-20200101.nc").write_bytes(b"x")
    (tmp_path / "records" / "m-20200104.nc").write_bytes(b"whole")
    with page_of(config) as page:
        assert [file["file"] for file in page.get("/api/records")["files"]] == ["m-20200104.nc"]
        for name in ("m-20200101.nc", "m-20200102.nc", "m-20200103.nc", "other-20200101.nc"):
            assert page.ask(f"/records/{name}").status == 404, name
        assert page.ask("/records/m-20200104.nc").body == b"whole"


def test_names_come_as_they_are_and_as_json(page: Page) -> None:
    reply = page.ask("/api/events")
    assert reply.headers["content-type"] == "application/json"
    (event,) = reply.json["events"]
    assert event["channel"] == EVIL
    for path in (f"/api/channels/m/{'%3Cscript%3E'}/records", "/api/machines/%3Cb%3E%22/blocks"):
        reply = page.ask(path)
        assert reply.status == 404
        assert b"<" not in reply.body


def test_what_is_too_large_is_refused_before_it_is_read(page: Page) -> None:
    long = "x" * 9000
    assert page.ask(f"/api/machines?{long}").status in (400, 414)
    assert page.ask("/api/machines", headers={"x-long": long}).status in (400, 431)
    assert page.ask("/api/machines", headers={f"x-{n}": "y" * 900 for n in range(12)}).status in (400, 431)
    assert page.ask("/api/machines", headers={"content-length": "5"}, body=b"words").status == 400
    assert page.post("/login", {"token": long}).status == 413
    chunked = {"transfer-encoding": "chunked", "content-type": "application/json"}
    assert page.ask("/login", "POST", chunked, b"0\r\n\r\n").status == 411
    with page.dial() as connection:
        head = b"POST /login HTTP/1.1\r\nHost: localhost:%d\r\nContent-Type: application/json\r\n" % page.port
        connection.sendall(head + b"Content-Length: 99999999999\r\n\r\n")
        assert connection.recv(100).startswith(b"HTTP/1.1 413")


def ended(connection: object) -> bool:
    try:
        return connection.recv(4096) == b""  # pyright: ignore[reportAttributeAccessIssue]  # a socket
    except ConnectionResetError:
        return True


def test_whoever_sends_slowly_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LimitedProtocol, "head_within", 0.3)
    monkeypatch.setattr("monitor.web.security._MAX_ANSWER_S", 0.5)
    monkeypatch.setattr("monitor.web.server._KEEP_ALIVE_S", 0.5)
    with page_of(machine_with_event(tmp_path)) as page:
        with page.dial() as silent, page.dial() as slow, page.dial() as again, page.dial() as served:
            served.sendall(b"GET /readyz HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port)
            assert served.recv(4096).startswith(b"HTTP/1.1 200")
            slow.sendall(b"GET /api/session HTTP/1.1\r\nHost: loc")
            again.sendall(b"GET /readyz HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port)
            assert again.recv(4096).startswith(b"HTTP/1.1 200")
            again.sendall(b"GET /rea")
            for connection in (silent, slow, served):
                wait_until(lambda found=connection: ended(found))
            wait_until(lambda: ended(again))
        head = b"POST /login HTTP/1.1\r\nHost: localhost:%d\r\nContent-Type: application/json\r\n" % page.port
        with page.dial() as half:
            half.sendall(head + b"Content-Length: 100\r\n\r\n{")
            assert half.recv(4096).startswith(b"HTTP/1.1 503")
        assert page.ask("/readyz").status == 200


def test_so_many_streams_and_no_more(tmp_path: Path) -> None:
    config = machine_with_event(tmp_path)
    with page_of(config, web=WebSection(max_streams=2)) as page:
        with page.events() as first, page.events() as second:
            assert next(first)[0] == next(second)[0] == "machines"
            reply = page.ask("/api/stream")
            assert reply.status == 429
            assert "max_streams" in reply.json["error"]
        wait_until(lambda: _streams(page))


def _streams(page: Page) -> bool:
    with page.dial() as connection:
        connection.sendall(b"GET /api/stream HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port)
        return connection.recv(100).startswith(b"HTTP/1.1 200")


def test_the_token_is_made_once_and_for_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "new" / "web.token"
    token = load_token(path, make=True)
    assert len(token) >= 43
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert load_token(path, make=True) == token
    assert [item.name for item in path.parent.iterdir()] == ["web.token"]


@pytest.mark.parametrize(
    ("mode", "allowed"), [(0o600, True), (0o400, True), (0o640, True), (0o644, False), (0o660, False)]
)
def test_a_token_that_others_know_is_refused(tmp_path: Path, mode: int, allowed: bool) -> None:
    path = tmp_path / "token"
    path.write_text("a secret of some length\n")
    path.chmod(mode)
    if allowed:
        assert load_token(path, make=False) == "a secret of some length"
    else:
        with pytest.raises(TokenError, match="chmod 600"):
            load_token(path, make=False)


@pytest.mark.parametrize("content", [b"", b"short\n", b"\xff\xfe" * 20, "ä".encode() * 20, b"with\ttab in it here\n"])
def test_what_is_no_token_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "token"
    path.write_bytes(content)
    path.chmod(0o600)
    with pytest.raises(TokenError, match="token"):
        load_token(path, make=True)
    with pytest.raises(TokenError, match="no such file"):
        load_token(tmp_path / "none", make=False)
    with pytest.raises(TokenError, match="is not a file"):
        load_token(tmp_path, make=False)


def test_sessions_end_by_themselves_and_are_not_too_many() -> None:
    now = [0.0]
    keeper = Doorkeeper("a secret of some length", monotonic=lambda: now[0])
    first = keeper.open_session()
    now[0] = 3600.0
    sessions = [keeper.open_session() for _ in range(1000)]
    assert not keeper.visitor(first)
    assert keeper.visitor(sessions[0])
    now[0] = 3600.0 + 12 * 3600.0
    assert not keeper.visitor(sessions[-1])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('host = "0.0.0.0"', "allow_remote"),
        ('host = "192.168.1.5"', "allow_remote"),
        ('host = "plant.example"', "allow_remote"),
        ("port = 70000", "port"),
        ('cert_file = "a.pem"', "cert_file and key_file come together"),
        ('allowed_hosts = ["https://x"]', "allowed_hosts"),
        ("max_streams = 0", "max_streams"),
        ("hots = 1", "unknown key"),
    ],
)
def test_a_section_that_cannot_be_meant_is_refused(tmp_path: Path, text: str, says: str) -> None:
    config = make_machine(tmp_path)
    config.write_text(config.read_text().replace("enabled = false", text))
    with pytest.raises(ConfigError, match=says):
        load_config(config)


def test_a_section_that_can_be_meant_is_taken(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    plain = load_config(config)
    text = (
        'host = "0.0.0.0"\nallow_remote = true\ntoken_file = "secrets/web"\nallowed_hosts = ["a.example:443", "[::1]"]'
    )
    config.write_text(config.read_text().replace("enabled = false", text))
    found = load_config(config)
    assert found.web.token_file == tmp_path / "secrets" / "web"
    assert found.web.reading_needs_token
    assert not plain.web.reading_needs_token
    assert found.hash == plain.hash
    assert json.loads(found.web.model_dump_json())["port"] == 8710

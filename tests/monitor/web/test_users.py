"""Users of the page: who may do what, with which password, and what becomes of them while the page runs."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import stat
import threading
from base64 import b64encode
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st

import monitor.web.auth as auth
import monitor.web.passwords as passwords
import streams.link.front as front
from monitor.cli import spallwatch
from monitor.config.load import load_config
from monitor.config.outputs import WebSection
from monitor.records.events import EventLog
from monitor.web.auth import STRANGER, Caller, Doorkeeper, Visitor
from monitor.web.passwords import hash_password, is_password
from monitor.web.turns import MAX_OF_KEY, SignInError
from monitor.web.users import User, Users, UsersError, changed_users, invite, read_users
from streams.link.front import FREE_GUESSES
from tests.support.pages import Page, Reply, page_of
from tests.support.security import machine_with_event
from tests.support.waiting import PATIENCE_S

PASSWORD = "correct horse battery"
HASH = hash_password(PASSWORD)


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Answer wrong passwords without the second of delay."""
    monkeypatch.setattr(auth, "_WRONG_TOKEN_S", 0.0)


def put(path: Path, *users: User) -> None:
    with changed_users(path) as found:
        found.clear()
        found.update({user.name: user for user in users})


ADA, BEN, CLEO = User("Ada", "operator", HASH), User("Ben", "viewer", HASH), User("Cleo", "admin", HASH)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "web.users"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Page, Path]]:
    """A page that asks for a sign-in for everything, and its file of users."""
    config = machine_with_event(tmp_path_factory.mktemp("m"))
    with page_of(config, web=WebSection(allow_remote=True)) as page:
        yield page, load_config(config).machine.state_dir / "web.users"


def sign_in(page: Page, name: str, password: str = PASSWORD) -> Reply:
    return page.post("/login", {"name": name, "password": password})


def cookie_of(reply: Reply) -> str:
    assert reply.status == 204, reply.body
    cookie, *rules = (part.strip() for part in reply.headers["set-cookie"].split(";"))
    assert {"HttpOnly", "SameSite=strict", "Path=/"} <= set(rules)
    return cookie


def acknowledge(page: Page, cookie: str, path: str = "/api/events/m:n1/acknowledge", **more: object) -> Reply:
    own = f"http://127.0.0.1:{page.port}"
    return page.post(path, {"who": "Mallory", "note": "", **more}, cookie=cookie, origin=own)


def test_who_acknowledged_is_who_signed_in(served: tuple[Page, Path]) -> None:
    page, users = served
    put(users, ADA, BEN, CLEO)
    cookie = cookie_of(sign_in(page, "Ada"))
    session = page.ask("/api/session", headers={"cookie": cookie}).json
    assert (session["user"], session["role"], session["can_acknowledge"]) == ("Ada", "operator", True)
    assert acknowledge(page, cookie).json["acknowledgements"][-1]["who"] == "Ada"
    with EventLog(users.parent / "state.db") as log:
        name = log.notice(1e9, {"kind": "test"})
    found = acknowledge(page, cookie, "/api/acknowledge", events=[f"m:{name}"]).json
    assert found["results"][0]["event"]["acknowledgements"][0]["who"] == "Ada"


def test_a_viewer_reads_and_an_operator_invites_nobody(served: tuple[Page, Path]) -> None:
    page, users = served
    put(users, ADA, BEN, CLEO)
    viewer, operator, admin = (cookie_of(sign_in(page, name)) for name in ("Ben", "Ada", "Cleo"))
    assert page.ask("/api/machines").status == 401
    assert page.ask("/api/machines", headers={"cookie": viewer}).status == 200
    for path in ("/api/events/m:n1/acknowledge", "/api/acknowledge"):
        reply = acknowledge(page, viewer, path, events=["m:n1"])
        assert (reply.status, reply.json["error"]) == (403, "Ben is a viewer, and may only read")
    assert page.ask("/api/session", headers={"cookie": viewer}).json["can_acknowledge"] is False
    for cookie, status in ((viewer, 403), (operator, 403), (admin, 200)):
        assert page.ask("/api/users", headers={"cookie": cookie}).status == status
        assert acknowledge(page, cookie, "/api/users/invite", name="Ben").status == status
    assert page.ask("/api/users").status == 401
    assert b"argon2id" not in page.ask("/api/users", headers={"authorization": page.bearer}).body


def test_wrong_passwords_keep_nobody_out(served: tuple[Page, Path]) -> None:
    page, users = served
    put(users, User("Eve", "operator", HASH), ADA)
    answers = [sign_in(page, "Eve", "wrong password").status for _ in range(FREE_GUESSES + 1)]
    assert answers == [401] * len(answers)
    # The right one is checked as soon as the delay is over; an unknown name is answered in the same way.
    assert sign_in(page, "Eve").status == 204
    assert [sign_in(page, "Nobody").status for _ in range(3)] == [401] * 3
    assert sign_in(page, "Ada").status == 204
    assert page.post("/login", {"token": page.token}).status == 204
    for wrong in ({"name": "Ada"}, {"name": "Ada", "password": 1}, {"name": 1, "password": PASSWORD}):
        assert page.post("/login", wrong).status == 400


def test_a_browser_that_signed_in_by_a_name_shows_it_again(served: tuple[Page, Path]) -> None:
    page, users = served
    put(users, ADA, BEN)
    session, device = sign_in(page, "Ada").cookies
    assert session.startswith(f"spallwatch-{page.port}=")
    name, *rules = (part.strip() for part in device.split(";"))
    assert name.startswith(f"spallwatch-{page.port}-device=")
    assert {"HttpOnly", "SameSite=strict", "Path=/login"} <= set(rules)
    # It is no session, and the token has none.
    assert page.ask("/api/machines", headers={"cookie": name}).status == 401
    assert len(page.post("/login", {"token": page.token}).cookies) == 1


def keeper_of(path: Path) -> Doorkeeper:
    return Doorkeeper("a token of some length", Users(path))


async def status_of(keeper: Doorkeeper, name: str, password: str, caller: Caller = STRANGER) -> int:
    try:
        await keeper.sign_in(name, password, caller)
    except SignInError as error:
        return error.status
    return 204


def test_guesses_are_counted_by_client_and_name(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(path, ADA, BEN)
    # A delay that is never over.
    monkeypatch.setattr(front, "_FIRST_DELAY_S", 1e6)
    monkeypatch.setattr(front, "_MAX_DELAY_S", 1e6)
    keeper = keeper_of(path)
    device = keeper.device_cookie(ADA)

    async def run() -> None:
        stranger = Caller("192.0.2.1")
        for _ in range(FREE_GUESSES):
            assert await status_of(keeper, "Ada", "wrong", stranger) == 401
        waiting = [asyncio.create_task(status_of(keeper, "Ada", PASSWORD, stranger)) for _ in range(MAX_OF_KEY)]
        await asyncio.sleep(0)
        # What more comes is refused; other clients, other names and browsers that are known do not wait.
        assert await status_of(keeper, "Ada", PASSWORD, stranger) == 429
        for name, caller in (
            ("Ada", Caller("192.0.2.2")),
            ("Ada", Caller("2001:db8::1")),
            ("Ben", stranger),
            ("Ada", Caller("192.0.2.1", device)),
        ):
            assert await status_of(keeper, name, PASSWORD, caller) == 204
        # The browser of one name, or with another password, is not known.
        put(path, User("Ada", "operator", hash_password("another password")), BEN)
        assert keeper._device(device, "Ada") is None
        assert keeper._device(keeper.device_cookie(BEN), "Ada") is None
        assert not any(task.done() for task in waiting)
        for task in waiting:
            task.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)

    asyncio.run(run())
    keeper.close()


def test_parallel_attempts_do_not_outrun_the_delay(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(path, ADA)
    monkeypatch.setattr(front, "_FIRST_DELAY_S", 1e6)
    monkeypatch.setattr(front, "_MAX_DELAY_S", 1e6)
    keeper = keeper_of(path)
    checked: list[str] = []
    check = keeper._check
    monkeypatch.setattr(keeper, "_check", lambda name, password: checked.append(password) or check(name, password))

    async def run() -> None:
        tasks: list[asyncio.Task[int]] = []
        async with asyncio.timeout(PATIENCE_S):
            while len(checked) < FREE_GUESSES:
                tasks += [asyncio.create_task(status_of(keeper, "Ada", "wrong")) for _ in range(MAX_OF_KEY)]
                await asyncio.sleep(0.01)
        await asyncio.sleep(0.3)
        assert len(checked) == FREE_GUESSES
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    asyncio.run(run())
    keeper.close()


def test_wrong_tokens_and_codes_take_no_place_of_a_sign_in(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(path, ADA)
    monkeypatch.setattr(auth, "_WRONG_TOKEN_S", 1e6)
    keeper = keeper_of(path)
    code, _ = invite(path, "Ada")

    async def run() -> None:
        held = [asyncio.create_task(keeper.delay_wrong_token()) for _ in range(200)]
        await asyncio.sleep(0)
        assert sum(task.done() for task in held) == 200 - auth._MAX_HELD
        assert not any(task.result() for task in held if task.done())
        with pytest.raises(SignInError, match="too many wrong codes"):
            await keeper.redeem("x" * 32, PASSWORD)
        assert [await status_of(keeper, "Ada", PASSWORD) for _ in range(3)] == [204] * 3
        assert (await keeper.redeem(code, "another password")).name == "Ada"
        for task in held:
            task.cancel()
        await asyncio.gather(*held, return_exceptions=True)

    asyncio.run(run())
    keeper.close()


def test_an_old_hash_is_replaced_at_the_next_sign_in(path: Path) -> None:
    # Of scrypt, as versions before this one stored it.
    salt = b"0123456789abcdef"
    key = hashlib.scrypt(PASSWORD.encode(), salt=salt, n=1 << 14, r=8, p=1, maxmem=1 << 25, dklen=32)
    old = f"scrypt$16384$8$1${b64encode(salt).decode()}${b64encode(key).decode()}"
    put(path, User("Ada", "operator", old))
    keeper = keeper_of(path)
    assert asyncio.run(status_of(keeper, "Ada", "wrong")) == 401
    assert read_users(path)["Ada"].password == old
    assert asyncio.run(status_of(keeper, "Ada", PASSWORD)) == 204
    new = read_users(path)["Ada"].password
    assert new.startswith("$argon2id$v=19$m=19456,t=2,p=1$")
    assert asyncio.run(status_of(keeper, "Ada", PASSWORD)) == 204
    assert read_users(path)["Ada"].password == new
    keeper.close()


def test_a_session_ends_with_its_user_or_password(path: Path) -> None:
    put(path, ADA, BEN)
    keeper = Doorkeeper("a token of some length", Users(path))
    ada, ben, token = keeper.open_session(ADA), keeper.open_session(BEN), keeper.open_session()
    assert keeper.visitor(ada) == Visitor("Ada", "operator")
    put(path, User("Ada", "viewer", HASH), BEN)
    assert keeper.visitor(ada) == Visitor("Ada", "viewer")
    put(path, User("Ada", "operator", hash_password("another password")))
    assert keeper.visitor(ada) is None
    assert keeper.visitor(ben) is None
    put(path, ADA, BEN)
    # Ended is ended, also if the user comes back.
    assert keeper.visitor(ben) is None
    path.unlink()
    assert not keeper.has_users
    assert keeper.visitor(token) == Visitor(None, "admin")


def test_a_removed_user_is_out_with_the_next_request(served: tuple[Page, Path]) -> None:
    page, users = served
    put(users, ADA, CLEO)
    cookie = cookie_of(sign_in(page, "Ada"))
    assert page.ask("/api/machines", headers={"cookie": cookie}).status == 200
    put(users, CLEO)
    assert page.ask("/api/machines", headers={"cookie": cookie}).status == 401
    assert acknowledge(page, cookie).status == 401
    # A file that cannot be used lets nobody in.
    cookie = cookie_of(sign_in(page, "Cleo"))
    users.chmod(0o644)
    assert page.ask("/api/machines", headers={"cookie": cookie}).status == 401
    assert sign_in(page, "Cleo").status == 401
    users.unlink()


def test_a_code_sets_a_password_once(served: tuple[Page, Path], path: Path) -> None:
    page, users = served
    users.unlink(missing_ok=True)
    put(users, User("Dan", "operator"))
    # Without a password nobody signs in.
    assert sign_in(page, "Dan", "").status == 401
    code, _ = invite(users, "Dan")
    assert code not in users.read_text()
    assert page.post("/login", {"code": code, "password": "short"}).status == 400
    assert page.post("/login", {"code": code[:-1], "password": PASSWORD}).status == 401
    cookie = cookie_of(page.post("/login", {"code": f" {code} ", "password": PASSWORD}))
    assert page.ask("/api/session", headers={"cookie": cookie}).json["user"] == "Dan"
    assert page.post("/login", {"code": code, "password": PASSWORD}).status == 401
    assert sign_in(page, "Dan").status == 204
    now = [0.0]
    put(path, User("Dan", "operator"))
    code, until = invite(path, "Dan", lambda: now[0])
    late = Users(path, lambda: now[0])
    now[0] = until + 1.0
    assert late.redeem(code, PASSWORD) is None
    now[0] = until
    assert late.redeem(code, PASSWORD) is not None


@given(st.text(min_size=1, max_size=30), st.text(max_size=30))
@settings(max_examples=5)
def test_only_its_password_fits_a_hash(password: str, other: str) -> None:
    stored = hash_password(password)
    assert is_password(password, stored)
    assert is_password(other, stored) == (other == password)


@pytest.mark.parametrize(
    "stored",
    [
        "",
        "x",
        "scrypt$16384$8$1$$",
        "scrypt$16384$8$1$AA==$",
        "plain$1$1$1$a$b",
        "scrypt$99999999999$8$1$AA==$AA==",
        HASH.replace("m=19456", "m=9999999"),
        HASH.replace("t=2", "t=0"),
        HASH.replace("p=1", "p=0"),
        HASH[:-1],
    ],
    # A hash holds its salt.
    ids=range(10),
)
def test_what_is_no_hash_fits_no_password(stored: str) -> None:
    assert not is_password("", stored)
    assert not is_password(PASSWORD, stored)


def test_unknown_users_take_as_much_work(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(path, ADA)
    costs: list[str] = []
    check = passwords._is_argon2id

    def counted(password: str, stored: str) -> bool:
        costs.append(stored.rsplit("$", 2)[0])
        return check(password, stored)

    monkeypatch.setattr(passwords, "_is_argon2id", counted)
    users = Users(path)
    assert [users.is_password(name, "wrong") for name in ("Ada", "Nobody")] == [False, False]
    assert costs == ["$argon2id$v=19$m=19456,t=2,p=1"] * 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name,role\n", "expected the columns"),
        ("{columns}\nAda,boss,,,\n", ":2: role: expected one of viewer, operator, admin, found 'boss'"),
        ("{columns}\nAda,viewer,,,\nAda,admin,,,\n", ":3: a second user of the name 'Ada'"),
        ("{columns}\n Ada,viewer,,,\n", ":2: a name has 1 to 64 printable characters"),
        ("{columns}\nAda,viewer\n", ":2: expected 5 columns, found 2"),
        ("{columns}\nAda,viewer,,,tomorrow\n", ":2: could not convert"),
        ('{columns}\n"Ada,viewer,,,\n', "is not a file of users"),
    ],
)
def test_a_wrong_file_says_where(path: Path, text: str, says: str) -> None:
    path.write_text(text.replace("{columns}", "name,role,password,invite,invite_until_utc_s"))
    path.chmod(0o600)
    with pytest.raises(UsersError) as caught:
        read_users(path)
    assert says in str(caught.value)
    assert Users(path).all() == {}


def test_the_file_is_private_whole_and_changed_by_one_at_a_time(path: Path) -> None:
    put(path, User('Ada "the, first"', "viewer", HASH))
    assert list(read_users(path)) == ['Ada "the, first"']
    if os.name == "posix":
        assert stat.S_IMODE(path.stat().st_mode) == 0o600

    def fail() -> None:
        with changed_users(path) as users:
            users.clear()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert read_users(path)

    def add(number: int) -> None:
        with changed_users(path) as users:
            users[f"u{number}"] = User(f"u{number}", "viewer")

    threads = [threading.Thread(target=add, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(read_users(path)) == 9
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def call(config: Path, *words: str, stdin: str | None = None) -> Result:
    return CliRunner().invoke(spallwatch, ["user", *words, "--config", str(config)], input=stdin)


def test_users_are_managed_by_a_command(tmp_path: Path) -> None:
    config = machine_with_event(tmp_path)
    path = load_config(config).machine.state_dir / "web.users"
    assert "no users in" in call(config, "list").output
    assert call(config, "add", "Ada", "--role", "admin", stdin=f"{PASSWORD}\n").exit_code == 0
    assert Users(path).is_password("Ada", PASSWORD)
    assert PASSWORD not in path.read_text()
    printed = call(config, "add", "Ben", "--invite").output
    code = next(line.partition(": ")[2] for line in printed.splitlines() if line.startswith("code"))
    assert f"#/invite/{code}" in printed or "link" not in printed
    listed = json.loads(call(config, "list", "--json").output)["users"]
    assert [(user["name"], user["role"], user["password"], user["invited"]) for user in listed] == [
        ("Ada", "admin", True, False),
        ("Ben", "operator", False, True),
    ]
    # Another role by an invitation leaves the password; another password ends an invitation.
    assert call(config, "add", "Ada", "--role", "viewer", "--invite").exit_code == 0
    assert (read_users(path)["Ada"].role, Users(path).is_password("Ada", PASSWORD)) == ("viewer", True)
    assert call(config, "remove", "Ada").exit_code == 0
    assert list(read_users(path)) == ["Ben"]
    for words, stdin in (
        (("add", "Cy"), "short\n"),
        (("add", " Cy"), PASSWORD),
        (("remove", "Cy"), None),
        (("invite", "Cy"), None),
    ):
        assert call(config, *words, stdin=stdin).exit_code != 0, words
    assert list(read_users(path)) == ["Ben"]

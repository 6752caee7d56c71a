"""The import desk over HTTP: who may use it, what it may read, and that it never overwrites."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import monitor.web.desk as desk
from monitor.config.load import load_config
from monitor.config.outputs import WebSection
from monitor.web.passwords import hash_password
from monitor.web.users import Role, User, changed_users
from tests.support.pages import Page, Reply, page_of
from tests.support.security import machine_with_event

PASSWORD = "correct horse battery"
ANSWERS = {"bearing": "6205", "speed_hz": "1770 rpm", "unit": "g", "rate_hz": "8 kHz", "start_utc": "none"}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Page, Path, Path]]:
    """A page with a desk, the folder that it may read, and that of its configurations."""
    home = tmp_path_factory.mktemp("desk")
    root = home / "recordings"
    (root / "press").mkdir(parents=True)
    (root / "empty").mkdir()
    (home / "secret").mkdir()
    (root / "linked").mkdir()
    values = np.random.default_rng(1).normal(size=(2, 16_000))
    for number in range(2):
        np.save(root / "press" / f"f{number}.npy", values)
    np.save(home / "secret" / "f0.npy", values)
    (root / "linked" / "out").symlink_to("../../secret")
    (root / "linked" / "file.npy").symlink_to("../../secret/f0.npy")
    (home / "m").mkdir()
    config = machine_with_event(home / "m")
    with page_of(config, web=WebSection(import_folders=(root,))) as page:
        yield page, root, load_config(config).machine.state_dir.parent


def send(page: Page, address: str, **body: Any) -> Reply:
    return page.post(address, body, authorization=page.bearer)


def look(page: Page, path: Path | str, **answers: Any) -> Reply:
    return send(page, "/api/desk/look", path=str(path), answers=ANSWERS | answers)


def test_folders_are_listed_below_the_configured_ones_alone(served: tuple[Page, Path, Path]) -> None:
    page, root, _ = served
    own = {"authorization": page.bearer}
    assert [entry["path"] for entry in page.ask("/api/desk", headers=own).json["entries"]] == [str(root)]
    found = page.ask(f"/api/desk?path={root}", headers=own).json
    assert [entry["name"] for entry in found["entries"]] == ["empty", "linked", "press"]
    assert found["parent"] is None
    found = page.ask(f"/api/desk?path={root}/press", headers=own).json
    assert [(entry["name"], entry["folder"]) for entry in found["entries"]] == [("f0.npy", False), ("f1.npy", False)]
    assert found["parent"] == str(root)


def test_nothing_outside_is_read_or_told_to_exist(served: tuple[Page, Path, Path]) -> None:
    page, root, _ = served
    outside = [root.parent / "secret", root / ".." / "secret", root.parent / "none", "/etc/passwd", "", "a\0b",
               root / "linked" / "out", root / "linked" / "file.npy", root / "linked",
               # Nothing is fetched: an admin reaches no other computer, nor what only this one reaches.
               "http://169.254.169.254/latest/meta-data/", "https://127.0.0.1/x.csv", "http://[::1]:8710/", "s3://bucket/x",
               f"file://{root}/press", "tcp://127.0.0.1:5777", "dataset:ims:http://10.0.0.1/", "rig:x"]  # fmt: skip
    for path in outside:
        reply = look(page, path)
        assert reply.status == 403, (path, reply.body)
        assert "import_folders" in reply.json["error"]
        assert str(root.parent) not in reply.json["error"]
    listed = page.ask(f"/api/desk?path={root}/linked", headers={"authorization": page.bearer}).json
    assert listed["entries"] == []
    assert page.ask("/api/desk?path=/etc", headers={"authorization": page.bearer}).status == 403
    assert look(page, root / "none").status == 404


@pytest.mark.parametrize(
    ("answers", "key", "said"),
    [
        ({"speed_hz": "1770"}, "speed_hz", "did you mean 1770 rpm?"),
        ({"speed_hz": "1,770 rpm"}, "speed_hz", "1.770 or 1770"),
        ({"unit": "furlong"}, "unit", "expected one of g, m/s2"),
        ({"bearing": "9999"}, "bearing", "is not in the catalogue"),
        ({"rate_hz": "0"}, "rate_hz", "expected a sampling rate"),
        ({"columns": ["x"]}, "columns", "is no column of f0.npy"),
        ({"wheel": "7"}, "wheel", "is no question"),
        ({"rate_hz": None}, "rate_hz", "expected words or a number"),
    ],
)
def test_an_answer_that_is_none_is_named(
    served: tuple[Page, Path, Path], answers: dict[str, Any], key: str, said: str
) -> None:
    page, root, _ = served
    reply = look(page, root / "press", **answers)
    assert (reply.status, reply.json["key"]) == (400, key)
    assert said in reply.json["error"]


def test_an_empty_folder_and_a_body_that_is_none_are_refused(served: tuple[Page, Path, Path]) -> None:
    page, root, _ = served
    assert "empty holds no files" in look(page, root / "empty").json["error"]
    for body in ({}, {"path": 7}, {"path": str(root), "answers": []}, {"path": str(root), "name": 3}):
        assert send(page, "/api/desk/look", **body).status == 400


def test_large_files_are_left_to_the_command_line(
    served: tuple[Page, Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    page, root, _ = served
    monkeypatch.setattr(desk, "MAX_FILE_BYTES", 1000)
    reply = look(page, root / "press")
    assert (reply.status, "spallwatch init" in reply.json["error"]) == (413, True)


def test_open_questions_come_first_and_then_the_preview(served: tuple[Page, Path, Path]) -> None:
    page, root, _ = served
    reply = send(page, "/api/desk/look", path=str(root / "press"), answers={}).json
    open_keys = [question["key"] for question in reply["questions"] if question["default"] is None]
    assert open_keys == ["bearing", "rate_hz", "unit", "speed_hz"]
    assert (reply["configuration"], reply["doubts"], reply["channels"]) == (None, None, [])
    reply = look(page, root / "press").json
    assert reply["channels"][0]["lines_hz"]["outer"] == pytest.approx([105.75 * k for k in range(1, 6)], rel=1e-4)
    assert len(reply["channels"][0]["signal"]["high"]) <= 400
    assert reply["ends"]
    assert 'designation = "6205"' in reply["configuration"]


def test_a_configuration_is_saved_once(served: tuple[Page, Path, Path]) -> None:
    page, root, configurations = served
    given = {"path": str(root / "press"), "answers": ANSWERS}
    saved = send(page, "/api/desk/save", **given, file="press.toml")
    assert (saved.status, saved.json["next"]) == (201, "spallwatch run --config press.toml")
    config = load_config(configurations / "press.toml")
    assert Path(str(config.source[0].url).removeprefix("folder:")).name == "press"
    again = send(page, "/api/desk/save", **given, file="press.toml")
    assert (again.status, again.json["key"]) == (400, "out")
    assert "is there already" in again.json["error"]
    for wrong in ("../press.toml", "/etc/x.toml", ".hidden", "a b"):
        assert send(page, "/api/desk/save", **given, file=wrong).json["key"] == "file"
    missing = send(page, "/api/desk/save", path=given["path"], answers={}, file="other")
    assert missing.status == 400
    assert not (configurations / "other.toml").exists()


def test_it_needs_a_sign_in(served: tuple[Page, Path, Path]) -> None:
    page, root, _ = served
    own = f"http://127.0.0.1:{page.port}"
    body = {"path": str(root / "press"), "answers": ANSWERS, "file": "theirs"}
    assert page.ask("/api/desk").status == 401
    assert page.post("/api/desk/look", body, origin=own).status == 401
    assert page.post("/api/desk/save", body, origin=own).status == 401


def test_users_who_are_no_admins_are_refused(tmp_path: Path) -> None:
    root = tmp_path / "recordings"
    root.mkdir()
    (tmp_path / "m").mkdir()
    config = machine_with_event(tmp_path / "m")
    path = load_config(config).machine.state_dir / "web.users"
    with page_of(config, web=WebSection(import_folders=(root,))) as page:
        with changed_users(path) as users:
            roles: dict[str, Role] = {"Ada": "operator", "Ben": "viewer", "Cleo": "admin"}
            users.update({name: User(name, role, hash_password(PASSWORD)) for name, role in roles.items()})
        for name, status in (("Ada", 403), ("Ben", 403), ("Cleo", 200)):
            signed = page.post("/login", {"name": name, "password": PASSWORD})
            cookie = signed.headers["set-cookie"].split(";")[0]
            assert page.ask("/api/desk", headers={"cookie": cookie}).status == status
            assert page.ask("/api/session", headers={"cookie": cookie}).json["desk"] is True


def test_without_configured_folders_there_is_no_desk(tmp_path: Path) -> None:
    with page_of(machine_with_event(tmp_path)) as page:
        assert page.get("/api/session")["desk"] is False
        assert page.ask("/api/desk", headers={"authorization": page.bearer}).status == 404
        assert look(page, tmp_path).status == 403

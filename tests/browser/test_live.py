"""What changes while somebody looks: new blocks, states, a daemon that ends, an acknowledgement."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from monitor.records.events import EventLog
from monitor.web.passwords import hash_password
from monitor.web.users import User, changed_users, invite
from tests.browser.conftest import Visitor
from tests.browser.machine import Served, channel_name
from tests.support.effort import effort_count
from tests.support.pages import page_of

pytestmark = pytest.mark.browser

NOTE = "<b onmouseover=window.trapped=1>grease</b> & 'patience'"


def free_port() -> int:
    """Return a port that was free a moment ago: a page that comes back must come back in the same place."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


@pytest.fixture
def fixed(tmp_path: Path) -> Iterator[Served]:
    """A daemon whose page keeps its address, after 12 blocks."""
    served = Served(tmp_path, web=f"[web]\nport = {free_port()}\n")
    served.start()
    served.put(12)
    yield served
    served.stop()


def test_a_new_block_and_a_new_state_appear_by_themselves(fixed: Served, visitor: Visitor) -> None:
    visit = visitor(fixed.url)
    page = visit.go("#/channel/pump/x0")
    answers = page.locator(".answers")
    expect(answers).to_contain_text("block 12")
    expect(page.locator('[data-chart="rms"] canvas')).to_be_visible()
    page.evaluate("window.same = true")
    fixed.put(2)
    expect(answers).to_contain_text("block 14")
    expect(page.locator(".figure-body .when").first).to_contain_text("07:00:06")
    expect(page.get_by_role("region", name="Envelope spectrum")).to_contain_text("block 14")
    fixed.put(4, level=5.0)
    expect(answers).to_contain_text("Failure")
    newest = page.get_by_role("slider")
    expect(newest).to_have_attribute("aria-valuetext", re.compile("block 18"))
    expect(page.get_by_role("region", name="Events")).to_contain_text("RMS")
    expect(page).to_have_title(re.compile(r"^\(\d\) pump / x0 – spallwatch$"))
    assert page.evaluate("window.same") is True


def test_a_daemon_that_ends_is_seen_and_so_is_its_return(fixed: Served, visitor: Visitor) -> None:
    visit = visitor(fixed.url)
    page = visit.go()
    expect(page.locator("#live")).to_have_text("live")
    fixed.stop()
    expect(page.locator("#banners")).to_contain_text("Not live since")
    expect(page.locator("#live")).to_have_text("not live")
    fixed.start()
    expect(page.locator("#live")).to_have_text("live")
    expect(page.locator("#banners")).to_be_empty()
    fixed.put(1)
    visit.trouble = [text for text in visit.trouble if "ERR_" not in text]


def test_an_alarm_is_acknowledged_with_a_name_and_a_note(fixed: Served, visitor: Visitor) -> None:
    fixed.put(4, level=5.0)
    visit = visitor(fixed.url)
    page = visit.go("#/events")
    events = page.locator(".event")
    expect(events.filter(has_text="danger")).to_have_count(1)
    before = page.locator(".event[data-open]").count()
    events.filter(has_text="danger").get_by_role("button").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_label("Token").fill("not the token")
    dialog.get_by_role("button", name="Log in").click()
    expect(dialog).to_contain_text("Not accepted: the token is wrong")
    dialog.get_by_label("Token").fill(fixed.token)
    dialog.get_by_role("button", name="Log in").click()
    dialog.get_by_label("Your name").fill("Anna <i>B.</i>")
    dialog.get_by_label("Note").fill(NOTE)
    dialog.get_by_role("button", name="Acknowledge").click()
    expect(dialog).to_have_count(0)
    acknowledged = events.filter(has_text="danger")
    expect(acknowledged).to_contain_text(NOTE)
    expect(acknowledged).to_contain_text("Anna <i>B.</i>")
    expect(page.locator(".event[data-open]")).to_have_count(before - 1)
    expect(page.locator("#badge")).to_have_text(str(before - 1))
    with EventLog(fixed.folder / "state" / "state.db") as log:
        given = [one for _, event in log.events() for one in event.acknowledgements]
    assert [(one.who, one.note) for one in given] == [("Anna <i>B.</i>", NOTE)]
    # The token is asked for once; the name is remembered.
    page.locator(".event[data-open]").first.get_by_role("button").click()
    expect(dialog.get_by_label("Your name")).to_have_value("Anna <i>B.</i>")
    dialog.get_by_role("button", name="Acknowledge").click()
    expect(page.locator(".event[data-open]")).to_have_count(before - 2)
    assert page.evaluate("window.trapped") is None
    visit.trouble = [text for text in visit.trouble if not text.startswith(("401", "403"))]


def test_many_are_acknowledged_with_one_note_by_keyboard(fixed: Served, visitor: Visitor) -> None:
    with EventLog(fixed.folder / "state" / "state.db") as log:
        names = [log.notice(time.time(), {"kind": "test", "text": f"many {number}"}) for number in range(3)]
    visit = visitor(fixed.url)
    page = visit.go("#/events")
    page.get_by_label("Filter events").fill("many")
    drawn = page.locator(".event")
    expect(drawn).to_have_count(3)
    button = page.locator(".choice button")
    expect(button).to_be_disabled()
    drawn.nth(2).get_by_role("checkbox").press("Space")
    expect(button).to_have_text("Acknowledge 1 event")
    page.get_by_label("all open ones shown").press("Space")
    expect(button).to_have_text("Acknowledge 3 events")
    drawn.nth(0).get_by_role("checkbox").press("Space")
    # What the filter hides is not acknowledged.
    page.get_by_label("Filter events").fill("many 0")
    expect(button).to_be_hidden()
    page.get_by_label("Filter events").fill("many")
    expect(button).to_have_text("Acknowledge 1 event")
    page.get_by_label("all open ones shown").press("Space")
    expect(button).to_have_text("Acknowledge 3 events")
    button.press("Enter")
    dialog = page.get_by_role("dialog", name="Acknowledge 3 events")
    expect(dialog.get_by_role("listitem")).to_have_count(3)
    dialog.get_by_label("Token").fill(fixed.token)
    dialog.get_by_label("Token").press("Enter")
    dialog.get_by_label("Your name").fill("Anna")
    dialog.get_by_label("Note").fill(NOTE)
    dialog.get_by_role("button", name="Acknowledge").press("Enter")
    expect(dialog).to_have_count(0)
    expect(drawn.filter(has_text=NOTE)).to_have_count(3)
    expect(button).to_be_hidden()
    with EventLog(fixed.folder / "state" / "state.db") as log:
        given = [log.event(name) for name in names]
    assert [[(one.who, one.note) for one in event.acknowledgements] for event in given if event] == [
        [("Anna", NOTE)]
    ] * 3


@pytest.fixture
def ended(tmp_path: Path) -> Iterator[str]:
    """Address of the page of a machine that was well when its daemon was stopped."""
    served = Served(tmp_path)
    served.start()
    served.put(16)
    served.stop()
    with page_of(served.config) as page:
        yield page.url


def test_where_no_daemon_runs_nothing_is_read_as_healthy(ended: str, visitor: Visitor) -> None:
    visit = visitor(ended)
    page = visit.go()
    expect(page.locator("#banners")).to_contain_text("The daemon was stopped")
    expect(page.locator(".group:visible > h2")).to_have_count(1)
    expect(page.locator(".group:visible > h2")).to_contain_text("No data")
    expect(page.locator(".row[data-stale]")).to_have_count(2)
    expect(page.locator(".row").first).to_contain_text("last said: normal")
    page = visit.go("#/channel/pump/x0")
    expect(page.locator(".answers")).to_contain_text("nothing is known since")
    expect(page.locator('[data-chart="rms"] canvas')).to_be_visible()


@pytest.fixture
def restricted(tmp_path: Path) -> Iterator[Served]:
    """A daemon whose page may be reached by another name, and so asks for the token before it shows anything."""
    served = Served(tmp_path, web='[web]\nport = 0\nallowed_hosts = ["bearings.plant.example"]\n')
    served.start()
    yield served
    served.stop()


def test_where_reading_needs_the_token_nothing_is_shown_before(restricted: Served, visitor: Visitor) -> None:
    visit = visitor(restricted.url)
    page = visit.go()
    expect(page.get_by_text("Sign in to this page")).to_be_visible()
    assert page.locator(".row").count() == 0
    page.get_by_label("Token").fill(restricted.token)
    page.get_by_role("button", name="Log in").click()
    expect(page.locator(".row")).to_have_count(2)
    visit.trouble = [text for text in visit.trouble if not text.startswith("401")]


def test_an_operator_signs_in_without_a_file_of_the_server(restricted: Served, visitor: Visitor) -> None:
    state = restricted.folder / "state"
    with changed_users(state / "web.users") as users:
        users |= {"Ada": User("Ada", "operator"), "Ben": User("Ben", "viewer")}
        users["Cleo"] = User("Cleo", "admin", hash_password("not the batteries"))
    codes = {name: invite(state / "web.users", name)[0] for name in ("Ada", "Ben")}
    with EventLog(state / "state.db") as log:
        log.notice(time.time(), {"kind": "test", "text": "to be known"})
    visit = visitor(restricted.url)
    page = visit.go(f"#/invite/{codes['Ada']}")
    expect(page.get_by_label("Code")).to_have_value(codes["Ada"])
    page.get_by_label("New password").fill("short")
    page.get_by_label("New password").press("Enter")
    expect(page.get_by_role("alert").filter(has_text="10 to 200 characters")).to_be_visible()
    page.get_by_label("New password").fill("correct horse")
    page.get_by_label("New password").press("Enter")
    expect(page.locator(".row")).to_have_count(2)
    assert codes["Ada"] not in page.url
    page.keyboard.press("?")
    page.get_by_role("button", name="Log out").click()
    page.get_by_label("Name").fill("Ada")
    page.get_by_label("Password").fill("correct horse")
    page.get_by_label("Password").press("Enter")
    page.locator("#nav-events").click()
    page.locator(".event").get_by_role("button").click()
    expect(page.get_by_label("Your name")).to_have_value("Ada")
    expect(page.get_by_label("Your name")).not_to_be_editable()
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    page.context.clear_cookies()
    page = visit.go(f"#/invite/{codes['Ben']}")
    page.get_by_label("New password").fill("a staple of the battery")
    page.get_by_role("button", name="Log in").click()
    page.locator("#nav-events").click()
    page.locator(".event").get_by_role("button").click()
    expect(page.get_by_role("dialog")).to_contain_text("Ben is a viewer, and may only read.")
    # An admin invites from the page; the link leads to the form with the code.
    page.context.clear_cookies()
    page = visit.go()
    page.get_by_label("Name").fill("Cleo")
    page.get_by_label("Password").fill("not the batteries")
    page.get_by_role("button", name="Log in").click()
    expect(page.locator(".row")).to_have_count(2)
    page.keyboard.press("?")
    page.get_by_role("button", name="Invite Ben").click()
    link = page.locator(".users code").text_content() or ""
    page.context.clear_cookies()
    page = visit.go(link.removeprefix(visit.url))
    expect(page.get_by_label("Code")).to_have_value(link.rpartition("/")[2])
    visit.trouble = [text for text in visit.trouble if not text.startswith(("400", "401"))]


@pytest.fixture
def crowd(tmp_path: Path) -> Iterator[Served]:
    """A daemon with very many channels, each with two blocks."""
    served = Served(tmp_path, channels=effort_count(quick=50, full=1000))
    served.start()
    served.put(2)
    yield served
    served.stop()


def test_very_many_channels(crowd: Served, visitor: Visitor) -> None:
    page = visitor(crowd.url).go()
    expect(page.locator(".row")).to_have_count(crowd.channels)
    name = channel_name(crowd.channels - 1)
    page.get_by_label("Filter channels").fill(name)
    expect(page.locator(".row:visible")).to_have_count(1)
    expect(page.locator(".row:visible .when")).not_to_be_empty()
    page.get_by_role("link", name=name).click()
    expect(page.locator(".answers")).to_contain_text("block 2")
    crowd.put(1)
    expect(page.locator(".answers")).to_contain_text("block 3")
    page.go_back()
    expect(page.locator(".row")).to_have_count(crowd.channels)

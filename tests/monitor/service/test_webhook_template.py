"""Templates of webhooks: what arrives is JSON of the service's own form, and a wrong template is found when read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from monitor.config.outputs import WebhookSection
from monitor.config.webhook import READY, TEXTS, WebhookTemplate
from monitor.service.broker import NotifyError
from monitor.service.notify.channels import Message, WebhookChannel
from tests.support.receivers import Hook

EVENT = {"kind": "alarm_raised", "severity": "alert", "channel": "x", "text": 'RMS is "3.2" g'}
MESSAGE = Message(
    "press: <x>: alert",
    'RMS is "3.2" g & rising\nV_eq 0.01 mm³/mm\n',
    {"machine": "press", "page": "https://page.example/", "headline": "alert", "events": [EVENT], "left_out": 0},
)


def posted(message: Message, **section: Any) -> Any:
    """What a service receives of a message."""
    with Hook().serving() as server:
        channel = WebhookChannel(WebhookSection(url=f"http://127.0.0.1:{server.port}/hook", **section))
        channel.check()
        assert channel.send(message) is None
    return server.received[0][2]


def test_slack() -> None:
    assert posted(MESSAGE, template="slack") == {
        "text": '*press: &lt;x&gt;: alert*\n```RMS is "3.2" g &amp; rising\nV_eq 0.01 mm³/mm\n```'
    }


def test_mattermost() -> None:
    body = posted(MESSAGE, template="mattermost")
    assert body["text"].splitlines()[0] == "#### press: <x>: alert"
    assert body["text"].endswith("```\nhttps://page.example/")


def test_teams() -> None:
    (attachment,) = posted(MESSAGE, template="teams")["attachments"]
    texts = [item["text"] for item in attachment["content"]["body"]]
    assert texts == ["press: <x>: alert", "alert", MESSAGE.text]
    assert attachment["content"]["actions"][0]["url"] == "https://page.example/"


def test_apprise() -> None:
    body = posted(MESSAGE, template="apprise")
    assert body == {"title": MESSAGE.title, "body": MESSAGE.text, "format": "text", "type": "warning"}


def test_one_of_the_plant_and_without_one_the_whole_message() -> None:
    template = '{"to": "4711", "n": {{ events | length }}, "what": {{ events[0].text | tojson }}}'
    assert posted(MESSAGE, template='{"to": "4711", "n": {{ events | length }}, "severity": "{{ severity }}"}') == {
        "to": "4711",
        "n": 1,
        "severity": "alert",
    }
    assert posted(MESSAGE) == json.loads(MESSAGE.to_json())
    with pytest.raises(ValidationError, match="has no element 0"):
        WebhookSection(url="http://127.0.0.1/", template=template)


COMPILED = {name: WebhookTemplate(name) for name in READY}


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(sorted(READY)), st.text(max_size=50), st.text(max_size=50))
def test_ready_templates_render_any_text(name: str, title: str, text: str) -> None:
    fields = Message(title, text, dict.fromkeys(TEXTS[2:])).fields
    assert json.loads(COMPILED[name].render(fields))


@pytest.mark.parametrize(
    ("template", "expected"),
    [
        ("discord", "expected one of slack, mattermost, teams, apprise"),
        ('{"text": "{{ title }}"}', r"renders no JSON .*need \{\{ ... \| tojson \}\}"),
        ('{"text":\n {{ titel | tojson }}}', "'titel' is undefined"),
        ('{"text":\n {{ title | tojson }', "template, line 2"),
        ('{"text": {{ title | json }}}', "No filter named 'json'"),
        ('{"text": {{ "".__class__.__mro__ | tojson }}}', "SecurityError"),
    ],
)
def test_a_wrong_template_is_refused_when_the_configuration_is_read(template: str, expected: str) -> None:
    with pytest.raises(ValidationError, match=expected):
        WebhookSection(url="https://hooks.example/a", template=template)


def test_what_a_template_cannot_render_is_posted_without_it() -> None:
    # Fields of the events depend on their kind.
    template = '{"rule": {{ (events[0].rule if events and events[0].kind == "no_data" else "") | tojson }}}'
    message = Message("t", "x", {"events": [{"kind": "no_data"}]})
    with Hook().serving() as server:
        section = WebhookSection(url=f"http://127.0.0.1:{server.port}/hook", template=template)
        problem = WebhookChannel(section).send(message)
    assert problem is not None
    assert "no attribute 'rule'" in problem
    assert server.received[0][2]["title"] == "t"


def test_a_secret_address_is_in_a_file_and_never_in_an_error(tmp_path: Path) -> None:
    file = tmp_path / "address"
    channel = WebhookChannel(WebhookSection(url_file=file, template="slack"))
    with pytest.raises(NotifyError, match="cannot be read"):
        channel.check()
    with Hook(answers=[403]).serving() as server:
        file.write_text(f"http://127.0.0.1:{server.port}/T00/B00/secret\n")
        channel.check()
        with pytest.raises(NotifyError, match="answered 403") as refused:
            channel.send(MESSAGE)
        assert channel.send(MESSAGE) is None
    assert server.received[1][0] == "/T00/B00/secret"
    assert "secret" not in str(refused.value)
    for line, expected in (("http://hooks.example/secret", "in the clear"), ("gopher://127.0.0.1/secret", "https://")):
        file.write_text(line)
        with pytest.raises(NotifyError, match=expected) as refused:
            channel.check()
        assert "/secret" not in str(refused.value)
    for keys in ({}, {"url": "https://a.example/", "url_file": file}):
        with pytest.raises(ValidationError, match="one of url and url_file"):
            WebhookSection(**keys)

"""The ways of telling against real servers here: delivered whole, encrypted where it must be, refused in words."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from email.message import EmailMessage
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from monitor.config.outputs import MqttSection, NotifySection, RecordMqttSection, SmtpSection, WebhookSection
from monitor.service.notify.channels import (
    Message,
    MqttChannel,
    NotifyError,
    SmtpChannel,
    WebhookChannel,
    read_secret,
)
from tests.support.broker import Broker
from tests.support.receivers import Certificate, Hook, Mail, make_certificate, subscribed
from tests.support.waiting import wait_until

MESSAGE = Message("press: Hörizontal: danger", "RMS is 3.21 g\nV_eq 0.01 mm³/mm\n", {"events": [{"kind": "x"}]})
SECRET = "let me in"


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Certificate:
    return make_certificate(tmp_path_factory.mktemp("certificates"))


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> tuple[Certificate, ...]:
    """A certificate of another authority, one of another host, and one that has ended."""
    folder = tmp_path_factory.mktemp("others")
    elsewhere = make_certificate(folder, "elsewhere", "DNS:elsewhere.example")
    return make_certificate(folder, "stranger"), elsewhere, make_certificate(folder, "ended", expired=True)


@pytest.fixture
def secrets(tmp_path: Path) -> tuple[Path, Path]:
    user, password = tmp_path / "user", tmp_path / "password"
    user.write_text("press\n")
    password.write_text(f"{SECRET}\n")
    return user, password


def smtp(port: int, **more: Any) -> SmtpChannel:
    to = ("anna@plant.example", "ben@plant.example")
    values = {"security": "none", "sender": "watch@plant.example", "to": to, **more}
    return SmtpChannel(SmtpSection(host="127.0.0.1", port=port, **values))


def hook(port: int, scheme: str = "http", **more: Any) -> WebhookChannel:
    return WebhookChannel(WebhookSection(url=f"{scheme}://127.0.0.1:{port}/hook?a=1", **more))


def part(mail: EmailMessage, kind: str) -> EmailMessage:
    found = mail.get_body((kind,))
    assert isinstance(found, EmailMessage)
    return found


def plain(mail: EmailMessage) -> str:
    return str(part(mail, "plain").get_content()).replace("\r\n", "\n")


def test_a_mail_shows_what_is_said_with_its_picture() -> None:
    said = {"headline": "danger <b>", "sureness": "sure: x", "level": "level 3 times", "action": 'call "Ben" & Co'}
    png = b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20
    with Mail().serving() as server:
        smtp(server.port).send(replace(MESSAGE, values=said, picture=png))
    mail = server.received[0]
    assert plain(mail) == MESSAGE.text
    page = str(part(mail, "html").get_content())
    assert page.index("danger &lt;b&gt;") < page.index("sure: x") < page.index("level 3 times") < page.index("To do:")
    assert "call &quot;Ben&quot; &amp; Co" in page
    (image,) = [one for one in mail.walk() if one.get_content_type() == "image/png"]
    assert image.get_payload(decode=True) == png
    assert image.get_content_disposition() == "inline"
    (name,) = re.findall(r'<img src="cid:([^"]+)"', page)
    assert image["Content-ID"] == f"<{name}>"
    assert "http" not in page


def test_an_email_arrives_whole() -> None:
    with Mail().serving() as server:
        smtp(server.port).send(MESSAGE)
    mail = server.received[0]
    assert len(server.recipients) == 2
    assert mail["Subject"] == MESSAGE.title
    assert (mail["From"], mail["To"]) == ("watch@plant.example", "anna@plant.example, ben@plant.example")
    assert mail.get_content_type() == "multipart/alternative"
    assert plain(mail) == MESSAGE.text
    page = part(mail, "html").get_content()
    assert "V_eq 0.01 mm³/mm" in page
    assert "<img" not in page


@pytest.mark.process
@pytest.mark.parametrize("security", ["starttls", "tls"])
def test_an_email_is_encrypted_and_the_password_never_in_the_clear(
    certificate: Certificate, secrets: tuple[Path, Path], security: str
) -> None:
    server = Mail(certificate=certificate, tls=security == "tls", login=("press", SECRET))
    keys = {"username_file": secrets[0], "password_file": secrets[1]}
    with server.serving():
        smtp(server.port, security=security, ca_file=certificate.cert, **keys).send(MESSAGE)
    assert len(server.received) == 1
    assert [line.split()[0].upper() for line in server.clear] == (
        ["EHLO", "STARTTLS"] if security == "starttls" else []
    )


@pytest.mark.process
@pytest.mark.parametrize("security", ["starttls", "tls"])
@pytest.mark.parametrize("other", [0, 1, 2])
def test_a_mail_server_with_a_wrong_certificate_gets_nothing(
    others: tuple[Certificate, ...],
    certificate: Certificate,
    secrets: tuple[Path, Path],
    security: str,
    other: int,
) -> None:
    # Of another authority; and of the right one, but for another host, or ended.
    ca_file = (certificate, *others[1:])[other].cert
    server = Mail(certificate=others[other], tls=security == "tls", login=("press", SECRET))
    keys = {"ca_file": ca_file, "username_file": secrets[0], "password_file": secrets[1]}
    with server.serving(), pytest.raises(NotifyError, match="certificate verify failed"):
        smtp(server.port, security=security, **keys).send(MESSAGE)
    assert server.received == []
    assert not any("AUTH" in line.upper() for line in server.clear)


def test_a_mail_server_that_cannot_encrypt_gets_no_password(secrets: tuple[Path, Path]) -> None:
    server = Mail(login=("press", SECRET))
    keys = {"username_file": secrets[0], "password_file": secrets[1]}
    with server.serving(), pytest.raises(NotifyError, match="STARTTLS"):
        smtp(server.port, security="starttls", **keys).send(MESSAGE)
    assert not any("AUTH" in line.upper() for line in server.clear)


@pytest.mark.process
def test_a_refused_login_is_named_without_the_secret(certificate: Certificate, secrets: tuple[Path, Path]) -> None:
    # This server repeats the password in its answer.
    server = Mail(certificate=certificate, login=("press", "another"))
    keys = {"username_file": secrets[0], "password_file": secrets[1], "ca_file": certificate.cert}
    with server.serving(), pytest.raises(NotifyError, match="refuses the login") as refused:
        smtp(server.port, security="starttls", **keys).send(MESSAGE)
    assert SECRET not in str(refused.value)
    # Changed in its file, it is used with the next message.
    secrets[1].write_text("another\n")
    with server.serving():
        smtp(server.port, security="starttls", **keys).send(MESSAGE)
    assert len(server.received) == 1


def test_what_is_not_taken_is_said(tmp_path: Path) -> None:
    with Mail(refuse="@").serving() as server, pytest.raises(NotifyError, match=r"refused for anna.*ben"):
        smtp(server.port).send(MESSAGE)
    with Mail(refuse="ben@").serving() as server:
        assert smtp(server.port).send(MESSAGE) == "smtp 127.0.0.1: refused for ben@plant.example"
    assert len(server.received) == 1
    with Hook(answers=[302]).serving() as server, pytest.raises(NotifyError, match="answered 302"):
        hook(server.port).send(MESSAGE)
    assert len(server.received) == 1
    for way in (smtp(1), hook(1), MqttChannel(MqttSection(url="mqtt://127.0.0.1:1/alarms"))):
        with pytest.raises(NotifyError, match=way.name):
            way.send(MESSAGE)
    with pytest.raises(NotifyError, match="cannot be read"):
        read_secret(tmp_path / "none")
    (tmp_path / "empty").write_text("\n")
    with pytest.raises(NotifyError, match="is empty"):
        read_secret(tmp_path / "empty")


@pytest.mark.process
def test_a_webhook_gets_json_and_the_token_from_its_file(tmp_path: Path, certificate: Certificate) -> None:
    token = tmp_path / "token"
    token.write_text(f"{SECRET}\n")
    with Hook().serving() as plain, Hook(certificate=certificate).serving() as server:
        hook(plain.port).send(MESSAGE)
        hook(server.port, "https", token_file=token, ca_file=certificate.cert).send(MESSAGE)
    assert plain.received[0][1] is None
    path, authorization, body = server.received[0]
    assert (path, authorization) == ("/hook?a=1", f"Bearer {SECRET}")
    assert body == {"title": MESSAGE.title, "text": MESSAGE.text, "events": [{"kind": "x"}]}


def test_missing_files_are_known_before_they_are_needed(tmp_path: Path) -> None:
    there, gone = tmp_path / "there", tmp_path / "gone"
    there.write_text(f"{SECRET}\n")
    keys = {"username_file": there, "password_file": there}
    url = "mqtts://127.0.0.1/alarms"
    for way in (
        smtp(1, security="tls", username_file=there, password_file=gone),
        smtp(1, security="tls", ca_file=gone),
        hook(1, "https", token_file=gone),
        hook(1, "https", ca_file=there),
        MqttChannel(MqttSection(url=url, username_file=gone)),
        MqttChannel(MqttSection(url=url, ca_file=gone)),
    ):
        with pytest.raises(NotifyError, match=r"(gone|there) cannot be (read|used)") as missing:
            way.check()
        assert SECRET not in str(missing.value)
    for way in (
        smtp(1, security="tls", **keys),
        hook(1, "https", token_file=there),
        MqttChannel(MqttSection(url=url, **keys)),
    ):
        way.check()


@pytest.mark.process
@pytest.mark.parametrize("other", [0, 1, 2])
def test_a_webhook_with_a_wrong_certificate_gets_nothing(
    tmp_path: Path, certificate: Certificate, others: tuple[Certificate, ...], other: int
) -> None:
    token = tmp_path / "token"
    token.write_text(f"{SECRET}\n")
    ca_file = (certificate, *others[1:])[other].cert
    with Hook(certificate=others[other]).serving() as server:
        for keys in ({"ca_file": ca_file}, {}):
            with pytest.raises(NotifyError, match="certificate verify failed") as refused:
                hook(server.port, "https", token_file=token, **keys).send(MESSAGE)
            assert SECRET not in str(refused.value)
    assert server.received == []


@pytest.mark.broker
def test_mqtt_publishes_and_knows_that_the_broker_has_it(tmp_path: Path) -> None:
    with Broker(tmp_path / "broker") as broker, subscribed(broker.port, "plant/alarms") as heard:
        MqttChannel(MqttSection(url=f"mqtt://127.0.0.1:{broker.port}/plant/alarms")).send(MESSAGE)
        wait_until(lambda: heard)
    assert heard[0][1]["title"] == MESSAGE.title


# paho leaves the socket of a refused handshake to the garbage collector.
@pytest.mark.filterwarnings("ignore:Exception ignored in.*SSLSocket:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.broker
def test_mqtt_is_encrypted_and_asks_who_it_is(
    tmp_path: Path, certificate: Certificate, others: tuple[Certificate, ...], secrets: tuple[Path, Path]
) -> None:
    passwords = tmp_path / "passwords"
    subprocess.run(["mosquitto_passwd", "-b", "-c", passwords, "press", SECRET], check=True, capture_output=True)
    tls = (f"certfile {certificate.cert}", f"keyfile {certificate.key}")
    with Broker(tmp_path / "broker", "allow_anonymous false", f"password_file {passwords}", *tls) as broker:
        url = f"mqtts://127.0.0.1:{broker.port}/plant/alarms"
        keys: dict[str, Any] = {"username_file": secrets[0], "password_file": secrets[1], "ca_file": certificate.cert}
        MqttChannel(MqttSection(url=url, **keys)).send(MESSAGE)
        with pytest.raises(NotifyError, match="certificate verify failed"):
            MqttChannel(MqttSection(url=url, **(keys | {"ca_file": others[0].cert}))).send(MESSAGE)
        with pytest.raises(NotifyError, match="cannot be used"):
            MqttChannel(MqttSection(url=url, **(keys | {"ca_file": tmp_path / "none"}))).send(MESSAGE)
        with pytest.raises(NotifyError, match="Not authorized"):
            MqttChannel(MqttSection(url=url, ca_file=certificate.cert)).send(MESSAGE)
        wrong = tmp_path / "wrong"
        wrong.write_text("let me out\n")
        with pytest.raises(NotifyError, match="refuses") as refused:
            MqttChannel(MqttSection(url=url, **(keys | {"password_file": wrong}))).send(MESSAGE)
        assert "let me" not in str(refused.value)


@pytest.mark.parametrize(
    ("section", "values", "words"),
    [
        (MqttSection, {"url": "mqtt://broker/t", "username_file": "u", "password_file": "p"}, "needs mqtts://"),
        (MqttSection, {"url": "mqtt://anna:hidden@broker/t"}, "give a file that holds it"),
        (MqttSection, {"url": "mqtt://broker/t", "ca_file": "c"}, "ca_file belongs"),
        (MqttSection, {"url": "mqtts://broker/t", "password_file": "p"}, "needs username_file"),
        (MqttSection, {"url": "mqtt://broker/plant/#"}, "has no"),
        (RecordMqttSection, {"url": "mqtt://broker/$SYS/x"}, "does not begin with"),
        (RecordMqttSection, {"url": "mqtt://broker:port/x"}, "url"),
        (WebhookSection, {"url": "http://hooks.example/x", "token_file": "t"}, "needs https://"),
        (WebhookSection, {"url": "https://anna:hidden@hooks.example/x"}, "give a file that holds it"),
        (WebhookSection, {"url": "http://hooks.example/x", "ca_file": "t"}, "ca_file belongs"),
        (NotifySection, {"page_url": "https://anna:hidden@hooks.example/x"}, "give a file that holds it"),
        (
            SmtpSection,
            {
                "host": "mail",
                "security": "none",
                "sender": "a@b",
                "to": ["a@b"],
                "username_file": "u",
                "password_file": "p",
            },
            "needs security",
        ),
    ],
)
def test_no_secret_goes_out_in_the_clear(section: type[Any], values: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        section(**values)


def test_within_this_computer_a_secret_may_be_sent_in_the_clear() -> None:
    for host in ("127.0.0.1", "localhost", "[::1]"):
        url = f"mqtt://{host}/plant/alarms"
        assert MqttSection(url=url, username_file=Path("u"), password_file=Path("p")).topic == "plant/alarms"


def test_a_topic_is_all_that_stands_behind_the_host() -> None:
    section = RecordMqttSection(url="mqtts://broker:1/a%20b/c?d/")
    assert (section.host, section.port, section.topic, section.encrypted) == ("broker", 1, "a b/c?d", True)

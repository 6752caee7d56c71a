"""Notification channels: e-mail (SMTP), webhook (HTTP) and MQTT, the message that they deliver, and the heartbeat.

Each channel serves the section of its name in ``[notify]``. The text of no error holds a secret.
"""

from __future__ import annotations

import html
import http.client
import io
import json
import logging
import smtplib
import socket
import ssl
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from email.message import EmailMessage
from email.utils import formatdate, make_msgid
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, urlsplit

from monitor.config.outputs import NotifySection, SmtpSection, WebhookSection
from monitor.config.webhook import TEXTS, WebhookTemplate
from monitor.service.broker import BrokerLink, NotifyError, read_secret
from monitor.service.children import Worker

_LOG = logging.getLogger(__name__)
_TIMEOUT_S = 10.0
_MAX_EXCHANGE_S = 60.0
_MAX_ANSWER_BYTES = 1 << 16
_MAX_SAID_CHARACTERS = 200


@dataclass(frozen=True)
class Message:
    """A notification: one line, the whole for people, and plain values for programs."""

    title: str
    text: str
    values: Mapping[str, Any] = field(default_factory=dict)
    picture: bytes | None = None
    """A PNG for channels that show one."""

    @property
    def fields(self) -> dict[str, Any]:
        """The fields of a template: texts, "" where there is nothing to say, ``events`` and ``left_out``."""
        known = {"title": self.title, "text": self.text, "events": [], "left_out": 0, **self.values}
        known["severity"] = _severity(known["events"])
        return known | {name: known.get(name) or "" for name in TEXTS}

    def to_json(self) -> str:
        """Return it as one JSON object."""
        return json.dumps({"title": self.title, "text": self.text, **self.values}, allow_nan=False)


def _severity(events: Iterable[Mapping[str, Any]]) -> str:
    """Return ``danger``, ``alert`` or ``info``, of the worst event."""
    found = {"info"}
    for event in events:
        kind = event.get("kind")
        found |= {str(event.get("severity"))} if kind == "alarm_raised" else set()
        found |= {"danger"} if kind == "end_of_life" else {"alert"} if kind == "final_stage" else set()
    return next(severity for severity in ("danger", "alert", "info") if severity in found)


class NotificationChannel:
    """One channel of delivery, such as e-mail, as its section configures it.

    Attributes:
        name: of the channel and of its section.
        pictures: whether it shows the picture of a message.
    """

    name: str
    pictures = False
    _secrets: tuple[str, ...] = ("username_file", "password_file")

    def __init__(self, section: Any) -> None:
        """Keep the configured section."""
        self._section = section

    def check(self) -> None:
        """Read the configured files, so that a missing one raises :class:`NotifyError` before the first alarm."""
        for path in (getattr(self._section, name) for name in self._secrets):
            if path is not None:
                read_secret(path)
        if self._section.ca_file is not None:
            _tls_context(self._section.ca_file)

    def send(self, message: Message) -> str | None:
        """Deliver one message, or raise :class:`NotifyError`; return a problem in spite of the delivery, or None."""
        raise NotImplementedError


class SmtpChannel(NotificationChannel):
    """Sends one e-mail a message."""

    name = "smtp"

    def __init__(self, section: SmtpSection) -> None:
        """Keep the configured section."""
        super().__init__(section)
        self.pictures = section.picture

    def send(self, message: Message) -> str | None:
        """Send a message, or raise :class:`NotifyError`; return the rejected recipients, if not all, or None."""
        section = self._section
        mail = EmailMessage()
        mail["Subject"] = message.title
        mail["From"], mail["To"] = section.sender, ", ".join(section.to)
        mail["Date"], mail["Message-ID"] = formatdate(), make_msgid(domain=section.sender.partition("@")[2])
        # Prevents automatic replies, such as absence notes.
        mail["Auto-Submitted"] = "auto-generated"
        # Seven bits, which every server accepts.
        mail.set_content(message.text, cte="quoted-printable")
        _add_html(mail, message)
        try:
            server = self._connect()
            try:
                if section.username_file is not None and section.password_file is not None:
                    server.login(read_secret(section.username_file), read_secret(section.password_file))
                refused = server.send_message(mail)
                # What the server answers now does not undo the delivery.
                with suppress(OSError, smtplib.SMTPException):
                    server.quit()
            finally:
                server.close()
        except smtplib.SMTPRecipientsRefused as error:
            raise NotifyError(f"smtp {section.host}: refused for {', '.join(error.recipients)}") from None
        except smtplib.SMTPAuthenticationError as error:
            # The text of the server may repeat the credentials.
            raise NotifyError(f"smtp {section.host}: the server refuses the login ({error.smtp_code})") from None
        except smtplib.SMTPResponseException as error:
            said = error.smtp_error
            said = said if isinstance(said, str) else said.decode(errors="replace")
            if section.password_file is not None and read_secret(section.password_file) in said:
                said = "its text repeats the password"
            said = said[:_MAX_SAID_CHARACTERS]
            raise NotifyError(f"smtp {section.host}: answered {error.smtp_code}: {said}") from None
        except (OSError, smtplib.SMTPException, ValueError) as error:
            raise NotifyError(f"smtp {section.host}: {error}") from None
        return f"smtp {section.host}: refused for {', '.join(refused)}" if refused else None

    def _connect(self) -> smtplib.SMTP:
        section = self._section
        if section.security == "none":
            return _Smtp(section.host, section.port, timeout=_TIMEOUT_S)
        context = _tls_context(section.ca_file)
        if section.security == "tls":
            return _SmtpTls(section.host, section.port, timeout=_TIMEOUT_S, context=context)
        server = _Smtp(section.host, section.port, timeout=_TIMEOUT_S)
        try:
            server.starttls(context=context)
        except BaseException:
            server.close()
            raise
        return server


class _Answer(io.RawIOBase):
    """Reads the answers of a server; OSError where they are longer, or take longer, than any server needs."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection, self._bytes = connection, 0
        self._until = time.monotonic() + _MAX_EXCHANGE_S

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left = self._until - time.monotonic()
        if left <= 0.0:
            raise TimeoutError(f"the answer is not complete after {_MAX_EXCHANGE_S:g} s")
        if self._bytes > _MAX_ANSWER_BYTES:
            raise OSError(f"the answer has more than {_MAX_ANSWER_BYTES} bytes")
        self._connection.settimeout(min(left, _TIMEOUT_S))
        count = self._connection.recv_into(buffer)
        self._bytes += count
        return count


class _Smtp(smtplib.SMTP):
    def getreply(self) -> tuple[int, bytes]:
        if self.file is None and self.sock is not None:
            self.file = io.BufferedReader(_Answer(self.sock))
        return super().getreply()


class _SmtpTls(_Smtp, smtplib.SMTP_SSL):
    """The same, encrypted from the first byte."""


class _Response(http.client.HTTPResponse):
    def __init__(self, sock: socket.socket, *rest: Any, **options: Any) -> None:
        super().__init__(sock, *rest, **options)
        self.fp.close()
        self.fp = io.BufferedReader(_Answer(sock))


_SAID = (("headline", "font-size:17px;font-weight:600"), ("sureness", "color:#4a5058"), ("level", ""), ("action", ""))


def _add_html(mail: EmailMessage, message: Message) -> None:
    """Add the message as HTML: what is said of the channel, the picture, and the text as it stands."""
    said = [(name, style, message.values.get(name)) for name, style in _SAID]
    lines = [
        f'<p style="margin:0 0 4px;{style}">{"<b>To do:</b> " if name == "action" else ""}{html.escape(str(text))}</p>'
        for name, style, text in said
        if text
    ]
    name = make_msgid(domain="picture.invalid")
    if message.picture is not None:
        shown = "Level and lines over time, and the envelope spectrum"
        lines.append(f'<p><img src="cid:{name[1:-1]}" alt="{shown}" style="max-width:100%"></p>')
    lines.append(f'<pre style="white-space:pre-wrap">{html.escape(message.text)}</pre>')
    head = '<html><body style="font-family:sans-serif;font-size:14px;color:#22262b">'
    mail.add_alternative(f"{head}{''.join(lines)}</body></html>", subtype="html", cte="quoted-printable")
    if message.picture is not None:
        page = list(mail.iter_parts())[1]
        assert isinstance(page, EmailMessage)
        page.add_related(message.picture, "image", "png", cid=name, filename="bearing.png", disposition="inline")


class WebhookChannel(NotificationChannel):
    """Posts one request a message; redirections are not followed, as they would send the token elsewhere."""

    name = "webhook"
    _secrets = ("token_file",)

    def __init__(self, section: WebhookSection) -> None:
        """Keep the configured section."""
        super().__init__(section)
        self._template = None if section.template is None else WebhookTemplate(section.template)

    def check(self) -> None:
        """Read the configured files; raise :class:`NotifyError` where one cannot be used."""
        super().check()
        self._url()

    def send(self, message: Message) -> str | None:
        """Post a message; raise :class:`NotifyError` if the answer is not 2xx.

        A message that the template cannot render is posted without it, and the problem returned.
        """
        headers = {"Content-Type": "application/json"}
        if self._section.token_file is not None:
            headers["Authorization"] = f"Bearer {read_secret(self._section.token_file)}"
        body, problem = message.to_json(), None
        if self._template is not None:
            try:
                body = self._template.render(message.fields)
            except ValueError as error:
                problem = f"webhook: {error}; it was posted without the template"
        request("webhook", "POST", self._url(), body=body.encode(), headers=headers, ca_file=self._section.ca_file)
        return problem

    def _url(self) -> SplitResult:
        section = self._section
        if section.url_file is None:
            return urlsplit(section.url or "")
        url = read_secret(section.url_file)
        try:
            section.check_url(url)
        except ValueError as error:
            raise NotifyError(f"{section.url_file}: {error}") from None
        if not url.startswith(("https://", "http://")):
            raise NotifyError(f"{section.url_file}: expected an address that begins with https://")
        return urlsplit(url)


class MqttChannel(NotificationChannel):
    """Publishes with QoS 1, over one connection a message: alarms are too rare to stay connected."""

    name = "mqtt"

    def send(self, message: Message) -> None:
        """Publish a message; raise :class:`NotifyError` if the broker does not confirm it."""
        link = BrokerLink(self._section)
        try:
            link.connect()
            link.wait_confirmed({link.publish(self._section.topic, message.to_json())}, _TIMEOUT_S)
        finally:
            link.close()


_CHANNELS = {"smtp": SmtpChannel, "webhook": WebhookChannel, "mqtt": MqttChannel}


def configured_channels(settings: NotifySection) -> list[NotificationChannel]:
    """Return the channels whose sections are configured."""
    sections = {name: getattr(settings, name) for name in _CHANNELS}
    return [_CHANNELS[name](section) for name, section in sections.items() if section is not None]


def request(
    name: str,
    method: str,
    url: SplitResult,
    *,
    body: bytes | None = None,
    headers: Mapping[str, str] | None = None,
    ca_file: Path | None = None,
) -> None:
    """Send one request to an address; ``name`` begins the message of an error, which does not hold the address.

    Raises:
        NotifyError: it cannot be sent, or the answer is not 2xx.
    """
    where = f"{name} {url.hostname}"
    path = (url.path or "/") + (f"?{url.query}" if url.query else "")
    try:
        if url.scheme == "https":
            context = _tls_context(ca_file)
            connection: http.client.HTTPConnection = http.client.HTTPSConnection(
                url.hostname or "", url.port, timeout=_TIMEOUT_S, context=context
            )
        else:
            connection = http.client.HTTPConnection(url.hostname or "", url.port, timeout=_TIMEOUT_S)
        connection.response_class = _Response
        try:
            connection.request(method, path, body, dict(headers or {}))
            status = connection.getresponse().status
        finally:
            connection.close()
    except http.client.HTTPException as error:
        # Its text may be what the server sent, which may repeat the token.
        raise NotifyError(f"{where}: no answer of HTTP ({type(error).__name__})") from None
    except (OSError, ValueError) as error:
        raise NotifyError(f"{where}: {type(error).__name__}: {error}") from None
    if not 200 <= status < 300:
        raise NotifyError(f"{where}: answered {status}")


def _tls_context(ca_file: Path | None) -> ssl.SSLContext:
    """Return a context that verifies servers by public authorities or those in a file; NotifyError without it."""
    try:
        return ssl.create_default_context(cafile=None if ca_file is None else str(ca_file))
    except OSError as error:
        raise NotifyError(f"{ca_file} cannot be used: {error.strerror or type(error).__name__}") from None


class Heartbeat(Worker):
    """Requests the configured address when the thread that commits calls, at most once in the interval.

    The request itself is made by a thread of its own, so that a slow answer delays nothing.
    """

    def __init__(self, settings: NotifySection, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Keep address and interval; without an address, nothing is ever requested."""
        super().__init__("heartbeat")
        self._url = None if settings.heartbeat_url is None else urlsplit(settings.heartbeat_url)
        self._interval, self._monotonic = settings.heartbeat_interval_s, monotonic
        self._due = float("-inf")
        if self._url is not None:
            self.start()

    def beat(self, healthy: Callable[[], bool]) -> None:
        """Have the address requested if that is due and ``healthy``; returns at once."""
        now = self._monotonic()
        if self._url is None or now < self._due or not healthy():
            return
        self._due = now + self._interval
        self.changed()

    def close(self) -> None:
        """Request nothing more; an answer that is waited for is left to its timeout."""
        self.end()

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._news or self._ending)
                if self._ending:
                    return
            self._request()
            with self._wake:
                # What was asked for meanwhile is late: the thread that asked may hang by now.
                self._news = False

    def _request(self) -> None:
        assert self._url is not None
        try:
            request("heartbeat", "GET", self._url)
        except NotifyError as error:
            if self.problem is None:
                _LOG.error("%s", error)
            self.problem = str(error)
        except Exception as error:  # A fault of one request must not end the signal.
            self.problem = f"heartbeat: {type(error).__name__}"
            _LOG.exception("the heartbeat fails")
        else:
            self.problem = None

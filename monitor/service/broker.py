"""A connection to an MQTT broker, and the worker that publishes over one connection after the other.

Messages go with and without confirmation; there may be a will, and what was subscribed.
"""

from __future__ import annotations

import logging
import ssl
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from models.words.errors import SpallwatchError
from monitor.config.outputs import BrokerSection
from monitor.records.database import StoreError
from monitor.service.children import Worker
from streams.link.mqtt_client import end_client, loss, new_client, start_client

_LOG = logging.getLogger(__name__)
_MIN_PAUSE_S, _MAX_PAUSE_S = 1.0, 60.0
TIMEOUT_S = 10.0
"""Seconds that a connection may take."""
_KEEPALIVE = 15
_IN_FLIGHT = 100
_MAX_MESSAGES = 100
_MAX_MESSAGE_BYTES = 1 << 16
_MAX_SECRET_CHARACTERS = 4096


class NotifyError(SpallwatchError):
    """A message could not be delivered, or a configured file cannot be used."""


class BrokerError(NotifyError):
    """The broker cannot be reached, refuses, or is lost; no secret is in the text."""


def read_secret(path: Path) -> str:
    """Return the first line of a file, read for each message, as secrets change; NotifyError where there is none."""
    try:
        with path.open(encoding="utf-8") as file:
            line = file.readline(_MAX_SECRET_CHARACTERS).strip()
    except (OSError, UnicodeDecodeError) as error:
        raise NotifyError(f"{path} cannot be read: {type(error).__name__}") from None
    if not line:
        raise NotifyError(f"the first line of {path} is empty")
    return line


class BrokerLink:
    """One connection; after its loss, a new link is needed. Messages are sent with QoS 1 by default.

    All methods but :meth:`close` raise :class:`BrokerError` where the connection is lost.
    """

    def __init__(
        self,
        section: BrokerSection,
        *,
        will: tuple[str, str | bytes] | None = None,
        keep_will: bool = True,
        wake: Callable[[], None] = lambda: None,
    ) -> None:
        """Read the credentials; nothing is connected yet.

        The broker publishes ``will`` (topic and payload), retained if ``keep_will``, when the connection breaks;
        ``wake`` is called from another thread when a message is confirmed or came, or the connection is lost.

        Raises:
            BrokerError: paho-mqtt is missing, or a certificate cannot be read.
        """
        self._section, self._wake = section, wake
        self._where = f"mqtt {section.host}:{section.port}"
        self._state = threading.Condition()
        self._accepted = False
        self._lost: str | None = None
        self._confirmed: set[int] = set()
        self._messages: list[tuple[str, bytes]] = []
        try:
            client = new_client(_MAX_MESSAGE_BYTES, reconnect_on_failure=False)
        except ModuleNotFoundError:
            raise BrokerError('mqtt needs paho-mqtt: pip install "spallwatch[mqtt]"') from None
        client.connect_timeout = TIMEOUT_S
        client.max_inflight_messages_set(_IN_FLIGHT)
        if section.username_file is not None:
            password = None if section.password_file is None else read_secret(section.password_file)
            client.username_pw_set(read_secret(section.username_file), password)
        if section.encrypted:
            try:
                ca_file = None if section.ca_file is None else str(section.ca_file)
                client.tls_set_context(ssl.create_default_context(cafile=ca_file))
            except OSError as error:
                raise BrokerError(f"{self._where}: {section.ca_file} cannot be used: {error}") from None
        if will is not None:
            client.will_set(*will, qos=1, retain=keep_will)
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect
        client.on_publish, client.on_message = self._on_publish, self._on_message
        self._client: Any = client

    def connect(self) -> None:
        """Connect, and wait until the broker accepts the connection."""
        try:
            self._client.connect(self._section.host, self._section.port, _KEEPALIVE)
        except (OSError, ValueError) as error:
            raise BrokerError(f"{self._where}: {error}") from None
        start_client(self._client, lambda cause: self._lose(loss(self._client, cause)))
        with self._state:
            answered = self._state.wait_for(lambda: self._accepted or self._lost is not None, TIMEOUT_S)
        if not answered:
            raise BrokerError(f"{self._where}: the broker does not answer")
        self.check()

    def check(self) -> None:
        """Raise if the connection is lost."""
        with self._state:
            if self._lost is not None:
                raise BrokerError(f"{self._where}: {self._lost}")

    def publish(self, topic: str, payload: str | bytes, *, retain: bool = False, qos: int = 1) -> int:
        """Send a message; return the number of its confirmation, which with ``qos`` 0 says only that it was sent."""
        self.check()
        try:
            return self._client.publish(topic, payload, qos=qos, retain=retain).mid
        except (OSError, ValueError, RuntimeError) as error:
            raise BrokerError(f"{self._where}: {error}") from None

    def subscribe(self, topic: str) -> None:
        """Ask for the messages of a topic, with QoS 1."""
        self.check()
        try:
            self._client.subscribe(topic, qos=1)
        except (OSError, ValueError, RuntimeError) as error:
            raise BrokerError(f"{self._where}: {error}") from None

    def take_messages(self) -> list[tuple[str, bytes]]:
        """Return topic and payload of the messages that came since the last call, at most the latest hundred."""
        with self._state:
            found, self._messages = self._messages, []
        return found

    def take_confirmed(self) -> set[int]:
        """Return the numbers of the messages confirmed since the last call."""
        with self._state:
            found, self._confirmed = self._confirmed, set()
        return found

    def wait_confirmed(self, numbers: set[int], timeout: float) -> None:
        """Wait until messages are confirmed; raise :class:`BrokerError` after the timeout (s)."""
        until, waiting = time.monotonic() + timeout, set(numbers)
        with self._state:
            while waiting - self._confirmed and self._lost is None:
                if not self._state.wait(max(0.0, until - time.monotonic())) and time.monotonic() >= until:
                    raise BrokerError(f"{self._where}: the broker does not confirm")
            waiting -= self._confirmed
        if waiting:
            self.check()

    def close(self) -> None:
        """Disconnect; unconfirmed messages may have arrived or not."""
        end_client(self._client)

    def _on_connect(self, client: Any, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:
        with self._state:
            if reason.is_failure:
                self._lost = f"the broker refuses: {reason}"
            self._accepted = not reason.is_failure
            self._state.notify_all()

    def _on_disconnect(self, client: Any, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:
        self._lose(loss(client, reason))

    def _lose(self, reason: str) -> None:
        with self._state:
            self._lost = self._lost or reason
            self._state.notify_all()
        self._wake()

    def _on_message(self, client: Any, userdata: Any, message: Any) -> None:
        if len(message.payload) > _MAX_MESSAGE_BYTES:
            return
        with self._state:
            self._messages = [*self._messages[1 - _MAX_MESSAGES :], (message.topic, message.payload)]
        self._wake()

    def _on_publish(self, client: Any, userdata: Any, number: int, reason: Any, properties: Any) -> None:
        with self._state:
            self._confirmed.add(number)
            self._state.notify_all()
        self._wake()


class Sessions(Worker):
    """Base of what publishes to a broker; a failure is a :attr:`problem`, never an exception.

    A subclass gives ``_session``, one connection until its loss or the end, and starts the thread.
    """

    _expected: tuple[type[Exception], ...] = (NotifyError, StoreError)
    """What a session may raise; anything else ends the thread, which its owner starts again."""

    def __init__(self, name: str, over: str, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Set up without a thread; ``name`` is that of the thread, ``over`` completes "publishing ..." in the log."""
        super().__init__(name)
        self._over_what, self._monotonic = over, monotonic
        self._connected, self._news, self._until = False, True, float("inf")

    def close(self, seconds: float = 0.5) -> None:
        """Publish for at most so many seconds more, then end."""
        self._until = self._monotonic() + seconds
        self.end()
        self.join(seconds)

    def _session(self) -> None:
        """Publish over one connection, until the end or its loss."""
        raise NotImplementedError

    def _over(self) -> bool:
        """Return whether no further session begins."""
        return self._ending

    def _work(self) -> None:
        pause = _MIN_PAUSE_S
        while not self._over():
            try:
                self._session()
            except self._expected as error:
                self._fail(str(error))
            else:
                return
            with self._wake:
                if self._wake.wait_for(lambda: self._ending, pause):
                    return
            pause = _MIN_PAUSE_S if self._connected else min(2.0 * pause, _MAX_PAUSE_S)

    def _fail(self, problem: str) -> None:
        if self.problem is None and not self._ending:
            _LOG.error("publishing %s fails, it is tried again: %s", self._over_what, problem)
        self.problem = problem

    def _works(self) -> None:
        """Note that the connection is made."""
        if self.problem is not None:
            _LOG.warning("publishing %s works again", self._over_what)
        self._connected, self.problem = True, None

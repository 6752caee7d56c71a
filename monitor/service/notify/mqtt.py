"""MQTT: the message as JSON, published with QoS 1."""

from __future__ import annotations

import ssl
import time
from urllib.parse import unquote, urlsplit

from monitor.alarm_config import MqttSection
from monitor.service.notify.channels import TIMEOUT, Message, NotifyError, read_secret


class MqttWay:
    """Connects, publishes, waits for the broker's receipt, and disconnects: alarms are too rare to stay connected."""

    name = "mqtt"

    def __init__(self, section: MqttSection) -> None:
        """Take the configured broker and topic."""
        self._section = section
        self._url = urlsplit(section.url)

    def send(self, message: Message) -> None:
        """Publish it; :class:`NotifyError` where the broker does not confirm."""
        try:
            from paho.mqtt.client import Client
            from paho.mqtt.enums import CallbackAPIVersion
        except ModuleNotFoundError:
            raise NotifyError('mqtt needs paho-mqtt: pip install "spallwatch[mqtt]"') from None
        section, where = self._section, f"mqtt {self._url.hostname}"
        client = Client(CallbackAPIVersion.VERSION2)
        client.connect_timeout = TIMEOUT
        try:
            if section.username_file is not None:
                password = None if section.password_file is None else read_secret(section.password_file)
                client.username_pw_set(read_secret(section.username_file), password)
            if self._url.scheme == "mqtts":
                ca_file = None if section.ca_file is None else str(section.ca_file)
                client.tls_set_context(ssl.create_default_context(cafile=ca_file))
            client.connect(self._url.hostname or "", self._url.port or (8883 if self._url.scheme == "mqtts" else 1883))
            client.loop_start()
            try:
                receipt = client.publish(unquote(self._url.path[1:]), message.to_json(), qos=1)
                until = time.monotonic() + TIMEOUT
                while not receipt.is_published() and time.monotonic() < until:
                    time.sleep(0.02)
                confirmed = receipt.is_published()
            finally:
                client.disconnect()
                client.loop_stop()
        except (OSError, ValueError, RuntimeError) as error:
            raise NotifyError(f"{where}: {error}") from None
        if not confirmed:
            raise NotifyError(f"{where}: the broker does not confirm")

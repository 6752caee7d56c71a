"""MQTT: the message as JSON, published with QoS 1."""

from __future__ import annotations

from monitor.config.notify import MqttSection
from monitor.service.broker import TIMEOUT_S, BrokerError, BrokerLink
from monitor.service.notify.channels import Message, NotifyError, check_files, read_secret


class Channel:
    """One connection a message: alarms are too rare to stay connected."""

    name = "mqtt"

    def __init__(self, section: MqttSection) -> None:
        """Keep the configured broker and topic."""
        self._section = section

    def check(self) -> None:
        """Read the configured files; raise :class:`NotifyError` where one cannot be used."""
        section = self._section
        check_files(section.ca_file, section.username_file, section.password_file)

    def send(self, message: Message) -> None:
        """Publish a message; raise :class:`NotifyError` if the broker does not confirm it."""
        try:
            link = BrokerLink(self._section, read_secret)
            try:
                link.connect()
                link.wait_confirmed({link.publish(self._section.topic, message.to_json())}, TIMEOUT_S)
            finally:
                link.close()
        except BrokerError as error:
            raise NotifyError(str(error)) from None

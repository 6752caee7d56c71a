"""Webhook: the message as JSON in a POST request."""

from __future__ import annotations

import http.client
from urllib.parse import urlsplit

from monitor.config.notify import WebhookSection
from monitor.service.notify.channels import TIMEOUT_S, Message, NotifyError, check_files, read_secret, tls_context


class Channel:
    """One request a message; redirections are not followed, as they would send the token elsewhere."""

    name = "webhook"

    def __init__(self, section: WebhookSection) -> None:
        """Keep the configured address."""
        self._section = section
        self._url = urlsplit(section.url)

    def check(self) -> None:
        """Read the configured files; raise :class:`NotifyError` where one cannot be used."""
        check_files(self._section.ca_file, self._section.token_file)

    def send(self, message: Message) -> None:
        """Post a message; raise :class:`NotifyError` if the answer is not 2xx."""
        headers = {"Content-Type": "application/json"}
        if self._section.token_file is not None:
            headers["Authorization"] = f"Bearer {read_secret(self._section.token_file)}"
        where = f"webhook {self._url.hostname}"
        path = (self._url.path or "/") + (f"?{self._url.query}" if self._url.query else "")
        try:
            connection = self._connection()
            try:
                connection.request("POST", path, message.to_json().encode(), headers)
                status = connection.getresponse().status
            finally:
                connection.close()
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise NotifyError(f"{where}: {type(error).__name__}: {error}") from None
        if not 200 <= status < 300:
            raise NotifyError(f"{where}: answered {status}")

    def _connection(self) -> http.client.HTTPConnection:
        host = self._url.hostname or ""
        if self._url.scheme == "https":
            context = tls_context(self._section.ca_file)
            return http.client.HTTPSConnection(host, self._url.port, timeout=TIMEOUT_S, context=context)
        return http.client.HTTPConnection(host, self._url.port, timeout=TIMEOUT_S)

"""E-mail over SMTP."""

from __future__ import annotations

import smtplib
from email.message import EmailMessage
from email.utils import formatdate, make_msgid

from monitor.config.notify import SmtpSection
from monitor.service.notify.channels import TIMEOUT_S, Message, NotifyError, check_files, read_secret, tls_context


class Channel:
    """Sends one e-mail a message."""

    name = "smtp"

    def __init__(self, section: SmtpSection) -> None:
        """Keep the configured server and addresses."""
        self._section = section

    def check(self) -> None:
        """Read the configured files; raise :class:`NotifyError` where one cannot be used."""
        section = self._section
        check_files(section.ca_file, section.username_file, section.password_file)

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
        try:
            with self._connect() as server:
                if section.username_file is not None and section.password_file is not None:
                    server.login(read_secret(section.username_file), read_secret(section.password_file))
                refused = server.send_message(mail)
        except smtplib.SMTPRecipientsRefused as error:
            raise NotifyError(f"smtp {section.host}: refused for {', '.join(error.recipients)}") from None
        except smtplib.SMTPAuthenticationError as error:
            # The text of the server may repeat the credentials.
            raise NotifyError(f"smtp {section.host}: the server refuses the login ({error.smtp_code})") from None
        except (OSError, smtplib.SMTPException, ValueError) as error:
            raise NotifyError(f"smtp {section.host}: {error}") from None
        return f"smtp {section.host}: refused for {', '.join(refused)}" if refused else None

    def _connect(self) -> smtplib.SMTP:
        section = self._section
        if section.security == "none":
            return smtplib.SMTP(section.host, section.port, timeout=TIMEOUT_S)
        context = tls_context(section.ca_file)
        if section.security == "tls":
            return smtplib.SMTP_SSL(section.host, section.port, timeout=TIMEOUT_S, context=context)
        server = smtplib.SMTP(section.host, section.port, timeout=TIMEOUT_S)
        try:
            server.starttls(context=context)
        except BaseException:
            server.close()
            raise
        return server

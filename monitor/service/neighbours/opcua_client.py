"""The process that reads speed and load from the nodes of an OPC UA server, a child of the daemon."""

from __future__ import annotations

import asyncio
import json
import logging
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from monitor.config.opcua import OpcUaCondition
from monitor.service.child_process import end_with_parent, report_line
from monitor.service.neighbours.opcua_server import MISSING, OpcUaError
from monitor.service.notify.channels import NotifyError, read_secret

if TYPE_CHECKING:
    from asyncua.client.client import Client
    from asyncua.crypto.uacrypto import CertProperties

Report = Callable[[dict[str, Any]], object]

_TIMEOUT_S = 5.0
_MIN_PAUSE_S, _MAX_PAUSE_S = 1.0, 20.0


async def follow(section: OpcUaCondition, report: Report) -> None:
    """Read the nodes at intervals until the task is cancelled; connect again after a failure.

    ``report`` is called with ``reading``, [UTC s, Hz or None, N or None], and ``problem``, a sentence or None.

    Raises:
        OpcUaError: asyncua is missing, or a configured file cannot be used.
    """
    try:
        from asyncua import ua
        from asyncua.client.client import Client
    except ModuleNotFoundError:
        raise OpcUaError(MISSING) from None
    pause = _MIN_PAUSE_S
    while True:
        client = Client(section.url, timeout=_TIMEOUT_S)
        try:
            await _secure(client, section)
            async with client:
                pause = _MIN_PAUSE_S
                await _read(client, section, report)
        except NotifyError as error:
            raise OpcUaError(str(error)) from None
        except (ua.UaError, OSError, TimeoutError, ConnectionError) as error:
            report({"problem": f"{section.url}: {type(error).__name__}: {error}".rstrip(": ")})
        await asyncio.sleep(pause)
        pause = min(2.0 * pause, _MAX_PAUSE_S)


async def _secure(client: Client, section: OpcUaCondition) -> None:
    from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
    from asyncua.crypto.uacrypto import load_certificate
    from cryptography.x509 import ExtensionNotFound, SubjectAlternativeName, UniformResourceIdentifier

    if section.username_file is not None and section.password_file is not None:
        client.set_user(read_secret(section.username_file))
        client.set_password(read_secret(section.password_file))
    if section.cert_file is None or section.key_file is None or section.server_cert_file is None:
        return
    try:
        cert, key, theirs = map(_content, (section.cert_file, section.key_file, section.server_cert_file))
        # Servers compare the name of an application with the one in its certificate.
        extensions = (await load_certificate(cert.path_or_content, cert.extension)).extensions
        names = extensions.get_extension_for_class(SubjectAlternativeName).value
        uris = names.get_values_for_type(UniformResourceIdentifier)
        if not uris:
            raise ValueError("the certificate has no URI among its names")
        client.application_uri = uris[0]
        await client.set_security(SecurityPolicyBasic256Sha256, cert, key, server_certificate=theirs)
    except ExtensionNotFound:
        raise OpcUaError(f"{section.cert_file}: the certificate has no names; expected a URI among them") from None
    except (OSError, ValueError, TypeError) as error:
        raise OpcUaError(f"[operating.opcua] cert_file, key_file, server_cert_file: cannot be used ({error})") from None


def _content(path: Path) -> CertProperties:
    """Return the content of a certificate or a key, PEM or DER whatever the name of the file."""
    from asyncua.crypto.uacrypto import CertProperties

    content = path.read_bytes()
    return CertProperties(content, "pem" if content.startswith(b"-----BEGIN") else "der")


async def _read(client: Client, section: OpcUaCondition, report: Report) -> None:
    """Read until the connection is lost."""
    wanted = ((section.speed_node, section.speed_scale), (section.load_node, section.load_scale))
    while True:
        utc, problem = time.time(), None
        found: list[float | None] = []
        for name, scale in wanted:
            value, reason = (None, None) if name is None else await _value(client, name, scale)
            found.append(value)
            problem = problem or reason
        report({"reading": [utc, *found], "problem": problem})
        await asyncio.sleep(section.interval_s)


async def _value(client: Client, name: str, scale: float) -> tuple[float | None, str | None]:
    """Return the value of a node times a scale, or None and why there is none: only a good one counts."""
    data = await client.get_node(name).read_data_value(raise_on_bad_status=False)
    value = None if data.Value is None else data.Value.Value
    if data.StatusCode is not None and not data.StatusCode.is_good():
        return None, f"{name}: its quality is {data.StatusCode.name}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None, f"{name}: expected a number, found {type(value).__name__}"
    return float(value) * scale, None


def child() -> None:
    """Read until standard input ends; report on standard output, one JSON object a line.

    The argument is a JSON object: ``section``.
    """
    section = OpcUaCondition.model_validate(json.loads(sys.argv[1])["section"])
    end_with_parent()
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)

    try:
        asyncio.run(follow(section, report_line))
    except OpcUaError as error:
        report_line({"problem": str(error)})
        sys.exit(1)

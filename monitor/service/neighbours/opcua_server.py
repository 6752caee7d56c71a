"""The process of the OPC UA server, a child of the daemon: one tree of a machine, for reading alone."""

from __future__ import annotations

import asyncio
import hmac
import json
import logging
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.platform.portable import lower_priority
from models.words.errors import WrongInputError
from monitor import __version__
from monitor.config.load import Config, ConfigError, load_config
from monitor.config.outputs import OpcUaSection
from monitor.service.broker import NotifyError, read_secret
from monitor.service.children import end_with_parent, report_line
from monitor.service.neighbours.points import Kind, MachinePoint, PointPath, Snapshots, channels_of, points_of

if TYPE_CHECKING:
    from asyncua.common.node import Node
    from asyncua.server.server import Server

Report = Callable[[dict[str, Any]], object]

MISSING = 'opcua needs asyncua: pip install "spallwatch[opcua]"'
_NAMESPACE = "urn:spallwatch:"
_POLL_S = 1.0
_ALIVE_S = 5.0
_QUALITY = {
    "good": "Good",
    "uncertain": "UncertainSubNormal",
    "old": "UncertainLastUsableValue",
    "bad": "BadNoData",
}
"""Status codes of OPC UA by the quality of a point."""
_TYPES: dict[Kind, str] = {"float": "Double", "int": "Int64", "text": "String"}


class OpcUaError(WrongInputError):
    """Nothing can be served; the message says why, and holds no secret."""


class MachineServer:
    """An OPC UA server with the points of a machine; within one event loop."""

    def __init__(self, config: Config, section: OpcUaSection, poll_s: float = _POLL_S) -> None:
        """Keep configuration and section; the store is looked at every ``poll_s``. :meth:`serve` does the rest."""
        self._poll_s = poll_s
        self._machine, self._section = config.machine.name, section
        self._channels = channels_of(config)
        sources = (channel.source for channel in self._channels)
        self._snapshots = Snapshots(self._machine, sources, config.machine.state_dir)
        self._nodes: dict[PointPath, Node] = {}
        self._written: dict[PointPath, MachinePoint] = {}

    async def serve(self, report: Report) -> None:
        """Serve until the task is cancelled; ``report`` is called with ``url``, then with ``alive`` now and then.

        Raises:
            OpcUaError: asyncua is missing, a file cannot be used, or the address is taken.
        """
        try:
            from monitor.service.neighbours.opcua_front import LimitedServer
        except ModuleNotFoundError:
            raise OpcUaError(MISSING) from None
        section = self._section
        server = LimitedServer(_Users(section))
        await server.init()
        server.set_endpoint(section.url)
        server.set_server_name(f"spallwatch {self._machine}")
        await server.set_application_uri(f"{_NAMESPACE}{self._machine}")
        with suppress(ValueError):
            await server.set_build_info(
                "urn:spallwatch", "spallwatch", "spallwatch", __version__, "", datetime.now(UTC).replace(tzinfo=None)
            )
        await self._secure(server)
        await self._build(server)
        await self._write(server)
        try:
            await server.start()
        except OSError as error:
            raise OpcUaError(f"{section.url}: cannot be listened on ({error.strerror or error})") from None
        try:
            report({"url": section.url})
            told = 0.0
            while True:
                await asyncio.sleep(self._poll_s)
                await self._write(server)
                told += self._poll_s
                if told >= _ALIVE_S:
                    report({"alive": True, "listener": server.connections()})
                    told = 0.0
        finally:
            await server.stop()

    async def _secure(self, server: Server) -> None:
        """Set what connections and users are accepted."""
        from asyncua.crypto.truststore import TrustStore
        from asyncua.crypto.validator import CertificateValidator, CertificateValidatorOptions

        section, ua = self._section, _ua()
        if section.username_file is not None:
            server.set_identity_tokens([ua.UserNameIdentityToken])
        else:
            server.set_identity_tokens([ua.AnonymousIdentityToken])
        if section.cert_file is None or section.key_file is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
            return
        policies = ua.SecurityPolicyType
        server.set_security_policy([policies.Basic256Sha256_SignAndEncrypt, policies.Aes256Sha256RsaPss_SignAndEncrypt])
        for load, path in ((server.load_certificate, section.cert_file), (server.load_private_key, section.key_file)):
            try:
                content = await asyncio.to_thread(path.read_bytes)
                await load(content, format="pem" if content.startswith(b"-----BEGIN") else "der")
            except (OSError, ValueError, TypeError) as error:
                raise OpcUaError(f"{path}: cannot be used ({type(error).__name__})") from None
        if section.trusted_dir is not None:
            store = TrustStore([section.trusted_dir], [])
            try:
                await store.load()
            except (OSError, ValueError) as error:
                raise OpcUaError(f"{section.trusted_dir}: cannot be used ({type(error).__name__})") from None
            options = CertificateValidatorOptions
            wanted = options.TIME_RANGE | options.TRUSTED | options.PEER_CLIENT
            server.set_certificate_validator(CertificateValidator(wanted, store))

    async def _build(self, server: Server) -> None:
        """Make the nodes: objects by machine, bearing and channel, a variable for each point."""
        ua = _ua()
        space = await server.register_namespace(f"{_NAMESPACE}{self._machine}:records")
        objects: dict[PointPath, Node] = {}

        async def parent_of(path: PointPath) -> Node:
            if path not in objects:
                above = await parent_of(path[:-1]) if path else server.nodes.objects
                name = path[-1] if path else self._machine
                objects[path] = await above.add_object(
                    ua.NodeId("/".join((self._machine, *path)), space), ua.QualifiedName(name, space)
                )
            return objects[path]

        for path, point in points_of(self._channels, self._snapshots.read()).items():
            place = await parent_of(path[:-1])
            # Names hold neither a slash nor a colon.
            identifier = f"{'/'.join((self._machine, *path[:-1]))}:{path[-1]}"
            kind = ua.VariantType[_TYPES[point.kind]]
            first = "" if point.kind == "text" else 0
            self._nodes[path] = await place.add_variable(
                ua.NodeId(identifier, space), ua.QualifiedName(path[-1], space), first, varianttype=kind
            )

    async def _write(self, server: Server) -> None:
        """Write the points that have changed."""
        ua = _ua()
        # The store may be slow to read, and clients are answered meanwhile.
        snapshot = await asyncio.to_thread(self._snapshots.read)
        for path, point in points_of(self._channels, snapshot).items():
            if self._written.get(path) == point:
                continue
            kind = ua.VariantType[_TYPES[point.kind]]
            value = ua.Variant(None, ua.VariantType.Null) if point.value is None else ua.Variant(point.value, kind)
            await server.write_attribute_value(
                self._nodes[path].nodeid,
                ua.DataValue(
                    Value=value,
                    StatusCode=ua.StatusCode(getattr(ua.StatusCodes, _QUALITY[point.quality])),
                    SourceTimestamp=_utc(point.time),
                    ServerTimestamp=datetime.now(UTC).replace(tzinfo=None),
                ),
            )
            self._written[path] = point


class _Users:
    """Who may read; no one is an administrator. The files are read at each sign-in."""

    def __init__(self, section: OpcUaSection) -> None:
        self._section = section
        try:
            for path in (section.username_file, section.password_file):
                if path is not None:
                    read_secret(path)
        except NotifyError as error:
            raise OpcUaError(str(error)) from None

    def get_user(
        self, iserver: object, username: str | None = None, password: str | bytes | None = None, certificate: Any = None
    ) -> Any:
        """Return a user who may read, or None."""
        from asyncua.crypto.permission_rules import User, UserRole

        section = self._section
        if section.username_file is None or section.password_file is None:
            return User(role=UserRole.User)
        given = password.encode() if isinstance(password, str) else password or b""
        try:
            wanted = read_secret(section.username_file), read_secret(section.password_file)
        except NotifyError:
            return None
        same = hmac.compare_digest((username or "").encode(), wanted[0].encode())
        same &= hmac.compare_digest(given, wanted[1].encode())
        return User(role=UserRole.User, name=username) if same else None


def _ua() -> Any:
    """Return the types of OPC UA; without their stubs, which ask for wrappers where plain values do."""
    from asyncua import ua

    return ua


def _utc(time: float | None) -> datetime | None:
    try:
        return None if time is None else datetime.fromtimestamp(time, UTC).replace(tzinfo=None)
    except (OverflowError, OSError, ValueError):
        return None


def child() -> None:
    """Serve until standard input ends; report on standard output, one JSON object a line.

    The argument is a JSON object: ``config``, a file.
    """
    given: Mapping[str, str] = json.loads(sys.argv[1])
    # The thread that commits has priority.
    lower_priority()
    end_with_parent()
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(asctime)s %(levelname)s opcua: %(message)s")
    # A client that is refused or goes away is none of our failures.
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)

    try:
        config = load_config(Path(given["config"]))
        asyncio.run(MachineServer(config, config.publish.opcua or OpcUaSection()).serve(report_line))
    except (OpcUaError, ConfigError) as error:
        report_line({"problem": str(error)})
        sys.exit(1)

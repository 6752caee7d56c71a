"""What clients may ask of the OPC UA server: asyncua behind limits of its bytes, connections, sessions and items.

asyncua 2.1 keeps a chunk however large its header says it is, every registered server, every session that a connection
creates, and as many monitored items as are asked for. docs/reference/daemon.md has the table of the limits.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Iterable
from functools import partial
from socket import socket
from typing import Any

from asyncua import ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import Buffer, ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.server import Server
from asyncua.server.subscription_service import SubscriptionService
from asyncua.ua.status_codes import StatusCodes
from asyncua.ua.ua_binary import header_from_binary

from streams.link.entrance import Entrance
from streams.link.front import BACKLOG, Bucket, Cause, Door, FullError, client_of

MAX_CHUNK_BYTES, MAX_MESSAGE_BYTES = 65_535, 1 << 19
MAX_CONNECTIONS, MAX_SUBSCRIPTIONS, MAX_ITEMS = 128, 256, 20_000
"""In all; one client has at most half of them."""
IDLE_S = 15.0
"""Time to activate a session, and of a connection without one."""
MAX_SESSION_S = 120.0
_MAX_HELLO_BYTES, _MIN_BUFFER_BYTES = 8192, 8192
_MESSAGES_PER_S, _BURST, _MAX_QUEUED = 500.0, 1000.0, 64
_MAX_UNREAD_BYTES, _MAX_UNREAD_S = 1 << 18, 10.0
_RESUME_S = 0.02
_MAX_ITEM_QUEUE = 100
_MIN_INTERVAL_MS, _MAX_INTERVAL_MS = 20.0, 3.6e6
_HEAD = struct.Struct("<3scI")
_HELLO = struct.Struct("<IIIII")


class LimitedServer(Server):
    """A server of asyncua with limits."""

    def __init__(self, user_manager: Any) -> None:
        """Take who may read."""
        super().__init__(iserver=_Services(user_manager))
        self.limits = TransportLimits(
            MAX_CHUNK_BYTES, MAX_CHUNK_BYTES, MAX_MESSAGE_BYTES // MAX_CHUNK_BYTES + 1, MAX_MESSAGE_BYTES
        )

    def connections(self) -> dict[str, Any]:
        """Return the counts of connections."""
        assert isinstance(self.bserver, Listener)
        return self.bserver.door.counts()

    async def start(self) -> None:
        """Listen, as the class above does, with limits for each connection."""
        await self._setup_server_nodes()
        await self.iserver.start()
        host, port = self._get_bind_socket_info()
        self.bserver = Listener(self.iserver, host or "", port or 0, self.limits)
        self.bserver.set_policies(self._policies)
        try:
            await self.bserver.start()
        except Exception:
            await self.iserver.stop()
            raise


class Listener(BinaryServer):
    """The listening socket, with its connections in :attr:`door`."""

    def __init__(self, *given: Any) -> None:
        """Take what the class above does."""
        super().__init__(*given)
        self._sockets: list[socket] = []
        self._entrances: list[asyncio.Task[None]] = []
        self.door: Door[LimitedConnection] = Door(
            MAX_CONNECTIONS, MAX_CONNECTIONS // 2, lambda connection: connection.idleness
        )

    async def start(self) -> None:
        """Listen as the class above does, but accept through an :class:`Entrance`."""
        made = await asyncio.get_running_loop().create_server(
            self._make_protocol, self.hostname, self.port, start_serving=False
        )
        self._server = made
        # The server owns the bound sockets, these are of the same.
        self._sockets = [found.dup() for found in made.sockets]
        for found in self._sockets:
            found.listen(BACKLOG)
        self.port = self._sockets[0].getsockname()[1]
        self._entrances = [
            asyncio.create_task(Entrance(found, self.door, self._make_protocol).run()) for found in self._sockets
        ]
        self.cleanup_task = asyncio.create_task(self._close_task_loop())

    async def stop(self) -> None:
        """End all connections."""
        for entrance in self._entrances:
            entrance.cancel()
        await asyncio.gather(*self._entrances, return_exceptions=True)
        for found in self._sockets:
            found.close()
        await super().stop()

    def _make_protocol(self) -> OPCUAProtocol:
        return LimitedConnection(
            self.door,
            iserver=self.iserver,
            policies=self._policies,
            clients=self.clients,
            closing_tasks=self.closing_tasks,
            limits=self.limits,
        )


class LimitedConnection(OPCUAProtocol):
    """One connection; what is too large is refused by its head, before it is kept."""

    def __init__(self, door: Door[LimitedConnection], **given: Any) -> None:
        """Wait for the hello."""
        super().__init__(**given)
        self._door = door
        self._received = bytearray()
        self._chunk_bytes: int | None = None
        """Agreed on by the hello; None before it."""
        self._opening = False
        self._bucket = Bucket(_MESSAGES_PER_S, _BURST)
        self._heard = 0.0
        self._read = asyncio.Event()
        self._read.set()
        self._timers: dict[str, asyncio.TimerHandle] = {}

    @property
    def idleness(self) -> tuple[int, float] | None:
        """How readily the connection makes room: the less far on the way to a session, then one that is silent."""
        if not self._active:
            on_the_way = self.processor is not None and self.processor.session is not None
            return (2 if on_the_way else 1 if self._opening else 0), self._heard
        return (3, self._heard) if asyncio.get_running_loop().time() - self._heard > MAX_SESSION_S / 2 else None

    @property
    def _active(self) -> bool:
        session = None if self.processor is None else self.processor.session
        return session is not None and session.is_activated()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count the connection; end another one for it, or refuse it."""
        self._heard = asyncio.get_running_loop().time()
        address = str((transport.get_extra_info("peername") or ("",))[0])
        try:
            idlest = self._door.room_for(address)
        except FullError:
            transport.close()
            return
        if idlest is not None:
            idlest.end("replaced")
        self._door.add(self, address)
        assert isinstance(transport, asyncio.Transport)
        transport.set_write_buffer_limits(high=_MAX_UNREAD_BYTES)
        super().connection_made(transport)
        self._after("idle", IDLE_S, self._end_if_idle)

    def connection_lost(self, ex: BaseException | None) -> None:
        """Count it no more, and one that broke off as such."""
        if ex is not None:
            self._door.refused["lost"] += 1
        self._door.remove(self)
        for timer in self._timers.values():
            timer.cancel()
        self._timers.clear()
        super().connection_lost(ex)

    def end(self, cause: Cause | None = None) -> None:
        """End the connection at once, whatever it has not read; a ``cause`` is counted."""
        if cause is not None:
            self._door.refused[cause] += 1
        self._door.remove(self)
        if self.transport is not None:
            self.transport.abort()

    def _after(self, name: str, seconds: float, act: Callable[[], None]) -> None:
        previous = self._timers.pop(name, None)
        if previous is not None:
            previous.cancel()
        self._timers[name] = asyncio.get_running_loop().call_later(seconds, act)

    def _end_if_idle(self) -> None:
        left = self._heard + IDLE_S - asyncio.get_running_loop().time()
        if not self._active and left <= 0.0:
            self.end("slow")
            return
        self._after("idle", max(left, 1.0), self._end_if_idle)

    def data_received(self, data: bytes) -> None:
        """Take whole chunks; refuse one whose head claims too much; stop reading while many wait."""
        if self.transport is None or self.transport.is_closing():
            return
        self._received += data
        self._door.received_bytes += len(data)
        while len(self._received) >= _HEAD.size:
            kind, part, size = _HEAD.unpack_from(self._received)
            if not self._admit(kind, part, size):
                return
            if len(self._received) < size:
                break
            chunk = bytes(self._received[:size])
            if kind == b"HEL" and not self._agree(chunk):
                return
            del self._received[:size]
            buffer = Buffer(chunk)
            self.messages.put_nowait((header_from_binary(buffer), buffer))
            wait = self._bucket.take()
            if wait > 0.0 or self.messages.qsize() >= _MAX_QUEUED:
                self.transport.pause_reading()
                self._after("resume", max(wait, _RESUME_S), self._resume)
                return

    def _resume(self) -> None:
        if self.transport is None or self.transport.is_closing():
            return
        if self.messages.qsize() > _MAX_QUEUED // 2:
            self._after("resume", _RESUME_S, self._resume)
            return
        self.transport.resume_reading()
        self.data_received(b"")

    def _admit(self, kind: bytes, part: bytes, size: int) -> bool:
        """Return whether a chunk may come, judged by its head; one that may not ends the connection."""
        first = self._chunk_bytes is None
        if kind not in ((b"HEL",) if first else (b"OPN", b"MSG", b"CLO")) or (part == b"C" and not self._active):
            return self._refuse(StatusCodes.BadTcpMessageTypeInvalid)
        most = _MAX_HELLO_BYTES if self._chunk_bytes is None else self._chunk_bytes
        # The head of what belongs to a channel has its number, too.
        if not (_HEAD.size if first else _HEAD.size + 4) < size <= most:
            return self._refuse(StatusCodes.BadTcpMessageTooLarge)
        return True

    def _agree(self, hello: bytes) -> bool:
        """Keep the size of a chunk from the hello; less than the standard allows would make endless small answers."""
        if len(hello) < _HEAD.size + _HELLO.size:
            return self._refuse(StatusCodes.BadTcpMessageTypeInvalid)
        _, receives, sends, _, _ = _HELLO.unpack_from(hello, _HEAD.size)
        if min(receives, sends) < _MIN_BUFFER_BYTES:
            return self._refuse(StatusCodes.BadConnectionRejected)
        self._chunk_bytes = min(sends, MAX_CHUNK_BYTES)
        return True

    def _refuse(self, code: int) -> bool:
        """Say why, where the client reads, and end the connection."""
        self._received.clear()
        self._door.refused["message"] += 1
        if self.transport is not None:
            self.transport.write(_HEAD.pack(b"ERR", b"F", _HEAD.size + 8) + struct.pack("<Ii", code, -1))
            self.transport.close()
            self._after("close", 1.0, self.end)
        return False

    async def _process_one_msg(self, header: Any, buf: Buffer) -> bool:
        # Nothing more is answered to a client that does not read; and others have their turn after each message.
        await self._read.wait()
        await asyncio.sleep(0)
        self._heard = asyncio.get_running_loop().time()
        self._opening = self._opening or header.MessageType == ua.MessageType.SecureOpen
        return await super()._process_one_msg(header, buf)

    def pause_writing(self) -> None:
        """Answer no more until the client reads, and end the connection where it does not."""
        self._read.clear()
        self._after("unread", _MAX_UNREAD_S, partial(self.end, "unread"))

    def resume_writing(self) -> None:
        """Go on answering."""
        self._read.set()
        timer = self._timers.pop("unread", None)
        if timer is not None:
            timer.cancel()


class _Services(InternalServer):
    def __init__(self, user_manager: Any) -> None:
        super().__init__(user_manager=user_manager)
        self.subscription_service = _Subscriptions(self.aspace, self)
        self.max_connections = MAX_CONNECTIONS + 1
        self.max_pending_activation_seconds = IDLE_S
        self.max_session_timeout_ms = MAX_SESSION_S * 1000.0
        self.max_subscriptions = MAX_SUBSCRIPTIONS
        self.max_monitored_item_queue_size = self.max_unacked_messages_per_subscription = _MAX_ITEM_QUEUE
        self.max_pending_messages_per_connection = 2 * _MAX_QUEUED

    def register_server(self, server: Any, conf: Any = None) -> None:
        """Refuse: this is no discovery server."""
        raise ServiceError(StatusCodes.BadServiceUnsupported)

    def create_session(self, name: Any, user: User | None = None, external: bool = False) -> InternalSession:
        """Create the one session of a connection, whose address and port are its name."""
        sessions = self._external_sessions
        if external and (len(sessions) >= MAX_CONNECTIONS or any(found.name == name for found in sessions.values())):
            raise ServiceError(StatusCodes.BadTooManySessions)
        given = user or User(role=UserRole.Anonymous)
        return _Session(self, self.aspace, self.subscription_service, name, user=given, external=external)

    def client_of_session(self, session_id: ua.NodeId) -> str:
        """Return the client of a session; "" for one of the server itself or one that has ended."""
        for session in self._external_sessions.values():
            if session.session_id == session_id:
                return client_of(str(session.name[0]))
        return ""


class _Session(InternalSession):
    """A session that reaches its own subscriptions alone: asyncua looks for their numbers only."""

    def _own(self, number: int) -> int:
        """Return the number of a subscription, 0 for one of another session, which is then unknown."""
        found = self.subscription_service.subscriptions.get(number)
        return number if found is not None and found.session_id == self.session_id else 0

    async def delete_subscriptions(self, ids: list[int]) -> list[ua.StatusCode]:
        return await super().delete_subscriptions([self._own(number) for number in ids])

    def modify_subscription(self, params: ua.ModifySubscriptionParameters) -> ua.ModifySubscriptionResult:
        params.SubscriptionId = self._own(params.SubscriptionId)
        return super().modify_subscription(params)

    async def create_monitored_items(self, params: ua.CreateMonitoredItemsParameters) -> Any:
        params.SubscriptionId = self._own(params.SubscriptionId)
        return await super().create_monitored_items(params)

    async def modify_monitored_items(self, params: ua.ModifyMonitoredItemsParameters) -> Any:
        params.SubscriptionId = self._own(params.SubscriptionId)
        return await super().modify_monitored_items(params)

    async def delete_monitored_items(self, params: ua.DeleteMonitoredItemsParameters) -> list[ua.StatusCode]:
        params.SubscriptionId = self._own(params.SubscriptionId)
        return await super().delete_monitored_items(params)

    async def set_monitoring_mode(self, params: ua.SetMonitoringModeParameters) -> list[ua.StatusCode]:
        params.SubscriptionId = self._own(params.SubscriptionId)
        return await super().set_monitoring_mode(params)

    async def set_publishing_mode(self, params: ua.SetPublishingModeParameters) -> list[ua.StatusCode]:
        params.SubscriptionIds = [self._own(number) for number in params.SubscriptionIds]
        return await super().set_publishing_mode(params)

    def republish(self, params: ua.RepublishParameters) -> ua.NotificationMessage:
        params.SubscriptionId = self._own(params.SubscriptionId)
        return super().republish(params)

    def publish(self, acks: Iterable[ua.SubscriptionAcknowledgement] | None = None) -> tuple[int, list[ua.StatusCode]]:
        given = list(acks or ())
        for ack in given:
            ack.SubscriptionId = self._own(ack.SubscriptionId)
        return super().publish(given)

    async def transfer_subscriptions(self, params: ua.TransferSubscriptionsParameters, callback: Any) -> Any:
        """Take over subscriptions of the same client, as after a lost connection."""
        services, own = self.iserver, client_of(str(self.name[0]))
        assert isinstance(services, _Services)
        found = self.subscription_service.subscriptions
        params.SubscriptionIds = [
            number if number in found and services.client_of_session(found[number].session_id) == own else 0
            for number in params.SubscriptionIds
        ]
        return await super().transfer_subscriptions(params, callback)


class _Subscriptions(SubscriptionService):
    """Subscriptions and their monitored items, of which one client has at most half."""

    def _items(self, client: str | None = None) -> int:
        services = self.iserver
        assert isinstance(services, _Services)
        return sum(
            len(found.monitored_item_srv._monitored_items)
            for found in self.subscriptions.values()
            if client is None or services.client_of_session(found.session_id) == client
        )

    async def create_subscription(
        self,
        params: ua.CreateSubscriptionParameters,
        callback: Any,
        session_id: ua.NodeId,
        request_callback: Any = None,
    ) -> ua.CreateSubscriptionResult:
        services = self.iserver
        assert isinstance(services, _Services)
        client = services.client_of_session(session_id)
        clients = [services.client_of_session(found.session_id) for found in self.subscriptions.values()]
        if client and clients.count(client) >= MAX_SUBSCRIPTIONS // 2:
            raise ServiceError(StatusCodes.BadTooManySubscriptions)
        # An interval of nothing, or none that is a number, would publish without a pause.
        params.RequestedPublishingInterval = min(
            max(_MIN_INTERVAL_MS, params.RequestedPublishingInterval), _MAX_INTERVAL_MS
        )
        return await super().create_subscription(params, callback, session_id, request_callback)

    async def create_monitored_items(self, params: ua.CreateMonitoredItemsParameters) -> Any:
        services, found = self.iserver, self.subscriptions.get(params.SubscriptionId)
        assert isinstance(services, _Services)
        if found is not None:
            client, more = services.client_of_session(found.session_id), len(params.ItemsToCreate)
            if self._items() + more > MAX_ITEMS or (client and self._items(client) + more > MAX_ITEMS // 2):
                raise ServiceError(StatusCodes.BadTooManyMonitoredItems)
        return await super().create_monitored_items(params)

    def modify_monitored_items(self, params: ua.ModifyMonitoredItemsParameters) -> Any:
        for item in params.ItemsToModify:
            item.RequestedParameters.QueueSize = min(item.RequestedParameters.QueueSize, _MAX_ITEM_QUEUE)
        return super().modify_monitored_items(params)

"""The process of the page, a child of a daemon or ``spallwatch page``; time limits against slow clients."""

from __future__ import annotations

import asyncio
import json
import logging
import signal
import socket
import sys
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from models.platform.portable import lower_priority
from models.platform.process_signals import on_signals
from models.platform.supervision import LostThreadError, Restarts
from models.words.errors import WrongInputError
from monitor.config.load import Config, ConfigError, load_config
from monitor.config.outputs import WebSection
from monitor.service.children import end_with_parent, report_line
from monitor.service.system import ServiceManager
from monitor.web.app import STREAM, Site, application
from monitor.web.auth import Doorkeeper, TokenError, load_token
from monitor.web.desk import ImportFolders
from monitor.web.machines import Machines
from monitor.web.security import Doors
from monitor.web.users import USERS_FILE, Users
from monitor.words.numbers import count
from streams.link.entrance import Entrance
from streams.link.front import BACKLOG, Cause, Door

Report = Callable[[dict[str, Any]], object]

_LOG = logging.getLogger(__name__)
MAX_CONNECTIONS = 256
"""Connections besides those of streams, half of them of one client; one more takes the place of the idlest."""
HEAD_S = 10.0
_MAX_STUCK = 3
_ALIVE_S = 5.0
_MAX_HEAD_BYTES = 8192
_KEEP_ALIVE_S = 15
_CONNECTIONS_PER_S = 400.0
"""Of all clients; a browser begins with six."""


class LimitedProtocol(H11Protocol):
    """Limit the number of connections; close those without a request or with an unread answer.

    A new connection is always taken: a limit that refuses it would let idle ones keep ``/healthz`` from being answered.
    """

    door: ClassVar[Door[LimitedProtocol]]
    """The connections of the page but for streams, which have a limit of their own and end with their connection."""
    head_within = HEAD_S
    """Seconds for the head of a request, from its first byte or from the connection."""
    _head: asyncio.TimerHandle | None = None
    _watch: asyncio.TimerHandle | None = None
    _pending = 0
    _stuck = 0
    _since = 0.0
    _uncounted = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]  # as the class above does
        """Start the timers."""
        super().connection_made(transport)
        self._since = self.loop.time()
        # None is never refused: each is idle in some degree, but for streams, which are not counted.
        idlest = self.door.room_for(self._address)
        if idlest is not None:
            self.door.remove(idlest)
            idlest.end("replaced")
        self.door.add(self, self._address)
        self._head = self.loop.call_later(self.head_within, self._give_up)
        self._watch = self.loop.call_later(self.head_within, self._check_progress)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timers; a connection that broke off is counted."""
        if exc is not None:
            self.door.refused["lost"] += 1
        for timer in (self._head, self._watch):
            if timer is not None:
                timer.cancel()
        self._head = self._watch = None
        self.door.remove(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Process data; a head that has begun must be complete in time."""
        self.door.received_bytes += len(data)
        super().data_received(data)
        if self._streaming:
            self.door.remove(self)
            self._uncounted = True
        incomplete = self.conn.their_state is h11.IDLE and not self.transport.is_closing()
        if not incomplete and self._head is not None:
            self._head.cancel()
            self._head = None
        elif incomplete and self._head is None and self.timeout_keep_alive_task is None:
            self._head = self.loop.call_later(self.head_within, self._give_up)

    def on_response_complete(self) -> None:
        """Note that the connection is idle from now on."""
        self._since = self.loop.time()
        if self._uncounted:
            self._uncounted = False
            self.door.add(self, self._address)
        super().on_response_complete()

    @property
    def _address(self) -> str:
        return "" if self.client is None else self.client[0]

    @property
    def _streaming(self) -> bool:
        return self.cycle is not None and self.cycle.scope["path"] == STREAM and not self.cycle.response_complete

    @property
    def idleness(self) -> tuple[int, float]:
        """Sort key: connections that wait for a request or its body first, then unread answers; the oldest first."""
        if self.conn.their_state in (h11.IDLE, h11.SEND_BODY):
            return 0, self._since
        return 1 if self.transport.get_write_buffer_size() else 2, self._since

    def _give_up(self) -> None:
        self._head = None
        if not self.transport.is_closing():
            self.end("slow")

    def end(self, cause: Cause) -> None:
        """End the connection at once; the cause is counted."""
        self.door.refused[cause] += 1
        self.transport.abort()

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no request."""
        self.door.refused["message"] += 1
        super().send_400_response(msg)

    def _check_progress(self) -> None:
        """End the connection if waiting data has not moved for a while."""
        pending = self.transport.get_write_buffer_size()
        self._stuck = self._stuck + 1 if pending and pending == self._pending else 0
        self._pending = pending
        if self._stuck >= _MAX_STUCK:
            self.end("unread")
            return
        self._watch = self.loop.call_later(self.head_within, self._check_progress)


class PageError(WrongInputError):
    """The page cannot be served; the message says why."""


class _Server(uvicorn.Server):
    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to the caller."""
        yield

    async def abandon(self) -> None:
        """Abort connections that are still being answered."""
        for connection in list(self.server_state.connections):
            connection.transport.abort()
        await asyncio.gather(*self.server_state.tasks, return_exceptions=True)


async def serve(
    machines: Machines,
    web: WebSection,
    state_dir: Path,
    report: Report,
    port: int | None = None,
    configurations: Path | None = None,
) -> None:
    """Serve the page until the task is cancelled.

    ``state_dir`` is the folder of the token if none is configured; ``port`` takes the place of the configured one.
    ``configurations`` is the folder to which the import desk adds, by default that of the state folder.
    ``report`` is called with ``url`` once the page listens, then with ``alive`` every few seconds.

    Raises:
        PageError: the address is taken, or the token or the certificate cannot be used.
    """
    with closing(_listen(web, web.port if port is None else port)) as listening:
        try:
            token = load_token(web.token_file or state_dir / "web.token", make=web.token_file is None)
        except TokenError as error:
            raise PageError(str(error)) from None
        doors = Doors.of(web, listening.getsockname()[1])
        users = Users(web.users_file or state_dir / USERS_FILE)
        folders = ImportFolders(web.import_folders, configurations or state_dir.parent)
        site = Site(machines, doors, Doorkeeper(token, users), web.max_streams, folders)
        door: Door[LimitedProtocol] = Door(
            MAX_CONNECTIONS, max(MAX_CONNECTIONS // 2, 1), lambda connection: connection.idleness
        )
        site.measures.listener = door.counts
        settings = _settings(site, web, door)
        server = _Server(settings)
        make = partial(settings.http_protocol_class, settings, server.server_state, {})
        entrance = Entrance(listening, door, make, settings.ssl, _CONNECTIONS_PER_S)
        with site:
            beating = partial(_beat, report, web.url(doors.port), site.tend)
            tasks = {
                "the beat of the page": beating,
                "the stream of the page": site.hub.run,
                "the entrance of the page": entrance.run,
            }
            beside = [asyncio.create_task(keep_running(name, run)) for name, run in tasks.items()]
            # It has no socket of its own: the entrance gives it connections.
            serving = asyncio.create_task(server.serve([]))
            try:
                ended, _ = await asyncio.wait((serving, *beside), return_when=asyncio.FIRST_COMPLETED)
                for task in ended:
                    task.result()
            finally:
                server.should_exit = server.force_exit = True
                for task in beside:
                    task.cancel()
                await asyncio.gather(serving, *beside, return_exceptions=True)
                await server.abandon()


def _settings(site: Site, web: WebSection, door: Door[LimitedProtocol]) -> uvicorn.Config:
    settings = uvicorn.Config(
        application(site),
        http=type("Protocol", (LimitedProtocol,), {"door": door}),
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=_MAX_HEAD_BYTES,
        timeout_keep_alive=_KEEP_ALIVE_S,
        ssl_certfile=web.cert_file,
        ssl_keyfile=web.key_file,
    )
    # Malformed requests are not logged; the site logs its own failures.
    logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
    try:
        settings.load()
    except OSError as error:
        raise PageError(f"[web] cert_file, key_file: cannot be used ({error})") from None
    return settings


async def _beat(report: Report, url: str, tend: Callable[[], None]) -> None:
    report({"url": url})
    while True:
        await asyncio.sleep(_ALIVE_S)
        tend()
        report({"alive": True})


async def keep_running(name: str, run: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run a task beside the server, and again where it fails.

    Raises:
        LostThreadError: it fails again and again; the process is started again as a whole.
    """
    restarts = Restarts(name)
    while True:
        restarts.started()
        try:
            await run()
        except Exception as error:  # Whatever ends a task would be seen nowhere.
            _LOG.exception("%s ended and is started again", name)
            restarts.failed(f"{type(error).__name__}: {error}")
            if restarts.down:
                raise LostThreadError(f"{restarts.name} failed too often: {restarts.cause}") from None
        await asyncio.sleep(max(0.0, restarts.wait_s))


def _listen(web: WebSection, port: int) -> socket.socket:
    listening: socket.socket | None = None
    try:
        family, _, _, _, address = socket.getaddrinfo(web.host, port, type=socket.SOCK_STREAM)[0]
        # With the protocol named, the event loop sends small answers at once instead of after up to 40 ms.
        listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(BACKLOG)
    except OSError as error:
        if listening is not None:
            listening.close()
        raise PageError(
            f"[web] host = {web.host!r}, port = {port}: cannot be listened on ({error.strerror or error})"
        ) from None
    return listening


def child() -> None:
    """Serve until standard input ends; report on standard output, one JSON object a line.

    The argument is a JSON object: ``config``, a file, ``web``, the section, and ``state_dir``.
    """
    given = json.loads(sys.argv[1])
    # The thread that commits has priority.
    lower_priority()
    end_with_parent()
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(asctime)s %(levelname)s page: %(message)s")

    web, state_dir, path = WebSection.model_validate(given["web"]), Path(given["state_dir"]), Path(given["config"])
    try:
        machines = Machines([load_config(path)])
        asyncio.run(serve(machines, web, state_dir, report_line, configurations=path.parent))
    except (PageError, ConfigError, LostThreadError) as error:
        report_line({"problem": str(error)})
        sys.exit(1)


def serve_until_signal(
    configs: Sequence[Config],
    web: WebSection,
    state_dir: Path,
    port: int | None = None,
    configurations: Path | None = None,
) -> None:
    """Serve the page in this process until SIGTERM or SIGINT; its address is printed on standard output.

    Arguments and errors are those of :func:`serve`.
    """
    manager = ServiceManager()

    def report(values: dict[str, Any]) -> None:
        if "url" in values:
            print(values["url"], flush=True)
            _LOG.info("the page of %s is at %s", count(len(configs), "machine"), values["url"])
            manager.send("READY=1", f"STATUS=the page of {count(len(configs), 'machine')} is at {values['url']}")
        manager.feed_watchdog(time.monotonic())

    async def run() -> None:
        serving = asyncio.create_task(serve(Machines(configs), web, state_dir, report, port, configurations))
        on_signals((signal.SIGTERM, signal.SIGINT), serving.cancel)
        with suppress(asyncio.CancelledError):
            await serving

    asyncio.run(run())
    manager.send("STOPPING=1")

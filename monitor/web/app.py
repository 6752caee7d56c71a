"""The ASGI application: routes, the threads that compute answers, and the files that are served."""

from __future__ import annotations

import asyncio
import json
import logging
import mimetypes
import os
import stat
import threading
from collections.abc import AsyncGenerator, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import aclosing
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, BinaryIO, Self

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from models.platform.portable import NO_LINK
from models.platform.supervision import OwnedThread, Restarts
from monitor.records.database import StoreError
from monitor.records.filing import published_name
from monitor.web import api, desk, event_view
from monitor.web.answers import VIEWS, Answer, Query, RequestError, answer_of, json_answer, without_folders
from monitor.web.api import levels
from monitor.web.auth import Doorkeeper
from monitor.web.desk import ImportFolders
from monitor.web.machines import Machines, WatchedMachine
from monitor.web.metrics import METRICS_TYPE, Measures, metrics
from monitor.web.security import MAX_BODY_BYTES, Doors, Guard, sign_in_routes
from monitor.web.stream import Hub
from monitor.words.statuses import page_words

_LOG = logging.getLogger(__name__)
_THREADS = 4
_JOIN_S = 5.0
_MAX_WAITING = 64
_PART_BYTES = 1 << 18
_FOLDER = Path(__file__).parent / "static"
_TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".svg": "image/svg+xml", ".LICENSE": "text/plain"}
STREAM = "/api/stream"
"""Address of the server-sent events."""
_WORDS = b'<script type="application/json" id="words">'
_lock = threading.Lock()
_known: dict[str, tuple[tuple[int, int], Answer]] = {}


class Site:
    """State that all requests of a page share."""

    def __init__(
        self, machines: Machines, doors: Doors, keeper: Doorkeeper, max_streams: int, folders: ImportFolders
    ) -> None:
        """Keep the machines, the rules of access and the folders of the import desk; nothing runs yet."""
        self.machines, self.doors, self.keeper, self.max_streams = machines, doors, keeper, max_streams
        self.folders = folders
        self.hub = Hub(machines)
        self.measures = Measures()
        self._threads = ThreadPoolExecutor(_THREADS, "answer")
        self._waiting = 0
        # However busy the others are, the health is answered.
        self._health_thread = ThreadPoolExecutor(1, "health")
        # One recording is read at a time, and keeps no other answer waiting.
        self._desk_thread = ThreadPoolExecutor(1, "desk")
        self._checking: asyncio.Future[Answer] | None = None
        self._ending = threading.Event()
        self._upkeep = OwnedThread(Restarts("upkeep"), partial(machines.keep_counting, self._ending))

    async def run(self, make: Callable[..., Any], *values: Any) -> Any:
        """Call a function in one of the few threads; raise :class:`RequestError` 503 where too many wait."""
        if self._waiting >= _MAX_WAITING:
            raise RequestError(503, "too much is asked at once; try again later")
        self._waiting += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._threads, make, *values)
        finally:
            self._waiting -= 1

    async def at_desk(self, request: Request, make: Callable[..., Answer], *values: Any) -> Response:
        """Compute an answer of the import desk, in its own thread."""
        try:
            found = await asyncio.get_running_loop().run_in_executor(self._desk_thread, make, self.folders, *values)
        except Exception as error:
            found = _failed(error)
        return _response(request, found)

    async def health(self) -> Answer:
        """Return the health of the machines; requests that come while it is found get the same answer."""
        if self._checking is None or self._checking.done():
            loop = asyncio.get_running_loop()
            self._checking = loop.run_in_executor(self._health_thread, self._find_health)
        return await asyncio.shield(self._checking)

    def _find_health(self) -> Answer:
        try:
            status, found = api.health(self.machines)
            return json_answer(found, status)
        except Exception as error:
            return _failed(error)

    async def answer(self, request: Request, make: Callable[[], Answer]) -> Response:
        """Compute an answer in a thread, and return it in an encoding that the client accepts."""
        try:
            found = await self.run(make)
        except Exception as error:
            found = _failed(error)
        return _response(request, found)

    def tend(self) -> None:
        """Start the thread that counts blocks again where it has ended."""
        self._upkeep.tend()

    def __enter__(self) -> Self:
        """Begin to count blocks."""
        self._upkeep.start()
        return self

    def __exit__(self, *error: object) -> None:
        """End the threads and close the stores."""
        self._ending.set()
        for threads in (self._threads, self._health_thread, self._desk_thread):
            threads.shutdown(wait=True, cancel_futures=True)
        self.keeper.close()
        self.hub.close()
        self._upkeep.join(_JOIN_S)
        for machine in self.machines:
            machine.store.close()


def _failed(error: Exception) -> Answer:
    """Return the answer that reports an error."""
    if isinstance(error, RequestError):
        return json_answer({"error": error.sentence}, error.status)
    if isinstance(error, StoreError):
        return json_answer({"error": without_folders(str(error))}, 503)
    _LOG.error("an answer could not be made", exc_info=error)
    return json_answer({"error": "the answer could not be made; the log of the page says why"}, 500)


def _response(request: Request, answer: Answer) -> Response:
    headers = {"cache-control": "no-cache"}
    if answer.tag is not None and answer.status == 200:
        headers["etag"] = answer.tag
        if answer.tag in request.headers.get("if-none-match", ""):
            return Response(status_code=304, headers=headers)
    body = answer.body
    if answer.packed is not None:
        headers["vary"] = "accept-encoding"
        if "gzip" in request.headers.get("accept-encoding", ""):
            headers["content-encoding"] = "gzip"
            body = answer.packed
    return Response(body, answer.status, headers, answer.media_type)


def application(site: Site) -> ASGIApp:
    """Return the guarded ASGI application of a site."""
    routes = [*_page_routes(site), *_api_routes(site), *_desk_routes(site), *sign_in_routes(site.doors, site.keeper)]
    app = Starlette(routes=routes, exception_handlers={HTTPException: _unknown})
    app.router.redirect_slashes = False
    return Guard(app, site.doors, site.keeper, site.measures.answered)


async def _unknown(request: Request, error: Exception) -> Response:
    """Answer an unknown address or a method that it does not have."""
    status = error.status_code if isinstance(error, HTTPException) else 500
    sentence = {404: "there is no such address", 405: "this address is not asked for in this way"}.get(status)
    return _response(request, json_answer({"error": sentence or "the request cannot be answered"}, status))


def _page_routes(site: Site) -> list[Route]:
    async def static(request: Request) -> Response:
        return await site.answer(request, partial(static_file, request.path_params.get("file", "index.html")))

    async def download(request: Request) -> Response:
        try:
            file, size = await site.run(open_published, site.machines, request.path_params["file"])
        except RequestError as error:
            return _response(request, _failed(error))
        name = request.path_params["file"]
        headers = {"content-length": str(size), "content-disposition": f'attachment; filename="{name}"'}
        return _EndedStream(_parts(site, file, size), headers, "application/x-netcdf", file.close)

    async def measured(request: Request) -> Response:
        def make() -> Answer:
            return answer_of(metrics(site.machines, site.measures, len(site.hub)), METRICS_TYPE)

        return await site.answer(request, make)

    async def healthy(request: Request) -> Response:
        return _response(request, await site.health())

    async def is_ready(request: Request) -> Response:
        # Answered without a thread, however busy they are.
        return _response(request, json_answer({"status": "ready"}))

    return [
        Route("/", static, methods=["GET"]),
        Route("/static/{file:path}", static, methods=["GET"]),
        Route("/records/{file}", download, methods=["GET"]),
        Route("/metrics", measured, methods=["GET"]),
        Route("/healthz", healthy, methods=["GET"]),
        Route("/readyz", is_ready, methods=["GET"]),
    ]


async def _parts(site: Site, file: BinaryIO, size: int) -> AsyncGenerator[bytes]:
    """Yield exactly ``size`` bytes of a file, which is replaced, never changed."""
    with file:
        while size > 0:
            found = await site.run(file.read, min(_PART_BYTES, size))
            if not found:
                return
            size -= len(found)
            yield found


def _api_routes(site: Site) -> list[Route]:
    def route(path: str, make: Callable[[Request], dict[str, Any]]) -> Route:
        async def endpoint(request: Request) -> Response:
            return await site.answer(request, lambda: json_answer(make(request)))

        return Route(path, endpoint, methods=["GET"])

    def machine(request: Request) -> WatchedMachine:
        return _begun(site.machines.machine(request.path_params["machine"]))

    def of_channel(path: str, make: Callable[[WatchedMachine, str, Query], dict[str, Any]]) -> Route:
        return route(path, lambda request: make(machine(request), request.path_params["channel"], request.query_params))

    channel = "/api/channels/{machine}/{channel}"
    return [
        route("/api/machines", lambda _: api.machines(site.machines)),
        route("/api/machines/{machine}/blocks", lambda request: api.blocks(machine(request), request.query_params)),
        route("/api/machines/{machine}/levels", lambda request: levels(machine(request), request.query_params)),
        of_channel(channel, lambda machine, name, _: api.channel(machine, name)),
        of_channel("/api/machines/{machine}/channels/{channel}", lambda machine, name, _: api.channel(machine, name)),
        *(of_channel(f"{channel}/{name}", resolve_name(f"monitor.web.{place}")) for name, place in VIEWS.items()),
        route("/api/events", lambda request: event_view.events(site.machines, request.query_params)),
        route("/api/records", lambda _: published_files(site.machines)),
        Route("/api/events/{event}/acknowledge", partial(_acknowledge, site), methods=["POST"]),
        Route("/api/acknowledge", partial(_acknowledge, site), methods=["POST"]),
        Route(STREAM, partial(_stream, site), methods=["GET"]),
    ]


def _desk_routes(site: Site) -> list[Route]:
    async def listing(request: Request) -> Response:
        query = request.query_params
        return await site.at_desk(request, lambda folders: json_answer(desk.listing(folders, query)))

    async def look(request: Request) -> Response:
        return await site.at_desk(request, desk.look, await request.body())

    async def save(request: Request) -> Response:
        return await site.at_desk(request, desk.save, await request.body(), request.state.visitor.name)

    return [
        Route("/api/desk", listing, methods=["GET"]),
        Route("/api/desk/look", look, methods=["POST"]),
        Route("/api/desk/save", save, methods=["POST"]),
    ]


def _begun(machine: WatchedMachine) -> WatchedMachine:
    """Return a machine that has a store; raise :class:`RequestError` 503 for others."""
    if machine.store.identity() is None:
        raise RequestError(503, f"nothing is recorded of machine {machine.name} yet: it has no store")
    return machine


async def _acknowledge(site: Site, request: Request) -> Response:
    body = await request.body()
    if len(body) > MAX_BODY_BYTES:
        return _response(request, json_answer({"error": "the body is too long"}, 413))
    name, user = request.path_params.get("event"), request.state.visitor.name

    def make() -> Answer:
        if name is None:
            return json_answer(event_view.acknowledge_many(site.machines, body, user))
        return json_answer(event_view.acknowledge(site.machines, name, body, user))

    found = await site.answer(request, make)
    site.hub.wake()
    return found


async def _stream(site: Site, request: Request) -> Response:
    machine, channel = request.query_params.get("machine"), request.query_params.get("channel")
    signed_in = getattr(request.state, "visitor", None) is not None
    try:
        if len(site.hub) >= site.max_streams and not (signed_in and site.hub.make_room()):
            raise RequestError(429, f"{site.max_streams} pages are open already, as many as [web] max_streams allows")
        if machine and channel:
            site.machines.machine(machine).channel(channel)
    except RequestError as error:
        return _response(request, _failed(error))
    # Counted here, without a pause since the check above, so that simultaneous requests cannot exceed the limit.
    subscriber = site.hub.subscribe((machine, channel) if machine and channel else None, signed_in=signed_in)
    headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
    end = partial(site.hub.unsubscribe, subscriber)
    return _EndedStream(site.hub.messages(subscriber), headers, "text/event-stream", end)


class _EndedStream(StreamingResponse):
    """A stream whose generator is closed with the answer, however that ends; then ``end`` is called."""

    def __init__(
        self, parts: AsyncGenerator[bytes], headers: Mapping[str, str], media_type: str, end: Callable[[], object]
    ) -> None:
        super().__init__(parts, 200, headers, media_type)
        self._parts, self._end = parts, end

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            # A generator that was never started runs nothing when it is closed.
            self._end()

    async def stream_response(self, send: Send) -> None:
        async with aclosing(self._parts):
            await super().stream_response(send)


def static_file(name: str, folder: Path = _FOLDER) -> Answer:
    """Return a file of the page, kept in memory until it changes; :class:`RequestError` 404 where there is none."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    if name not in {path.relative_to(folder).as_posix() for path in files}:
        raise RequestError(404, "there is no such file")
    path = folder / name
    found = path.stat()
    state = (found.st_mtime_ns, found.st_size)
    with _lock:
        known = _known.get(str(path))
        if known is None or known[0] != state:
            known = _known[str(path)] = (state, answer_of(_content(path), _type_of(path), level=9))
        return known[1]


def _content(path: Path) -> bytes:
    """Return the bytes of a file; ``index.html`` with the words of the page in its place for them."""
    content = path.read_bytes()
    # "<" is escaped so that no word can end the element.
    words = json.dumps(page_words(), ensure_ascii=False).replace("<", "\\u003c").encode()
    return content.replace(_WORDS + b"{}", _WORDS + words) if path.name == "index.html" else content


def _type_of(path: Path) -> str:
    kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return f"{kind}; charset=utf-8" if kind.startswith("text/") else kind


def published_files(site: Machines) -> dict[str, Any]:
    """Return the published files of all machines, by name."""
    found = []
    for machine in site:
        for name, state in _published(machine).items():
            modified = datetime.fromtimestamp(state.st_mtime, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
            found.append({"machine": machine.name, "file": name, "bytes": state.st_size, "modified_utc": modified})
    return {"files": sorted(found, key=lambda item: item["file"])}


def open_published(site: Machines, name: str) -> tuple[BinaryIO, int]:
    """Return an open published file and its size; :class:`RequestError` 404 where there is none of this name."""
    for machine in site:
        if name in _published(machine):
            try:
                descriptor = os.open(machine.records_dir / name, os.O_RDONLY | NO_LINK)
            except OSError:
                continue
            file = os.fdopen(descriptor, "rb")
            return file, os.fstat(descriptor).st_size
    raise RequestError(404, "there is no such file")


def _published(machine: WatchedMachine) -> dict[str, os.stat_result]:
    """Return the files of a machine's folder that have the name of a day or of the undated records; no links."""
    pattern = published_name(machine.name)
    found: dict[str, os.stat_result] = {}
    try:
        with os.scandir(machine.records_dir) as entries:
            for entry in entries:
                if pattern.fullmatch(entry.name):
                    state = entry.stat(follow_symlinks=False)
                    if stat.S_ISREG(state.st_mode):
                        found[entry.name] = state
    except OSError:
        # Nothing is published yet, or the folder cannot be reached.
        return {}
    return found

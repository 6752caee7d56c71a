"""The application: addresses, and the threads that answer them while the event loop goes on."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from monitor.records.tables import StoreError
from monitor.service.web import api
from monitor.service.web.answers import Answer, RequestError, json_answer
from monitor.service.web.machines import Machines, without_folders
from monitor.service.web.static_files import static_file

_LOG = logging.getLogger(__name__)
_THREADS = 4


class Site:
    """The page of some machines."""

    def __init__(self, machines: Machines) -> None:
        """Take the machines."""
        self.machines = machines
        self._threads = ThreadPoolExecutor(_THREADS, "answer")

    async def answer(self, request: Request, make: Callable[[], Answer]) -> Response:
        """Have an answer made in a thread."""
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(self._threads, lambda: _answered(make))
        return _response(request, found)

    def close(self) -> None:
        """Let go of the threads."""
        self._threads.shutdown(wait=False, cancel_futures=True)


def _answered(make: Callable[[], Answer]) -> Answer:
    try:
        return make()
    except RequestError as refused:
        return json_answer({"error": refused.sentence}, refused.status)
    except StoreError as error:
        return json_answer({"error": without_folders(str(error))}, 503)
    except Exception:
        _LOG.exception("an answer could not be made")
        return json_answer({"error": "the answer could not be made; the log of the page says why"}, 500)


def _response(request: Request, answer: Answer) -> Response:
    headers = dict(answer.headers)
    headers.setdefault("cache-control", "no-cache")
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


def application(site: Site) -> Starlette:
    """Return the ASGI application of a site."""

    def json_route(path: str, make: Callable[[Mapping[str, str], Mapping[str, str]], Mapping[str, Any]]) -> Route:
        async def endpoint(request: Request) -> Response:
            return await site.answer(request, lambda: json_answer(make(request.path_params, request.query_params)))

        return Route(path, endpoint, methods=["GET"])

    async def static(request: Request) -> Response:
        return await site.answer(request, lambda: static_file(request.path_params.get("file", "index.html")))

    machines = site.machines
    return Starlette(
        routes=[
            Route("/", static, methods=["GET"]),
            Route("/static/{file:path}", static, methods=["GET"]),
            json_route("/api/machines", lambda *_: api.machines(machines)),
            json_route(
                "/api/channels/{machine}/{channel}/records",
                lambda path, query: api.records(machines.machine(path["machine"]), path["channel"], query),
            ),
        ]
    )

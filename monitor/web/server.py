"""The process of the page: started beside a daemon, or by ``python -m monitor.web.server FILE.toml...``."""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import uvicorn

from models.errors import SpallwatchError
from monitor.config.load import Config, ConfigError, load_config
from monitor.config.web import WebSection
from monitor.web.app import Site, application
from monitor.web.auth import Doorkeeper, TokenError, load_token
from monitor.web.machines import Machines
from monitor.web.protocol import PatientProtocol
from monitor.web.security import Doors

_LOG = logging.getLogger(__name__)
_ALIVE_EVERY = 5.0
_HEAD = 8192
_KEPT_ALIVE = 15
_BACKLOG = 128
Say = Callable[[dict[str, Any]], object]


class PageError(SpallwatchError):
    """The page cannot be served; the message says why."""


class _Server(uvicorn.Server):
    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave the signals to the caller."""
        yield

    async def abandon(self) -> None:
        """End what is still being answered."""
        for connection in list(self.server_state.connections):
            connection.transport.abort()
        await asyncio.gather(*self.server_state.tasks, return_exceptions=True)


async def serve(machines: Machines, web: WebSection, state_dir: Path, say: Say, port: int | None = None) -> None:
    """Serve the page until the task is cancelled.

    Args:
        machines: what it shows.
        web: where it listens, and to whom.
        state_dir: where the token is kept if none is configured.
        say: is given ``url`` once it listens, then ``alive`` every few seconds.
        port: in place of the configured one.

    Raises:
        PageError: the address is taken, or the token or the certificate cannot be used.
    """
    with closing(_listen(web, web.port if port is None else port)) as listening:
        try:
            token = load_token(web.token_file or state_dir / "web.token", make=web.token_file is None)
        except TokenError as error:
            raise PageError(str(error)) from None
        doors = Doors.of(web, listening.getsockname()[1])
        site = Site(machines, doors, Doorkeeper(token), web.max_streams)
        server = _Server(_settings(site, web))
        with site:
            beside = [asyncio.create_task(_beat(say, _url(web, doors))), asyncio.create_task(site.hub.run())]
            serving = asyncio.create_task(server.serve([listening]))
            try:
                await asyncio.shield(serving)
            finally:
                server.should_exit = server.force_exit = True
                for task in beside:
                    task.cancel()
                await asyncio.gather(serving, *beside, return_exceptions=True)
                await server.abandon()


def _settings(site: Site, web: WebSection) -> uvicorn.Config:
    settings = uvicorn.Config(
        application(site),
        http=PatientProtocol,
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=_HEAD,
        timeout_keep_alive=_KEPT_ALIVE,
        ssl_certfile=web.cert_file,
        ssl_keyfile=web.key_file,
    )
    # What strangers send is no news, and the site logs its own failures.
    logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
    try:
        settings.load()
    except OSError as error:
        raise PageError(f"[web] cert_file, key_file: cannot be used ({error})") from None
    return settings


async def _beat(say: Say, url: str) -> None:
    say({"url": url})
    while True:
        await asyncio.sleep(_ALIVE_EVERY)
        say({"alive": True})


def _listen(web: WebSection, port: int) -> socket.socket:
    listening: socket.socket | None = None
    try:
        family, _, _, _, address = socket.getaddrinfo(web.host, port, type=socket.SOCK_STREAM)[0]
        # With the protocol named, the event loop sends small answers at once; otherwise each may wait for 40 ms.
        listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(_BACKLOG)
    except OSError as error:
        if listening is not None:
            listening.close()
        raise PageError(
            f"[web] host = {web.host!r}, port = {port}: cannot be listened on ({error.strerror or error})"
        ) from None
    return listening


def _url(web: WebSection, doors: Doors) -> str:
    host = f"[{web.host}]" if ":" in web.host else web.host
    return f"{'https' if doors.secure else 'http'}://{host}:{doors.port}/"


def child() -> None:
    """Serve until standard input ends, and say on standard output how it goes, one JSON object a line.

    The argument is a JSON object: ``configs``, a list of files, ``web``, the section, and ``state_dir``.
    """
    given = json.loads(sys.argv[1])
    # Whoever commits goes first.
    os.nice(5)
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(asctime)s %(levelname)s page: %(message)s")

    def say(said: dict[str, Any]) -> None:
        try:
            print(json.dumps(said), flush=True)
        except OSError:
            os._exit(0)

    configs = _readable([Path(name) for name in given["configs"]], say)
    web, state_dir = WebSection.model_validate(given["web"]), Path(given["state_dir"])
    try:
        asyncio.run(serve(Machines(configs), web, state_dir, say))
    except (PageError, ValueError) as error:
        say({"problem": str(error)})
        sys.exit(1)


def _readable(paths: Sequence[Path], say: Say) -> list[Config]:
    """Return the configurations that can be read; a file that was spoilt since hides no other machine."""
    configs: list[Config] = []
    for path in paths:
        try:
            configs.append(load_config(path))
        except ConfigError as error:
            _LOG.error("%s", error)
            say({"problem": str(error)})
    return configs


def _end_with_parent() -> None:
    """End at once when standard input does: the parent asked for it, or is gone, however it ended."""
    while os.read(0, 4096):
        pass
    os._exit(0)


def main() -> None:
    """Serve the page of the machines whose configurations are named, without a daemon."""
    parser = argparse.ArgumentParser(description="The page beside the stores of some machines.")
    parser.add_argument("configs", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--port", type=int, help="in place of the configured one; 0: any that is free")
    options = parser.parse_args()
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(asctime)s %(levelname)s %(message)s")
    try:
        configs = [load_config(path) for path in options.configs]
        first = configs[0]

        def say(said: dict[str, Any]) -> None:
            if "url" in said:
                print(said["url"], flush=True)

        asyncio.run(serve(Machines(configs), first.web, first.machine.state_dir, say, options.port))
    except (PageError, ConfigError, ValueError) as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()

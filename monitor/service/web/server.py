"""The process of the page: ``python -m monitor.service.web.server FILE.toml...`` serves it without a daemon, too."""

from __future__ import annotations

import argparse
import asyncio
import socket
from pathlib import Path

import uvicorn

from monitor.config import load_config
from monitor.service.web.app import Site, application
from monitor.service.web.machines import Machines


def main() -> None:
    """Serve the page of the machines whose configurations are named."""
    parser = argparse.ArgumentParser(description="The page beside the stores of some machines.")
    parser.add_argument("configs", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--port", type=int, help="in place of the configured one")
    options = parser.parse_args()
    configs = [load_config(path) for path in options.configs]
    web = configs[0].web
    site = Site(Machines(configs))
    listening = socket.create_server((web.host, web.port if options.port is None else options.port))
    print(f"http://{web.host}:{listening.getsockname()[1]}/", flush=True)
    settings = uvicorn.Config(application(site), log_level="warning", server_header=False, lifespan="off")
    asyncio.run(uvicorn.Server(settings).serve(sockets=[listening]))


if __name__ == "__main__":
    main()

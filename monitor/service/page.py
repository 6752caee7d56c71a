"""The page of a daemon: a child process, restarted when it ends; no call waits for it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from monitor.config.outputs import WebSection
from monitor.service.server_process import ServerProcess

_ENTRY = "monitor.web.server:child"


class PageProcess(ServerProcess):
    """Serves the page of one machine, from one thread; its failure is a :attr:`problem`, never an exception."""

    def __init__(
        self,
        config: Path,
        web: WebSection,
        state_dir: Path,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Keep file and section of the configuration and the folder of the token; :meth:`tick` starts the child."""
        request = {
            "config": str(config.absolute()),
            "web": web.model_dump(mode="json"),
            "state_dir": str(state_dir.absolute()),
        }
        super().__init__("the page", _ENTRY, request, monotonic)

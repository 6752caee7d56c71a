"""A machine for the neighbours: a store, a status file and a configuration, without a daemon."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from monitor.config.load import Config, load_config
from monitor.health.record import Record
from monitor.records.store import Store
from monitor.service.neighbours.opcua_server import MachineServer
from monitor.service.system import StatusFile
from streams.types.block import STANDARD_GRAVITY
from tests.support.waiting import PATIENCE_S, wait_until

_CONFIG = """
[machine]
name = "pump"
state_dir = "{folder}"
records_dir = "{folder}"
[web]
enabled = false
[[bearing]]
name = "de"
designation = "1205 ETN9"
[[source]]
name = "s"
url = "folder:{folder}"
[[channel]]
name = "x"
source = "s"
column = 1
unit = "g"
bearing = "de"
[[channel]]
name = "y"
source = "s"
column = 2
unit = "g"
bearing = "de"
"""
STATUS: dict[str, Any] = {
    "status": "running",
    "machine": "pump",
    "state": "maintenance_required",
    "alarms": 1,
    "unacknowledged": 2,
    "problems": {},
    "updated_utc": "2026-09-21T14:13:23.000Z",
    "version": "1",
    "bearings": {"de": {"fault": "outer"}},
    "channels": {
        "x": {"state": "maintenance_required", "reason": "the final stage has begun", "alarms": [{}]},
        "y": {"state": "no_data", "reason": "no block for 60 s", "alarms": []},
    },
}


class Machine:
    """A machine named pump with the channels x and y on a bearing named de, both of a source s."""

    def __init__(self, folder: Path, more: str = "") -> None:
        """Make it in a folder; ``more`` are further sections of its configuration."""
        self.path = folder / "pump.toml"
        self.path.write_text(_CONFIG.format(folder=folder) + more, encoding="utf-8")
        self.folder = folder
        self.store = Store.open(folder / "state.db", machine="pump")
        self._status = StatusFile.open(folder)
        self.last = 0
        self.show(STATUS)

    @property
    def config(self) -> Config:
        """The configuration as it is read."""
        return load_config(self.path)

    def show(self, status: dict[str, Any]) -> None:
        """Write the status file."""
        self._status.write(status)

    def add(self, *, y: dict[str, Any] | None = None, **fields: Any) -> None:
        """Commit a block whose number is also the RMS of channel x in g; ``y`` are the values of channel y."""
        self.last += 1
        values = {
            "x": {
                "rms": STANDARD_GRAVITY * self.last,
                "stage": "final",
                "fault": "outer",
                "v_eq": 2e-8,
                "v_eq_lower": 1e-8,
                "v_eq_upper": 3e-8,
                "edv_status": "widened",
                "tt": (3600.0,),
                "tt_status": ("ok",),
                "t_fs_block": 1,
            },
            "y": y or {"rms": STANDARD_GRAVITY, "stage": "healthy", "edv_status": "not_final_stage"},
        }
        given = {"time": 1.79e9 + self.last, "channels": values, **fields}
        self.store.commit(Record("s", self.last, "b", str(self.last), **given), {})

    def stop_daemon(self) -> None:
        """Release the lock of the status file, as an ended daemon does."""
        self._status.close()

    def close(self) -> None:
        """Close store and status file."""
        self.store.close()
        self._status.close()


@contextmanager
def serving(machine: Machine) -> Iterator[str]:
    """Serve a machine in a thread; give the address."""
    loop = asyncio.new_event_loop()
    found: list[dict[str, Any]] = []
    section = machine.config.publish.opcua
    assert section is not None
    task = loop.create_task(MachineServer(machine.config, section, poll_s=0.05).serve(found.append))
    thread = threading.Thread(target=lambda: loop.run_until_complete(asyncio.wait([task])))
    thread.start()
    try:
        wait_until(lambda: found or task.done())
        if task.done():
            task.result()
        yield found[0]["url"]
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join(PATIENCE_S)
        loop.close()

"""Keeps the count of blocks of each machine up to date beside the answers."""

from __future__ import annotations

import logging
import threading

from monitor.records.database import StoreError
from monitor.web.machines import Machine, Machines

_LOG = logging.getLogger(__name__)
_INTERVAL_S = 1.0
_PAUSE_S = 0.01
"""Pause between two steps of a count that is behind, for the answers."""


def keep_up(machines: Machines, ending: threading.Event) -> None:
    """Count new blocks of all stores, in turn, until ``ending`` is set; a store that fails is tried again."""
    failing: dict[str, str] = {}
    while not ending.is_set():
        more = False
        for machine in machines:
            if ending.is_set():
                return
            try:
                more = _step(machine) or more
            except StoreError as error:
                if failing.get(machine.name) != str(error):
                    _LOG.warning("count of blocks: %s", error)
                failing[machine.name] = str(error)
            except Exception:
                _LOG.exception("count of blocks of machine %s", machine.name)
                failing[machine.name] = "program error"
                ending.wait(_INTERVAL_S)
            else:
                failing.pop(machine.name, None)
        ending.wait(_PAUSE_S if more else _INTERVAL_S)


def _step(machine: Machine) -> bool:
    return machine.store.identity() is not None and machine.tally.update()

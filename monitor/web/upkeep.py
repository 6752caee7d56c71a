"""What is kept up to date beside the answers: the trends, and the count of blocks."""

from __future__ import annotations

import logging
import threading

from monitor.records.database import StoreError
from monitor.web.machines import Machine, Machines

_LOG = logging.getLogger(__name__)
_EVERY = 1.0
_STEP = 2000
_BREATH = 0.01


def keep_up(machines: Machines, ending: threading.Event) -> None:
    """Take what is new of all stores, in turn, until told to end; a store that fails is tried again.

    Args:
        machines: whose stores.
        ending: set by whoever wants an end.
    """
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
                    _LOG.warning("trends: %s", error)
                failing[machine.name] = str(error)
            except Exception:
                _LOG.exception("trends of machine %s", machine.name)
                failing[machine.name] = "a mistake of the program"
                ending.wait(_EVERY)
            else:
                failing.pop(machine.name, None)
        # Even where there is a year to catch up with, answers come first.
        ending.wait(_BREATH if more else _EVERY)


def _step(machine: Machine) -> bool:
    if machine.store.identity() is None:
        machine.updating = False
        return False
    trends = machine.trends.update(_STEP)
    machine.updating = trends
    return machine.tally.update() or trends

"""The state of a source at which a store ends; where only older states are left, taken on over the records since."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from typing import Any

from monitor.health.retrace import AVERAGED_SPECTRA, BAND_VOTES, Retraced, retrace
from monitor.health.state import SourceSettings, SourceState
from monitor.records.events import EventLog
from monitor.records.store import Store

_LOG = logging.getLogger(__name__)
_WORDS = {
    AVERAGED_SPECTRA: "its average of spectra, from which the damaged part is named, begins again",
    BAND_VOTES: "the choice of its band begins again",
}


def resumed_state(store: Store, settings: SourceSettings) -> SourceState:
    """Return the state of a source after its last block, which a store that is open for writing then has.

    Raises:
        KeyError, TypeError, ValueError: a state in the store is of another version.
        StoreError: the store cannot be read or written.
    """
    source = settings.name
    found = store.rows("SELECT block FROM stage_states WHERE name = ?", f"source:{source}")
    block = found[0][0] if found else 0
    state = SourceState.begin(settings, store.load_states(), store.record(source, store.last(source)))
    records = (row.to_record() for row in store.stored("source = ? AND blocks.id > ?", source, block))
    after = retrace(state, records, settings)
    if after.blocks and store.writable:
        store.replace_states(source, after.state.to_stored())
        notice = _notice(source, after)
        _LOG.warning("%s", notice["text"])
        with EventLog(store.path) as log:
            log.notice(time.time(), notice)
    return after.state


def _notice(source: str, after: Retraced) -> Mapping[str, Any]:
    text = f"{source}: the state was made again from {after.blocks} records"
    missing = "; ".join(f"{name}: {_WORDS[part]}" for name, parts in after.missing.items() for part in parts)
    return {
        "kind": "state_retraced",
        "channel": None,
        "text": f"{text}; {missing}" if missing else f"{text}, without loss",
        "records": after.blocks,
        "missing": {name: list(parts) for name, parts in after.missing.items()},
    }

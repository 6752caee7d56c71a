"""What a store holds beside records: kept spectra, views of blocks, particles of the tracker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from monitor.health.signal.waterfall import SpectrumRow
from monitor.health.size.filter.particles import Particles
from monitor.records.spectra import read_block_view, read_ias, read_spectra, viewed_blocks
from monitor.records.store import Store


@dataclass(frozen=True, eq=False)
class StoredBeside:
    """Blocks by status; spectra, views, rows with a spectrum of the angular speed, and particles by channel."""

    counts: Mapping[str, int]
    spectra: Mapping[str, Sequence[SpectrumRow]]
    views: Mapping[str, Sequence[SpectrumRow]]
    ias: Mapping[str, Sequence[SpectrumRow]]
    particles: Mapping[str, Particles]


def read_beside(store: Store) -> StoredBeside:
    """Read what a store holds beside records; particles of another version are left out."""
    states = {key.split(":", 2)[2]: state for key, state in store.load_states().items() if key.startswith("channel:")}
    particles: dict[str, Particles] = {}
    for name, state in states.items():
        stored = ((state.get("damage") or {}).get("filter") or {}).get("particles")
        if stored:
            with suppress(KeyError, ValueError, TypeError):
                particles[name] = Particles.from_dict(stored)
    spectra = {name: read_spectra(store, name) for name in states}
    views = {name: _views(store, name, state) for name, state in states.items()}
    return StoredBeside(store.counts(), spectra, views, _ias(store, spectra, states), particles)


def _ias(
    store: Store, spectra: Mapping[str, Sequence[SpectrumRow]], states: Mapping[str, Mapping[str, Any]]
) -> dict[str, list[SpectrumRow]]:
    """Return the newest row of each source with a spectrum of the angular speed, after the last before the onset."""
    found: dict[str, list[SpectrumRow]] = {}
    for source in {row.source for rows in spectra.values() for row in rows[-1:]}:
        newest = read_ias(store, source)
        if newest is not None:
            onset = _onset(states.get(newest.channel, {}))
            before = None if onset is None else read_ias(store, source, until=onset - 1)
            found[newest.channel] = [row for row in (before, newest) if row is not None]
    return found


def _onset(state: Mapping[str, Any]) -> int | None:
    """Return the number of the block with which the final stage began, by the state of a channel."""
    return ((state.get("detect") or {}).get("t_fs") or {}).get("sequence")


def _views(store: Store, name: str, state: Mapping[str, Any]) -> list[SpectrumRow]:
    """Return the newest block with a view, after the middle one of those before the final stage."""
    onset = _onset(state)
    before = [] if onset is None else [number for number in viewed_blocks(store, name) if number < onset]
    at = [before[len(before) // 2], None] if before else [None]
    return [row for block in at if (row := read_block_view(store, name, at=block)) is not None]

"""Envelope spectra of a channel: the latest one, and all that are kept as a waterfall."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.health.waterfall import SpectrumRow
from monitor.records.spectra import binned, kept_blocks, read_spectra
from monitor.web.answers import Query, RequestError, numbers, optional_number, whole_number
from monitor.web.machines import Machine
from monitor.words.features import FEATURES

_BINS = 300


def spectrum(machine: Machine, channel: str, query: Query) -> dict[str, Any]:
    """Return the spectrum of one block, by default the newest, and the blocks with a spectrum; 404 without one."""
    section = machine.channel(channel)
    block = whole_number(query, "block", 0, 0, 2**62)
    found = read_spectra(machine.store, channel, source=section.source, at=block or None, newest=1)
    if not found:
        raise RequestError(404, "no spectrum is kept of this block" if block else "no spectrum is kept yet")
    row = found[0]
    factor = _factor(row)
    return {
        "block": row.sequence,
        "time_s": row.time,
        "resolution_hz": row.resolution,
        "band_hz": list(row.band),
        "speed_hz": row.speed,
        "mean_g": row.mean * factor,
        "unit": "g" if row.absolute else "unknown",
        "amplitude_g": numbers(row.amplitude * factor, 4),
        "lines_hz": dict(row.lines),
        "blocks": [number for number, _ in kept_blocks(machine.store, channel, source=section.source)],
    }


def waterfall(machine: Machine, channel: str, query: Query) -> dict[str, Any]:
    """Return all spectra over common bins: the highest amplitude in each."""
    section = machine.channel(channel)
    bins = whole_number(query, "bins", _BINS, 10, 2000)
    highest = optional_number(query, "to_hz")
    if highest is not None and highest <= 0.0:
        raise RequestError(400, "to_hz must be above 0")
    rows = read_spectra(machine.store, channel, source=section.source)
    # One scale for all: a sensor whose unit became known begins anew.
    rows = [row for row in rows if row.absolute == rows[-1].absolute and row.amplitude.size]
    if not rows:
        return {"unit": "g", "time_s": [], "blocks": [], "frequency_hz": [], "amplitude_g": []}
    frequency, amplitude = binned(rows, bins, highest)
    return {
        "unit": "g" if rows[-1].absolute else "unknown",
        "time_s": [row.time for row in rows],
        "blocks": [row.sequence for row in rows],
        "frequency_hz": numbers(np.asarray(frequency)),
        "amplitude_g": [numbers(line * _factor(rows[-1]), 4) for line in np.asarray(amplitude)],
    }


def newest_block(machine: Machine, channel: str) -> int | None:
    """Return the number of the newest block of which a spectrum is kept, or None."""
    section = machine.channel(channel)
    found = read_spectra(machine.store, channel, source=section.source, newest=1)
    return found[-1].sequence if found else None


def _factor(row: SpectrumRow) -> float:
    return FEATURES["rms"].of_si(absolute=row.absolute)

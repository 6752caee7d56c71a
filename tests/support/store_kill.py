"""Makers and checks that tests of store kill share."""

from __future__ import annotations

from monitor.health.record import Record


def block(sequence: int) -> Record:
    values = {"rms": sequence / 7.0, "stage": "healthy", "bpfo_amplitude": [sequence / k for k in range(1, 7)]}
    return Record(
        source="s",
        sequence=sequence,
        name=f"block {sequence}",
        content_hash=f"{sequence:08x}",
        time=1.7e9 + 5.0 * sequence,
        channels={"x": values, "y": values},
        forecasts=({"tt": float(sequence)},),
        events=({"kind": "tick", "n": sequence},) if sequence % 3 == 0 else (),
    )

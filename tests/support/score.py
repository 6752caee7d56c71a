"""Makers and checks that tests of score share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from monitor.health.record import Record
from monitor.records.publish import publish
from monitor.records.store import Store

STEP = 100.0


ONSET, KNOWN = 4, 6


THRESHOLD = 0.05e-6


DAY = 86400.0 * 20000


TT = (500.0, None, 200.0, 260.0, 90.0)


"""Forecasts of the blocks 6 to 10; the end comes with block 11, at 1000 s."""


def record(sequence: int, values: Mapping[str, Any], *, start: float | None, flags: tuple[str, ...] = ()) -> Record:
    elapsed = STEP * (sequence - 1)
    own = {"quality_status": flags[0] if flags else "ok", "quality_flags": flags, "detect_score": 1.0, **values}
    status = own.get("tt_status")
    row = {"channel": "x", "method": "library", "threshold_mm2": 0.05, "status": status, "tt_s": own.get("tt")}
    row |= {"tt_lower_s": own.get("tt_lower"), "tt_upper_s": own.get("tt_upper")}
    row |= {"quantiles_s": own.pop("quantiles_s", None)}
    silent = status in (None, "not_final_stage") or isinstance(status, tuple)
    return Record(
        source="s",
        sequence=sequence,
        name=f"b{sequence}",
        content_hash=f"{sequence}",
        status=flags[0] if flags else "ok",
        flags=flags,
        time=None if start is None else start + elapsed,
        elapsed=elapsed,
        channels={"x": own},
        forecasts=() if silent else (row,),
    )


def run(
    tt: Sequence[float | None] = TT, *, start: float | None = None, more: Mapping[int, Mapping[str, Any]] | None = None
) -> list[Record]:
    """A run of eleven blocks; ``more`` are further values by block."""
    made = []
    for sequence in range(1, 12):
        values: dict[str, Any] = {"v_th": THRESHOLD, "tt_status": "not_final_stage", "stage": "healthy"}
        if sequence >= KNOWN:
            answer = tt[sequence - KNOWN] if sequence - KNOWN < len(tt) else 0.0
            axis = 0.0 if start is None else start
            values |= {"t_fs": axis + STEP * (ONSET - 1), "t_fs_known": axis + STEP * (KNOWN - 1), "stage": "final"}
            values |= {"v_eq": 0.005e-6 * (sequence - 1), "edv_status": "ok"}
            values |= {"tt": answer, "tt_status": "concave" if answer is None else "ok"}
        values |= (more or {}).get(sequence, {})
        made.append(record(sequence, values, start=start))
    return made


def stored(
    folder: Path, records: Sequence[Record], machine: str = "m", *, published: bool = False, **attributes: Any
) -> Path:
    """Put records into a store; without ``published`` there is nothing but its archive to read."""
    with Store.open(folder / "state.db", machine=machine) as store:
        store.describe(attributes)
        store.commit_many([(record, {}) for record in records])
        if published:
            publish(store, folder / "records")
    return folder

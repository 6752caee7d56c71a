"""A made-up life of a bearing as records: healthy, then damaged, with bad blocks on the way."""

from __future__ import annotations

import math
import random
from typing import Any

from monitor.health.record import Record, plain

GRAVITY = 9.80665
THRESHOLD = 5e-8
INTERVAL = 60.0


def life(
    blocks: int = 600, *, start: float | None = None, onset: int = 400, learn: int = 100, seed: int = 1
) -> list[Record]:
    """Records of channels "horizontal" (tracked, with the truth) and "vertical" (not tracked, in an unknown unit)."""
    draw = random.Random(seed)
    records: list[Record] = []
    for sequence in range(1, blocks + 1):
        elapsed = INTERVAL * (sequence - 1) + (7200.0 if sequence > blocks // 4 else 0.0)
        time = None if start is None else start + elapsed
        if sequence % 97 == 0:
            records.append(
                Record(
                    "s", sequence, f"b{sequence}.csv", f"{sequence:x}", "nan", (), "sample 5 is <NaN>", time, elapsed
                )
            )
            continue
        axis = elapsed if time is None else time
        flags = ("clipped",) if sequence % 151 == 0 else ()
        horizontal = _tracked(draw, sequence, axis, onset, learn, blocks)
        vertical = {"rms": 3.0 * draw.uniform(0.9, 1.1), "h_or": draw.uniform(0.01, 0.02), "absolute_level": "no"}
        vertical |= {"stage": "learning" if sequence <= learn else "healthy", "quality_status": "ok"}
        for values in (horizontal, vertical):
            values |= {"band_lo": 5000.0, "band_hi": 9000.0, "band_source": "learning", "quality_flags": flags}
        known = sequence == onset + 5
        records.append(
            Record(
                source="s",
                sequence=sequence,
                name=f"b{sequence}.csv",
                content_hash=f"{sequence:x}",
                status=flags[0] if flags else "ok",
                flags=flags,
                time=time,
                elapsed=elapsed,
                channels={"horizontal": plain(horizontal), "vertical": plain(vertical)},
                events=({"kind": "final_stage", "channel": "horizontal", "t_fs_block": onset},) if known else (),
            )
        )
    return records


def _tracked(draw: random.Random, sequence: int, axis: float, onset: int, learn: int, blocks: int) -> dict[str, Any]:
    damaged = max(0.0, (sequence - onset) / (blocks - onset))
    level = 0.4 * (1.0 + 7.0 * damaged**2) * draw.uniform(0.95, 1.05)
    final = sequence >= onset + 5
    values: dict[str, Any] = {
        "rms": level * GRAVITY,
        "h_or": 0.02 * (1.0 + 30.0 * damaged**1.5) * draw.uniform(0.9, 1.1) * GRAVITY,
        "peak": 5.0 * level * GRAVITY,
        "stage": "learning" if sequence <= learn else ("final" if final else "healthy"),
        "detect_threshold": 4.4,
        "quality_status": "ok",
        "edv_status": "ok" if final else "not_final_stage",
        "tt_status": "not_final_stage",
        "v_th": THRESHOLD,
        "speed": 30.0,
        "load": 4000.0,
    }
    if sequence > learn:
        values["detect_score"] = 1.0 * draw.uniform(0.3, 2.0) * (1.0 + 40.0 * damaged)
    if final:
        onset_axis = axis - INTERVAL * (sequence - onset)
        values |= {"t_fs": onset_axis, "t_fs_block": onset}
        values |= {"t_fs_known": onset_axis + 5.0 * INTERVAL, "t_fs_known_block": onset + 5}
        values |= {
            "fault": "outer",
            "fault_snr": 3.0 + 9.0 * damaged,
            "fault_depth": 0.4,
            "fault_score": 20.0 * damaged,
        }
        growth = 8e-8 * damaged**1.7
        crossing = onset + (blocks - onset) * (THRESHOLD / 8e-8) ** (1.0 / 1.7)
        left = INTERVAL * (crossing - sequence)
        values["v_eq"] = growth * (1.0 + 0.1 * math.sin(sequence / 9.0))
        values |= {"v_eq_true": growth, "tt_true": max(0.0, left)}
        if left <= 0:
            values |= {"tt": 0.0, "tt_status": "already_crossed"}
        elif sequence > onset + 8:
            values |= {"tt": left * (1.0 + 4.0 * (1.0 - damaged) ** 6 * draw.uniform(-0.2, 1.0)), "tt_status": "ok"}
        else:
            values["tt_status"] = "too_few_points"
    return values

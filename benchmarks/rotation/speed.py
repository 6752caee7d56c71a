"""How well the shaft speed is estimated from the signal: recordings with a stated speed, noise, and a simulated rig.

    python -m benchmarks.rotation.speed [--quick] [--json FILE]

The error is against what the recording states: CWRU's own tachometer reading by file, the nominal speed of MFPT (25 Hz)
and HIT-SM (20 Hz), which the machine need not have turned at, PRONOSTIA's set speed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Tables, benchmark
from models.machine.bearing import Bearing, from_catalogue
from monitor.health.signal.speed import SpeedStatus, estimate_speed
from reference import recordings_folder
from streams.open import open_source
from streams.rig.bench import SimulatedRig
from streams.types.block import Block
from streams.types.spec import ChannelSpec, SourceSpec

LIMITS = (10.0, 60.0)
_DATA = recordings_folder()
_NICE = Bearing("NICE", 8, 0.235 * 0.0254, 1.245 * 0.0254, element="roller")
_PRONOSTIA = Bearing("PRONOSTIA", 13, 3.5e-3, 25.6e-3)


def recordings() -> Iterator[tuple[str, NDArray[Any], float, Bearing, float]]:
    """Yield name, samples, rate, bearing and stated speed of the blocks of each recording."""
    sets: tuple[tuple[str, str, str, str | None, str, Any, float | None, Bearing, float], ...] = (
        ("cwru", "cwru", "*.mat", "X*_DE_time", "g", 5.0, None, from_catalogue("6205"), 1797 / 60),
        ("mfpt", "mfpt", "*.mat", None, "g", "file", None, _NICE, 25.0),
        ("hit_sm", "hit_sm_mfs", "*.mat", None, "unknown", "file", 51200.0, from_catalogue("6205"), 20.0),
        ("pronostia", "femto", "Bearing2_7*", None, "g", "file", None, _PRONOSTIA, 27.5),
    )
    for kind, folder, pattern, key, unit, block_s, rate, bearing, stated in sets:
        for path in sorted((_DATA / folder).glob(pattern)):
            name = "horizontal" if kind == "pronostia" else "x"
            channel = ChannelSpec(name, key=key, unit=unit)
            spec = SourceSpec("s", str(path), format=kind, channels=(channel,), block_s=block_s, rate=rate)
            for number, block in enumerate(open_source(spec)):
                if isinstance(block, Block) and number < 2:
                    yield (
                        f"{kind} {path.stem}[{number + 1}]",
                        block.samples[0],
                        block.rate,
                        bearing,
                        block.speed or stated,
                    )


def _row(name: str, samples: NDArray[Any], rate: float, bearing: Bearing, stated: float) -> dict[str, Any]:
    began = time.thread_time()
    found = estimate_speed(samples, rate, bearing, LIMITS)
    spent = time.thread_time() - began
    return {
        "block": name,
        "stated_hz": stated,
        "status": str(found.status),
        "found_hz": found.speed if math.isfinite(found.speed) else None,
        "error_percent": 100.0 * (found.speed / stated - 1.0) if math.isfinite(found.speed) else None,
        "sd_percent": 100.0 * found.sd / stated if math.isfinite(found.sd) else None,
        "score": found.score if math.isfinite(found.score) else None,
        "margin": found.margin if math.isfinite(found.margin) else None,
        "ms": 1e3 * spent,
    }


def simulated(lives: int) -> Iterator[dict[str, Any]]:
    """Yield rows of simulated lives that wear out at 40 Hz: before the damage, in the middle, at the end."""
    for seed in range(1, lives + 1):
        rig = SimulatedRig("r", seed, healthy_blocks=2)
        for number in (1, len(rig) // 2, len(rig)):
            block = rig.block(number)
            # The first number that the rig draws for a block: its drive is not exact.
            drawn = np.random.default_rng([seed, 2, number]).standard_normal()
            true = rig.speed * (1.0 + 0.001 * float(drawn))
            yield _row(f"rig {seed}[{number}]", block.samples[0], block.rate, rig.bearing, true)


def noise(count: int) -> dict[str, Any]:
    """Return the highest score of white noise, and how often a speed was called."""
    rng = np.random.default_rng(0)
    found = [
        estimate_speed(rng.standard_normal(128_000), 25600.0, from_catalogue("6205"), LIMITS) for _ in range(count)
    ]
    return {
        "blocks": count,
        "called": sum(item.status == SpeedStatus.OK for item in found),
        "highest_score": max(item.score for item in found),
        "highest_margin": max(item.margin for item in found),
    }


@benchmark(__doc__ or "")
def main(quick: bool) -> Tables:
    """Print the tables."""
    rows = [_row(*item) for item in recordings()] if _DATA.is_dir() else []
    rows += list(simulated(2 if quick else 8))
    quiet = noise(20 if quick else 300)
    return {"rows": rows, "noise": quiet}

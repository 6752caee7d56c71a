"""Onset and V_eq of lives beside gears, with their lines left in and removed.

Run as ``python -m benchmarks.gear_lives [--quick] [--json FILE]``. Lives of the simulated rig (150 healthy blocks, then
damage up to 1.3 times the threshold) with gears of 23 and 71 teeth by the model of the train, loaded, at two levels
over the background in 1 to 10 kHz. Their blocks go through the monitor of the demo (map of nominal parameters, the
tracker "filter") with the band 1 to 11 kHz, in which the gears are: without gears; with them and nothing configured;
with ``[gear]``. The RMS keeps the lines of gears in all of them, the envelope loses them by ``[gear]``.

Tables: the onset in blocks after the true one, negative where it came before the damage; and ln of V_eq over the true
volume in the blocks after the onset that have one. Seeds: those set aside for lives; nothing was fitted on lives.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.common import Row, arguments, circumstances, print_table, write_json
from benchmarks.seeded_gears import GEAR_LIVES
from models.machine.rig import Rig
from monitor.commands.demo import _demo_map, demo_config
from monitor.health.gears.interference import gear_interference
from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel
from monitor.health.state import SourceSettings
from monitor.service.setup import source_settings
from streams.rig import open_rig
from tests.support.steps import Steps

CHANNEL = "test_bearing"
BAND = (1000.0, 11_000.0)
TEETH = (23, 71)
LEVELS = (10, 20)
LIVES = 4


@dataclass(frozen=True)
class Life:
    """What was said of a life in one way.

    Attributes:
        way: of the gears.
        onset: blocks from the true onset to the one that was said; None: never.
        errors: ln of V_eq over the truth.
        ratio: blocks after the onset with V_eq over all of them.
    """

    way: str
    onset: int | None
    errors: tuple[float, ...]
    ratio: float


def ways() -> dict[str, tuple[int | None, SourceSettings]]:
    """Return the level of the gears, dB, and the settings of each way."""
    config = demo_config("filter")
    settings = source_settings(config, config.source[0], {CHANNEL: _demo_map(config, Rig.model, quiet=True)})
    channel = replace(settings.channels[CHANNEL], bands=(BAND,))
    wheels = GearWheel("driver", TEETH[0], 1.0), GearWheel("driven", TEETH[1], TEETH[0] / TEETH[1])
    lines = gear_interference(GearSettings(wheels, (GearPairing("driver", "driven"),)))
    left = replace(settings, channels={CHANNEL: channel})
    removed = replace(settings, channels={CHANNEL: replace(channel, interference=lines)})
    found: dict[str, tuple[int | None, SourceSettings]] = {"no gears": (None, left)}
    for level in LEVELS:
        found[f"{level} dB, nothing"] = level, left
        found[f"{level} dB, [gear]"] = level, removed
    return found


def lives(seed: int, settings: Mapping[str, tuple[int | None, SourceSettings]]) -> Iterator[Life]:
    """Yield what is said of a life in each way."""
    url = f"rig:ferrara?seed={seed}"
    plain, geared = open_rig(url, "rig"), open_rig(f"{url}&gear={TEETH[0]}/{TEETH[1]}&gear_db=0", "rig")
    steps = {way: Steps(one) for way, (_, one) in settings.items()}
    known: dict[str, int] = {}
    errors: dict[str, list[float]] = {way: [] for way in steps}
    for block in plain:
        added = geared.block(block.sequence).samples - block.samples
        true: float = plain.truth(block.sequence, ())["v_eq_true"]
        for way, (level, _) in settings.items():
            x = block.samples if level is None else block.samples + np.float32(10.0 ** (level / 20.0)) * added
            said: Mapping[str, Any] = steps[way].take(replace(block, samples=x)).channels[CHANNEL]
            if said["stage"] in ("final", "end_of_life"):
                known.setdefault(way, block.sequence)
            v_eq = said.get("v_eq")
            if true > 0.0 and v_eq is not None and v_eq > 0.0:
                errors[way].append(math.log(v_eq / true))
    after = len(plain) - plain.life.onset + 1
    for way, found in errors.items():
        onset = known[way] - plain.life.onset if way in known else None
        yield Life(way, onset, tuple(found), len(found) / after)


def rows_of(found: list[Life]) -> list[Row]:
    """Return the table."""
    rows: list[Row] = []
    for way in dict.fromkeys(life.way for life in found):
        of = [life for life in found if life.way == way]
        onsets = [life.onset for life in of]
        errors = np.array([error for life in of for error in life.errors])
        rows.append(
            {
                "gears": way,
                "lives": len(of),
                "onset, blocks after the true one": ", ".join("never" if one is None else str(one) for one in onsets),
                "blocks with V_eq, share": float(np.mean([life.ratio for life in of])),
                "median ln(V_eq/true)": float(np.median(errors)) if errors.size else None,
                "rms ln(V_eq/true)": float(np.sqrt(np.mean(errors**2))) if errors.size else None,
            }
        )
    return rows


def main() -> None:
    """Run, print, write."""
    options = arguments("Onset and V_eq beside gears.")
    settings = ways()
    found = [life for seed in GEAR_LIVES[: 1 if options.quick else LIVES] for life in lives(seed, settings)]
    rows = rows_of(found)
    print_table("Lives beside gears", rows)
    write_json(options.json, {"run": circumstances(), "lives": rows})


if __name__ == "__main__":
    main()

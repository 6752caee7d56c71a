"""Naming the damaged part: right where a part can be found, silent where none can.

Run as ``python -m benchmarks.naming [--quick] [--json FILE]``. Tables:

1. every single recording through the program as its example configuration says: the name, and the evidence beside what
   it needed. ``score`` must reach ``threshold`` and exceed ``rival`` (sought only where the rest holds), ``depth`` must
   reach the least depth;
2. the same with the stated shaft speed 4 % too low and too high: the right part or none is right, another is wrong;
3. margins: the weakest of the true, the strongest of what had to stay silent, nominal speed and wrong speeds together;
4. the same recordings in every band that the program would consider (``band_hz = "auto"``), not only the configured
   one, in pieces of a second, and with any stated speed up to 12 % wrong: how often right, silent, wrong;
5. white noise and simulated healthy bearings, single and averaged: names, of which there should be none; and one block
   of regular impacts among averaged quiet ones;
6. simulated damage by height of the impacts: how often named rightly, wrongly;
7. for each bearing of the catalogue the two families that stand closest, and how wrong the stated speed must be for one
   to be taken for the other.

Without the recordings (``SPALLWATCH_DATA``) tables 1 to 4 are left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.naming_of import namings_of
from models.machine.bearing import Kinematics, catalogue, kinematics
from monitor.health.name.naming import MIN_DEPTH, SURE, Naming
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.bands import candidate_bands, find_band
from monitor.health.signal.features import FAULTS, FeatureSettings, block_features, fundamentals
from monitor.health.signal.lines import SEARCH
from monitor.health.signal.transform import Band
from streams.block import Block
from tests.conftest import recordings_folder
from tests.support.recordings import CASES, Case, watch
from tests.support.signals import HealthyMachine, bearing_lines, impacts, pulses

SPEED_ERRORS = (0.0, -0.04, 0.04)


@dataclass(frozen=True)
class Named:
    """One verdict: of a case and channel, at a speed error, and the verdict on it."""

    case: Case
    channel: str
    speed_error: float
    naming: Naming | None

    @property
    def verdict(self) -> str:
        """Return right, silent (allowed where speed is wrong or nothing can be found), missed or wrong."""
        fault = None if self.naming is None else self.naming.fault
        if fault is not None:
            return "right" if fault in self.case.allowed else "wrong"
        return "silent" if self.case.expected is None or self.speed_error else "missed"

    def row(self) -> Row:
        """Return the evidence."""
        naming = self.naming
        evidence = None if naming is None else naming.evidence
        return {
            "recording": Path(self.case.file).name,
            "channel": self.channel,
            "speed_error": self.speed_error,
            "expected": self.case.expected or "none",
            "named": "stopped" if naming is None else (naming.fault or "none"),
            "verdict": self.verdict,
            "best": naming and naming.best,
            "score": evidence and evidence.comb_score,
            "threshold": naming and naming.threshold,
            "rival": None if naming is None or np.isnan(naming.rival) else naming.rival,
            "depth": evidence and evidence.depth,
            "snr": evidence and evidence.family_snr,
            "speed_factor": evidence and evidence.speed_factor,
        }


def verdicts(folder: Path, speed_error: float) -> Iterator[Named]:
    """Take every recording through the program."""
    for case in CASES:
        for item, steps, _ in watch(case.config, folder / case.file, speed_error=speed_error):
            if not isinstance(item, Block):
                raise AssertionError(f"{case.file}: {item}")
            for channel, output in steps.outputs.items():
                yield Named(case, channel, speed_error, output.naming)


def standing(naming: Naming) -> float:
    """Return how far a family stands in the weakest of its two conditions, 0 where another comb takes its place."""
    evidence = naming.evidence
    if evidence is None or naming.rival > 0.0:
        return 0.0
    sure = evidence.depth - SURE * evidence.depth_error
    return min(evidence.comb_score / naming.threshold, sure / MIN_DEPTH)


def margin_rows(found: list[Named]) -> list[Row]:
    """Table 3: the three weakest of the true, the five strongest of those that had to stay silent."""
    seen = [(standing(one.naming), one) for one in found if one.naming is not None]
    seen.sort(key=lambda pair: pair[0])
    true = [pair for pair in seen if pair[1].verdict in ("right", "missed")][:3]
    silent = [pair for pair in seen if pair[1].verdict in ("silent", "wrong")][::-1][:5]
    tagged = [("true", *pair) for pair in true] + [("silent", *pair) for pair in silent]
    return [{"what": what, "standing": value, **one.row()} for what, value, one in tagged]


def tally(counts: Counter[str]) -> dict[str, int]:
    """Return the counts of right, silent and wrong verdicts."""
    return {name: counts[name] for name in ("right", "silent", "wrong")}


def judged(fault: str | None, case: Case | str) -> str:
    """Return right, silent or wrong, for a recording or the damaged part."""
    if fault is None:
        return "silent"
    return "right" if fault == case or (isinstance(case, Case) and fault in case.allowed) else "wrong"


def namings(
    x: NDArray[np.floating],
    rate: float,
    bands: tuple[Band, ...],
    lines: Kinematics,
    recent: RecentSpectra | None = None,
    average: int = 1,
) -> tuple[list[Naming], RecentSpectra]:
    """Return the verdict in each band, and the recent spectra with those of this block."""
    settings = FeatureSettings(rate, bands, fundamentals(lines), speed=lines.speed, average_blocks=average)
    features = block_features(x, rate, settings, recent)
    return list(namings_of(features, lines)), features.recent


def band_rows(folder: Path) -> list[Row]:
    """Table 4: each recording in all candidate bands, and in pieces of a second in the configured one."""
    rows: list[Row] = []
    for case in CASES:
        bands: Counter[str] = Counter()
        automatic: Counter[str] = Counter()
        wrong: list[str] = []
        pieces: Counter[str] = Counter()
        for block, steps, _ in watch(case.config, folder / case.file):
            for channel, output in steps.outputs.items():
                if output.naming is None or output.speed.value is None or not isinstance(block, Block):
                    continue
                lines = kinematics(steps.settings.channels[channel].bearing, output.speed.value)
                x = block.samples[block.channels.index(channel)]
                candidates = candidate_bands(block.rate, max(fundamentals(lines).values()))
                chosen = find_band([x], block.rate, fundamentals(lines))
                found, _ = namings(x, block.rate, candidates, lines)
                for band, naming in zip(candidates, found, strict=True):
                    verdict = judged(naming.fault, case)
                    if verdict == "wrong" and naming.evidence is not None:
                        wrong.append(
                            f"{channel} {band[0]:.0f}-{band[1]:.0f}: {naming.fault} {naming.evidence.depth:.2f}"
                        )
                    bands[verdict] += 1
                    automatic[verdict] += band == chosen
        for block, steps, _ in watch(case.config, folder / case.file, block_s=1.0):
            for output in steps.outputs.values():
                if output.naming is not None and isinstance(block, Block):
                    pieces[judged(output.naming.fault, case)] += 1
        rows.append(
            {
                "recording": Path(case.file).name,
                "configuration": case.config,
                "expected": case.expected or "none",
                **{f"bands {name}": count for name, count in tally(bands).items()},
                **{f"auto {name}": count for name, count in tally(automatic).items()},
                **{f"pieces {name}": count for name, count in tally(pieces).items()},
                "wrong in bands (Hz: part, depth)": "; ".join(wrong),
            }
        )
    return rows


def speed_rows(folder: Path) -> list[Row]:
    """Table 4, second part: how often right, silent, wrong by the error of the stated speed."""
    rows: list[Row] = []
    for percent in range(-12, 13):
        counts: Counter[str] = Counter()
        wrong = set()
        for one in verdicts(folder, percent / 100.0):
            counts["silent" if one.verdict == "missed" else one.verdict] += 1
            if one.verdict == "wrong":
                wrong.add(f"{Path(one.case.file).stem}: {one.naming and one.naming.fault}")
        rows.append({"speed_error_%": percent, **tally(counts), "which": "; ".join(sorted(wrong))})
    return rows


def family_rows() -> list[Row]:
    """Table 7."""
    rows: list[Row] = []
    for name, bearing in catalogue().items():
        lines = sorted(fundamentals(kinematics(bearing, 1.0)).items(), key=lambda item: item[1])
        (low, f_low), (high, f_high) = min(pairwise(lines), key=lambda pair: pair[1][1] / pair[0][1])
        gap = f_high / f_low - 1.0
        rows.append(
            {
                "bearing": name,
                "closest": f"{low}, {high}",
                "apart_%": 100 * gap,
                "speed_error_%": 100 * max(0.0, gap - SEARCH),
            }
        )
    return rows


NULLS = (
    ("6205", 30.0, 1.0, 1),
    ("6205", 30.0, 5.0, 1),
    ("ZA-2115", 33.3, 1.0, 1),
    ("1205 ETN9", 40.0, 5.0, 1),
    ("22207", 10.0, 5.0, 1),
    ("PRONOSTIA", 27.5, 0.1, 1),
    ("PRONOSTIA", 27.5, 0.1, 16),
    ("PRONOSTIA", 27.5, 0.1, 60),
)
"""Bearing, shaft speed in Hz, seconds of a block, blocks averaged."""


def null_row(signal: str, bearing: str, speed: float, duration: float, average: int, count: int) -> Row:
    """Return how often a signal without damage gets a name.

    The signal is "white" noise, a "healthy" machine, or "impacts": white noise in all averaged blocks but one, in which
    something knocks five times in the rhythm of the outer race.
    """
    rng = np.random.default_rng(8)
    _, lines = bearing_lines(bearing, speed)
    rate, n = 25600.0, round(25600.0 * duration)
    named, scores, threshold = 0, [], 0.0
    for _ in range(count):
        machine = HealthyMachine.draw(rng, speed, lines.bpfo)
        recent: RecentSpectra | None = None
        naming: Naming | None = None
        for i in range(average):
            x = machine.block(rng, 1.0, rate, n) if signal == "healthy" else rng.standard_normal(n)
            if signal == "impacts" and i == average // 2:
                x += pulses(n, rate, rng.uniform(0.0, 0.03) + np.arange(5) / lines.bpfo, 300.0)
            (naming,), recent = namings(x.astype(np.float32), rate, ((1000.0, 9000.0),), lines, recent, average)
        if naming is None:
            raise AssertionError("no block was averaged")
        named += naming.fault is not None
        scores.append(0.0 if naming.evidence is None else naming.evidence.comb_score)
        threshold = naming.threshold
    return {
        "signal": signal,
        "bearing": bearing,
        "block_s": duration,
        "averaged": average,
        "spectra": count,
        "named": named,
        "highest score": max(scores),
        "threshold": threshold,
    }


def null_rows(quick: bool) -> list[Row]:
    """Table 5."""
    budget = 25.0 if quick else 250.0
    rows = []
    for bearing, speed, duration, average in NULLS:
        count = round(min(20 * budget, max(8.0, budget / (duration * average))))
        signals = ("white", "healthy", "impacts") if average > 1 else ("white", "healthy")
        rows += [null_row(signal, bearing, speed, duration, average, count) for signal in signals]
    return rows


def damage_rows(quick: bool) -> list[Row]:
    """Table 6: 6205 at 30 Hz in noise of 1 m/s2, jitter 0.5 %, slip 0.5 %."""
    rows: list[Row] = []
    _, lines = bearing_lines("6205", 30.0)
    rate, count = 25600.0, 3 if quick else 12
    for fault in FAULTS:
        for duration in (1.0, 5.0):
            for height in (2.0, 4.0, 8.0, 30.0, 1000.0):
                counts: Counter[str] = Counter()
                depths = []
                for seed in range(count):
                    x = impacts(np.random.default_rng(seed), fault, lines, duration=duration, height=height)
                    (naming,), _ = namings(x.astype(np.float32), rate, ((1000.0, 9000.0),), lines)
                    counts[judged(naming.fault, fault)] += 1
                    depths.append(naming.families[fault].depth)
                rows.append(
                    {
                        "damaged": fault,
                        "block_s": duration,
                        "height": height,
                        "depth": float(np.median(depths)),
                        **tally(counts),
                    }
                )
    return rows


def main() -> None:
    """Run, print, write."""
    options = arguments("Naming the damaged part: recordings, margins, noise, simulated damage.")
    tables: dict[str, list[Row]] = {}
    folder = recordings_folder()
    if folder.is_dir():
        found = [one for error in SPEED_ERRORS for one in verdicts(folder, error)]
        tables["nominal"] = [one.row() for one in found if one.speed_error == 0.0]
        tables["wrong_speed"] = [one.row() for one in found if one.speed_error != 0.0]
        tables["margins"] = margin_rows(found)
        print_table("1. Recordings", tables["nominal"])
        print_table("2. Recordings with the speed wrong", tables["wrong_speed"])
        print_table("3. Margins", tables["margins"])
        if not options.quick:
            tables["bands"] = band_rows(folder)
            print_table("4. All candidate bands; pieces of a second", tables["bands"])
            tables["speeds"] = speed_rows(folder)
            print_table("4. Stated speed wrong", tables["speeds"])
    else:
        print("no recordings: SPALLWATCH_DATA names no folder")
    tables["undamaged"] = null_rows(options.quick)
    print_table("5. Undamaged", tables["undamaged"])
    tables["damaged"] = damage_rows(options.quick)
    print_table("6. Simulated damage", tables["damaged"])
    tables["families"] = family_rows()
    print_table("7. Closest families", tables["families"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()

"""Which band to demodulate: the choice of a band, judged by the names that it gives.

Run as ``python -m benchmarks.bands [--quick] [--json FILE]``. Each way of choosing looks at one block and gives one
band, in which the damaged part is named as the program does:

- configured: that of the example configuration (recordings), 1 to 9 kHz (simulated);
- widest: from five times the highest fault frequency to 0.98 of the Nyquist frequency;
- auto: ``band_hz = "auto"`` as it was until this benchmark (kurtosis times contrast and depth of all periodic lines);
- kurtogram: the band of the highest kurtosis (Antoni 2007, ``monitor/health/signal/kurtogram.py``);
- infogram: the band of the highest mean negentropy of the squared envelope and its spectrum (Antoni, doi
  10.1016/j.ymssp.2015.04.034);
- log envelope: the band whose spectrum of the logarithm of the squared envelope has the strongest lines at the
  bearing's frequencies (Borghesani and Antoni, doi 10.1016/j.ymssp.2016.06.004): cyclostationarity as evidence;
- deepest comb: the band in which a family of the bearing stands highest over what a name needs;
- several: the configured band, the widest and the halves of the range at once, the name of the best (``band_hz`` as a
  list);
- any: whether any band that was looked at gives the right name, the best that a choice could do; wrong: whether any
  gives a wrong one.

Bands are those of the kurtogram and the candidates of ``auto``, six times as wide as the highest fault frequency at
least. Tables: recordings (a whole block, and pieces of a second), and of how many as a whole ``auto`` takes the widest
band; simulated machines with a resonance anywhere, loud noise elsewhere, knocks without rhythm and a gear mesh; the
same machines without damage, of which none may be named; names by when ``auto`` chooses, before the damage or with it,
and with the mesh configured as interference; cost; the kurtogram of white noise.
Nothing was fitted on the simulated machines (seeds from 2000).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from benchmarks.naming_of import namings_of
from models.machine.bearing import Kinematics, kinematics
from monitor.health.name.naming import Naming
from monitor.health.signal.bands import candidate_bands, find_band
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from monitor.health.signal.interference import Comb, Interference
from monitor.health.signal.kurtogram import Kurtogram, kurtogram
from monitor.health.signal.transform import Band
from streams.block import Block
from tests.conftest import recordings_folder
from tests.support.recordings import CASES, OTHER_ENDS, judge, watch
from tests.support.signals import bearing_lines

FIRST_SEED = 2000
MESH = Interference(orders=(23.0,))
RATE, DURATION = 25600.0, 2.0
BEARINGS = (("6205", 24.3), ("6203", 41.0), ("ZA-2115", 33.3), ("PRONOSTIA", 27.5), ("1205 ETN9", 17.0))


@dataclass(frozen=True, eq=False)
class Subject:
    """A block, and what is true of it: ``fault`` is None where nothing may be named."""

    name: str
    x: NDArray[np.float64]
    rate: float
    lines: Kinematics
    fault: str | None
    configured: Band

    @cached_property
    def highest(self) -> float:
        """The highest fault frequency, Hz."""
        return max(fundamentals(self.lines).values())

    @cached_property
    def kurtogram(self) -> Kurtogram | None:
        """The kurtogram."""
        return kurtogram(self.x, self.rate)

    @cached_property
    def bands(self) -> tuple[Band, ...]:
        """All bands that are looked at; the first is the widest candidate."""
        found = list(candidate_bands(self.rate, self.highest))
        if self.kurtogram is not None:
            for level in range(1, len(self.kurtogram.levels)):
                tree = [self.kurtogram.band(level, place) for place in range(len(self.kurtogram.levels[level]))]
                found += [band for band in tree if band[1] - band[0] >= 6.0 * self.highest]
        return tuple(dict.fromkeys((*found, self.configured)))

    @cached_property
    def namings(self) -> Mapping[Band, Naming]:
        """What is named in each band."""
        settings = FeatureSettings(self.rate, self.bands, fundamentals(self.lines), speed=self.lines.speed)
        features = block_features(self.x.astype(np.float32), self.rate, settings)
        return dict(zip(self.bands, namings_of(features, self.lines), strict=True))

    @cached_property
    def envelopes(self) -> Mapping[Band, NDArray[np.float64]]:
        """The squared envelope of each band at its critical rate."""
        spectrum = np.fft.rfft(self.x - self.x.mean())
        edges = {band: [round(edge * self.x.size / self.rate) for edge in band] for band in self.bands}
        return {band: np.abs(np.fft.ifft(spectrum[lo:hi])) ** 2 for band, (lo, hi) in edges.items()}


def configured(subject: Subject) -> Band:
    """Return the configured band."""
    return subject.configured


def widest(subject: Subject) -> Band:
    """Return the widest candidate."""
    return subject.bands[0]


def automatic(subject: Subject) -> Band:
    """Return the choice of ``auto``."""
    return find_band([subject.x], subject.rate, fundamentals(subject.lines))


def of_kurtogram(subject: Subject) -> Band:
    """Return the band of the highest kurtosis, of those wide enough; the widest where all is noise."""
    found = subject.kurtogram
    if found is None:
        return subject.bands[0]
    cells = [
        (value, found.band(level, place))
        for level, row in enumerate(found.levels)
        for place, value in enumerate(row)
        if value > found.noise_limit(level) and found.band(level, place) in subject.bands
    ]
    return max(cells)[1] if cells else subject.bands[0]


def of_infogram(subject: Subject) -> Band:
    """Return the band of the highest negentropy, half that of the squared envelope, half that of its spectrum."""

    def negentropy(values: NDArray[np.float64]) -> float:
        share = values / max(float(values.mean()), 1e-300)
        return float(np.mean(share * np.log(np.maximum(share, 1e-300))))

    def score(envelope: NDArray[np.float64]) -> float:
        spectrum = np.abs(np.fft.rfft(envelope - envelope.mean())[1:]) ** 2
        return 0.5 * (negentropy(envelope) + negentropy(spectrum))

    return max(subject.envelopes, key=lambda band: score(subject.envelopes[band]))


def of_log_envelope(subject: Subject) -> Band:
    """Return the band whose log envelope has the strongest lines of the bearing over the median of its spectrum."""
    resolution = subject.rate / subject.x.size

    def score(envelope: NDArray[np.float64]) -> float:
        logarithm = np.log(np.maximum(envelope, 1e-12 * envelope.max() + 1e-300))
        window = np.hanning(logarithm.size)
        power = np.abs(np.fft.rfft((logarithm - logarithm.mean()) * window)) ** 2
        best = 0.0
        for fundamental in fundamentals(subject.lines).values():
            factors = np.arange(0.98, 1.0201, 0.5 * resolution / (5.0 * fundamental))
            bins = np.rint(np.multiply.outer(np.arange(1, 6) / resolution, fundamental * factors)).astype(np.intp)
            best = max(best, float(np.append(power, 0.0)[np.minimum(bins, power.size)].sum(axis=0).max()))
        return best / max(float(np.median(power)), 1e-300)

    return max(subject.envelopes, key=lambda band: score(subject.envelopes[band]))


def standing(naming: Naming) -> tuple[bool, float]:
    """Return by what the best of several bands is chosen in the program."""
    return naming.fault is not None, naming.relative_score


def of_deepest(subject: Subject) -> Band:
    """Return the band in which a family stands highest."""
    return max(subject.namings, key=lambda band: standing(subject.namings[band]))


def of_several(subject: Subject) -> Band:
    """Return the best of the configured, the widest, and the halves."""
    few = {subject.configured, *subject.bands[:4]}
    return max(few, key=lambda band: standing(subject.namings[band]))


CHOICES: Mapping[str, Callable[[Subject], Band]] = {
    "configured": configured,
    "widest": widest,
    "auto": automatic,
    "kurtogram": of_kurtogram,
    "infogram": of_infogram,
    "log envelope": of_log_envelope,
    "deepest comb": of_deepest,
    "several": of_several,
}


def rows_of(subjects: Iterable[Subject], what: str) -> list[Row]:
    """Return one row for each way of choosing."""
    rows: list[Row] = []
    any_right = any_wrong = 0
    counts = {name: Counter[str]() for name in CHOICES}
    depths: dict[str, list[float]] = {name: [] for name in CHOICES}
    same = Counter[str]()
    for subject in subjects:
        for name, choose in CHOICES.items():
            band = choose(subject)
            naming = subject.namings[band]
            counts[name][judge(subject.fault, naming.fault)] += 1
            same[name] += band == subject.bands[0]
            if subject.fault is not None and subject.fault in naming.families:
                depths[name].append(naming.families[subject.fault].depth)
        verdicts = {judge(subject.fault, naming.fault) for naming in subject.namings.values()}
        any_right += "right" in verdicts
        any_wrong += bool({"wrong", "healthy named"} & verdicts)
    for name, count in counts.items():
        found = {verdict: count[verdict] for verdict in ("right", "joined", "silent", "wrong", "healthy named")}
        depth = float(np.median(depths[name])) if depths[name] else None
        rows.append({"signals": what, "band": name, **found, "median depth": depth, "is the widest": same[name]})
    total = {"right": any_right, "joined": None, "silent": None, "wrong": any_wrong, "healthy named": None}
    rows.append({"signals": what, "band": "any", **total, "median depth": None, "is the widest": None})
    return rows


def recorded(folder: Path, block_s: float | None) -> Iterator[Subject]:
    """Yield the blocks of all recordings and channels, at most three a recording."""
    for case in (*CASES, *OTHER_ENDS):
        if case.kind.startswith("disputed"):
            continue
        for place, (item, steps, _) in enumerate(watch(case.config, folder / case.file, block_s=block_s)):
            if place == 3:
                break
            for channel, output in steps.outputs.items():
                if output.naming is None or output.speed.value is None or not isinstance(item, Block):
                    continue
                lines = kinematics(steps.settings.channels[channel].bearing, output.speed.value)
                x = item.samples[item.channels.index(channel)].astype(np.float64)
                yield Subject(case.file, x, item.rate, lines, case.part, output.bands[0])


def widest_rows(folder: Path) -> list[Row]:
    """Return of how many whole recordings, by channel, ``auto`` takes the widest band, as a replay does."""
    counts: dict[str, Counter[bool]] = {"damaged": Counter(), "undamaged": Counter()}
    for case in (*CASES, *OTHER_ENDS):
        blocks: dict[str, list[Subject]] = {}
        for item, steps, _ in watch(case.config, folder / case.file):
            for channel, output in steps.outputs.items():
                if output.naming is None or output.speed.value is None or not isinstance(item, Block):
                    continue
                lines = kinematics(steps.settings.channels[channel].bearing, output.speed.value)
                x = item.samples[item.channels.index(channel)].astype(np.float64)
                blocks.setdefault(channel, []).append(Subject("", x, item.rate, lines, None, output.bands[0]))
        for found in blocks.values():
            first = found[0]
            same = [subject.x for subject in found if subject.x.size == first.x.size]
            band = find_band(same, first.rate, fundamentals(first.lines))
            counts["damaged" if case.part else "undamaged"][band == candidate_bands(first.rate, first.highest)[0]] += 1
    return [{"recordings": what, "widest": count[True], "other": count[False]} for what, count in counts.items()]


def ringing(train: NDArray[np.float64], frequency: float, decay: float) -> NDArray[np.float64]:
    """Return what a train of impacts excites in a resonance, shape (sample,)."""
    t = np.arange(train.size) / RATE
    ring = np.exp(-decay * t) * np.sin(2.0 * np.pi * frequency * t)
    return np.fft.irfft(np.fft.rfft(train, 2 * train.size) * np.fft.rfft(ring, 2 * train.size))[: train.size]


def machine(seed: int, fault: str | None) -> Subject:
    """Return a simulated machine of 2 s, with a resonance anywhere and disturbances elsewhere."""
    rng = np.random.default_rng(seed)
    bearing, speed = BEARINGS[seed % len(BEARINGS)]
    _, lines = bearing_lines(bearing, speed)
    n = round(RATE * DURATION)
    frequency = np.fft.rfftfreq(n, 1.0 / RATE)
    loud = 1.0 + rng.uniform(2.0, 10.0) * np.exp(
        -(((frequency - rng.uniform(500, 12e3)) / rng.uniform(300, 1500)) ** 2)
    )
    x = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * loud, n)
    for k in range(1, 9):
        x += rng.uniform(0.0, 1.5) / k * np.cos(2.0 * np.pi * (k * 23 * speed * np.arange(n) / RATE + rng.uniform()))
    knocks = np.zeros(n)
    knocks[rng.integers(0, n, rng.poisson(3.0 * DURATION))] = rng.uniform(5.0, 40.0)
    x += ringing(knocks, rng.uniform(1000.0, 12_000.0), rng.uniform(300.0, 2000.0))
    if fault is not None:
        line = fundamentals(lines)[fault] * (1.0 - rng.uniform(0.0, 0.012))
        times = np.cumsum((1.0 + 0.005 * rng.standard_normal(int(DURATION * line * 1.1))) / line)
        times = times[times < DURATION]
        carrier = lines.ftf if fault == "ball" else lines.speed
        swing = 1.0 + rng.uniform(0.1, 0.3 if fault == "outer" else 1.0) * np.cos(2.0 * np.pi * carrier * times)
        train = np.zeros(n)
        np.add.at(train, (times * RATE).astype(np.intp), rng.uniform(2.0, 16.0) * swing)
        x += ringing(train, rng.uniform(1500.0, 11_500.0), rng.uniform(300.0, 2000.0))
    return Subject(bearing, x, RATE, lines, fault, (1000.0, 9000.0))


def named_in(subject: Subject, band: Band, combs: tuple[Comb, ...]) -> str | None:
    """Return the name in one band, interference removed."""
    lines = fundamentals(subject.lines)
    settings = FeatureSettings(subject.rate, (band,), lines, speed=subject.lines.speed, interference=combs)
    features = block_features(subject.x.astype(np.float32), subject.rate, settings)
    return namings_of(features, subject.lines)[0].fault


def moment_rows(count: int) -> list[Row]:
    """Return how names depend on when ``auto`` chooses, and on the mesh being configured as interference."""
    counts: dict[tuple[str, str], Counter[str]] = {}
    faults = ("outer", "inner", "ball")
    for i in range(count):
        damaged, before = machine(FIRST_SEED + i, faults[i % 3]), machine(FIRST_SEED + i, None)
        lines = fundamentals(damaged.lines)
        for mesh in ("left in", "removed"):
            combs = MESH.combs(damaged.lines.speed) if mesh == "removed" else ()
            chosen = {
                "widest": damaged.bands[0],
                "auto, before the damage": find_band([before.x], RATE, lines, combs),
                "auto, with the damage": find_band([damaged.x], RATE, lines, combs),
            }
            for what, band in chosen.items():
                verdict = judge(damaged.fault, named_in(damaged, band, combs))
                counts.setdefault((what, mesh), Counter())[verdict] += 1
    return [
        {"band": what, "mesh": mesh, **{name: found[name] for name in ("right", "joined", "silent", "wrong")}}
        for (what, mesh), found in counts.items()
    ]


def cost_rows(rounds: int) -> list[Row]:
    """Return the processor time of each choice for one block of 5 s."""
    x = np.tile(machine(FIRST_SEED, "outer").x, 3)[:128_000]
    lines = machine(FIRST_SEED, "outer").lines

    def run(choose: Callable[[Subject], Band]) -> Callable[[], object]:
        return lambda: choose(Subject("", x, RATE, lines, None, (1000.0, 9000.0)))

    names = ("auto", "kurtogram", "infogram", "log envelope", "deepest comb")
    timed: dict[str, Callable[[], object]] = {name: run(CHOICES[name]) for name in names}
    timed["kurtogram by itself"] = lambda: kurtogram(x, RATE)
    timed["real FFT of 128,000 samples"] = calibration_kernel()
    return [{"choice": name, "ms": value} for name, value in interleaved_ms(timed, rounds).items()]


def noise_rows(count: int) -> list[Row]:
    """Return how often the kurtogram of white noise has a cell beyond what it says that noise may be."""
    rows: list[Row] = []
    for n in (2560, 4096, 25_600, 32_768):
        blocks = (np.random.default_rng(FIRST_SEED + i).standard_normal(n) for i in range(count))
        found = [kurtogram(block, RATE) for block in blocks]
        rows.append(
            {"samples": n, "blocks": count, "beyond": sum(one is not None and one.best() is not None for one in found)}
        )
    return rows


def main() -> None:
    """Run, print, write."""
    options = arguments("The band to demodulate: names by the way of choosing it.")
    count = 10 if options.quick else 120
    tables: dict[str, list[Row]] = {"recordings": []}
    folder = recordings_folder()
    if folder.is_dir():
        for what, block_s in (("blocks as configured", None), ("pieces of 1 s", 1.0)):
            found = list(recorded(folder, block_s))
            damaged = [subject for subject in found if subject.fault is not None]
            rest = [subject for subject in found if subject.fault is None]
            tables["recordings"] += rows_of(damaged, f"{what}, {len(damaged)} damaged")
            tables["recordings"] += rows_of(rest, f"{what}, {len(rest)} undamaged")
            if options.quick:
                break
        print_table("Recordings", tables["recordings"])
        tables["widest"] = widest_rows(folder)
        print_table("auto over whole recordings, by channel", tables["widest"])
    faults = ("outer", "inner", "ball")
    tables["simulated"] = rows_of(
        (machine(FIRST_SEED + i, faults[i % 3]) for i in range(count)), f"{count} simulated, damaged"
    )
    tables["simulated"] += rows_of((machine(FIRST_SEED + count + i, None) for i in range(count)), f"{count} healthy")
    print_table("Simulated machines", tables["simulated"])
    tables["moment"] = moment_rows(count)
    print_table(f"When auto chooses, {count} simulated machines", tables["moment"])
    tables["cost"] = cost_rows(2 if options.quick else 5)
    print_table("Processor time", tables["cost"])
    tables["noise"] = noise_rows(50 if options.quick else 500)
    print_table("Kurtogram of white noise", tables["noise"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()

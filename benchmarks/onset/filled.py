"""What lost samples that were filled with a constant do, and which are found; see ``monitor/health/signal/filled.py``.

Run as ``python -m benchmarks.onset.filled [--quick] [--json FILE]``. Tables:

1. blocks of 5 s with a share of the samples replaced in runs by 0, the mean or the last value: how RMS and H_or (the
   sum of the first five harmonics of the envelope spectrum) change, and how many of them have the flag ``filled``.
   Noise; a strong tone in it; noise about a level of ten times its RMS; impacts of a damaged outer race;
2. healthy machines of the first three kinds that have learned from whole blocks, and then get filled ones: how many
   begin a final stage where the flag is heeded, and where it is not;
3. recorded and simulated rows that nothing was lost of: the largest share that is taken for filled (without the
   recordings, simulated rows alone);
4. microseconds of the checks of a block of 128,000 samples, and of the search alone, taking turns; the ratio is that of
   the checks with it to those without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

import spallwatch as sw
from benchmarks.common import CALIBRATION_SAMPLES, Row, Tables, benchmark, interleaved_ms
from benchmarks.onset.parts import RATE, SECONDS, SPEED, features_of
from monitor.health import onset as detect
from monitor.health.signal import filled, quality
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from reference import recordings_folder
from reference.signals import HealthyMachine, bearing_lines, impacts

Samples = NDArray[np.float32]
SEED = 20261127
KINDS = ("noise", "tone", "offset", "damaged")
SHARES = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.39, 0.5)
RUNS = (3, 10, 30, 100, 300, 1000)
N = round(RATE * SECONDS)
LEARNED = 140
QUANTUM = 0.01


def fill(samples: Samples, share: float, run: int, how: str, rng: np.random.Generator) -> Samples:
    """Return samples of which a share is replaced in runs, one in each of as many parts of the block."""
    found = samples.copy()
    count = max(1, round(share * samples.size / run))
    part = samples.size // count
    for begin in range(0, count * part, part):
        first = max(1, begin + int(rng.integers(0, max(1, part - run))))
        value = {"zero": 0.0, "mean": float(samples.mean()), "held": samples[first - 1]}[how]
        found[first : first + run] = value
    return found


def block_of(kind: str, machine: HealthyMachine, level: float, rng: np.random.Generator) -> Samples:
    """Return a block of 5 s of a machine, quantised."""
    _, lines = bearing_lines("PRONOSTIA", SPEED)
    x = machine.block(rng, level, RATE, N)
    if kind == "tone":
        x += 10.0 * level * np.sin(2.0 * np.pi * (20.0 * SPEED / RATE * np.arange(N) + rng.uniform()))
    elif kind == "offset":
        x += 10.0
    elif kind == "damaged":
        x += impacts(rng, "outer", lines, rate=RATE, duration=SECONDS, height=4.0, noise=0.0)
    return quantised(x)


def quantised(x: NDArray[np.floating]) -> Samples:
    """Return samples as multiples of the quantum."""
    return (np.round(x / QUANTUM) * QUANTUM).astype(np.float32)


def flagged(samples: Samples) -> bool:
    """Return whether a block has the flag."""
    return "filled" in quality.check_samples(samples).flags


def levels_of(samples: Samples) -> tuple[float, float]:
    """Return RMS and H_or of a block."""
    _, lines = bearing_lines("PRONOSTIA", SPEED)
    asked = FeatureSettings(RATE, ((500.0, 6000.0),), fundamentals(lines), speed=SPEED)
    found = block_features(samples, RATE, asked)
    return found.rms, found.lines[0]["outer"].total


def changes(kind: str, how: str, shares: tuple[float, ...], runs: tuple[int, ...], draws: int) -> Iterator[Row]:
    """Table 1, a row a share and length of the runs."""
    rng = np.random.default_rng(SEED)
    _, lines = bearing_lines("PRONOSTIA", SPEED)
    machine = HealthyMachine.draw(rng, SPEED, lines.bpfo)
    whole = [block_of(kind, machine, 1.0, rng) for _ in range(draws)]
    before = np.array([levels_of(block) for block in whole])
    for share in shares:
        for run in runs:
            blocks = [fill(block, share, run, how, rng) for block in whole]
            change = np.array([levels_of(block) for block in blocks]) / before - 1.0
            yield {
                "machine": kind,
                "filled with": how,
                "share": share,
                "run": run,
                "rms_change": float(np.median(change[:, 0])),
                "h_or_change": float(np.median(change[:, 1])),
                "h_or_change_max": float(np.max(np.abs(change[:, 1]))),
                "flagged": float(np.mean([flagged(block) for block in blocks])),
            }


def onsets(kind: str, shares: tuple[float, ...], runs: tuple[int, ...], machines: int, blocks: int) -> Iterator[Row]:
    """Table 2, a row a share and length of the runs: whole blocks, then filled ones."""
    _, lines = bearing_lines("PRONOSTIA", SPEED)
    rng = np.random.default_rng(SEED + 1)
    settings = detect.DetectSettings()
    learned: list[tuple[detect.DetectState, list[Samples]]] = []
    for _ in range(machines):
        machine, state = HealthyMachine.draw(rng, SPEED, lines.bpfo), detect.DetectState()
        whole = [block_of(kind, machine, float(level), rng) for level in machine.levels(rng, LEARNED + blocks)]
        for i, block in enumerate(whole[:LEARNED]):
            state, _ = detect.step(state, features_of(block, i + 1), settings)
        learned.append((state, whole[LEARNED:]))
    for share in shares:
        for run in runs:
            found = {"heeded": 0, "not heeded": 0}
            for start, whole in learned:
                lossy = [fill(block, share, run, "zero", rng) for block in whole]
                inputs = [features_of(block, LEARNED + 1 + i) for i, block in enumerate(lossy)]
                for name in found:
                    state = start
                    for block, features in zip(lossy, inputs, strict=True):
                        usable = name == "not heeded" or not flagged(block)
                        state, _ = detect.step(state, replace(features, usable=usable), settings)
                    found[name] += state.stage not in (detect.LEARNING, detect.HEALTHY)
            finals = {f"final stages, flag {name}": count for name, count in found.items()}
            yield {"machine": kind, "share": share, "run": run, "machines": machines, **finals}


def recorded() -> Iterator[tuple[str, Samples]]:
    """Give the rows of the recordings by data set, and simulated rows of few and of many values."""
    for path in sorted(recordings_folder().glob("*/*")):
        if path.parent.name == "femto_histories" or path.suffix not in (".mat", ".xz", ".bz2"):
            continue
        for block in sw.blocks(path, block_s="file", skip_rejected=True):
            yield from ((path.parent.name, row) for row in block.values)
    rng = np.random.default_rng(SEED + 2)
    noise = rng.standard_normal(N)
    for quantum in (0.001, 0.03, 0.1, 0.2, 0.3, 0.5, 1.0, 3.0, 10.0):
        yield "white noise", np.round(noise / quantum).astype(np.float32)
        yield "clipped noise", np.clip(np.round(noise / quantum), -1.5 / quantum, 1.5 / quantum).astype(np.float32)
        slow = 10.0 * np.sin(2e-3 * np.arange(N))
        yield "slow tone in noise", np.round((slow + noise) / quantum).astype(np.float32)
    yield (
        "text of 3 digits",
        np.array([float(f"{value:.3g}") for value in 10.0 * np.sin(2e-3 * np.arange(N))], np.float32),
    )


def not_lost() -> list[Row]:
    """Table 3."""
    shares: dict[str, list[float]] = {}
    for name, row in recorded():
        begins, ends = filled.filled_runs(row, float(row.min()), float(row.max()))
        shares.setdefault(name, []).append(float((ends - begins).sum()) / row.size)
    return [
        {"rows of": name, "rows": len(found), "largest share": max(found), "flagged": sum(share > 0 for share in found)}
        for name, found in shares.items()
    ]


def cost(rounds: int) -> list[Row]:
    """Table 4."""
    rng = np.random.default_rng(SEED + 3)
    whole = rng.standard_normal(CALIBRATION_SAMPLES).astype(np.float32)
    cases = {
        "float32": whole,
        "16 bits": np.round(whole * 3000.0),
        "12 bits": np.round(whole * 200.0),
        "few values": np.round(whole * 2.0),
        "40 % filled": fill(whole, 0.4, 100, "zero", rng),
    }
    rows: list[Row] = []
    for name, samples in cases.items():
        span = float(samples.min()), float(samples.max())
        check: Callable[[], object] = partial(quality.check_samples, samples, span=span)
        search: Callable[[], object] = partial(filled.filled_runs, samples, *span)
        ms = interleaved_ms({"checks": check, "search": search}, rounds)
        checks, searched = 1e3 * ms["checks"], 1e3 * ms["search"]
        rows.append({"block": name, "checks_us": checks, "search_us": searched, "ratio": checks / (checks - searched)})
    return rows


@benchmark("Lost samples that were filled: what they do, and which are found.")
def main(quick: bool) -> Tables:
    """Run, print, write."""
    shares, runs = (SHARES[1::4], RUNS[::3]) if quick else (SHARES, RUNS)
    tables: dict[str, list[Row]] = {"changes": [], "onsets": [], "cost": cost(50), "not_lost": not_lost()}
    for kind in KINDS:
        for how in ("zero", "held") if quick else ("zero", "mean", "held"):
            tables["changes"] += changes(kind, how, shares, runs, 1 if quick else 3)
    for kind in KINDS[:1] if quick else KINDS[:3]:
        tables["onsets"] += onsets(kind, shares[:: 1 if quick else 2], runs[::2], *((1, 8) if quick else (3, 12)))
    return tables

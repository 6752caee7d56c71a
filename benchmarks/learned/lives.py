"""Simulated runs to failure on which the constants of learned forecasts were chosen.

Run as ``python -m benchmarks.learned.lives [--quick] [--json FILE]``. It prints the scores of choices of the ridge, of
the weight of the prior and of the ends of a final stage that are left out, on kinds of machine that are drawn without
looking at a recorded run: median life 10 minutes to 3 days, its spread 0.2 to 1.8 (natural logarithm), 15 to 1000
blocks, five shapes of growth in any mixture, end levels 2 to 10 times the baseline and their spread, noise, spikes.
Each kind gives some runs to learn from and four to be asked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, Tables, benchmark
from monitor.health.rest.learned import fit
from monitor.health.rest.learned.fit import LearnedRun, RunMoments, moments_of
from monitor.health.rest.learned.scores import SCORED_SHARES, covers, crps_share

Array = NDArray[np.float64]
SEED = 900
ASKED = 4
SHARES = tuple((i + 0.5) / 40 for i in range(40))
CHOSEN: dict[str, Any] = {"RIDGE": fit.RIDGE, "PRIOR_RUNS": fit.PRIOR_RUNS, "MARGIN_SHARE": fit.MARGIN_SHARE}


@dataclass(frozen=True)
class Kind:
    """A kind of machine.

    Attributes:
        life: median final stage, s; ``spread`` of its natural logarithm.
        interval: between blocks, s.
        end: mean natural logarithm of the level at the end over the baseline; ``end_spread``.
        noise: of a block, ``memory`` of that from block to block, ``spikes`` the share of blocks with one.
        laws: how probable each shape of growth is.
    """

    life: float
    spread: float
    interval: float
    end: float
    end_spread: float
    noise: float
    memory: float
    spikes: float
    laws: tuple[float, ...]

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Kind:
        """Return a random kind."""
        life = math.exp(rng.uniform(math.log(600.0), math.log(3 * 86400.0)))
        spread, blocks = rng.uniform(0.2, 1.8), math.exp(rng.uniform(math.log(15.0), math.log(1000.0)))
        end, end_spread = rng.uniform(0.7, 2.3), rng.uniform(0.1, 0.7)
        noise, memory, spikes = rng.uniform(0.02, 0.2), rng.uniform(0.0, 0.8), rng.uniform(0.0, 0.04)
        laws = tuple(rng.dirichlet([0.7] * 5).tolist())
        return cls(life, spread, life / blocks, end, end_spread, noise, memory, spikes, laws)

    def run(self, rng: np.random.Generator) -> LearnedRun:
        """Return the final stage of a run, of 8 to 3000 blocks; its onset is found up to a twelfth of it late."""
        count = 0
        while count < 8:
            count = min(int(self.life * math.exp(self.spread * rng.standard_normal()) / self.interval), 3000)
        share = np.arange(count + 1, dtype=np.float64) / count
        begin, end = rng.uniform(0.1, 0.5), max(0.2, self.end + self.end_spread * rng.standard_normal())
        level = begin + (end - begin) * _growth(int(rng.choice(5, p=self.laws)), share, rng)
        error = self.noise * rng.standard_normal(count + 1)
        for i in range(1, count + 1):
            error[i] = self.memory * error[i - 1] + math.sqrt(1.0 - self.memory**2) * error[i]
        spiked = rng.random(count + 1) < self.spikes
        level = level + error + np.where(spiked, np.log(rng.uniform(1.5, 5.0, count + 1)), 0.0)
        late = int(rng.integers(0, max(1, count // 12) + 1))
        t = self.interval * np.arange(count + 1 - late, dtype=np.float64)
        return LearnedRun("simulated", np.asarray(t, dtype=np.float64), level[late:], 0.0, float(t[-1]))


def _growth(law: int, share: Array, rng: np.random.Generator) -> Array:
    """Return a growth from 0 to 1: a power, an exponential, an early jump, a late one, random increments."""
    if law == 0:
        return share ** math.exp(rng.uniform(math.log(0.4), math.log(4.0)))
    if law == 1:
        rate = rng.uniform(1.0, 8.0)
        return np.expm1(rate * share) / math.expm1(rate)
    if law == 2:
        jump = rng.uniform(0.3, 0.8)
        return jump * (1.0 - np.exp(-share / rng.uniform(0.02, 0.2))) + (1.0 - jump) * share ** rng.uniform(1.0, 4.0)
    if law == 3:
        late: Array = 0.2 * share + 0.8 / (1.0 + (1.0 - share) * rng.uniform(5.0, 40.0)) ** rng.uniform(0.5, 1.5)
        return (late - late[0]) / (late[-1] - late[0])
    knots = int(rng.integers(3, 14))
    reached = np.concatenate(([0.0], np.cumsum(rng.gamma(0.7, size=knots))))
    return np.interp(share ** math.exp(rng.uniform(-0.7, 1.1)), np.linspace(0.0, 1.0, knots + 1), reached / reached[-1])


@dataclass(frozen=True, eq=False)
class Drawn:
    """Runs of one kind to learn from and to be asked, with their moments over the whole of each life."""

    learned: tuple[tuple[LearnedRun, RunMoments], ...]
    asked: tuple[tuple[LearnedRun, RunMoments, RunMoments], ...]


def draw_kinds(kinds: int, runs: int, seed: int) -> list[Drawn]:
    """Return some kinds of machine, each with ``runs`` runs to learn from."""
    rng = np.random.default_rng(seed + runs)
    found: list[Drawn] = []
    for _ in range(kinds):
        kind = Kind.draw(rng)
        own = [kind.run(rng) for _ in range(runs + ASKED)]
        learned = tuple((run, moments_of(run, SHARES)) for run in own[:runs])
        asked = tuple((run, moments_of(run, SHARES), moments_of(run, SCORED_SHARES)) for run in own[runs:])
        found.append(Drawn(learned, asked))
    return found


@contextmanager
def constants(chosen: Mapping[str, Any]) -> Iterator[None]:
    """Set constants of the fit for the time of a block."""
    before = {name: getattr(fit, name) for name in chosen}
    for name, value in chosen.items():
        setattr(fit, name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(fit, name, value)


def _middle(run: LearnedRun, moments: RunMoments, margin: float) -> RunMoments:
    share = moments.elapsed / run.life
    kept = (share >= margin) & (share <= 1.0 - margin)
    return RunMoments(moments.inputs[kept], moments.elapsed[kept], moments.left[kept])


def score(drawn: Sequence[Drawn], chosen: Mapping[str, Any]) -> Row:
    """Return the mean CRPS over the life and the coverage of runs that were not learned from."""
    at_shares: list[list[float]] = []
    over_life: list[list[float]] = []
    with constants({name: value for name, value in chosen.items() if name != "MARGIN_SHARE"}):
        for one in drawn:
            used = [_middle(run, moments, chosen["MARGIN_SHARE"]) for run, moments in one.learned]
            model = fit.fit_moments([moments for moments in used if len(moments.elapsed)])
            for run, everywhere, scored in one.asked:
                for moments, rows in ((scored, at_shares), (everywhere, over_life)):
                    found = [model.distribution(x, t) for x, t in zip(moments.inputs, moments.elapsed, strict=True)]
                    pairs = list(zip(found, moments.left.tolist(), strict=True))
                    if pairs:
                        crps = [crps_share(forecast, left, run.life) for forecast, left in pairs]
                        held = [float(covers(forecast, left)) for forecast, left in pairs]
                        rows.append([float(np.mean(crps)), float(np.mean(held))])
    (crps, coverage), (crps_all, coverage_all) = (np.mean(rows, axis=0).tolist() for rows in (at_shares, over_life))
    return {"CRPS, three": crps, "cover, three": coverage, "CRPS, all": crps_all, "cover, all": coverage_all}


@benchmark(__doc__ or "")
def main(quick: bool) -> Tables:
    """Draw, score, print."""
    sizes = (6,) if quick else (3, 6, 12)
    drawn = {runs: draw_kinds(6 if quick else 30, runs, SEED) for runs in sizes}
    choices: dict[str, dict[str, Any]] = {"as long again": {"RIDGE": (1e9,) * 5, "PRIOR_RUNS": 1e9}}
    ridges = ((3.0,) * 5, (6.0,) * 5, (10.0,) * 5, (6.0, 2.0, 6.0, 6.0, 6.0), (6.0, 3.0, 10.0, 10.0, 10.0), fit.RIDGE)
    choices |= {"ridge " + " ".join(f"{value:g}" for value in ridge): {"RIDGE": ridge} for ridge in ridges}
    choices |= {f"prior runs {value:g}": {"PRIOR_RUNS": value} for value in (0.5, 2.0)}
    choices |= {f"ends {value:g}": {"MARGIN_SHARE": value} for value in (0.0, 0.05, 0.15)}
    rows: list[Row] = []
    for name, choice in choices.items():
        for runs, kinds in drawn.items():
            rows.append({"choice": name, "runs": runs, **score(kinds, {**CHOSEN, **choice})})
    return {"seed": {"kinds": SEED}, "rows": rows}

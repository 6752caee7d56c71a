"""Whether the library's intervals of TT can be put right by the share of the life that has gone.

Run as ``python -m benchmarks.library_stretch [--quick] [--json FILE]``. The interval of TT holds the truth too often at
half of a life and too seldom at three quarters. Here the errors that make it are stretched by a factor that depends on
the predicted share of the life, elapsed / (elapsed + predicted TT), and that is fitted so that coverage is 0.80 in each
tenth of the predicted share, in each tenth of the true one, or half way between the two.

Lives are those of the library population, never those that forecasts are scored on. What is said of a life comes from
fits without its fold, the errors from other lives, and the factor from the other four of five groups of lives.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.forecast_library import fitted
from benchmarks.forecast_lives import cached_lives
from benchmarks.forecast_population import LIBRARY, LIBRARY_RUNS
from monitor.health.size.library.model import LINES, OFFSET, Array, FeatureFit
from monitor.health.size.library.scores import SCORED_LEVEL

NEIGHBOURS = 300
KNOTS = (0.25, 0.5, 0.75, 0.95)
"""Predicted shares between which the logarithm of the factor is linear; constant beyond."""
BOUND, GRID = 0.6, 0.05
"""Largest logarithm of the factor, and how finely it is looked at."""
TENTHS = np.linspace(0.0, 1.0, 11)
BANDS = {"1/4": (0.2, 0.3), "1/2": (0.45, 0.55), "3/4": (0.7, 0.8)}
GROUPS = 5


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments before the crossing, n of them, and what the library has for each.

    Attributes:
        said: prediction of ln(TT + offset), in intervals, out of fold, shape (n,).
        truth: what was true, shape (n,).
        errors: of the alike moments of other lives, shape (n, NEIGHBOURS).
        crossed: whether those lay beyond the crossing, shape (n, NEIGHBOURS).
        predicted: predicted share of the life, shape (n,).
        true: true share, shape (n,).
        life: number of the life, shape (n,).
    """

    said: Array
    truth: Array
    errors: Array
    crossed: NDArray[np.bool_]
    predicted: Array
    true: Array
    life: NDArray[np.int64]

    def samples(self, stretch: Array) -> Array:
        """Return ascending samples of TT, in intervals, with the errors times factors (n,), shape (n, NEIGHBOURS)."""
        tt = np.exp(self.said[:, None] + stretch[:, None] * self.errors) - OFFSET
        return np.sort(np.where(self.crossed, 0.0, np.maximum(tt, 0.0)), axis=1)

    def covered(self, samples: Array) -> NDArray[np.bool_]:
        """Return whether the interval of each sample holds the truth, shape (n,)."""
        low, high = np.quantile(samples, [0.5 - SCORED_LEVEL / 2.0, 0.5 + SCORED_LEVEL / 2.0], axis=1)
        tt = np.exp(self.truth) - OFFSET
        return (low <= tt) & (tt <= high)

    def crps(self, samples: Array) -> Array:
        """Return the score of each sample, in intervals, shape (n,)."""
        tt, n = np.exp(self.truth) - OFFSET, samples.shape[1]
        return np.abs(samples - tt[:, None]).mean(axis=1) - samples @ (2.0 * np.arange(1, n + 1) - n - 1.0) / n**2


def moments_of(fit: FeatureFit) -> Moments:
    """Return the moments of a library's lives before the crossing."""
    rows = np.flatnonzero(~fit.crossed[:, 0] & np.isfinite(fit.error[:, 1]))
    said, life = fit.said[rows, 1], fit.life[rows]
    truth = said + fit.error[rows, 1]
    alike = np.array(
        [
            fit.nearest_moments(1, float(fit.said[row, 1]), float(fit.ln_elapsed[row]), NEIGHBOURS, int(fit.life[row]))
            for row in rows
        ]
    )
    elapsed = np.exp(fit.ln_elapsed[rows]) - 6.0
    return Moments(
        said=said,
        truth=truth,
        errors=fit.error[alike, 1],
        crossed=fit.crossed[alike, 0],
        predicted=elapsed / (elapsed + np.maximum(np.exp(said) - OFFSET, 0.1)),
        true=elapsed / (elapsed + np.exp(truth) - OFFSET),
        life=life,
    )


def by_band(share: Array, values: Array, edges: Array) -> Array:
    """Return the mean of values in each band of the share, 0.8 where there are none, shape (edges - 1,)."""
    place = np.digitize(share, edges) - 1
    within = (place >= 0) & (place < len(edges) - 1)
    count = np.bincount(place[within], minlength=len(edges) - 1)
    total = np.bincount(place[within], values[within], minlength=len(edges) - 1)
    return np.where(count > 0, total / np.maximum(count, 1), SCORED_LEVEL)


def fitted_factor(covered: NDArray[np.bool_], predicted: Array, share: Array) -> Array:
    """Return the logarithms of the factor at ``KNOTS`` that bring coverage nearest to nominal in tenths of a share.

    Args:
        covered: whether each moment is covered with each factor of the grid, shape (n, factors).
        predicted: predicted share, which the factor depends on, shape (n,).
        share: the share in whose tenths coverage is counted, shape (n,).
    """

    def loss(at_knots: Array) -> float:
        place = np.rint((np.interp(predicted, KNOTS, at_knots) + BOUND) / GRID).astype(int)
        found = by_band(share, covered[np.arange(len(covered)), place].astype(float), TENTHS)
        return float(np.mean((found - SCORED_LEVEL) ** 2))

    best, step = np.zeros(len(KNOTS)), 0.2
    least = loss(best)
    while step > 0.02:
        moved = False
        for knot, change in product(range(len(KNOTS)), (-step, step)):
            tried = best.copy()
            tried[knot] = np.clip(tried[knot] + change, -BOUND, BOUND)
            if (value := loss(tried)) < least:
                best, least, moved = tried, value, True
        step = step if moved else step / 2.0
    return best


def factors(moments: Moments) -> dict[str, tuple[Array, Array]]:
    """Return for each way of fitting the factor of each moment, fitted on other lives, and its mean at the knots."""
    grid = np.exp(np.arange(-BOUND, BOUND + GRID / 2.0, GRID))
    ones = np.ones(len(moments.said))
    covered = np.stack([moments.covered(moments.samples(one * ones)) for one in grid], axis=1)
    found = {name: (ones.copy(), np.zeros(len(KNOTS))) for name in ("none", "predicted", "true", "half way")}
    for group in range(GROUPS):
        own = moments.life % GROUPS == group
        fits = [
            fitted_factor(covered[~own], moments.predicted[~own], share[~own])
            for share in (moments.predicted, moments.true)
        ]
        for name, at_knots in zip(list(found)[1:], (*fits, np.mean(fits, axis=0)), strict=True):
            found[name][0][own] = np.exp(np.interp(moments.predicted[own], KNOTS, at_knots))
            found[name][1][:] += at_knots / GROUPS
    return found


def rows_of(features: str, moments: Moments) -> list[Row]:
    """Return coverage and CRPS by way of fitting."""
    rows: list[Row] = []
    before = moments.crps(moments.samples(np.ones(len(moments.said))))
    for name, (stretch, at_knots) in factors(moments).items():
        samples = moments.samples(stretch)
        covered, score = moments.covered(samples).astype(float), moments.crps(samples)
        by_said = by_band(moments.predicted, covered, TENTHS)
        row: dict[str, float | int | str | None] = {"features": features, "fitted by": name, "moments": len(covered)}
        for band, (low, high) in BANDS.items():
            there = (low <= moments.true) & (moments.true < high)
            row[f"coverage {band}"] = float(covered[there].mean())
            row[f"crps {band}"] = float(score[there].mean() / before[there].mean())
        row |= {"coverage": float(covered.mean()), "crps": float(score.mean() / before.mean())}
        row |= {"least by predicted": float(by_said.min()), "most by predicted": float(by_said.max())}
        row |= {"least below 0.9": float(by_said[:-1].min()), "above 0.9": float(by_said[-1])}
        row |= {f"factor {knot:g}": float(np.exp(value)) for knot, value in zip(KNOTS, at_knots, strict=True)}
        rows.append(row)
    return rows


def main() -> None:
    """Print the table and write it."""
    options = arguments(__doc__ or "")
    library = fitted(cached_lives(LIBRARY, 50 if options.quick else LIBRARY_RUNS))
    rows = [row for features in LINES for row in rows_of(features, moments_of(library.fit_for(features)))]
    print_table("TT of unseen lives, out of fold: coverage, and CRPS over that without a factor", rows)
    write_json(options.json, {"quick": {"quick": str(options.quick)}, "stretch": rows})


if __name__ == "__main__":
    main()

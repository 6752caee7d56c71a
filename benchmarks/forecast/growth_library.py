"""Make the library that ships with the program: fitted on growth of damage alone, for histories of V_eq.

Run as ``python -m benchmarks.forecast.growth_library [--quick] [--json FILE] [--out FILE]``. The lives are 2500 of
``models.lives.growth``, with V_eq as a tracker would have followed it. Arrays are rounded and moments drawn so that the
file stays small; scores are those before that. A test knows the hash of the file; a fit on another machine agrees to
rounding, not bit for bit.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np

from benchmarks.common import Row, print_table, write_json
from models.lives.growth import GROWTH, TrackingError, grow_lives
from monitor.health.size.library.fit import FitSettings, fit_library
from monitor.health.size.library.model import Array, FeatureFit, Library
from monitor.records.library_file import save_library
from monitor.service.libraries import SHIPPED, growth_words

LIVES = 2500
MOMENTS = 6000
"""Moments that are kept for their errors."""
COLUMNS = 400
STEPS = 2.0**10
"""Arrays are multiples of one over this, coefficients aside: what is not needed does not fill the file."""


def build(lives: int = LIVES) -> Library:
    """Return the library as it is fitted, before it is made small."""
    error = TrackingError()
    made_of = {"growth": json.loads(GROWTH.as_json()), "tracking_error": asdict(error), "runs": lives}
    return fit_library(
        list(grow_lives(GROWTH, range(lives))),
        thresholds=(GROWTH.threshold,),
        interval=GROWTH.interval,
        prior=growth_words(GROWTH, error, lives),
        made_of=json.loads(json.dumps(made_of)),
        settings=FitSettings(seed=GROWTH.seed, columns=COLUMNS),
        features=("v_eq",),
    )


def small(library: Library) -> Library:
    """Return a library with rounded arrays and fewer moments."""
    return replace(library, fits={name: _small(fit) for name, fit in library.fits.items()})


def _rounded(values: Array) -> Array:
    return np.round(values * STEPS) / STEPS


def _small(fit: FeatureFit) -> FeatureFit:
    # The moments stay in the order of their lives.
    kept = np.sort(np.random.default_rng(GROWTH.seed).permutation(len(fit.said))[:MOMENTS])
    regression = fit.regression
    parts = {one.name: _rounded(getattr(regression, one.name)) for one in fields(regression)}
    parts |= {"coefficients": regression.coefficients.astype(np.float32).astype(np.float64)}
    return replace(
        fit,
        regression=replace(regression, **parts),
        said=_rounded(fit.said[kept]),
        error=_rounded(fit.error[kept]),
        crossed=fit.crossed[kept],
        standing=fit.standing[kept],
        ln_elapsed=_rounded(fit.ln_elapsed[kept]),
        life=fit.life[kept],
        lifetimes=np.sort(np.round(fit.lifetimes, -1), axis=0),
    )


def score_rows(library: Library) -> list[Row]:
    """Return the scores out of fold."""
    climatology = library.scores["climatology"]["0.05"]
    rows: list[Row] = []
    for share, score in library.scores["v_eq"]["0.05"].items():
        over = score["crps_s"] / climatology[share]["crps_s"]
        rows.append({"at": share, **score, "crps_over_climatology": over})
    return rows


def main() -> None:
    """Make the library, print its scores, and write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n", maxsplit=1)[0])
    parser.add_argument("--quick", action="store_true", help="few lives, nothing written")
    parser.add_argument("--json", type=Path, help="write the scores")
    parser.add_argument("--out", type=Path, default=SHIPPED)
    options = parser.parse_args()
    library = build(200 if options.quick else LIVES)
    rows, still = score_rows(library), [{"features": name, **row} for name, row in library.scores["no_growth"].items()]
    print_table("unseen lives, out of fold", rows)
    print_table("probability of no growth, out of fold", still)
    if not options.quick:
        made = small(library)
        save_library(made, options.out)
        sys.stderr.write(f"{options.out}: {options.out.stat().st_size} bytes, hash {made.hash}\n")
    write_json(options.json, {"scores": rows, "no_growth": still})


if __name__ == "__main__":
    main()

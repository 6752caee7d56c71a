"""What a library of any growth costs on lives of the five laws for which a narrower one was made.

Run as ``python -m benchmarks.library_five_laws [--quick] [--json FILE]``. The test lives of ``forecast_population``
take no part in a fit. They are forecast by a library of its library population, and by one of the lives of that
population that follow the five laws.
"""

from __future__ import annotations

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.forecast_cases import cases_of
from benchmarks.forecast_library import ask, fitted
from benchmarks.forecast_lives import cached_lives
from benchmarks.forecast_naive import of_elapsed_time
from benchmarks.forecast_population import FIVE_LAWS, FRACTIONS, LIBRARY, LIBRARY_RUNS, TEST, TEST_RUNS
from benchmarks.library_unseen import FEATURES, row_of, summed


def main() -> None:
    """Print the table and write it."""
    options = arguments(__doc__ or "")
    lives = cached_lives(LIBRARY, 100 if options.quick else LIBRARY_RUNS)
    cases = cases_of(cached_lives(TEST, 10 if options.quick else TEST_RUNS))
    rows: list[Row] = []
    for name, some in (("any growth", lives), ("five laws", [life for life in lives if life.law in FIVE_LAWS])):
        library, naive = fitted(some), dict(of_elapsed_time(cases, lives))
        for features in FEATURES:
            answers = ask(library, cases, features)
            for m, fraction in enumerate(FRACTIONS):
                rows.append(
                    {
                        "library": name,
                        "lives": len(some),
                        "features": features,
                        "at": fraction,
                        **row_of(answers, cases, naive, m),
                    }
                )
    table = summed(rows, ("library", "features", "at"))
    print_table("test lives of five laws", table)
    write_json(options.json, {"five_laws": table})


if __name__ == "__main__":
    main()

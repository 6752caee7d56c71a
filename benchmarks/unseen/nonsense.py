"""Is nonsense flagged: stalls, noise, a gain, a dead sensor, another part, steps of the load, a law of its own, a gap.

Run as ``python -m benchmarks.unseen.nonsense [--judged | --development] [--lives N] [--filter-lives N] [--sound N]
[--causes NAME...] [--library FILE | --library-runs N] [--features rms|rms+harmonics] [--json FILE] [--quick]``. The
lives are those of ``unseen_causes``. Blocks go through ``monitor.health.tracker``, as in the daemon, on a
calibrated channel with a map of the outer race; V_eq is by the library or by the filter, TT by the library.

A flag is any status other than those with which values are issued as usual (``PASSING``), of V_eq or TT; the first
blocks, too few for a TT, are none. Tables: by cause and method, the share of lives flagged within ``WATCHED`` blocks of
the cause (also without ``no_growth``, which is right of a stall alone), before it, and at the last block watched; the
share of lives without a cause that were ever flagged, up to 3/4 of their time to the threshold, with and without
``no_growth``, which is right where damage stands still (asked without it of all lives, with it of those of laws that
never stand still); and the statuses that were given. ``ambiguous`` is no flag: of
V_eq by the library it says that the filter beside it disagrees. ``flag`` says what is right: "yes", "no" (the machine
is sound, or the monitor knows what changed), or "either".
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.common import Row, print_table, write_json
from benchmarks.unseen import causes
from benchmarks.unseen.ask import follow, library_for, map_for, settings_for
from benchmarks.unseen.causes import WATCHED, Case
from benchmarks.unseen.laws import STAND_STILL
from benchmarks.unseen.seeds import seed_of
from monitor.health.tracker import DamageGate, DamageSettings, TrackMethod

PASSING = frozenset(
    ("ok", "widened", "ambiguous", "uncalibrated", "already_crossed", "beyond_horizon", "too_few_points")
)
NO_GROWTH = "no_growth"
MAX_SOUND = 0.03
METHODS: tuple[TrackMethod, ...] = ("library", "filter")

Maker = Callable[[int, int], Sequence[Case]]
CAUSES: dict[str, tuple[str, Maker]] = {
    "stall": ("yes", causes.stall),
    "noise": ("yes", lambda count, seed: causes.changed(count, seed, causes.noise)),
    "gain x 3": ("yes", lambda count, seed: causes.changed(count, seed, causes.gain)),
    "dead sensor": ("yes", lambda count, seed: causes.changed(count, seed, causes.dead)),
    "inner race, named": ("yes", lambda count, seed: causes.inner_race(count, seed, named=True)),
    "inner race, not named": ("yes", lambda count, seed: causes.inner_race(count, seed, named=False)),
    "load step, unknown": ("yes", lambda count, seed: causes.load_step(count, seed, known=False)),
    "load step, known": ("no", lambda count, seed: causes.load_step(count, seed, known=True)),
    "law of its own": ("either", causes.decelerating),
    "gap of 20 h": ("no", lambda count, seed: causes.changed(count, seed, causes.gap)),
}
"""Whether a flag is right, and the lives, by cause."""


@dataclass(frozen=True)
class Flags:
    """Flags of one life, in the order of its blocks from the first.

    Attributes:
        raised: statuses of each block that are flags.
        cause: first block of the cause.
        ambiguous: of each block, whether V_eq is.
    """

    raised: tuple[tuple[str, ...], ...]
    cause: int
    ambiguous: tuple[bool, ...] = ()

    @property
    def watched(self) -> tuple[tuple[str, ...], ...]:
        """Flags of the blocks in which they count."""
        return self.raised[self.cause : self.cause + WATCHED]

    @property
    def delay(self) -> int | None:
        """Blocks from the cause to the first flag, 0 for the first block of the cause; None without a flag."""
        return next((k for k, one in enumerate(self.watched) if one), None)


def flags_of(case: Case, settings: DamageSettings) -> Flags:
    """Return the flags of a life."""
    blocks = min(case.life.t.size, case.cause + WATCHED) if case.cause or case.fault else case.life.t.size
    raised: list[tuple[str, ...]] = []
    ambiguous: list[bool] = []
    for damage, forecast in follow(case.life, settings, blocks, DamageGate(fault=case.fault)):
        statuses = dict.fromkeys((damage.status.value, forecast.status.value))
        raised.append(tuple(status for status in statuses if status not in PASSING))
        ambiguous.append(damage.status.value == "ambiguous")
    return Flags(tuple(raised), case.cause, tuple(ambiguous))


def cause_row(name: str, wanted: str, method: str, found: Sequence[Flags]) -> Row:
    """Return the figures of one cause by one method."""
    delays = [one.delay for one in found if one.delay is not None]
    statuses = Counter(status for one in found for status in {s for block in one.watched for s in block})
    return {
        "cause": name,
        "method": method,
        "flag": wanted,
        "lives": len(found),
        "flagged": len(delays) / len(found),
        "but_no_growth": float(np.mean([any(set(block) - {NO_GROWTH} for block in one.watched) for one in found])),
        "median_delay": float(np.median(delays)) if delays else None,
        "before": float(np.mean([any(one.raised[: one.cause]) for one in found])),
        "at_last": float(np.mean([bool(one.watched[-1]) for one in found])),
        "ambiguous": float(np.mean([any(one.ambiguous[one.cause : one.cause + WATCHED]) for one in found])),
        "lives_by_status": ", ".join(f"{status} {count}" for status, count in statuses.most_common()),
    }


def sound_rows(method: str, cases: Sequence[Case], found: Sequence[Flags]) -> list[Row]:
    """Return how often lives without a cause were flagged: all, and those of laws that never stand still."""
    rows: list[Row] = []
    groups = {"all": list(found)}
    groups["of steady laws"] = [one for case, one in zip(cases, found, strict=True) if case.life.law not in STAND_STILL]
    for name, group in groups.items():
        ever = [{status for block in one.raised for status in block} for one in group]
        flagged = float(np.mean([bool(statuses) for statuses in ever]))
        other = float(np.mean([bool(statuses - {NO_GROWTH}) for statuses in ever]))
        # Where a law never stands still, ``no_growth`` is wrong too.
        judged = other if name == "all" else flagged
        counts = Counter(status for statuses in ever for status in statuses)
        rows.append(
            {
                "lives": name,
                "method": method,
                "count": len(group),
                "ever_flagged": flagged,
                "but_no_growth": other,
                "ambiguous": float(np.mean([any(one.ambiguous) for one in group])),
                "blocks_flagged": float(np.mean([bool(block) for one in group for block in one.raised])),
                "asked": MAX_SOUND,
                "met": "pass" if judged <= MAX_SOUND else "MISS",
                "lives_by_status": ", ".join(f"{status} {count}" for status, count in counts.most_common()),
            }
        )
    return rows


def main() -> None:
    """Judge, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="two lives of each: shows that all works")
    parser.add_argument("--judged", action="store_true", help="the lives of the judged score")
    parser.add_argument("--development", action="store_true", help="lives on which choices are made")
    parser.add_argument("--lives", type=int, default=200, metavar="N", help="of each cause")
    parser.add_argument("--filter-lives", type=int, default=60, metavar="N", help="of them by the filter")
    parser.add_argument("--sound", type=int, default=200, metavar="N", help="lives without a cause")
    parser.add_argument("--causes", nargs="*", choices=list(CAUSES), default=list(CAUSES))
    parser.add_argument("--features", choices=("rms", "rms+harmonics"), default="rms+harmonics")
    parser.add_argument("--library", type=Path, metavar="FILE")
    parser.add_argument("--library-runs", type=int, default=1000, metavar="N", help="of the library that is built")
    options = parser.parse_args()
    seed = seed_of(judged=options.judged, development=options.development)
    count, count_sound = (2, 2) if options.quick else (options.lives, options.sound)
    library, rms_map = library_for(options.library, 60 if options.quick else options.library_runs), map_for()
    by_method = {method: settings_for(library, options.features, method, rms_map) for method in METHODS}
    rows: list[Row] = []
    for name in options.causes:
        wanted, make = CAUSES[name]
        cases = make(count, seed)
        for method, settings in by_method.items():
            asked = cases if method == "library" else cases[: options.filter_lives]
            rows.append(cause_row(name, wanted, method, [flags_of(case, settings) for case in asked]))
            print(rows[-1], flush=True)
    without = causes.sound(count_sound, seed)
    sound: list[Row] = []
    for method, settings in by_method.items():
        asked = without if method == "library" else without[: options.filter_lives]
        sound += sound_rows(method, asked, [flags_of(case, settings) for case in asked])
    print_table("causes", rows)
    print_table("without a cause", sound)
    made = {"seeds": seed, "features": options.features, "library": library.hash, "prior": library.prior}
    write_json(options.json, {"causes": rows, "sound": sound, "made": made})


if __name__ == "__main__":
    main()

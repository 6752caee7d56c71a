"""A census of names: each recording at its stated speed and at speeds that are stated wrongly.

Run as ``python -m benchmarks.naming.census [--json FILE] [--quick] [--baseline]``. Every recording of
``reference.recordings`` goes through the program as configured by its example; the name is the one of its record.
Tables:

1. by error of the stated speed: faults named right, joined with another part (``inner|ball``), silent, wrong; healthy
   bearings named; the one disputed bearing named. Of the silent: those whose comb is ``FINDABLE`` deep at the true
   part, measured by ``benchmarks/naming/truth.py``;
2. the same by set of recordings, all speeds together;
3. what was wrong, and what was silent although findable.

``--baseline`` keeps the figures as those to compare with; they stay in the file until the next ``--baseline``. The
baseline of the results is commit 83a1ef3, whose tree got this file, ``naming_truth.py``, the truth in ``tests``,
``streams/datasets.py`` and ``examples/uestc.toml`` of today.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import Row, circumstances, print_table, write_json
from benchmarks.naming.truth import FINDABLE, comb_depth, envelope_spectrum
from reference import recordings_folder
from reference.recordings import CASES, OTHER_ENDS, Case, watch
from streams.types.block import Block

SPEED_ERRORS = (-0.06, -0.04, -0.02, 0.0, 0.02, 0.04, 0.06)
VERDICTS = ("right", "joined", "silent", "wrong", "healthy named", "quiet", "disputed")
_REACH = 0.01
"""How far from where the README saw a comb it is measured, relative."""


@dataclass(frozen=True)
class Verdict:
    """What was said of one channel of a recording.

    Attributes:
        case: the recording.
        channel: its channel.
        speed_error: share by which the stated speed was wrong.
        fault: the name in the record, or None.
        found: what else the record and the naming say: depth of the best family, the speed over the stated one.
        depth: of the comb at the true part, 0 where there is none.
    """

    case: Case
    channel: str
    speed_error: float
    fault: str | None
    found: Row
    depth: float

    @property
    def verdict(self) -> str:
        """Return one of ``VERDICTS``."""
        return self.case.judge(self.fault)

    @property
    def missed(self) -> bool:
        """Whether a comb that is findable got no name."""
        return self.verdict == "silent" and self.depth >= FINDABLE

    def row(self) -> Row:
        """Return the row of the table of all verdicts."""
        return {
            "recording": self.case.file,
            "configuration": self.case.config,
            "channel": self.channel,
            "speed_error_%": round(100 * self.speed_error),
            "part": self.case.part,
            "named": self.fault,
            "verdict": self.verdict,
            "true_depth": round(self.depth, 3),
            "findable": self.depth >= FINDABLE,
            **self.found,
        }


def true_depths(folder: Path) -> dict[tuple[str, str], float]:
    """Return the depth of the true comb of each damaged recording, by file and configuration."""
    depths: dict[tuple[str, str], float] = {}
    for case in (*CASES, *OTHER_ENDS):
        if case.comb_hz is None or case.part is None:
            continue
        for block, steps, _ in watch(case.config, folder / case.file):
            for channel, settings in steps.settings.channels.items():
                if not isinstance(block, Block) or not settings.bands:
                    raise AssertionError(f"{case.file}: no block, or no configured band")
                envelope = envelope_spectrum(
                    block.samples[block.channels.index(channel)], block.rate, settings.bands[0]
                )
                depths[case.file, case.config] = comb_depth(envelope, case.comb_hz, _REACH)
    return depths


def verdicts(folder: Path, speed_error: float, depths: dict[tuple[str, str], float]) -> Iterator[Verdict]:
    """Take every recording through the program at an error of the stated speed."""
    for case in (*CASES, *OTHER_ENDS):
        for block, steps, record in watch(case.config, folder / case.file, speed_error=speed_error):
            if not isinstance(block, Block):
                raise AssertionError(f"{case.file}: {block}")
            for channel, output in steps.outputs.items():
                naming = output.naming
                evidence = None if naming is None else naming.evidence
                values: dict[str, Any] = dict(record.channels[channel])
                found: Row = {
                    "best": None if naming is None else naming.best,
                    "best_depth": None if evidence is None else round(evidence.depth, 3),
                    "speed_factor": values.get("speed_factor"),
                    "speed_factor_sd": values.get("speed_factor_sd"),
                }
                yield Verdict(
                    case, channel, speed_error, values.get("fault"), found, depths.get((case.file, case.config), 0.0)
                )


def summary(found: Sequence[Verdict], name: str, value: float | str) -> Row:
    """Return the counts of verdicts under a name."""
    counts = Counter(one.verdict for one in found)
    return {
        name: value,
        **{verdict: counts[verdict] for verdict in VERDICTS},
        "findable": sum(one.depth >= FINDABLE for one in found if one.case.part and one.verdict != "disputed"),
        "findable but silent": sum(one.missed for one in found),
    }


def tables_of(found: Sequence[Verdict]) -> dict[str, Sequence[Row]]:
    """Return all tables."""
    errors = sorted({one.speed_error for one in found})
    sets = sorted({one.case.file.split("/")[0] for one in found})
    return {
        "by_speed_error": [
            summary([one for one in found if one.speed_error == error], "speed_error_%", round(100 * error))
            for error in errors
        ],
        "by_set": [
            summary([one for one in found if one.case.file.startswith(f"{name}/")], "set", name) for name in sets
        ],
        "noted": [one.row() for one in found if one.missed or one.verdict in ("wrong", "healthy named", "disputed")],
        "faults": [one.row() for one in found if one.case.part],
    }


def kept(path: Path | None) -> dict[str, Any]:
    """Return what an earlier run wrote into the file."""
    return json.loads(path.read_text(encoding="utf-8")) if path is not None and path.is_file() else {}


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description="A census of names on all recordings.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="the stated speed and 4 % either way only")
    parser.add_argument("--baseline", action="store_true", help="keep the figures as those to compare with")
    options = parser.parse_args()
    folder = recordings_folder()
    errors = (-0.04, 0.0, 0.04) if options.quick else SPEED_ERRORS
    depths = true_depths(folder)
    tables = tables_of([one for error in errors for one in verdicts(folder, error, depths)])
    print_table("1. By error of the stated speed", tables["by_speed_error"])
    print_table("2. By set, all speeds", tables["by_set"])
    if tables["noted"]:
        print_table("3. Wrong, and silent although findable", tables["noted"])
    written: dict[str, Any] = dict(tables)
    if options.baseline:
        written = {f"baseline_{name}": rows for name, rows in tables.items()} | {"baseline": circumstances()}
        written |= {key: value for key, value in kept(options.json).items() if not key.startswith("baseline")}
    else:
        written |= {key: value for key, value in kept(options.json).items() if key.startswith("baseline")}
    write_json(options.json, written)


if __name__ == "__main__":
    main()

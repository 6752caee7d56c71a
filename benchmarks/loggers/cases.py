"""The small example inputs that once went wrong: what is expected of each, what came, and the verdict.

    python -m benchmarks.loggers.cases [FOLDER] [--json FILE]

FOLDER has one folder a case, ``../shared/cases/files`` beside the repository by default; each is read by init and
replay, by replay with its own machine.toml, and by ``sw.read``.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from benchmarks.common import print_table, write_json
from benchmarks.loggers.judge import ASKED, MISSED, REFUSED, RIGHT, WORDS, WRONG, Verdict, judge, words_for_read
from benchmarks.loggers.plan import GRAVITY, LoggerTruth, TrueChannel, TrueFile
from benchmarks.loggers.ways import Came, by_init, by_read, called, replayed

FOLDER = Path(__file__).resolve().parents[2].parent / "shared" / "cases" / "files"
RMS = 1.21702508
"""Of the signal of the cases whose name begins with p, m/s2."""


@dataclass(frozen=True)
class Case:
    """A case, with what is expected of it.

    Attributes:
        expected: in words.
        truth: what is in the files.
        allowed: verdicts that are right too.
        how: arguments of ``sw.read`` beyond those that init asked for.
    """

    expected: str
    truth: LoggerTruth
    allowed: tuple[str, ...] = ()
    how: Mapping[str, Any] = field(default_factory=dict)


def _utc(text: str) -> float:
    return datetime.fromisoformat(text + "+00:00").timestamp()


def _case(
    expected: str,
    rate: float,
    files: Sequence[tuple[Sequence[str], str, Sequence[float], str]],
    names: Sequence[str] = ("acc",),
    unit: str = "m/s2",
    allowed: tuple[str, ...] = (),
    speed: float | None = None,
    **answers: str,
) -> Case:
    """Return a case of files, each of paths, start, RMS of each channel, and what is wrong with it."""
    channels = [TrueChannel(name.rpartition("/")[2], name, number, unit) for number, name in enumerate(names, start=1)]
    recorded = [
        TrueFile(
            list(paths), _utc(start) if start else None, list(rms), fault != "clock", fault if fault != "clock" else ""
        )
        for paths, start, rms, fault in files
    ]
    given = {"--unit": unit, "--rate-hz": f"{rate:g}"} | {
        f"--{key.replace('_', '-')}": word for key, word in answers.items()
    }
    return Case(expected, LoggerTruth(0, "", rate, channels, recorded, speed, answers=given), allowed)


def _p(expected: str, path: str, rate: float = 4096.0, start: str = "2026-01-01T12:00:00", **how: Any) -> Case:
    return _case(expected, rate, [([path], start, [how.pop("rms", RMS)], how.pop("fault", ""))], **how)


_NAME = "a_20260101_120000"
_DE = [0.5 * GRAVITY, 0.3 * GRAVITY]
_LVM = [0.55 * GRAVITY, 0.35 * GRAVITY]
_2026 = "2026-03-28T12:"
CASES: Mapping[str, Case] = {
    "02_tdms_two_groups": _case(
        "both channels of one group; the speed is offered",
        20000.0,
        [(["log_000.tdms"], "2024-11-04T08:15:00", _DE, ""), (["log_001.tdms"], "2024-11-04T08:25:00", _DE, "")],
        ("Vibration/DE", "Vibration/NDE"),
        "g",
        speed=24.8,
    ),
    "06_tree_gz": _case(
        "two channels or a question; date of the folders",
        25600.0,
        [
            (
                [f"2024/11/04/081500_ch{n}.csv.gz" for n in (1, 2)],
                "2024-11-04T08:15:00",
                [0.5 * GRAVITY, 0.9 * GRAVITY],
                "",
            )
        ],
        ("ch1", "ch2"),
        "g",
        allowed=(ASKED, REFUSED),
    ),
    "10_lvm": _case(
        "unit g",
        10240.0,
        [(["test_001.lvm"], "2024-11-04T08:15:00", _LVM, ""), (["test_002.lvm"], "2024-11-04T08:25:00", _LVM, "")],
        ("Acc_DE", "Acc_NDE"),
        "g",
    ),
    "15_mems_epoch": _case(
        "a column of times, 3200 Hz, the date; a question for the unit",
        3200.0,
        [
            (["adxl345_0.csv"], "2024-11-04T08:15:00", [76.930282, 51.287849, 51.283857], ""),
            (["adxl345_1.csv"], "2024-11-04T08:25:00", [76.921674, 51.278213, 51.279209], ""),
        ],
        ("ax_raw", "ay_raw", "az_raw"),
        allowed=(ASKED,),
        unit_="unknown",
    ),
    "p01_time_us": _p("4096 Hz", f"{_NAME}.csv"),
    "p02_epoch_ms": _p("1000 Hz, start 12:00; too slow to be analysed", "a.csv", 1000.0, allowed=(REFUSED,)),
    "p03_rate_thousands": _p("4096 Hz, or refused as ambiguous", f"{_NAME}.csv", allowed=(ASKED, REFUSED)),
    "p04_nc_unsigned": _p("RMS 1.217", f"{_NAME}.nc"),
    "p07_h5_fillvalue": _p("not a number, block rejected", f"{_NAME}.h5", fault="fill", allowed=(REFUSED,)),
    "p09_uff_ms": _p("4096 Hz", "a.uff"),
    "p10_uff_pretrigger": _p(
        "11:50:00, or the start is not used", "a.uff", start="2026-01-01T11:50:00", allowed=(MISSED,)
    ),
    "p11_lvm_start": _p("12:00:00.375", "a.lvm", start="2026-01-01T12:00:00.375"),
    "p12_lvm_segments": _case(
        "two blocks or a refusal",
        4096.0,
        [
            (["a.lvm"], "2026-01-01T12:00:00.375", [1.21535421], ""),
            (["a.lvm"], "2026-01-01T12:30:00", [1.21811025], ""),
        ],
        allowed=(REFUSED,),
    ),
    "p13_wav_stream": _p("refused, or read without LIST", f"{_NAME}.wav", allowed=(REFUSED, ASKED), scale="1"),
    "p18_zero_gaps": _p("a flag or a rejection", f"{_NAME}.csv", fault="zeros", allowed=(REFUSED, ASKED)),
    "p21_comma_comma": _p("read or refused", f"{_NAME}.csv", allowed=(REFUSED, ASKED)),
    "p22_clock_2006": _case(
        "flag clock on the files of 2006",
        4096.0,
        [
            (["00_20260328_120000.csv"], f"{_2026}00:00", [0.99385158], ""),
            (["01_20260328_121000.csv"], f"{_2026}10:00", [0.98362725], ""),
            (["02_20060101_000012.csv"], "", [1.01222717], "clock"),
            (["03_20060101_001012.csv"], "", [0.99351333], "clock"),
            (["04_20260328_124000.csv"], f"{_2026}40:00", [0.99608018], ""),
        ],
        allowed=(ASKED,),
    ),
}
"""By the name of their folder."""


def judged(name: str, folder: Path) -> dict[str, Any]:
    """Read a case in all ways; return its row."""
    case = CASES[name]
    answers = dict(case.truth.answers)
    answers["--unit"] = answers.pop("--unit-", answers["--unit"])
    main = by_init(folder, answers)
    verdicts = {"init": judge(case.truth, main)}
    if (folder / "machine.toml").is_file():
        own = Came()
        with contextlib.chdir(folder):
            replayed(own, Path("machine.toml"), Path("by_machine"))
        verdicts["machine"] = judge(case.truth, own)
    verdicts["read"] = judge(_first(case.truth), _read(case, folder, main, answers))
    if case.truth.speed_hz is not None:
        offered = by_init(folder, answers, speed=False)
        if offered.speed_hz is None and not any(word in offered.said for word in ("24.8", "speed_channel")):
            verdicts["init"].say("channels", MISSED, "the speed of the shaft is not offered")
    row: dict[str, Any] = {"case": name, "expected": case.expected}
    for way in ("init", "machine", "read"):
        row[f"by_{way}"] = _word(case, verdicts[way]) if way in verdicts else ""
    words = [verdict.word for verdict in verdicts.values() if verdict.word not in case.allowed]
    row["verdict"] = max(words, key=WORDS.index, default=RIGHT)
    row["details"] = [
        f"by {way}: {text.replace(f'{folder}/', '')}" for way, verdict in verdicts.items() for text in verdict.details
    ]
    return row


def _word(case: Case, verdict: Verdict) -> str:
    return f"{verdict.word} (right)" if verdict.word in case.allowed and verdict.word != RIGHT else verdict.word


def _first(truth: LoggerTruth) -> LoggerTruth:
    """Return the truth of the first path alone, and of its channels."""
    path = truth.files[0].paths[0]
    files = [each for each in truth.files if path in each.paths]
    if len(files[0].paths) == 1:
        return LoggerTruth(0, "", truth.rate_hz, truth.channels, files, answers=truth.answers)
    alone = [TrueFile([path], each.start_utc, each.rms[:1], each.clock, each.lost) for each in files]
    return LoggerTruth(0, "", truth.rate_hz, truth.channels[:1], alone, answers=truth.answers)


def _read(case: Case, folder: Path, main: Came, answers: Mapping[str, str]) -> Came:
    how = dict(words_for_read(case.truth, main)) | dict(case.how)
    if "unit" in how:
        how["unit"] = answers["--unit"]
    if case.truth.channels[0].key.count("/"):
        how["channels"] = [each.key for each in case.truth.channels]
    return by_read(folder / "data" / case.truth.files[0].paths[0], how)


def checked(folder: Path) -> list[dict[str, Any]]:
    """Check the two configurations whose numbers are of another unit: a problem and exit code 2 are expected."""
    rows: list[dict[str, Any]] = []
    for name, expected in (("rpm", "speed_hz = 1488"), ("band", "band_hz = [2, 10]")):
        with contextlib.chdir(folder):
            code, output, said = called("check", "--config", f"{name}.toml", "--json")
        problems = json.loads(output).get("problems", []) if output.startswith("{") else said.strip().splitlines()[-1:]
        word = RIGHT if code == 2 and problems else WRONG
        details = [f"exit code {code}, problems {problems}"]
        rows.append(
            {"case": f"rpm_band/{name}", "expected": f"{expected}: a problem, exit code 2", "by_init": ""}
            | {"by_machine": word, "by_read": "", "verdict": word, "details": details}
        )
    return rows


def main() -> None:
    """Read all cases that are there, print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=FOLDER)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    if not options.folder.is_dir():
        print(f"skipped: there are no cases in {options.folder}")
        return
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as scratch:
        for name in [*CASES, "rpm_band"]:
            place = Path(scratch) / name
            if not (options.folder / name).is_dir():
                print(f"skipped: {name} is missing")
                continue
            shutil.copytree(options.folder / name, place, copy_function=shutil.copyfile)
            for each in [place, *place.rglob("*")]:
                each.chmod(0o755 if each.is_dir() else 0o644)
            rows += checked(place) if name == "rpm_band" else [judged(name, place)]
    print_table("the cases", [{key: value for key, value in row.items() if key != "details"} for row in rows])
    for row in rows:
        for text in row["details"]:
            print(f"{row['case']}: {' '.join(text.split())[:400]}")
    counts: dict[str, int] = {word: sum(row["verdict"] == word for row in rows) for word in WORDS}
    print_table("totals", [counts])
    write_json(options.json, {"cases": rows, "totals": counts})


if __name__ == "__main__":
    main()

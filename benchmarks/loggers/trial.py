"""One logger in all ways: made, read, judged."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from benchmarks.loggers.generate import generate
from benchmarks.loggers.judge import FACTS, Verdict, configuration_of, judge, words_for_read
from benchmarks.loggers.plan import LoggerTruth
from benchmarks.loggers.ways import Came, by_hand, by_init, by_read


def judged(seed: int, folder: str) -> dict[str, Any]:
    """Make the logger of a seed, read it in all ways, and return a row for the table."""
    place = Path(folder) / f"{seed:04d}"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    truth = generate(seed, place)
    main = by_init(place, _answers(truth))
    verdicts = {"init": judge(truth, main)}
    configuration = configuration_of(truth)
    if configuration is not None:
        verdicts["hand"] = judge(truth, by_hand(place, configuration))
    verdicts["read"] = _of_one_file(
        truth, by_read(place / "data" / truth.files[0].paths[0], words_for_read(truth, main))
    )
    row: dict[str, Any] = {"seed": seed, "format": truth.format}
    row |= {fact: verdicts["init"].facts[fact] for fact in FACTS}
    row["by_init"] = verdicts["init"].word
    row |= {f"by_{way}": verdicts[way].word if way in verdicts else "" for way in ("hand", "read")}
    row["speed"] = _speed(truth, place)
    row["questions"] = " ".join(main.asked)
    row["problems"] = len(main.problems)
    row["flagged"] = verdicts["init"].flagged
    row["names_file"] = str(verdicts["init"].names_file)
    asked_for = {*truth.unknowable, *truth.ambiguous} - ({"start"} if truth.files[0].start_utc is None else set())
    row["answerable"] = str(not asked_for)
    row["details"] = [
        f"by {way}: {text.replace(f'{place}/', '')}" for way, verdict in verdicts.items() for text in verdict.details
    ]
    row["details"] += [f"init has a problem: {each}" for each in main.problems]
    return row


def _answers(truth: LoggerTruth) -> dict[str, str]:
    unit = {"m/s²": "m/s2", "m/s^2": "m/s2", "counts": "g"}.get(truth.channels[0].unit, truth.channels[0].unit)
    known = {"--unit": unit, "--rate-hz": f"{truth.rate_hz:g}"}
    if truth.files[0].start_utc is not None:
        known["--start-utc"] = "none"
    return known | truth.answers


def _of_one_file(truth: LoggerTruth, came: Came) -> Verdict:
    """Judge one file alone: one channel of several where each has a file of its own."""
    paths, first = truth.files[0].paths, truth.files[0]
    alone = truth.files[:1] if truth.format != "lvm" else [each for each in truth.files if each.paths == paths]
    channels = truth.channels
    if len(paths) > 1:
        first.paths, first.rms, channels = paths[:1], first.rms[:1], channels[:1]
    return judge(LoggerTruth(truth.seed, truth.format, truth.rate_hz, channels, alone), came)


def _speed(truth: LoggerTruth, place: Path) -> str:
    """Return what became of a speed that is stated: offered, missed or wrong; "" where none is."""
    if truth.speed_hz is None:
        return ""
    came = by_init(place, _answers(truth), speed=False)
    if came.speed_hz is None:
        return "offered" if "24.8" in came.said else "missed"
    return "offered" if abs(came.speed_hz / truth.speed_hz - 1.0) < 1e-3 else "wrong"

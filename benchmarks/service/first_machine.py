"""From an empty folder to records, for five loggers, by ``init`` and two answers each: transcripts, times and levels.

    python -m benchmarks.service.first_machine [--write] [--json FILE]

The files come of ``benchmarks/service/loggers.py``, which imports nothing of the project. ``--write`` makes
``docs/tutorials/first-machine.md`` of the transcripts; a daemon is started for it.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import xarray as xr
from click.testing import CliRunner

from benchmarks.common import write_json
from examples.loggers import GRAVITY, LOGGERS, Truth
from monitor.cli import spallwatch

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "first-machine.md"
TEMPLATE = Path(__file__).with_name("first_machine.md")
FILES, SECONDS = 12, 1.0
MACHINES = {"csv": "fan", "tdms": "spindle", "wav": "pump", "hdf5": "mill", "mat": "conveyor"}
"""Folder of each logger."""
ANSWERS: Mapping[str, tuple[str, str]] = {
    "csv": ("6205-2RS", "1488 rpm"),
    "tdms": ("DE=SKF 6206; NDE=6205", "29.5"),
    "wav": ("6205-2RS", "10 V at 100 mV/g"),
    "hdf5": ("9 7.94 39.04", "33,2 Hz"),
    "mat": ("22207", "996 rpm"),
}
"""The two answers that each logger needs, in the order in which they are asked."""


@dataclass(frozen=True)
class Outcome:
    """What came of one logger.

    Attributes:
        transcripts: output by step: "init", "check", "replay".
        configuration: that ``init`` has written.
        start_error_s: largest error of the starts of the records.
        rms_error: largest relative error of their RMS.
        records: how many there are.
        truth: what was written.
    """

    transcripts: Mapping[str, str]
    configuration: str
    start_error_s: float
    rms_error: float
    records: int
    truth: Sequence[Truth]


def called(*arguments: str, typed: str = "") -> str:
    """Return what a command prints, with what is typed into it.

    Raises:
        RuntimeError: its exit code is not 0.
    """
    done = CliRunner().invoke(spallwatch, list(arguments), input=typed, prog_name="spallwatch")
    if done.exit_code != 0:
        raise RuntimeError(f"{' '.join(arguments)}: exit code {done.exit_code}\n{done.output}\n{done.exception}")
    return done.output


def follow(kind: str, folder: Path, count: int = FILES, seconds: float = SECONDS) -> Outcome:
    """Write the files of a logger below an empty folder, configure them by two answers, replay them, and compare."""
    machine = MACHINES[kind]
    (folder / machine).mkdir()
    truth = LOGGERS[kind](folder / machine, count, seconds)
    for file in truth:
        closed = file.start.timestamp() + seconds
        os.utime(folder / machine / file.name, (closed, closed))
    typed = "\n".join([*ANSWERS[kind], "", "", ""])
    config = f"{machine}.toml"
    with contextlib.chdir(folder):
        told = {
            "init": called("init", machine, "--out", config, typed=typed),
            "check": called("check", "--config", config),
            "replay": called("replay", machine, "--config", config, "--out", f"{machine}-replay", "--no-report"),
        }
        published = sorted((Path(f"{machine}-replay") / "records").glob("*.nc"))
        times, levels = _records(published)
    found = [_neutral(text, folder) for text in told.values()]
    return Outcome(
        dict(zip(told, found, strict=True)),
        (folder / config).read_text(encoding="utf-8"),
        max(abs(time - file.start.timestamp()) for time, file in zip(times, truth, strict=True)),
        max(
            abs(level / expected - 1.0)
            for row, file in zip(levels, truth, strict=True)
            for level, expected in zip(row, file.rms_g.values(), strict=True)
        ),
        len(times),
        truth,
    )


def _records(paths: Sequence[Path]) -> tuple[list[float], list[list[float]]]:
    """Return start (s since 1970 UTC) and RMS of each channel (g) of the records of published files."""
    times: list[float] = []
    levels: list[list[float]] = []
    for path in paths:
        with xr.open_dataset(path) as records:
            times += [float(value) / 1e9 for value in records["time"].values.astype("datetime64[ns]").astype("int64")]
            levels += [[float(value) / GRAVITY for value in row] for row in records["rms"].values]
    return times, levels


def _neutral(text: str, folder: Path) -> str:
    """Return output without the folder and the times of this run."""
    text = text.replace(f"{folder}/", "/data/").replace(f"{folder.resolve()}/", "/data/")
    return re.sub(r"blocks in [\d.]+ s", "blocks in 0.3 s", text).rstrip("\n")


def shortened(text: str, *beginnings: str) -> str:
    """Return the lines that begin with some words."""
    return "\n".join(line for line in text.splitlines() if line.strip().startswith(beginnings))


def watched(folder: Path) -> tuple[str, str]:
    """Run the daemon of the fan until all files are records; return its first lines and its status."""
    code = "from monitor.cli import main; main()"
    root = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "PYTHONPATH": root}
    with contextlib.chdir(folder):
        daemon = subprocess.Popen(
            [sys.executable, "-c", code, "run", "--config", "fan.toml"],
            env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            for _ in range(120):
                time.sleep(0.5)
                with contextlib.suppress(RuntimeError, json.JSONDecodeError, KeyError):
                    status = json.loads(called("status", "--config", "fan.toml", "--json"))
                    sources = status["sources"]
                    values = list(sources.values() if isinstance(sources, dict) else sources)
                    if values and values[0]["accepted"] >= FILES:
                        break
            words = called("status", "--config", "fan.toml")
        finally:
            daemon.send_signal(signal.SIGTERM)
            _, log = daemon.communicate(timeout=60)
    first = [line for line in log.splitlines() if "ready" in line or "the page is at" in line]
    return "\n".join(first), _neutral(words, folder)


def page(outcomes: Mapping[str, Outcome], daemon: tuple[str, str]) -> str:
    """Return the tutorial: its template with the transcripts."""
    parts: dict[str, str] = {"daemon": daemon[0], "status": daemon[1], "table": table(outcomes)}
    for kind, outcome in outcomes.items():
        parts[f"{kind}_init"] = outcome.transcripts["init"]
        parts[f"{kind}_config"] = outcome.configuration.rstrip("\n")
        parts[f"{kind}_check"] = outcome.transcripts["check"]
        parts[f"{kind}_first"] = shortened(outcome.transcripts["check"], "first file", "last file")
        parts[f"{kind}_replay"] = outcome.transcripts["replay"]
    text = TEMPLATE.read_text(encoding="utf-8")
    for key, value in parts.items():
        text = text.replace(f"<<{key}>>", value)
    left = re.findall(r"<<\w+>>", text)
    if left:
        raise ValueError(f"{TEMPLATE}: nothing is known of {', '.join(left)}")
    return text


def table(outcomes: Mapping[str, Outcome]) -> str:
    """Return the errors of the records in Markdown."""
    rows = [
        "| folder | format | answers | records | error of the start | relative error of the RMS |",
        "|---|---|---|---|---|---|",
    ]
    for kind, outcome in outcomes.items():
        answers = ", ".join(f"`{answer}`" for answer in ANSWERS[kind])
        start = "less than 1 ms" if outcome.start_error_s < 1e-3 else f"{outcome.start_error_s:.3g} s"
        rms = "less than 0.0001" if outcome.rms_error < 1e-4 else f"{outcome.rms_error:.2g}"
        rows.append(f"| `{MACHINES[kind]}` | {kind} | {answers} | {outcome.records} | {start} | {rms} |")
    return "\n".join(rows)


def figures(outcomes: Mapping[str, Outcome]) -> list[dict[str, float | int | str]]:
    """Return the figures as plain values, one row a logger."""
    return [
        {
            "logger": kind,
            "answers": ", ".join(ANSWERS[kind]),
            "records": outcome.records,
            "start_error_s": outcome.start_error_s,
            "rms_error": outcome.rms_error,
        }
        for kind, outcome in outcomes.items()
    ]


def main() -> None:
    """Follow all loggers, print the table, and write what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="renew the tutorial")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place).resolve()
        outcomes = {kind: follow(kind, folder) for kind in LOGGERS}
        print(table(outcomes))
        if options.write:
            PAGE.write_text(page(outcomes, watched(folder)), encoding="utf-8")
    write_json(options.json, {"loggers": figures(outcomes)})


if __name__ == "__main__":
    main()

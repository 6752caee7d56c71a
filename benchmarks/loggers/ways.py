"""The ways in which a recording comes in: init and replay, replay with a configuration by hand, and ``sw.read``."""

from __future__ import annotations

import contextlib
import json
import re
import tomllib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

import spallwatch as sw
from monitor.cli import spallwatch

FACT_OF = {
    "--unit": "level", "--sensitivity-mv-per-g": "level", "--scale": "level", "--range-g": "level",
    "--rate-hz": "rate", "--start-utc": "times", "--interval-s": "times", "--time-name": "times",
    "--date-order": "times", "--timezone": "times", "--format": "channels", "--speed-hz": "speed",
}  # fmt: skip
"""The fact that an option of ``init`` answers."""

WRONG_INPUT, CRASHED = 2, 99
"""Exit codes of wrong input, and of an exception that is none of the program."""

_QUESTION = re.compile(r"^  (--[a-z-]+)[:,]", re.MULTILINE)
_FIRST_FILE_RATE = re.compile(r": ([0-9.e+]+) Hz,")


@dataclass(frozen=True)
class BlockRead:
    """A block in the records.

    Attributes:
        name, status, reason: of the ledger.
        flags: of the block and its channels.
        time: of its first sample, s since 1970; None where it is not known.
        rms: by channel, m/s2.
    """

    name: str
    status: str
    reason: str
    flags: frozenset[str]
    time: float | None
    rms: Mapping[str, float]

    @property
    def accepted(self) -> bool:
        """Whether the block has values."""
        return any(np.isfinite(value) for value in self.rms.values())


@dataclass
class Came:
    """What came of one way.

    Attributes:
        blocks: in the records, those that were rejected included.
        asked: options that were asked for.
        said: what was printed for people.
        problems: that init has with its own configuration.
        refused: the reason, "" where something was read.
        rate: Hz, as the configuration or ``check`` says; None where nothing says it.
        channels: tables of the configuration.
        speed_hz: as the configuration says.
    """

    blocks: list[BlockRead] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    said: str = ""
    problems: list[Any] = field(default_factory=list)
    refused: str = ""
    rate: float | None = None
    channels: list[dict[str, Any]] = field(default_factory=list)
    speed_hz: float | None = None


def called(*arguments: str) -> tuple[int, str, str]:
    """Run a command in this process; return its exit code, standard output and standard error."""
    came = CliRunner().invoke(spallwatch, list(arguments))
    if isinstance(came.exception, sw.SpallwatchError):
        return WRONG_INPUT, came.stdout, f"{came.stderr}\nspallwatch: {came.exception}"
    if came.exception is not None and not isinstance(came.exception, SystemExit):
        return CRASHED, came.stdout, f"{came.stderr}\n{type(came.exception).__name__}: {came.exception}"
    return came.exit_code, came.stdout, came.stderr


def by_init(folder: Path, answers: Mapping[str, str], speed: bool = True) -> Came:
    """Run ``init`` on ``folder/data``, answer what it asks in at most three rounds, and replay."""
    came = Came()
    given: dict[str, str] = {"--bearing": "6205-2RS"} | ({"--speed-hz": "24.8"} if speed else {})
    output, said, asked, is_written = "", "", [], False
    with contextlib.chdir(folder):
        for _ in range(4):
            options = [word for pair in given.items() for word in pair]
            code, output, said = called("init", "data", *options, "--yes", "--force", "--json", "--out", "by_init.toml")
            came.said += said
            # A configuration that has a problem is written, and the exit code says so.
            is_written = output.startswith("{")
            asked = _QUESTION.findall(said) if code == WRONG_INPUT and not is_written else []
            came.asked += [each for each in asked if each not in came.asked]
            if not asked or any(each in given or each not in answers for each in asked):
                break
            given |= {each: answers[each] for each in asked}
            if "--unit" in asked and "--scale" in answers:
                given["--scale"] = answers["--scale"]
        if not is_written:
            came.refused = (
                said.strip().splitlines()[-1] if not asked else f"asks for {', '.join(asked)}: {said.strip()}"
            )
            return came
        came.problems = json.loads(output).get("problems", [])
        replayed(came, Path("by_init.toml"), Path("by_init"))
    return came


def replayed(came: Came, configuration: Path, out: Path, data: str = "data") -> None:
    """Replay with a configuration, and add what its records say."""
    text = tomllib.loads(configuration.read_text(encoding="utf-8"))
    came.channels = text.get("channel", [])
    operating = text.get("operating", {})
    came.speed_hz = operating.get("speed_hz")
    came.said += f"speed_channel {operating['speed_channel']}\n" if "speed_channel" in operating else ""
    rates = {source.get("rate_hz") for source in text.get("source", [])}
    came.rate = rates.pop() if len(rates) == 1 else None
    code, output, said = called(
        "replay", data, "--config", str(configuration), "--out", str(out), "--no-report", "--json"
    )
    came.said += said
    came.blocks = _records(out)
    if code != 0 and not came.blocks:
        came.refused = said.strip() or f"exit code {code}"
    if output.strip().startswith("{"):
        summary = json.loads(output)
        came.said += json.dumps(
            {key: summary.get(key) for key in ("reasons", "ignored", "refused")}, ensure_ascii=False
        )


def _records(out: Path) -> list[BlockRead]:
    found: list[BlockRead] = []
    for path in sorted((out / "records").glob("*.nc")):
        dated = "undated" not in path.name
        records = sw.open_records(path, dated=dated)
        for index in range(records.sizes["time"]):
            at = records.isel(time=index)
            flags = {str(at["flags"].item()), *map(str, np.ravel(at["quality_flags"].values))}
            words = frozenset(word for flag in flags for word in re.split(r"[ ,|]+", flag) if word and word != "ok")
            stamp = float(at["time"].values.astype("datetime64[ns]").astype(np.int64)) / 1e9 if dated else None
            rms = dict(zip(map(str, records["channel"].values), map(float, at["rms"].values), strict=True))
            found.append(
                BlockRead(str(at["name"].item()), str(at["status"].item()), str(at["reason"].item()), words, stamp, rms)
            )
    return found


def by_hand(folder: Path, configuration: str) -> Came:
    """Replay ``folder/data`` with a configuration that states what the files do not."""
    came = Came()
    with contextlib.chdir(folder):
        path = Path("by_hand.toml")
        path.write_text(configuration, encoding="utf-8")
        replayed(came, path, Path("by_hand"))
        _, output, said = called("check", "--config", "by_hand.toml", "--json")
        came.said += said
        ends = (
            [end for each in json.loads(output)["dating"].values() for end in each.get("ends", [])]
            if output.startswith("{")
            else []
        )
        found = [_FIRST_FILE_RATE.search(end) for end in ends]
        came.rate = float(found[0].group(1)) if found and found[0] else came.rate
    return came


def by_read(path: Path, how: Mapping[str, Any]) -> Came:
    """Read one file by ``sw.read``."""
    came = Came()
    try:
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            signal = sw.read(path, **how)
    except sw.SpallwatchError as error:
        came.refused = str(error)
        return came
    except Exception as error:
        came.refused = f"{type(error).__name__}: {error}"
        return came
    came.rate = float(signal.attrs["rate_hz"])
    start = signal.attrs.get("start_utc")
    names = [str(name) for name in signal["channel"].values]
    values = signal.values - signal.values.mean(axis=1, keepdims=True)
    rms = dict(zip(names, np.sqrt(np.mean(values**2, axis=1)).tolist(), strict=True))
    came.channels = [{"name": name, "unit": str(signal.attrs.get("units", ""))} for name in names]
    time = (
        None
        if start is None
        else np.datetime64(str(start).removesuffix("+00:00")).astype("datetime64[ns]").astype(np.int64) / 1e9
    )
    came.said = " ".join(str(each.message) for each in heard)
    flags = frozenset(f"{signal.attrs.get('flags', '')} {came.said}".replace(",", " ").split()) - {"ok"}
    came.blocks = [BlockRead(path.name, "ok", "", flags, time, rms)]
    return came

"""The ways in which a recording comes in: init with replay, replay by hand, and Python."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

import spallwatch as sw
from monitor.cli import spallwatch

MACHINE = """
[machine]
name = "m"
state_dir = "{folder}/state"
records_dir = "{folder}/records"
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = 24.8
[[source]]
name = "acq"
url = "folder:{folder}/data"
block_s = "file"
{source}
"""


@dataclass
class Records:
    """What came in by one way.

    Attributes:
        configuration: of init; None where it wrote none.
        said: what was printed for people.
        summary: the JSON object of the replay.
        names, flags, times: of each block; times in s since 1970, NaN where a block has none.
        rms: of each block by channel, m/s2; NaN where it was rejected.
    """

    configuration: dict[str, Any] | None = None
    said: str = ""
    summary: dict[str, Any] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    flags: list[set[str]] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    rms: dict[str, list[float]] = field(default_factory=dict)


def by_init(folder: Path, data: str = "data", *options: str) -> Records:
    """Run ``init`` on ``folder/data`` with a bearing and a speed, and replay with what it wrote."""
    out = folder / "by_init.toml"
    came = Records()
    words = ["init", str(folder / data), "--bearing", "6205-2RS", "--speed-hz", "24.8", "--yes", "--out", str(out)]
    found = CliRunner().invoke(spallwatch, [*words, *options])
    came.said = f"{found.output}\n{found.exception or ''}"
    if out.exists():
        came.configuration = tomllib.loads(out.read_text(encoding="utf-8"))
        _replay(came, folder, out)
    return came


def by_hand(folder: Path, channels: str, source: str = "") -> Records:
    """Replay ``folder/data`` with tables of channels as the text of a configuration."""
    path = folder / "by_hand.toml"
    path.write_text(MACHINE.format(folder=folder, source=source) + channels, encoding="utf-8")
    came = Records()
    _replay(came, folder, path)
    return came


def channel_table(place: str, unit: str, name: str = "c") -> str:
    """The table of a channel; ``place``: ``column = 1``."""
    return f'[[channel]]\nname = "{name}"\nsource = "acq"\nbearing = "b"\nband_hz = "auto"\n{place}\nunit = "{unit}"\n'


def _replay(came: Records, folder: Path, configuration: Path) -> None:
    out = folder / f"{configuration.stem}-out"
    words = ["replay", str(folder / "data"), "--config", str(configuration), "--out", str(out), "--no-report", "--json"]
    found = CliRunner().invoke(spallwatch, words)
    came.said += f"{found.stderr}\n{found.exception or ''}"
    if found.stdout.startswith("{"):
        came.summary = json.loads(found.stdout)
    for path in sorted((out / "records").glob("*.nc")):
        dated = "undated" not in path.name
        records = sw.open_records(path, dated=dated)
        came.names += [str(name) for name in records["name"].values]
        words_of = zip(records["flags"].values, records["quality_flags"].values, strict=True)
        came.flags += [
            {word for each in [str(a), *map(str, b)] for word in each.replace(",", " ").split()} for a, b in words_of
        ]
        stamps = (
            records["time"].values.astype("datetime64[ns]").astype(np.int64) / 1e9
            if dated
            else [np.nan] * records.sizes["time"]
        )
        came.times += [float(each) for each in stamps]
        for index, name in enumerate(records["channel"].values):
            came.rms.setdefault(str(name), []).extend(float(value) for value in records["rms"].values[:, index])

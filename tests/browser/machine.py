"""A machine whose daemon serves the page, fed by the test with blocks of a bearing that turns bad."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.support.daemons import start
from tests.support.forks import ForkedProgram
from tests.support.waiting import stop, wait_until

RATE = 2560
SECONDS = 0.5
OUTER_HZ = 180.0
BEGIN = 1_772_344_800.0
"""2026-03-01 06:00:00 UTC."""


def machine_text(name: str, folder: Path, channels: int, web: str) -> str:
    """Return the configuration of a machine with one source of several channels, which learn from 10 blocks."""
    head = f"""
[machine]
name = "{name}"
timezone = "Europe/Rome"
min_free_mb = 1
spectra_interval_s = 0.4
[publish]
interval_s = 0.5
[[bearing]]
name = "b"
n_elements = 10
element_diameter_mm = 10
pitch_diameter_mm = 100
contact_angle_deg = 0
[operating]
speed_hz = 40.0
load_newton = 1200.0
[[source]]
name = "s"
url = "folder:{folder}"
format = "csv"
rate_hz = {RATE}
settle_s = 0.1
block_s = "file"
[detect]
learn_blocks = 10
run_in_blocks = 1
persist_blocks = 3
end_of_life_peak_g = 200
[[alarms.level]]
feature = "rms"
alert_g = 1.5
danger_g = 3.0
on_delay_blocks = 2
latch = true
{web}
"""
    return head + "".join(
        f'[[channel]]\nname = "{channel_name(number)}"\nsource = "s"\ncolumn = "{channel_name(number)}"\nunit = "g"\n'
        'bearing = "b"\nband_hz = [[300, 1200]]\n'
        for number in range(channels)
    )


def channel_name(number: int) -> str:
    """Return the name of a channel."""
    return f"x{number}"


def sound(count: int, seed: int, *, level: float, damage: float = 0.0) -> NDArray[np.float64]:
    """Return noise of an RMS, with bursts as a damaged outer race makes them, ``damage`` times as high."""
    random = np.random.default_rng(seed)
    time = np.arange(count) / RATE
    bursts = np.exp(-((time * OUTER_HZ) % 1.0) * 8.0) * np.sin(2 * np.pi * 700.0 * time)
    return level * random.normal(size=count) + damage * bursts


class Served:
    """A daemon with a page, its folder and how to feed it."""

    def __init__(self, folder: Path, *, name: str = "pump", channels: int = 2, web: str = "[web]\nport = 0\n") -> None:
        """Write the configuration; nothing runs yet."""
        self.folder = folder
        self.inbox = folder / "in"
        self.inbox.mkdir(parents=True)
        self.name, self.channels = name, channels
        self.config = folder / "m.toml"
        self.config.write_text(machine_text(name, self.inbox, channels, web))
        self.files = self.trapped = 0
        self._process: ForkedProgram | None = None

    def start(self) -> None:
        """Start the daemon and wait for its page."""
        self._process = start(self.config)
        try:
            wait_until(lambda: self.status().get("page"))
        except AssertionError:
            raise AssertionError(f"the page does not come: {self.status().get('problems')}, {self.stop()}") from None

    def stop(self) -> str:
        """Stop the daemon in order, the page ends with it; return what it said on its standard error."""
        if self._process is None:
            return ""
        said = stop(self._process)
        self._process = None
        return said

    def status(self) -> dict[str, Any]:
        """Return what the daemon says."""
        try:
            return json.loads((self.folder / "state" / "status.json").read_text())
        except FileNotFoundError:
            return {}

    @property
    def url(self) -> str:
        """Address of the page."""
        return self.status()["page"]

    @property
    def token(self) -> str:
        """What an acknowledgement needs."""
        return (self.folder / "state" / "web.token").read_text().strip()

    def put_bytes(self, name: str, content: bytes) -> None:
        """Put a file into the watched folder, whole."""
        hidden = self.inbox / f".{self.files}.tmp"
        hidden.write_bytes(content)
        hidden.rename(self.inbox / name)
        self.files += 1

    def put(self, blocks: int, *, level: float = 1.0, damage: float = 0.0) -> None:
        """Feed blocks, the damage in the first channel alone, and wait until they are committed."""
        for _ in range(blocks):
            self.put_bytes(f"f{self.files:05d}.csv", self._file(level, damage))
        wait_until(lambda: self.status()["sources"]["s"]["accepted"] + self.trapped >= self.files)

    def _file(self, level: float, damage: float) -> bytes:
        """Return a block as CSV; the first column says when its samples were taken."""
        count, first = int(RATE * SECONDS), 1000 * self.files
        columns = [sound(count, first, level=level, damage=damage)]
        columns += [sound(count, first + n, level=1.0) for n in range(1, self.channels)]
        times = BEGIN + SECONDS * self.files + np.arange(count) / RATE
        head = ",".join(["time", *map(channel_name, range(self.channels))])
        rows = (
            f"{time:.6f}," + ",".join(f"{v:.3f}" for v in row)
            for time, row in zip(times, np.column_stack(columns), strict=True)
        )
        return "\n".join([head, *rows, ""]).encode()

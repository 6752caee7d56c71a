"""``check`` judges the files that wait: each rule with files that it doubts, and with their nearest good neighbour."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.config.plausible.rules import RULES
from streams.files.load import Loader
from streams.types.samples import Samples
from tests.streams.several_makers import lvm, parts_of
from tests.support.commands import run_command
from tests.support.doubtful_settings import CASES

RATE = 4000
CONFIG = """
[machine]
name = "m"
[[bearing]]
name = "b"
designation = "6205"
[operating]
{operating}
[[source]]
name = "s"
url = "folder:in"
{source}
[[channel]]
name = "x"
source = "s"
column = 1
bearing = "b"
{channel}
[[channel]]
name = "y"
source = "s"
column = 2
bearing = "b"
{channel}
"""


@dataclass(frozen=True)
class Waiting:
    """Files that wait in a folder: one array of shape (2, samples) each, and the configuration that reads them."""

    files: tuple[Any, ...]
    operating: str = "speed_hz = 31"
    source: str = f"rate_hz = {RATE}\nblock_s = 1"
    channel: str = 'unit = "g"'
    sidecar: dict[str, Any] | None = None
    years: tuple[int, ...] = ()


def noise(seed: int, level: float = 1.0) -> np.ndarray:
    return level * np.random.default_rng(seed).normal(size=(2, 2 * RATE))


def both(make: Callable[[np.ndarray], np.ndarray], **keys: Any) -> Waiting:
    return Waiting((make(noise(1)), make(noise(2))), **keys)


def changed(row: int, values: np.ndarray) -> Waiting:
    """Replace one row of the first file."""
    first = noise(1)
    first[row] = values
    return Waiting((first, noise(2)))


def plain(**keys: Any) -> Waiting:
    return both(lambda x: x, **keys)


ONE = plain()
IN_G, IN_SI = 'unit = "g"', 'unit = "m/s2"'
STATED = {"rate_hz": RATE}
WHOLE = f'rate_hz = {RATE}\nblock_s = "file"'
VOLTS: dict[str, Any] = {"channel": 'unit = "V"\nsensitivity_mv_per_g = 100'}
RANGE: dict[str, Any] = {"source": f"rate_hz = {RATE}\nblock_s = 1\nrange_g = 8\n[detect]\nend_of_life_peak_g = 7"}
HIGH: dict[str, Any] = {"source": f"rate_hz = {RATE}\nblock_s = 1\n[detect]\nend_of_life_peak_g = 150"}
BACK = Waiting(tuple(map(noise, range(5))), years=(2026, 2026, 2006, 2006, 2026))
ALTERNATING = Waiting(tuple(noise(number, 1.0 + number % 2) for number in range(8)))
DRIFTING = Waiting(tuple(noise(number, 1.0 + 0.1 * number) for number in range(8)))

SECONDS = f"rate_hz = {RATE}\nblock_s = 2"


def with_row(value: float, operating: str) -> Waiting:
    """Return files with a third row, "n", of one value."""
    rows = tuple(np.vstack([noise(seed), np.full(2 * RATE, value)]) for seed in (1, 2))
    return Waiting(rows, operating=operating.replace('"n"', "3"))


CASES_OF_FILES: list[tuple[str, str, str, Waiting, Waiting]] = [
    ("gravity", "problem", "channel[x].unit", both(lambda x: x + 9.81), both(lambda x: x + 1.0)),
    (
        "gravity",
        "problem",
        "channel[x].unit",
        both(lambda x: x + 1.0, channel=IN_SI),
        both(lambda x: x + 9.81, channel=IN_SI),
    ),
    ("bias", "problem", "channel[x]", both(lambda x: 0.1 * x + 10.5, **VOLTS), both(lambda x: 0.1 * x + 0.5, **VOLTS)),
    ("high_level", "warning", "channel[x].unit", both(lambda x: 40.0 * x, **HIGH), both(lambda x: 20.0 * x, **HIGH)),
    ("bias", "problem", "channel[x]", both(lambda x: x + 12.0), both(lambda x: x - 1.5)),
    ("high_level", "problem", "channel[x].unit", both(lambda x: 300.0 * x), both(lambda x: 3.0 * x)),
    ("high_level", "problem", "source[s].range_g", both(lambda x: 3.0 * x, **RANGE), plain(**RANGE)),
    ("low_level", "problem", "channel[x].unit", both(lambda x: 1e-5 * x), both(lambda x: 0.01 * x)),
    ("low_level", "warning", "channel[x].unit", both(lambda x: 1e-3 * x), both(lambda x: 0.01 * x)),
    ("low_level", "warning", "channel[x].unit", Waiting((noise(1), noise(2, 1e-5))), ONE),
    ("end_of_life", "warning", "detect.end_of_life_peak_g", both(lambda x: 8.0 * x), both(lambda x: 3.0 * x)),
    ("constant", "problem", "channel[y]", changed(1, np.full(2 * RATE, 0.3)), ONE),
    ("numbers", "problem", "channel[y]", changed(1, np.append(noise(3)[0, 1:], np.nan)), ONE),
    (
        "clock",
        "warning",
        "source[s].url",
        Waiting(tuple(map(noise, range(5))), years=(2026, 2026, 2006, 2006, 2026)),
        ONE,
    ),
    ("flagged", "warning", "channel[y]", changed(1, np.append(noise(3)[0, RATE:], np.zeros(RATE))), ONE),
    ("clipping", "warning", "channel[y]", changed(1, np.clip(noise(3)[0], -1.0, 1.0)), ONE),
    ("same_signal", "problem", "channel[y]", changed(1, 9.81 * noise(1)[0]), ONE),
    ("alternating", "problem", "channel[x]", ALTERNATING, DRIFTING),
    (
        "alternating",
        "problem",
        "channel[x]",
        Waiting((np.hstack(ALTERNATING.files),), source=SECONDS),
        Waiting((np.hstack(DRIFTING.files),), source=SECONDS),
    ),
    (
        "speed",
        "problem",
        "operating.speed_channel_scale",
        with_row(1860.0, 'speed_channel = "n"'),
        with_row(1860.0, 'speed_channel = "n"\nspeed_channel_scale = 0.0166667'),
    ),
    (
        "load",
        "problem",
        "operating.load_channel_scale",
        with_row(4.0, 'speed_hz = 31\nload_channel = "n"'),
        with_row(4.0, 'speed_hz = 31\nload_channel = "n"\nload_channel_scale = 1000'),
    ),
    ("file", "problem", "source[s].url", Waiting((noise(1), noise(2)[:1])), ONE),
    ("file", "problem", "source[s].url", Waiting((noise(1), noise(2)[:1], noise(3))), ONE),
    ("file", "problem", "source[s].rate_hz", plain(sidecar={"rate_hz": 5000}), ONE),
    ("file_speed", "problem", "operating.speed_hz", plain(sidecar={"speed_hz": 31 / 60}), ONE),
    ("file_speed", "warning", "operating.speed_hz", plain(sidecar={"speed_hz": 20}), ONE),
    ("speed", "problem", "operating.speed_hz", plain(sidecar={"speed_hz": 1860}), ONE),
    ("no_speed", "problem", "operating.speed_hz", plain(operating=""), plain(operating="", sidecar={"speed_hz": 31})),
    (
        "rate",
        "problem",
        "source[s].rate_hz",
        plain(source="block_s = 1", sidecar={"rate_hz": 40}),
        plain(source="block_s = 1", sidecar=STATED),
    ),
    (
        "band",
        "problem",
        "channel[x].band_hz",
        plain(source="block_s = 1", sidecar=STATED, channel=f"{IN_G}\nband_hz = [500, 2500]"),
        plain(source="block_s = 1", sidecar=STATED, channel=f"{IN_G}\nband_hz = [500, 1900]"),
    ),
    (
        "block",
        "problem",
        "source[s].block_s",
        Waiting((noise(1)[:, :200], noise(2)[:, :200]), source=WHOLE),
        plain(source=WHOLE),
    ),
    ("place", "warning", "source[s].url", Waiting(()), ONE),
]

ELSEWHERE = {
    "clocks": "tests/monitor/config/test_plausible.py",
    "access": "tests/monitor/config/test_network.py",
    "damage": "tests/monitor/service/test_setup.py",
    "dating": "tests/monitor/commands/test_redate.py",
    "extra": "tests/monitor/service/neighbours/test_opcua.py",
    "interference": "tests/monitor/config/test_interference.py",
    "level_unlearned": "tests/monitor/service/test_alarming.py",
    "refused": "tests/monitor/commands/test_check_refuses.py",
    "rig": "tests/monitor/config/test_rig.py",
    "tacho": "tests/monitor/commands/test_check_tacho.py",
    "unit_unknown": "tests/monitor/commands/test_check_recordings.py",
    "unlisted": "tests/spallwatch/test_kinds_unlisted.py",
}


def checked(folder: Path, waiting: Waiting) -> list[dict[str, Any]]:
    (folder / "in").mkdir(parents=True)
    for number, values in enumerate(waiting.files):
        year = waiting.years[number] if waiting.years else 2024
        path = folder / "in" / f"{number}_{year}-01-02_10-00-{2 * number:02d}.npy"
        np.save(path, values)
        if waiting.sidecar is not None:
            path.with_name(f"{path.name}.json").write_text(json.dumps(waiting.sidecar))
    text = CONFIG.format(operating=waiting.operating, source=waiting.source, channel=waiting.channel)
    (folder / "m.toml").write_text(text)
    done = run_command("check", "--config", "m.toml", "--json", cwd=folder)
    found: list[dict[str, Any]] = json.loads(done.stdout)["problems"]
    assert done.returncode == (2 if "problem" in {entry["severity"] for entry in found} else 0)
    for entry in found:
        assert set(entry) == {"severity", "file", "line", "key", "expected", "came"}
        assert entry["file"] == "m.toml"
        if entry["line"] is not None:
            assert entry["key"].rpartition(".")[2] in text.splitlines()[entry["line"] - 1] or "]" in entry["key"][-1]
    return found


@pytest.mark.parametrize(("rule", "severity", "key", "bad", "good"), CASES_OF_FILES, ids=range(len(CASES_OF_FILES)))
def test_files_are_doubted_and_their_neighbours_are_not(
    rule: str, severity: str, key: str, bad: Waiting, good: Waiting, tmp_path: Path
) -> None:
    found = checked(tmp_path / "bad", bad)
    assert (severity, key) in {(entry["severity"], entry["key"]) for entry in found}, (rule, found)
    assert checked(tmp_path / "good", good) == []


def test_each_rule_is_tested() -> None:
    tested = {rule for rule, *_ in CASES} | {rule for rule, *_ in CASES_OF_FILES} | set(ELSEWHERE)
    assert tested == set(RULES)


@pytest.mark.parametrize("hours", [0, 2])
def test_two_loggers_of_different_zones_are_a_warning(tmp_path: Path, hours: int) -> None:
    text = CONFIG.format(operating=ONE.operating, source=ONE.source, channel=ONE.channel)
    begin = datetime(2024, 1, 2, 10, tzinfo=UTC)
    for place, folder in enumerate(("in", "other")):
        (tmp_path / folder).mkdir()
        for number in range(3):
            written = begin + timedelta(minutes=10 * number)
            stated = written + timedelta(hours=hours * place)
            path = tmp_path / folder / f"{stated:%Y-%m-%d_%H-%M-%S}.npy"
            np.save(path, noise(10 * place + number))
            changed = written.timestamp() + 3.0
            os.utime(path, (changed, changed))
    second = text[text.index("[[source]]") :].replace('"s"', '"t"').replace("folder:in", "folder:other")
    for name in ("x", "y"):
        second = second.replace(f'name = "{name}"', f'name = "{name}2"')
    (tmp_path / "m.toml").write_text(text + second)
    found = json.loads(run_command("check", "--config", "m.toml", "--json", cwd=tmp_path).stdout)["problems"]
    clocks = [entry["came"] for entry in found if "ahead of those" in entry["came"]]
    assert len(clocks) == (hours > 0)
    assert all(came.startswith("times of t are 2 h ahead of those of s") for came in clocks)


def test_a_recording_that_breaks_off_is_a_warning(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    text = lvm(parts_of([8000] * 2, [5.0] * 2, channels=2), ("x", "y"))
    (tmp_path / "in" / "a.lvm").write_bytes(text[:-100])
    config = CONFIG.format(operating="speed_hz = 31", source="block_s = 1", channel='unit = "g"')
    (tmp_path / "config.toml").write_text(config.replace("column = 1", 'key = "x"').replace("column = 2", 'key = "y"'))
    done = run_command("check", "--config", tmp_path / "config.toml", "--json")
    found = [one for one in json.loads(done.stdout)["problems"] if one["came"].startswith("is left out")]
    assert [one["severity"] for one in found] == ["warning"]
    assert "a.lvm: line" in found[0]["came"]


def test_an_unknown_unit_is_a_warning(tmp_path: Path) -> None:
    found = checked(tmp_path, plain(channel='unit = "unknown"'))
    assert {(entry["severity"], entry["key"]) for entry in found} == {
        ("warning", "channel[x].unit"),
        ("warning", "channel[y].unit"),
    }


def test_the_lines_for_people_say_the_same_and_sum_up(tmp_path: Path) -> None:
    (problem,) = [
        entry for entry in checked(tmp_path, Waiting((), operating="speed_hz = 1860")) if entry["severity"] == "problem"
    ]
    assert (problem["line"], problem["key"]) == (8, "operating.speed_hz")
    done = run_command("check", "--config", "m.toml", cwd=tmp_path)
    assert done.returncode == 2
    said = done.stdout.splitlines()
    assert f"problem: m.toml:8: operating.speed_hz: {problem['came']}; expected {problem['expected']}" in said
    assert said[-1] == "1 problem, 1 warning"


def test_a_folder_of_many_files_is_judged_by_few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []
    load = Loader.load

    def counted(loader: Loader, raw: Any, path: str, *others: Any, **keys: Any) -> Samples:
        loaded.append(path)
        return load(loader, raw, path, *others, **keys)

    monkeypatch.setattr(Loader, "load", counted)
    assert checked(tmp_path, Waiting(tuple(noise(number)[:, : 2 * RATE] for number in range(25)))) == []
    # Ten for the blocks and files that are compared, two for the ends, and as many again for what dates them.
    assert len(loaded) <= 25
    assert len(set(loaded)) <= 11


@pytest.mark.parametrize(
    ("waiting", "said"),
    [
        (both(lambda x: x * np.nan), {"numbers"}),
        (both(lambda x: x * np.inf), {"numbers"}),
        (both(lambda x: x * 1e300), {"an RMS up to 100 g, peaks up to 1000 g", "peaks below 20 g"}),
        (both(lambda x: x[:, :0]), {"files that fit the configuration"}),
        (with_row(math.nan, 'speed_channel = "n"'), set()),
        (with_row(math.nan, 'speed_hz = 31\nload_channel = "n"'), set()),
    ],
    ids=range(6),
)
def test_no_samples_make_it_fail(waiting: Waiting, said: set[str], tmp_path: Path) -> None:
    assert {entry["expected"] for entry in checked(tmp_path, waiting)} == said

"""Pages whose commands are run: files, commands and output stand on them in fenced blocks.

A block ``toml NAME`` or ``csv NAME`` is a file, ``sh`` are commands, and ``text`` is a part of what the last of them
printed: its words, and its numbers within 2 %.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import spallwatch as sw
from monitor.health.record import Record
from reference.signals import bearing_lines, impacts
from streams.types.block import STANDARD_GRAVITY
from tests.streams.tcp_peers import receiving
from tests.support.commands import run_command
from tests.support.committing import committing
from tests.support.docs import DOCS, read
from tests.support.docs_commands import same
from tests.support.effort import effort_count
from tests.support.library_learn import features
from tests.support.memory_ledger import MemoryLedger
from tests.support.pages import page_of
from tests.support.score import DAY, record, run, stored

PRESS = """
[machine]
name = "press"
state_dir = "state"
records_dir = "state/records"
[[bearing]]
name = "b"
designation = "6205"
[operating]
speed_hz = 10.0
[[source]]
name = "s"
url = "x.npy"
rate_hz = 4000.0
block_s = 1.0
[[channel]]
name = "horizontal"
source = "s"
unit = "g"
bearing = "b"
band_hz = [500, 1500]
[[alarms.level]]
feature = "rms"
alert_g = 0.001
on_delay_blocks = 1
latch = true
"""
BENCH = """
[machine]
name = "press"
[[bearing]]
name = "b"
designation = "1205 ETN9"
[operating]
speed_hz = 40.0
load_newton = 4000.0
[[source]]
name = "s"
rate_hz = 25600.0
[[channel]]
name = "x"
source = "s"
unit = "g"
bearing = "b"
"""
BLOCK = re.compile(r"^```(\w*) ?(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass
class Session:
    """The commands of a page, run one after the other in a folder; ``printed`` is the output of the last one.

    ``changes``: by the beginning of a command, what is added to it in quick effort, or None: it is not run then.
    """

    folder: Path
    changes: Mapping[str, str | None] = field(default_factory=dict[str, str | None])
    printed: str = ""
    run: list[str] = field(default_factory=list[str])

    def take(self, kind: str, name: str, text: str) -> None:
        """Write the file of a block, run its commands, or compare its output."""
        if name:
            (self.folder / name).write_text(text, encoding="utf-8")
        elif kind == "sh":
            for line in text.splitlines():
                self.command(line)
        elif kind == "text":
            compare(text, self.printed)
        else:
            # A part of a configuration: test_docs_blocks validates it.
            assert kind == "toml", text

    def command(self, line: str) -> None:
        """Run one command; those of the program within this process."""
        words = shlex.split(line, comments=True)
        if words[0] == "make":
            return
        self.run.append(line)
        if words[0].rpartition("/")[2] == "spallwatch":
            begun = next((begin for begin in self.changes if " ".join(words[1:]).startswith(begin)), None)
            added = "" if begun is None else self.changes[begun]
            if added is None:
                return
            done = run_command(*words[1:], *added.split(), cwd=self.folder)
        else:
            done = subprocess.run(
                ["bash", "-c", line], cwd=self.folder, capture_output=True, text=True, check=False, timeout=60.0
            )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        self.printed = done.stdout


def recording_of_a_fan(folder: Path) -> None:
    """Write 60 files of a second; a spall of the outer race grows from the 45th on."""
    rate = 12800
    _, lines = bearing_lines("6205", 24.5)
    (folder / "recording").mkdir()
    for number in range(1, 61):
        height = 0.4 * 1.25 ** max(0, number - 44)
        samples = impacts(
            np.random.default_rng(number), "outer", lines, rate=float(rate), duration=1.0, height=height, slip=0.003
        )
        text = "\n".join(f"{value:.5g}" for value in samples / STANDARD_GRAVITY)
        (folder / "recording" / f"{number:03d}.csv").write_text(text)


def scored_runs(folder: Path) -> None:
    """Write stores of runs with forecasts."""
    stored(make(folder / "OUT"), run())
    stored(make(folder / "A"), run(start=DAY), "a")
    stored(make(folder / "B"), run(start=DAY), "b")
    truth = {
        sequence: {"tt_true": 100.0 * (11 - sequence), "v_eq_true": 0.005e-6 * sequence} for sequence in range(4, 12)
    }
    stored(make(folder / "demo-out"), run(more=truth), "rig")


def runs_to_report(folder: Path) -> None:
    """Write stores of runs, a folder of them, and a map."""
    for place in ("OUT", "A", "B", "C", "DIR/one", "DIR/two"):
        stored(make(folder / place), run(start=DAY), place.replace("/", "-"))
    rms_map = sw.build_map(
        load_newton=4000.0, speed_hz=40.0, dphi_deg=[0, 5, 10], h_d_um=[0, 10, 20], interpolation_tolerance=0.0
    )
    sw.save_map(rms_map, folder / "map.nc")


def bench_and_runs(folder: Path) -> None:
    """Write the configuration of the bench of the thesis, and three runs to failure."""
    (folder / "machine.toml").write_text(BENCH)
    for number, name in enumerate(("run1/records", "run2.csv", "run3.csv")):
        path = folder / name
        if path.suffix:
            features(path, seed=number)
        else:
            stored(make(path.parent), recorded_run(), published=True)


def recorded_run() -> list[Record]:
    """Return records of 200 blocks, the final stage from the 150th on."""
    final = {"stage": "final", "t_fs": 14900.0, "t_fs_known": 15500.0}
    return [
        record(
            number,
            {"rms": 1.0 + 0.05 * max(0, number - 150), **(final if number > 155 else {"stage": "healthy"})},
            start=None,
        )
        for number in range(1, 201)
    ]


def make(folder: Path) -> Path:
    folder.mkdir(parents=True)
    return folder


def compare(shown: str, printed: str) -> None:
    """Raise an AssertionError unless the lines shown are among those printed, in this order."""
    lines = iter(printed.splitlines())
    for line in shown.splitlines():
        assert any(agree(line.split(), other.split()) for other in lines), f"{line!r} is not in\n{printed}"


def agree(shown: list[str], printed: list[str]) -> bool:
    """Return whether words are equal and numbers nearly so; "..." stands for the rest of a line."""
    if "..." in shown:
        length = shown.index("...")
        shown, printed = shown[:length], printed[:length]
    return len(shown) == len(printed) and all(map(same, shown, printed))


@pytest.mark.parametrize(
    ("shown", "agrees"),
    [("k 1.0 to", True), ("k 1.01 to", True), ("k 1.1 to", False), ("b 1 to", False), ("k 1", False), ("k ...", True)],
)
def test_output_is_compared_word_by_word(shown: str, agrees: bool) -> None:
    assert agree(shown.split(), ["k", "1.0", "to"]) is agrees


def test_lines_of_output_are_in_order() -> None:
    compare("a 1\nc 3\n", "a 1\nb 2\nc 3\n")
    with pytest.raises(AssertionError, match="'a 1' is not in"):
        compare("c 3\na 1\n", "a 1\nb 2\nc 3\n")


SMALL_MAP = "--dphi-deg 0:20:5 --h-d-um 0:20:3 --interpolation-tolerance 0"
PAGES: dict[str, tuple[Callable[[Path], None] | None, dict[str, str | None]]] = {
    "how-to/calibrate-your-machine.md": (None, {}),
    "how-to/maps-and-libraries.md": (bench_and_runs, {"map build": SMALL_MAP, "library build": None}),
    "how-to/reports.md": (runs_to_report, {"report OUT --out press4.pdf": None, "report --batch": None}),
    "how-to/score.md": (scored_runs, {}),
    "tutorials/first-recording.md": (recording_of_a_fan, {}),
}
"""What each page finds in its folder, and what of it is made smaller or left out in quick effort: a library of lives
takes minutes; PDF and batch have tests of their own."""


@pytest.mark.process
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(page: str, tmp_path: Path) -> None:
    prepare, changes = PAGES[page]
    if prepare is not None:
        prepare(tmp_path)
    session = Session(tmp_path, changes if effort_count(quick=1, full=0) else {})
    for kind, name, text in BLOCK.findall(read(DOCS / page)):
        session.take(kind, name, text)
    named = re.findall(r"^(?:\.venv/bin/)?spallwatch .*$", read(DOCS / page), re.MULTILINE)
    assert [line for line in session.run if re.match(r"(\.venv/bin/)?spallwatch ", line)] == named
    assert named


def press_csv(folder: Path) -> None:
    """Write a recording of a damaged bearing."""
    _, lines = bearing_lines("6205", 29.95)
    samples = impacts(np.random.default_rng(1), "outer", lines) / STANDARD_GRAVITY
    np.savetxt(folder / "press.csv", samples, header="press", comments="")


def records_and_store(folder: Path) -> None:
    """Write records and the store of a machine with the channel ``mo``."""
    np.save(folder / "x.npy", np.random.default_rng(1).standard_normal(12000))
    source = {"name": "s", "url": str(folder / "x.npy"), "rate_hz": 4000.0, "block_s": 1.0}
    tables = {
        "machine": {"name": "ferrara"},
        "bearing": [{"name": "b", "designation": "6205"}],
        "operating": {"speed_hz": 10.0},
        "source": [{**source, "start_utc": datetime(2026, 11, 20, tzinfo=UTC)}],
        "channel": [{"name": "mo", "source": "s", "unit": "g", "bearing": "b", "band_hz": [500, 1500]}],
    }
    sw.replay(config=tables, out=folder / "state")
    (folder / "state" / "records").rename(folder / "records")


PYTHON_PAGES = {"reference/python.md": press_csv, "how-to/records.md": records_and_store}


@pytest.mark.parametrize("page", PYTHON_PAGES)
def test_the_python_of_a_page_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    PYTHON_PAGES[page](tmp_path)
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {}
    for kind, _, text in BLOCK.findall(read(DOCS / page)):
        assert kind == "python"
        exec(text, namespace)


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
@pytest.mark.process
def test_the_addresses_of_the_http_interface_answer(tmp_path: Path) -> None:
    """The calls of the page, to a page over a machine that has an alarm."""
    config = tmp_path / "press.toml"
    config.write_text(PRESS)
    np.save(tmp_path / "x.npy", np.random.default_rng(1).standard_normal(12000))
    sw.replay(tmp_path / "x.npy", config=config, out=tmp_path / "state")
    calls = next(text for kind, _, text in BLOCK.findall(read(DOCS / "reference" / "api.md")) if kind == "sh")
    with page_of(config) as page:
        event = page.get("/api/events")["events"][0]["id"]
        text = calls.replace("http://127.0.0.1:8710", page.url.rstrip("/")).replace("press:17", event)
        commands = text.replace("\\\n", " ").splitlines()
        assert len(commands) == 3
        for command in commands:
            done = subprocess.run(
                ["bash", "-c", command.replace("curl ", "curl --silent --fail-with-body ", 1)],
                cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60.0,
            )  # fmt: skip
            assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
            assert json.loads(done.stdout)
        assert page.get("/api/events")["events"][0]["acknowledgements"][0]["who"] == "Ada"


def test_the_command_that_sends_a_recording_reaches_a_receiver(tmp_path: Path) -> None:
    """The call over TCP; that over MQTT needs a broker, and has tests of its own."""
    np.savetxt(
        tmp_path / "recording.csv",
        np.random.default_rng(1).standard_normal(128000),
        fmt="%.5f",
        header="x (g)",
        comments="",
    )
    calls = next(text for kind, _, text in BLOCK.findall(read(DOCS / "how-to" / "stream.md")) if kind == "sh")
    line = next(line for line in calls.splitlines() if "tcp://receiver:5777" in line)
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, committing(receiver, ledger) as items:
        words = line.replace("receiver:5777", f"127.0.0.1:{receiver.port}").replace("--pace 1", "--pace 100")
        done = run_command(*shlex.split(words)[1:], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(items) == 1

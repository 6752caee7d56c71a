"""Commands with local workers, killed and interrupted at random moments, then continued with ``--resume``.

Each round runs one command (``benchmarks/work_cases.py``) in a session and a temporary folder of its own. Two to
four times a fault comes, early ones more often, as each run has less left to do; then ``--resume`` ends it. Counted as
a problem: a result that differs from that of one undisturbed process, an exit code other than ``FAULTS`` says, a
traceback, a process that is alive ``MAX_END_S`` after its caller, and a file left in the folder of the output or in the
temporary folder. Run with ``python -m benchmarks.work_campaign``; ``benchmarks/results/work_campaign.json`` keeps what
came of it. With ``--only``, figures of other commands in the file stay, so that commands can be run side by side.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.common import print_table, write_json
from benchmarks.work_cases import CASES, WorkCase
from tests.support.waiting import wait_until

ROUNDS = 6
"""Of each command."""
SEED = 23
MIN_FAULTS, MAX_FAULTS = 2, 4
MAX_END_S = 10.0
_UNFINISHED = (".part", ".tmp", ".state", ".chunks", ".lock")
_PROGRAM = """
import os, pathlib
import models.work.task
models.work.task.CHUNK_SECONDS = 0.1
from monitor.cli import main
pathlib.Path(os.environ["CAMPAIGN_BEGUN"]).touch()
main()
"""
"""Short chunks, so that small cases have many. Before ``main`` it is the interpreter that answers a signal."""


def _group(number: signal.Signals) -> Callable[[int, random.Random], bool]:
    def send(pid: int, _draw: random.Random) -> bool:
        with suppress(ProcessLookupError):
            os.killpg(pid, number)
            return True
        return False

    return send


def _caller(number: signal.Signals) -> Callable[[int, random.Random], bool]:
    def send(pid: int, _draw: random.Random) -> bool:
        os.kill(pid, number)
        return True

    return send


def _twice(pid: int, draw: random.Random) -> bool:
    os.killpg(pid, signal.SIGINT)
    time.sleep(draw.uniform(0.0, 0.3))
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGINT)
    return True


def _pool_process(pid: int, draw: random.Random) -> bool:
    """Kill a process of the pool, where there is one."""
    found = [other for other in session(pid) if b"spawn_main" in _command_line(other)]
    if found:
        with suppress(ProcessLookupError):
            os.kill(draw.choice(found), signal.SIGKILL)
            return True
    return False


FAULTS: dict[str, tuple[Callable[[int, random.Random], bool], tuple[int, ...]]] = {
    "SIGKILL to the caller": (_caller(signal.SIGKILL), (-signal.SIGKILL,)),
    "SIGKILL to all": (_group(signal.SIGKILL), (-signal.SIGKILL,)),
    "SIGTERM to the caller": (_caller(signal.SIGTERM), (1, -signal.SIGTERM)),
    "SIGTERM to all": (_group(signal.SIGTERM), (1, -signal.SIGTERM)),
    "SIGHUP to all": (_group(signal.SIGHUP), (1, -signal.SIGHUP)),
    "Ctrl-C": (_group(signal.SIGINT), (1,)),
    "Ctrl-C twice": (_twice, (1,)),
    "SIGKILL to a process of the pool": (_pool_process, (0,)),
}
"""What happens to a command, and its exit codes then: the signal itself before the shared work has begun.

0 where it had ended before.
"""


def session(leader: int) -> list[int]:
    """Return the processes of a session that are alive."""
    found: list[int] = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, of = path.read_text().rpartition(")")[2].split()[:4]
            if int(of) == leader and state != "Z":
                found.append(int(path.parent.name))
    return found


def _command_line(pid: int) -> bytes:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


@dataclass
class Round:
    """One command, disturbed and continued.

    Attributes:
        folder: of its output, ``out``, and of its temporary files, ``tmp``.
        faults: what happened, and what the command answered.
        problems: what should not be.
    """

    case: WorkCase
    inputs: Path
    folder: Path
    faults: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    problems: list[str] = field(default_factory=list[str])

    @property
    def out(self) -> Path:
        """File or folder of the output."""
        return self.folder / "out" / f"result{self.case.suffix or ''}"

    @property
    def begun(self) -> Path:
        """File that a command makes as its work begins, after the imports of the interpreter."""
        return self.folder / "begun"

    def start(self, *options: str) -> subprocess.Popen[str]:
        """Start the command."""
        for name in ("out", "tmp"):
            (self.folder / name).mkdir(exist_ok=True)
        place = ["--chunks", str(self.folder / "chunks")] if self.case.suffix is None else ["--out", str(self.out)]
        arguments = [*self.case.arguments(self.inputs), *place, *options, "--json", "--quiet"]
        environment = os.environ | {"TMPDIR": str(self.folder / "tmp"), "CAMPAIGN_BEGUN": str(self.begun)}
        return subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=environment,
        )

    def undisturbed(self, *options: str) -> tuple[str, float]:
        """Run the command to its end; return the digest of its result, and the seconds after it had begun."""
        process = self.start(*options)
        wait_until(lambda: self.begun.exists() or process.poll() is not None)
        begun = time.monotonic()
        output, errors = process.communicate()
        took = time.monotonic() - begun
        if process.returncode != 0:
            self.problems.append(f"exit code {process.returncode} without a fault: {errors[-500:]}")
            return "", took
        if errors:
            self.problems.append(f"without a fault it said: {errors[-500:]}")
        return self.case.content(self.out, json.loads(output)), took

    def disturbed(self, name: str, delay: float, draw: random.Random) -> None:
        """Start the command, let a fault come, and wait for its end."""
        self.begun.unlink(missing_ok=True)
        process = self.start("--workers", "2", "--resume")
        wait_until(lambda: self.begun.exists() or process.poll() is not None)
        time.sleep(delay)
        cause, codes = FAULTS[name]
        came = process.poll() is None and cause(process.pid, draw)
        _, errors = process.communicate()
        ended = time.monotonic()
        while (left := session(process.pid)) and time.monotonic() - ended < MAX_END_S:
            time.sleep(0.02)
        lived = time.monotonic() - ended
        self.faults.append({"fault": name, "at_s": delay, "came": came, "code": process.returncode, "lived_s": lived})
        if left:
            self.problems.append(f"{name}: {len(left)} processes lived on for {MAX_END_S:.0f} s")
            for pid in left:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        if process.returncode not in ((*codes, 0) if came else (0,)):
            self.problems.append(f"{name} after {delay:.2f} s: exit code {process.returncode}")
        if "Traceback" in errors or "Exception ignored" in errors:
            self.problems.append(f"{name} after {delay:.2f} s: {errors[-2000:]}")

    def end(self, expected: str) -> None:
        """Let the command end with ``--resume``, and compare."""
        digest, _ = self.undisturbed("--workers", "2", "--resume")
        if digest and digest != expected:
            self.problems.append("the result differs")
        self.problems += [f"left: {path}" for path in self.leftovers()]

    def leftovers(self) -> Iterator[str]:
        """Yield the files and folders that are no output, hidden ones within it included."""
        for path in (self.folder / "out").iterdir():
            named = path.stem.partition(".")[0] == "result" and path.suffix not in _UNFINISHED
            if self.case.suffix is None or not named:
                yield f"out/{path.name}"
        yield from (f"out/{path.relative_to(self.folder / 'out')}" for path in self.out.rglob(".*"))
        yield from (f"tmp/{path.name}" for path in (self.folder / "tmp").iterdir())
        for kind in ("started", "tasks", "failed"):
            yield from (f"chunks/{kind}/{path.name}" for path in (self.folder / "chunks" / kind).glob("*"))
        yield from (f"chunks/{path.name}" for path in (self.folder / "chunks").rglob(".part-*"))


def campaign(case: WorkCase, folder: Path, seed: int, rounds: int) -> Iterator[Round]:
    """Yield the rounds of a command."""
    inputs = folder / "inputs"
    case.prepare(inputs)
    alone = Round(case, inputs, folder / "alone")
    alone.folder.mkdir()
    expected, _ = alone.undisturbed("--workers", "1")
    timed = Round(case, inputs, folder / "timed")
    timed.folder.mkdir()
    again, took = timed.undisturbed("--workers", "2")
    if again != expected:
        timed.problems.append("two workers give another result than one")
    yield from (one for one in (alone, timed) if one.problems)
    for number in range(rounds):
        draw = random.Random(f"{seed} {case.name} {number}")
        one = Round(case, inputs, folder / f"round-{number}")
        one.folder.mkdir()
        for _ in range(draw.randint(MIN_FAULTS, MAX_FAULTS)):
            one.disturbed(draw.choice(list(FAULTS)), took * draw.random() ** 2, draw)
        one.end(expected)
        yield one


def main() -> None:
    """Run the campaign; exit code 1 where there is a problem."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--only", metavar="NAME", action="append", help="commands whose name begins so")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="of each command")
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args()
    # A shell ignores it for what runs in the background, and so would the commands.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    told: dict[str, Any] = {}
    for case in CASES:
        if options.only and not case.name.startswith(tuple(options.only)):
            continue
        with tempfile.TemporaryDirectory(prefix="spallwatch-campaign-") as scratch:
            found = figures(list(campaign(case, Path(scratch), options.seed, options.rounds)))
        if options.json is not None and options.json.exists():
            told = json.loads(options.json.read_text())["commands"]
        told[case.name] = found
        print(case.name, json.dumps(told[case.name], indent=1), flush=True)
        write_json(options.json, {"seed": options.seed, "commands": told})
    shown = ("rounds", "faults", "lived_s")
    rows = [{"command": name, **{key: of[key] for key in shown}} for name, of in told.items()]
    print_table("commands", [row | {"problems": len(told[row["command"]]["problems"])} for row in rows])
    if any(of["problems"] for of in told.values()):
        raise SystemExit(1)


def figures(rounds: list[Round]) -> dict[str, Any]:
    """Return what is kept of a command: counts of faults that met it alive, its exit codes, and the problems."""
    came = [fault for one in rounds for fault in one.faults if fault["came"]]
    answers = Counter(f"{fault['fault']}: {fault['code']}" for fault in came)
    return {
        "rounds": sum(bool(one.faults) for one in rounds),
        "faults": len(came),
        "exit_codes": dict(sorted(answers.items())),
        "lived_s": max((fault["lived_s"] for fault in came), default=0.0),
        "problems": [f"{one.folder.name}: {problem}" for one in rounds for problem in one.problems],
    }


if __name__ == "__main__":
    main()

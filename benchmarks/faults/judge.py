"""One fault in one life, and what is said of it: fired, nothing lost, goes on in time or ends with a reason, told."""

from __future__ import annotations

import sqlite3
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.common import Row
from benchmarks.faults.cases import Case
from benchmarks.faults.life import START_S, Life, held, wrongs

GOES_ON_S = 5.0
"""Time from the end of a fault in which all traffic must pass again."""
WRONGS = ("lost", "doubled", "changed", "rejected")
DEAD = "does not start again"
_WHILE_S = 1.5
_GIVE_UP_S = 20.0
_NOT_FIRED_S = 6.0
_NOTICEABLE_S = 2.0
"""Delay from which on a fault must be told."""


class NotWellError(Exception):
    """A daemon without a fault does not start, or traffic does not pass."""


@dataclass
class Verdict:
    """What came of a case.

    Attributes:
        case: which.
        fired: calls that failed.
        where: file of the first of them.
        wrongs: what :func:`benchmarks.faults.life.wrongs` found more than before.
        goes_on_s: from the end of the fault until all traffic passed; None where it did not.
        exit_code: of a daemon or a command that ended; None where it did not.
        told: where the fault is told: "status", "log", "exit"; "" nowhere.
        noticed: whether it delayed or failed anything that the traffic did.
        problems: reasons why this is no right outcome.
        text: what was told.
    """

    case: Case
    fired: int = 0
    where: str = ""
    wrongs: dict[str, int] = field(default_factory=dict)
    goes_on_s: float | None = None
    exit_code: int | None = None
    told: str = ""
    noticed: bool = False
    problems: list[str] = field(default_factory=list)
    text: str = ""

    def row(self) -> Row:
        """Return a row of the table."""
        told = self.told or ("" if self.noticed else "absorbed")
        seconds = None if self.goes_on_s is None else round(self.goes_on_s, 2)
        counts = {"fired": self.fired, **{name: self.wrongs.get(name, 0) for name in WRONGS}}
        ended = {"goes_on_s": seconds, "exit": self.exit_code, "told": told, "wrong": "; ".join(self.problems)}
        return {"case": self.case.name, "where": self.where, **counts, **ended, "text": self.text[:200]}


def judge(life: Life, case: Case, goes_on_s: float = GOES_ON_S) -> Verdict:
    """Let a fault happen in a life and judge what comes of it; afterwards a daemon runs, and all traffic passes."""
    verdict = Verdict(case)
    kinds = {"steady": _steady, "start": _start, "stop": _stop}
    try:
        kinds.get(case.when, _command)(life, verdict, goes_on_s)
    finally:
        life.shim.disarm()
    went_on = case.when in ("steady", "start") and verdict.goes_on_s is not None
    if life.daemon.poll() is not None or not (went_on or life.wait_well(_GIVE_UP_S)):
        try:
            _restart(life)
        except NotWellError as error:
            verdict.problems += [DEAD, str(error)]
    try:
        found = wrongs(life)
    except sqlite3.Error as error:
        verdict.problems.append(f"the store cannot be read: {error}")
    else:
        verdict.wrongs = {name: count - life.known_wrongs.get(name, 0) for name, count in found.items()}
        life.known_wrongs = found
        verdict.problems += [f"{count} {name}" for name, count in verdict.wrongs.items() if count]
    verdict.text = verdict.text.replace(f"{life.folder}/", "")
    return verdict


def _restart(life: Life) -> None:
    life.shim.disarm()
    if life.daemon.poll() is None:
        life.kill()
    life.start()
    if not life.wait_well():
        raise NotWellError(f"{life.config}: the daemon does not start again: {life.log_after(0)[-5:]}")


def _steady(life: Life, verdict: Verdict, goes_on_s: float) -> None:
    size = life.log_size()
    for each in life.traffic.values():
        each.clear()
    before = _lost(life)
    life.shim.arm(verdict.case.plan)
    _watch(life, verdict, size, goes_on_s, before)


def _watch(life: Life, verdict: Verdict, size: int, goes_on_s: float, lost: int = 0) -> None:
    """Follow the fault to its end, and the life until all traffic passes or the daemon ends.

    ``lost``: connections that had broken off before.
    """
    plan, problems = verdict.case.plan, set[str]()
    starts, began = verdict.case.when == "start", time.monotonic()
    give_up = began + (START_S if starts else _NOT_FIRED_S)
    while not life.shim.fired and time.monotonic() < give_up and life.daemon.poll() is None:
        if starts and all(each.done_after(began) is not None for each in life.traffic.values()):
            break
        time.sleep(0.005)
    if plan.calls is None:
        until = time.monotonic() + _WHILE_S
        while life.shim.fired and time.monotonic() < until and life.daemon.poll() is None:
            problems |= _problems(life)
            time.sleep(0.05)
    life.shim.disarm()
    verdict.fired, verdict.where, ended = life.shim.fired, life.shim.where, time.monotonic()
    if not verdict.fired:
        return
    while time.monotonic() < ended + (START_S if starts else _GIVE_UP_S) and life.daemon.poll() is None:
        problems |= _problems(life)
        done = [each.done_after(ended) for each in life.traffic.values()]
        if None not in done:
            verdict.goes_on_s = max(moment for moment in done if moment is not None) - ended
            break
        time.sleep(0.03)
    problems |= _problems(life)
    told = [line for line in life.log_after(size) if " WARNING " in line or " ERROR " in line]
    # Nothing passes before a start has ended, with a fault or without.
    verdict.noticed = not starts and any(
        each.failures() or each.longest() > _NOTICEABLE_S for each in life.traffic.values()
    )
    if life.daemon.poll() is not None:
        _judge_end(life, verdict, size)
    elif verdict.goes_on_s is None or verdict.goes_on_s > goes_on_s:
        stuck = [name for name, each in life.traffic.items() if each.done_after(ended) is None]
        verdict.problems.append(f"stuck: {', '.join(stuck)}" if stuck else "late")
    if not verdict.told and (problems or told):
        verdict.told = "status" if problems else "log"
        verdict.text = next(iter(sorted(problems)), told[0] if told else "")
    _judge_told(life, verdict, lost)


def _problems(life: Life) -> set[str]:
    status = life.status()
    if status.get("pid") != life.daemon.pid:
        return set()
    return {f"{name}: {problem}" for name, problem in status.get("problems", {}).items()}


def _lost(life: Life) -> int:
    """Return how many connections broke off, as /metrics counts them for the page and all that listens."""
    lines = life.reader.metrics().splitlines()
    return sum(int(float(line.split()[-1])) for line in lines if "_refused_total{" in line and 'cause="lost"' in line)


def _judge_told(life: Life, verdict: Verdict, lost: int) -> None:
    """What was noticed has to be told; a connection that broke off is, where it is counted."""
    if not verdict.noticed or verdict.told:
        return
    if _wait_for_lost(life, lost):
        verdict.told, verdict.text = "status", "a connection broke off: counted in /metrics"
    else:
        verdict.problems.append("not told")


def _wait_for_lost(life: Life, before: int) -> bool:
    until = time.monotonic() + GOES_ON_S
    while _lost(life) <= before and time.monotonic() < until:
        time.sleep(0.1)
    return _lost(life) > before


def _judge_end(life: Life, verdict: Verdict, size: int) -> None:
    """A daemon that ends does so with code 1 and a reason, and starts again whole."""
    verdict.exit_code = life.daemon.poll()
    lines = life.log_after(size)
    reasons = [line for line in lines if line.startswith("spallwatch:")]
    if reasons:
        verdict.told, verdict.text = "exit", reasons[-1]
    else:
        verdict.problems.append("ended without a reason")
    if verdict.exit_code != 1:
        verdict.problems.append(f"ended with {verdict.exit_code}")


def _start(life: Life, verdict: Verdict, goes_on_s: float) -> None:
    life.kill()
    size = life.log_size()
    for each in life.traffic.values():
        each.clear()
    life.shim.arm(verdict.case.plan)
    began = time.monotonic()
    life.start()
    _watch(life, verdict, size, goes_on_s + START_S)
    if verdict.goes_on_s is not None:
        verdict.goes_on_s = time.monotonic() - began


def _stop(life: Life, verdict: Verdict, _goes_on_s: float) -> None:
    size = life.log_size()
    life.shim.arm(verdict.case.plan)
    code = life.stop()
    life.shim.disarm()
    verdict.fired, verdict.where, verdict.exit_code = life.shim.fired, life.shim.where, code
    if not verdict.fired:
        return
    lines = life.log_after(size)
    said = [line for line in lines if " WARNING " in line or " ERROR " in line or line.startswith("spallwatch:")]
    verdict.told, verdict.text = ("log", said[-1]) if said else ("", "")
    if code not in (0, 1):
        verdict.problems.append("had to be killed" if code is None else f"ended with {code}")
    elif code == 1 and not said:
        verdict.problems.append("ended without a reason")
    began = time.monotonic()
    life.start()
    if life.wait_well():
        verdict.goes_on_s = time.monotonic() - began
    else:
        verdict.problems.append(DEAD)


def _command(life: Life, verdict: Verdict, _goes_on_s: float) -> None:
    """Run a command with the fault, then without: what it answers is true, and what it made is whole."""
    when = verdict.case.when
    backups = life.folder / "backups"
    if when == "restore" and not backups.exists():
        life.call("backup", "--config", str(life.config), str(backups))
    words = {
        "backup": ("backup", "--config", str(life.config), str(backups)),
        "restore": ("restore", "--config", str(life.other), "--replace", str(backups)),
        "archive-days": (
            *("archive-days", "--config", str(life.config), "--before", "2030-01-01"),
            *("--to", str(life.folder / "moved")),
        ),
    }[when]
    life.shim.arm(verdict.case.plan)
    first = life.call(*words)
    life.shim.disarm()
    verdict.fired, verdict.where, verdict.exit_code = life.shim.fired, life.shim.where, first.returncode
    if not verdict.fired:
        return
    began = time.monotonic()
    again = life.call(*words)
    verdict.goes_on_s = time.monotonic() - began
    verdict.problems += _command_problems(first, again)
    if first.returncode:
        verdict.noticed, verdict.told = True, "exit"
        verdict.text = (first.stderr.strip().splitlines() or [""])[0]
    verdict.problems += _copy_problems(life, backups if when == "backup" else None, restored=when == "restore")


def _command_problems(first: subprocess.CompletedProcess[str], again: subprocess.CompletedProcess[str]) -> list[str]:
    found: list[str] = []
    if first.returncode and not first.stderr.strip():
        found.append("failed without a reason")
    if "Traceback" in first.stderr:
        found.append("a traceback")
    if first.returncode not in (0, 1):
        found.append(f"ended with {first.returncode}")
    if again.returncode:
        found.append(f"again: {again.stderr.strip()[-200:]}")
    return found


def _copy_problems(life: Life, backups: Path | None, *, restored: bool) -> list[str]:
    """Compare what a command wrote with the store: every block that a copy has is that of the store."""
    made = () if backups is None else backups.glob("*/state.db")
    stores = [path for path in made if not path.parent.name.startswith(".")]
    if restored:
        stores.append(life.folder / "other-state" / "state.db")
    truth, found = held(life.store), list[str]()
    for store in stores:
        try:
            copy = held(store)
        except sqlite3.Error as error:
            found.append(f"{store.parent.name}: {error}")
            continue
        if not copy or any(truth.get(key) != content for key, content in copy.items()):
            found.append(f"{store.parent.name}: holds other blocks than the store")
    return found

"""The walk over a record: crash states are built, those of new content opened, and all are counted."""

from __future__ import annotations

import multiprocessing
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from benchmarks.crash.history import MODELS, History, Model, final_difference
from benchmarks.crash.life import Places
from benchmarks.crash.promise import Judge, Promised, Truth
from benchmarks.crash.recorder import Entry, compile_recorder, read_record, recording

SEED = 20261127
_MAX_SHOWN = 40
_ROUND_STATES = 800


@dataclass(frozen=True)
class Recorded:
    """A life that was lived: its places and its record."""

    places: Places
    entries: Sequence[Entry]
    truth: Truth


@dataclass
class Found:
    """What was counted.

    Attributes:
        built: number of states.
        seen: (call, kind of its file) and (model, loss) of each state of another content, by its digest.
        broken: (number of the entry, model, loss, call, promise) of each that is broken.
    """

    built: int = 0
    salvaged: int = 0
    republished: int = 0
    seen: dict[bytes, tuple[tuple[str, str], tuple[str, str]]] = field(
        default_factory=dict[bytes, tuple[tuple[str, str], tuple[str, str]]]
    )
    broken: list[tuple[int, str, str, str, str]] = field(default_factory=list[tuple[int, str, str, str, str]])

    @property
    def distinct(self) -> int:
        """Number of states of different content; all of them were opened."""
        return len(self.seen)

    def add(self, other: Found) -> None:
        """Add what another worker found."""
        self.built, self.salvaged = self.built + other.built, self.salvaged + other.salvaged
        self.republished += other.republished
        self.seen = other.seen | self.seen
        self.broken = sorted([*self.broken, *other.broken])


class LifeError(Exception):
    """The life failed, or its record is not complete."""


def record_life(base: Path) -> Recorded:
    """Live a life below a folder under the recorder.

    Raises:
        LifeError: it failed, or calls were not seen: the record does not lead to the files that are there.
    """
    places = Places(base)
    places.root.mkdir(parents=True)
    environment = recording(compile_recorder(base), places.root, base / "record")
    command = [sys.executable, "-m", "benchmarks.crash.life", str(base)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise LifeError(f"the life failed: {done.stderr[-2000:]}")
    life = read_life(base)
    history = History(places.root, "weakest")
    for entry in life.entries:
        if entry.call != "mark":
            history.add(entry)
    if differing := final_difference(places.root, history):
        raise LifeError(f"the record does not lead to the files that are there: {', '.join(differing)}")
    return life


def read_life(base: Path) -> Recorded:
    """Return a life that was recorded below a folder."""
    places, entries = Places(base), list(read_record(base / "record"))
    truth, history = Truth(entries), History(places.root, "weakest")
    for entry in entries:
        if entry.call == "mark":
            continue
        _, kind = history.add(entry)
        if entry.call == "rename" and kind == "published" and entry.paths[1].endswith(".nc"):
            name = Path(entry.paths[1])
            truth.note_published(name.name, history.tree()[0][name.relative_to(places.root.resolve()).as_posix()])
    return Recorded(places, entries, truth)


def explore(
    life: Recorded,
    states: int,
    *,
    models: Sequence[Model] = MODELS,
    ignore_syncs: bool = False,
    seed: int = SEED,
    stop_at: int | None = None,
    share: tuple[int, int] = (0, 1),
    found: Found | None = None,
) -> Found:
    """Open crash states of a life until so many of different content were opened, or no call is left.

    Args:
        life: recorded.
        states: number of distinct states that are aimed at; calls are left out evenly where they are too many.
        models: of file systems.
        ignore_syncs: the control in which no call for durability has any effect.
        seed: of the subsets.
        stop_at: end after so many broken promises.
        share: number of this worker, and how many share the calls.
        found: what was found before; its states are not opened again.
    """
    found = found or Found()
    judge = Judge(replace(life.places, name=f"ro{share[0]:02d}"), life.truth)
    calls = sum(entry.call != "mark" for entry in life.entries)
    # Two states of a call are not drawn: that with all, and that with only what is durable.
    number = max(3, min(12, round(2.0 * states / (len(models) * calls)) + 2))
    chosen = min(1.0, 2.0 * states / (number * len(models) * calls))
    for history, after, entry, call, promised in _crashes(life, models, ignore_syncs=ignore_syncs):
        if after % share[1] != share[0]:
            continue
        rng = random.Random(f"{seed} {history.disk.model} {after}")
        # Names are rare among writes, and are all crossed.
        if rng.random() > (chosen if entry.call in ("write", "fsync", "fdatasync") else 3.0 * chosen):
            continue
        for state in history.states(after, call, number, rng):
            found.built += 1
            if state.digest in found.seen:
                continue
            found.seen[state.digest] = (call, (state.model, state.loss))
            for promise in judge.broken(state, promised):
                found.broken.append((after, state.model, state.loss, " ".join(call), promise))
        if stop_at is not None and len(found.broken) >= stop_at:
            break
    found.salvaged, found.republished = found.salvaged + judge.salvaged, found.republished + judge.republished
    shutil.rmtree(judge.places.root, ignore_errors=True)
    return found


def explore_shared(life: Recorded, states: int, workers: int, seconds: float) -> Found:
    """Explore a life by several processes until so many states are found, or so many seconds are over.

    They go over all calls in rounds, each with other calls and other losses.
    """
    found, until = Found(), time.monotonic() + seconds
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("fork")) as pool:
        for part in pool.map(partial(_rounds, life, states, workers, until), range(workers)):
            found.add(part)
    return found


def _rounds(life: Recorded, states: int, workers: int, until: float, worker: int) -> Found:
    found, number = Found(), 0
    while found.distinct < states / workers and time.monotonic() < until:
        explore(life, _ROUND_STATES, seed=SEED + number, share=(worker, workers), found=found)
        number += 1
    return found


def _crashes(
    life: Recorded, models: Sequence[Model], *, ignore_syncs: bool
) -> Iterator[tuple[History, int, Entry, tuple[str, str], Promised]]:
    """Yield a history behind each call, by model in turns, and what is promised there."""
    histories = [History(life.places.root, model, ignore_syncs=ignore_syncs) for model in models]
    promised = Promised()
    for after, entry in enumerate(life.entries):
        if entry.call == "mark":
            promised = promised.after(entry)
            continue
        for history in histories:
            yield history, after, entry, history.add(entry), promised


def shown(found: Found) -> Iterator[str]:
    """Yield the broken promises, each kind once, with the number of its states."""
    kinds = Counter((model, promise.split(":")[0]) for _, model, _, _, promise in found.broken)
    for (model, promise), times in kinds.most_common(_MAX_SHOWN):
        first = next(item for item in found.broken if (item[1], item[4].split(":")[0]) == (model, promise))
        yield f"{times} times, {model}: after call {first[0]} ({first[3]}), {first[2]} lost: {first[4]}"

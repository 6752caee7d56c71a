"""Retention: condenses old blocks, thins spectra, shortens the store, and keeps to the quota, in short steps.

All of it runs in the thread that commits, between blocks: a step is a transaction of some hundredths of a second, so
that a kill leaves whole blocks, and the next start goes on where it ended.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from monitor.config.machine import RetentionSection
from monitor.records.compact import reusable_bytes, settle_log, shorten, stored_bytes
from monitor.records.condense import condense
from monitor.records.events import EventLog
from monitor.records.failures import Failures, StoreError
from monitor.records.quota import HEADROOM, give_up, given_up
from monitor.records.recover.loss import damage_in_use
from monitor.records.spectra import thin_spectra
from monitor.records.store import Store
from monitor.service.publisher import PublishedFiles
from monitor.words.events import utc_text

_LOG = logging.getLogger(__name__)
_DAY_S = 86400.0
MIN_FULL_S = _DAY_S
"""Record time whose full records stay even where space is short."""
_STEP_S = 0.05
_MIN_BLOCKS, _MAX_BLOCKS = 8, 512
_MIN_PAGES, _MAX_PAGES = 16, 1024
_BUSY_SHARE, _IDLE_SHARE = 20.0, 2.0
"""Least ratio of the pause after a step to its duration, while blocks come and while none does."""
_MIN_PAUSE_S, _MAX_PAUSE_S = 0.02, 5.0
_RETRY_S = 1.0
_SPECTRA_S = 3600.0
_MEASURE_S = 60.0
_NOTICE_S = _DAY_S
_GIVING_UP = (
    "store and published files reach max_gb = {:g}: waveforms, raw spectra, then full records older than a day leave "
    "the store"
)


class Retention:
    """Keeps the store of a machine within its limits; a failure is a :attr:`problem`, and only damage is raised."""

    def __init__(
        self,
        section: RetentionSection,
        store: Store,
        log: EventLog,
        *,
        monotonic: Callable[[], float] = time.monotonic,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Keep a store that is open for writing in this thread, and its event log."""
        self._section, self._store, self._log = section, store, log
        self._monotonic, self._clock = monotonic, clock
        self._due = self._spectra_due = self._measure_due = float("-inf")
        self._blocks, self._pages = 64, 64
        self._limit = None if section.max_gb is None else round(section.max_gb * 1e9)
        self._used: int | None = None
        self._over = self._exhausted = self._published = False
        self._noticed: dict[str, float] = {}
        self._lost: set[str] = set()
        self._news = False
        damage = partial(damage_in_use, store.path)
        self.failures = Failures("retention fails", "retention works again", damage, clock)
        self.problem: str | None = None
        """Why a limit is not kept, or None."""

    def take_news(self) -> bool:
        """Return whether a notice was added since the last call."""
        news, self._news = self._news, False
        return news

    @property
    def to_delete(self) -> int:
        """Bytes of published days to delete: where the configuration allows it and the store can give no more."""
        if self._used is None or self._limit is None or not self._section.delete_published:
            return 0
        return self._used - _soft(self._limit) if self._over and self._exhausted and self._published else 0

    def values(self) -> dict[str, Any] | None:
        """Return use, quota and what gave way for it, as plain values for JSON; None without a quota."""
        if self._limit is None:
            return None
        try:
            gone = given_up(self._store)
        except StoreError:
            # It is among the problems already.
            gone = {}
        return {
            "used_gb": None if self._used is None else round(self._used / 1e9, 6),
            "max_gb": self._section.max_gb,
            "given_up": {
                kind: {"since_utc": utc_text(found.since), "latest_utc": utc_text(found.latest)}
                for kind, found in gone.items()
            },
        }

    def reusable_bytes(self) -> int:
        """Return the bytes inside the store that new blocks can take, where it cannot be shortened."""
        return reusable_bytes(self._store)

    def tick(self, files: PublishedFiles, *, idle: bool, disk: str | None) -> None:
        """Do one step if it is due.

        Args:
            files: state of the published files.
            idle: whether no block is waiting.
            disk: what is short on the disk of the state, or None.

        Raises:
            StoreDamagedError: the store is damaged.
        """
        began = self._monotonic()
        if began < self._due:
            return
        try:
            busy = self._step(files, disk)
            self.problem = self._cap_problem()
            self.failures.end()
        except StoreError as error:
            busy = False
            self.failures.note(error)
            self.problem = self.failures.problem
        spent = self._monotonic() - began
        share = _IDLE_SHARE if idle else _BUSY_SHARE
        pause = _MAX_PAUSE_S if self.failures.problem is None else _RETRY_S
        self._due = self._monotonic() + (max(_MIN_PAUSE_S, share * spent) if busy else pause)

    def _step(self, files: PublishedFiles, disk: str | None) -> bool:
        """Do one step; return whether there may be more to do."""
        self._measure(files)
        self._note(files, disk)
        full_s = None if self._section.full_days is None else self._section.full_days * _DAY_S
        short = disk is not None
        if short:
            full_s = MIN_FULL_S if full_s is None else min(full_s, MIN_FULL_S)
        done = self._shorten()
        if not done and full_s is not None and files.complete:
            done = self._condense(full_s, by_number=short)
        if not done:
            done = self._thin(short=short)
        if not done and self._over:
            done = self._give_up(files)
        self._exhausted, self._published = not done, files.complete
        return done > 0

    def _give_up(self, files: PublishedFiles) -> int:
        began = time.monotonic()
        kind = give_up(self._store, MIN_FULL_S, self._blocks, self._clock(), published=files.complete)
        if kind == "records":
            self._blocks = _adapted(self._blocks, time.monotonic() - began, _MIN_BLOCKS, _MAX_BLOCKS)
        return kind is not None

    def _condense(self, full_s: float, *, by_number: bool) -> int:
        began = time.monotonic()
        done = condense(self._store, full_s, self._blocks, by_number=by_number)
        if done:
            self._blocks = _adapted(self._blocks, time.monotonic() - began, _MIN_BLOCKS, _MAX_BLOCKS)
        return done

    def _shorten(self) -> int:
        began = time.monotonic()
        done = shorten(self._store, self._pages)
        if done:
            self._pages = _adapted(self._pages, time.monotonic() - began, _MIN_PAGES, _MAX_PAGES)
        return done

    def _thin(self, *, short: bool) -> int:
        days = self._section.spectra_days
        spectra_s = None if days is None else days * _DAY_S
        if short:
            spectra_s = MIN_FULL_S if spectra_s is None else min(spectra_s, MIN_FULL_S)
        if spectra_s is None or self._monotonic() < self._spectra_due:
            return 0
        done = thin_spectra(self._store, spectra_s)
        if not done:
            self._spectra_due = self._monotonic() + _SPECTRA_S
        return done

    def _measure(self, files: PublishedFiles) -> None:
        """Compare the size of store and files with the quota, once a minute and after each step beyond it."""
        if self._limit is None or (not self._over and self._monotonic() < self._measure_due):
            return
        self._measure_due = self._monotonic() + _MEASURE_S
        self._used = stored_bytes(self._store) + files.size
        if self._used > _soft(self._limit):
            settle_log(self._store)
            self._used = stored_bytes(self._store) + files.size
        self._over = self._used > _soft(self._limit)

    def _cap_problem(self) -> str | None:
        """Return why the quota is not kept, where nothing is left that may give way."""
        if self._used is None or self._limit is None or self._used <= self._limit or not self._exhausted:
            return None
        more = "the oldest days can be moved with: spallwatch archive-days"
        if self._section.delete_published:
            more = "the rest is needed for states, counts, forecasts and the newest day; set a greater one"
        return f"store and published files take {self._used / 1e9:.3g} GB, max_gb is {self._section.max_gb:g}; {more}"

    def _note(self, files: PublishedFiles, disk: str | None) -> None:
        """Add notices: each at most once a day, each lost file once."""
        if disk is not None:
            self._notice("disk_low", f"{disk}; full records older than a day leave the store, they are in the files")
        if self._over:
            self._notice("size_cap", self._cap_problem() or _GIVING_UP.format(self._section.max_gb))
        lost = set(files.missing) - self._lost
        if lost:
            self._lost |= lost
            names = ", ".join(sorted(lost)[:5]) + (f" and {len(lost) - 5} more" if len(lost) > 5 else "")
            self._add("published_missing", f"{names}: not in the folder, and the store has the full records no more")

    def _notice(self, kind: str, text: str) -> None:
        now = self._monotonic()
        if now - self._noticed.get(kind, float("-inf")) >= _NOTICE_S:
            self._noticed[kind] = now
            self._add(kind, text)

    def _add(self, kind: str, text: str) -> None:
        _LOG.warning("%s", text)
        self._log.notice(self._clock(), {"kind": kind, "channel": None, "severity": "alert", "text": text})
        self._news = True


def _soft(limit: int) -> int:
    """Return the bytes beyond which something gives way."""
    return round(limit * (1.0 - HEADROOM))


def _adapted(size: int, spent: float, least: int, most: int) -> int:
    """Return the size of the next step, so that it takes about ``_STEP_S``."""
    if spent > _STEP_S:
        return max(least, size // 2)
    return min(most, 2 * size) if spent < _STEP_S / 2.0 else size

"""Retention: condenses old blocks, thins spectra, shortens the store, and keeps to the size cap, in short steps.

All of it runs in the thread that commits, between blocks: a step is a transaction of some hundredths of a second, so
that a kill leaves whole blocks, and the next start goes on where it ended.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial

from monitor.config.machine import RetentionSection
from monitor.records.compact import reusable_bytes, shorten, stored_bytes
from monitor.records.condense import condense
from monitor.records.events import EventLog
from monitor.records.failures import Failures, StoreError
from monitor.records.recover.loss import damage_in_use
from monitor.records.spectra import thin_spectra
from monitor.records.store import Store
from monitor.service.publisher import PublishedFiles

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
        self._over: int | None = None
        self._exhausted = False
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
        if self._over is None or self._section.max_gb is None or not self._section.delete_published:
            return 0
        return self._over - round(self._section.max_gb * 1e9) if self._exhausted else 0

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
        short = disk is not None or self._over is not None
        if short:
            full_s = MIN_FULL_S if full_s is None else min(full_s, MIN_FULL_S)
        done = self._shorten()
        if not done and full_s is not None and files.complete:
            done = self._condense(full_s, by_number=short)
        if not done:
            done = self._thin(short=short)
        self._exhausted = not done
        return done > 0

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
        """Compare the size of store and files with the cap, once a minute."""
        if self._section.max_gb is None or self._monotonic() < self._measure_due:
            return
        self._measure_due = self._monotonic() + _MEASURE_S
        total = stored_bytes(self._store) + files.size
        self._over = total if total > self._section.max_gb * 1e9 else None

    def _cap_problem(self) -> str | None:
        if self._over is None:
            return None
        return (
            f"store and published files take {self._over / 1e9:.3g} GB, max_gb is {self._section.max_gb:g}; the oldest "
            "days can be moved with: spallwatch archive-days"
        )

    def _note(self, files: PublishedFiles, disk: str | None) -> None:
        """Add notices: each at most once a day, each lost file once."""
        if disk is not None:
            self._notice("disk_low", f"{disk}; full records older than a day leave the store, they are in the files")
        if self._over is not None:
            self._notice("size_cap", self._cap_problem() or "")
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


def _adapted(size: int, spent: float, least: int, most: int) -> int:
    """Return the size of the next step, so that it takes about ``_STEP_S``."""
    if spent > _STEP_S:
        return max(least, size // 2)
    return min(most, 2 * size) if spent < _STEP_S / 2.0 else size

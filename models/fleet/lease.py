"""A lease: one process at a time writes what is below a URL of an object storage, which knows no locks.

A small object names the holder, who renews it. One that was not renewed for ``STALE_S`` may be taken over, by the clock
of the server, or by watching it for as long. A holder that stood still for longer finds out before it writes.

Such an object is read with a tag, and written only where it is still as it was read: on S3 by conditional requests
(``If-None-Match``, ``If-Match``). Where a server ignores or lacks them, and on other kinds, it is compared before it is
written and read again afterwards: two writers at the same moment can then both believe that they were alone.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Never

from models.fleet.object_store import KeptObject, ObjectStore
from models.words.errors import SpallwatchError, WrongInputError
from models.work.errors import ObjectStorageError

PAUSES_S = (0.1, 0.3, 1.0)
"""Before a conditional request is repeated that S3 refused because of another one (409), s."""


def write_unchanged(store: ObjectStore, name: str, data: bytes, tag: str | None) -> str | None:
    """Write an object as ``write_kept``, again where it was refused although it is as it was; return the new tag.

    None where another one is there.

    Raises:
        ObjectStorageError: a request fails, or each one is refused.
    """
    for pause in (*PAUSES_S, None):
        written = store.write_kept(name, data, tag)
        if written is not None:
            return written
        found = store.read_kept(name)
        if (None if found is None else found.tag) != tag:
            return None
        if pause is not None:
            time.sleep(pause)
    raise ObjectStorageError(f"{store.url}/{name} cannot be written: refused each time, though it is as it was")


LEASE_NAME = "lease.json"
RENEW_S = 10.0
STALE_S = 60.0
_POLL_S = 2.0
_END_S = 5.0
"""Time that is waited for a renewal under way; a lease that is not removed becomes stale."""


class LeaseHeldError(WrongInputError):
    """Another process writes there; the message names it."""


class LeaseLostError(SpallwatchError):
    """Another process has taken over; the message names it. Nothing more may be written."""


@dataclass(frozen=True)
class Holder:
    """Who holds a lease.

    Attributes:
        token: identity, as process numbers and host names are used again.
        host, pid: of the process.
        since, renewed: UTC by its own clock, for people.
        renewals: their number, by which each object is unlike those before.
    """

    token: str
    host: str = "an unknown host"
    pid: int = 0
    since: str = "an unknown time"
    renewed: str = ""
    renewals: int = 0

    @classmethod
    def of(cls, data: bytes) -> Holder:
        """Return the holder in an object; one that is unknown where it cannot be read."""
        try:
            return cls(**json.loads(data))
        except (ValueError, TypeError):
            return cls("")

    def to_json(self) -> bytes:
        """Return the content of the object."""
        return json.dumps(asdict(self), indent=1).encode()

    def __str__(self) -> str:
        """Name it for people."""
        return f"process {self.pid} on {self.host}, since {self.since}"


@dataclass(frozen=True)
class Times:
    """Times of a lease, s: between renewals, until one that is not renewed is stale, between two looks at another's."""

    renew_s: float = RENEW_S
    stale_s: float = STALE_S
    poll_s: float = _POLL_S


_TIMES = Times()


class Lease:
    """A lease that this process holds.

    Attributes:
        token: identity of the holder.
    """

    def __init__(self, store: ObjectStore, holder: Holder, times: Times) -> None:
        """Renew it in the background from now on; it was written already."""
        self.token = holder.token
        self._store, self._holder, self._times = store, holder, times
        self._lost: str | None = None
        self._unsure = False
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._loop, name="lease", daemon=True)
        self._thread.start()

    def check(self) -> None:
        """Raise LeaseLostError where it is known that another process has taken over; nothing is asked."""
        if self._lost is not None:
            raise LeaseLostError(self._lost)

    def confirm(self) -> None:
        """Renew it now.

        Raises:
            LeaseLostError: another process has taken over.
            ObjectStorageError: that is not known.
        """
        with self._lock:
            self.check()
            found = self._store.read_kept(LEASE_NAME)
            if found is None or Holder.of(found.data).token != self.token:
                self._lose(found)
            self._holder = replace(self._holder, renewed=_now(), renewals=self._holder.renewals + 1)
            if write_unchanged(self._store, LEASE_NAME, self._holder.to_json(), found.tag) is None:
                self._lose(self._store.read_kept(LEASE_NAME))

    def close(self) -> None:
        """Remove it, unless another process has taken over or the storage does not answer."""
        self._ended.set()
        self._thread.join(_END_S)
        if self._thread.is_alive() or self._unsure or self._lost is not None:
            return
        with suppress(ObjectStorageError):
            found = self._store.read_kept(LEASE_NAME)
            if found is not None and Holder.of(found.data).token == self.token:
                self._store.delete_kept(LEASE_NAME, found.tag)

    def _lose(self, found: KeptObject | None) -> Never:
        by = "was deleted" if found is None else f"is held by {Holder.of(found.data)}"
        self._lost = (
            f"{self._store.url}: {LEASE_NAME} {by}: this command did not renew it for {self._times.stale_s:.0f} s or "
            "more; it ends, and writes nothing more there"
        )
        raise LeaseLostError(self._lost)

    def _loop(self) -> None:
        while not self._ended.wait(self._times.renew_s):
            try:
                self.confirm()
                self._unsure = False
            except LeaseLostError:
                return
            except ObjectStorageError:
                # Whoever writes asks again.
                self._unsure = True


@contextmanager
def leased(store: ObjectStore, tell: Callable[[str], None], times: Times = _TIMES) -> Generator[Lease]:
    """Hold the lease of a store while the block runs.

    One that was left by a process that was killed is waited for until it is stale. ``tell`` is called with a line for
    people before that.

    Raises:
        LeaseHeldError: another process holds it, and was seen to renew it.
        ObjectStorageError: a request fails.
    """
    now = _now()
    holder = Holder(secrets.token_hex(8), socket.gethostname(), os.getpid(), now, now)
    _acquire(store, holder, times, tell)
    lease = Lease(store, holder, times)
    try:
        yield lease
    finally:
        lease.close()


def _acquire(store: ObjectStore, holder: Holder, times: Times, tell: Callable[[str], None]) -> None:
    seen: KeptObject | None = None
    since = time.monotonic()
    while True:
        found = store.read_kept(LEASE_NAME)
        if found is None or _is_stale(found, seen, time.monotonic() - since, times.stale_s):
            if store.write_kept(LEASE_NAME, holder.to_json(), None if found is None else found.tag) is not None:
                return
        elif seen is None:
            seen, since = found, time.monotonic()
            left = times.stale_s - max(found.age_s or 0.0, 0.0)
            tell(f"{store.url}: held by {Holder.of(found.data)}; waiting up to {left:.0f} s to see whether it is alive")
        elif found.tag != seen.tag:
            raise LeaseHeldError(f"{store.url}: is being written by {Holder.of(found.data)}")
        time.sleep(times.poll_s)


def _is_stale(found: KeptObject, seen: KeptObject | None, watched_s: float, stale_s: float) -> bool:
    """Return whether a lease has not been renewed for so long, by the server or as it was watched."""
    if found.age_s is not None and found.age_s > stale_s:
        return True
    return seen is not None and seen.tag == found.tag and watched_s > stale_s


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")

"""The order of day, month and year in the dates of a source, told by all its files."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from models.words.errors import SpallwatchError
from streams.dates.dating import Dating
from streams.types.listing import printable
from streams.types.spec import SourceSpec
from streams.types.stamps import ORDERS, Order, Stamp

_MAX_AHEAD_S = 366 * 86400.0
"""By how much a clock may be ahead of the present, before an order of the date is ruled out."""
Evidence = dict[frozenset[Order], str]
"""Orders that are left by a stamp, with the path and text of the first that leaves these."""


def evidence(stamps: Iterable[tuple[str, Stamp]], now: float) -> Evidence:
    """Return what stamps say of the order; ``now`` in s since 1970 UTC: none is of a year after."""
    found: Evidence = {}
    for path, stamp in stamps:
        past: list[Order] = [order for order in stamp.orders if (stamp.at(order) or 0.0) < now + _MAX_AHEAD_S]
        if stamp.open:
            found.setdefault(frozenset(past or stamp.orders), f"{path} ({stamp.text!r})")
    return found


def orders_left(found: Evidence) -> tuple[frozenset[Order], list[str]]:
    """Return the orders that all evidence leaves, and what leaves out the others; no orders where it disagrees."""
    left, by = frozenset(ORDERS), list[str]()
    for orders, path in sorted(found.items(), key=lambda pair: len(pair[0])):
        if not left <= orders:
            left, by = left & orders, [*by, path]
    return left, by


class UndatedError(SpallwatchError):
    """The date of a file cannot be told yet; it waits, and the message says for what."""

    def __init__(self, reason: str) -> None:
        """Take the reason, which may hold names that are no UTF-8."""
        super().__init__(printable(reason))


class DateOrder:
    """Resolves the stamps of one source, whose files decide the order, wait for it, or contradict it."""

    def __init__(
        self,
        spec: SourceSpec,
        choice: Callable[[], Dating],
        keep: Callable[[Dating], None],
        names: Callable[[], Iterable[str]],
        stamp_of: Callable[[str], Stamp | None],
    ) -> None:
        """Begin without evidence.

        Args:
            choice, keep: give and store what dates the source.
            names: gives the paths of the files that are known, ``stamp_of`` the stamp in one of them.
        """
        self._spec, self._choice, self._keep, self._names, self._stamp_of = spec, choice, keep, names, stamp_of
        self._conflicts: dict[str, str] = {}
        self._open: set[str] = set()
        self._scanned: set[str] = set()
        self._evidence: Evidence = {}

    @property
    def conflicts(self) -> tuple[str, ...]:
        """The files that contradict the order."""
        return tuple(self._conflicts)

    def forget(self, path: str) -> bool:
        """Forget what a file that is gone or rejected stated; return whether others waited for it."""
        waited = path in self._open or path in self._conflicts
        self._open.discard(path)
        self._conflicts.pop(path, None)
        return waited

    def resolve(self, stamp: Stamp, path: str) -> float:
        """Return the time of a stamp by the order over all files.

        Raises:
            UndatedError: the order is not decided, or files disagree.
        """
        self._conflicts.pop(path, None)
        if stamp.open and self._choice().order is None:
            self._decide(stamp, path)
        order = self._choice().order
        if not stamp.open or (order is None and stamp.fixed is not None):
            self.wait_for_open(path)
            return stamp.fixed or 0.0
        if order is None:
            self._open.add(path)
            raise UndatedError(
                f"{path}: {stamp.text!r} is {stamp.ways}, and no file decides which; "
                + self._remedy(" or ".join(stamp.orders))
            )
        found = stamp.at(order)
        if found is None:
            self._conflicts[path] = stamp.text
            raise UndatedError(
                f"{path}: {stamp.text!r} cannot be {order.replace('_', ' ')}, as {self._choice().decided_by} has it; "
                + self._remedy(stamp.orders[0])
            )
        if self._conflicts and stamp.fixed is None and self._choice().decided_by != "configuration":
            other, text = next(iter(self._conflicts.items()))
            raise UndatedError(f"{path}: waits while {other} ({text!r}) and {self._choice().decided_by} disagree")
        return found

    def wait_for_open(self, path: str) -> None:
        """Raise UndatedError while other files wait for the order: this one may come after them."""
        if self._choice().order is None and self._open - {path}:
            raise UndatedError(f"{path}: waits for {min(self._open)}, until a file tells day and month apart")

    def _decide(self, stamp: Stamp, path: str) -> None:
        stamps = [(path, stamp)]
        if self._choice().by == "name":
            names = set(self._names())
            if not names >= self._scanned:
                # What removed files stated counts no more.
                self._scanned, self._evidence = set(), {}
            new, self._scanned = sorted(names - self._scanned), names
            stamps += [(name, found) for name in new if (found := self._stamp_of(name)) is not None]
        self._evidence = evidence(stamps, time.time()) | self._evidence
        left, by = orders_left(self._evidence)
        if not left:
            raise UndatedError(f"{' and '.join(by)} disagree on the order of day and month; " + self._remedy("..."))
        if len(left) == 1:
            self._keep(replace(self._choice(), order=next(iter(left)), decided_by=" and ".join(by)))

    def _remedy(self, order: str) -> str:
        name = ' or time_name = "%d-%m-%Y_%H-%M-%S"' if self._choice().by == "name" else ""
        return (
            f"set [[source]] date_order = {order}{name}, and where blocks are dated already: "
            f"spallwatch redate {self._spec.name}"
        )

"""The base of the live sources of a network: a queue, and a receiver that is made again where it fails."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from models.platform.supervision import Restarts
from streams.link.arrivals import Arrivals, Ticket
from streams.link.refusals import LINK, SenderRefusals
from streams.types.source import Backlog, Delivery, Ledger, LiveSource
from streams.types.spec import NetworkSpec, SourceError, SourceSpec, parse_address

_LOG = logging.getLogger(__name__)


class Receiver(LiveSource):
    """A live source of the streams at one network address; base for TCP and MQTT."""

    def __init__(self, specs: Sequence[SourceSpec], network: NetworkSpec | None, form: str) -> None:
        """Take the sources that share an address; SourceError where it is not of this ``form``.

        ``network`` has limits and credentials; those of the first source by default.
        """
        self.name = ",".join(spec.name for spec in specs)
        self._where = f"[[source]] {self.name}: url"
        addresses = [parse_address(spec.url, self._where) for spec in specs]
        self._address = addresses[0]
        if any(replace(place, topic=self._address.topic) != self._address for place in addresses):
            raise ValueError(f"one receiver serves one address, got {addresses}")
        if self._address.scheme != form.partition(":")[0]:
            raise SourceError(f"{self._where} {specs[0].url!r}: expected {form}")
        self._network = network or specs[0].network or NetworkSpec()
        streams = {address.topic or spec.name: spec for address, spec in zip(addresses, specs, strict=True)}
        self._arrivals = Arrivals(streams, self._network.max_waiting)
        self._refusals = SenderRefusals(self.name)
        self._lock = threading.Lock()
        self._opened = False
        self._problem: str | None = None
        self._restarts = Restarts(f"the receiver of {self.name}")

    def check(self, *, taken: bool = False) -> None:
        """Raise SourceError where :meth:`open` would; ``taken``: another receiver has the address by right."""

    def open(self, ledger: Ledger) -> None:
        """Start receiving; SourceError as :meth:`_start`."""
        if self._opened:
            raise RuntimeError(f"source {self.name!r} is open already")
        self._arrivals.open(ledger)
        self._start()
        self._opened = True

    def next(self, timeout: float) -> Delivery | None:
        """Return the next delivery, or None after ``timeout`` seconds without one."""
        return self._arrivals.next(timeout)

    def acknowledge(self, delivery: Delivery) -> None:
        """Record a commit and acknowledge it to the sender."""
        self._confirm(self._arrivals.acknowledge(delivery))

    def queued_blocks(self) -> int | None:
        """Return how many blocks wait to be delivered; None where senders hold back more."""
        return self._arrivals.queued_blocks()

    def ready_blocks(self) -> int:
        """Return how many deliveries :meth:`next` gives at once."""
        return self._arrivals.ready

    def restarts(self) -> tuple[Restarts, ...]:
        """Return what is known of the failures of the receiver."""
        return (self._restarts,)

    def backlog(self) -> Backlog:
        """Return the counts of frames."""
        return replace(self._arrivals.backlog(), refused=self._refusals.count)

    def notices(self) -> list[dict[str, Any]]:
        """Return refusals for the event log; the same one is repeated after an hour at the earliest."""
        return self._refusals.take()

    def problem(self) -> str | None:
        """Return why nothing is received, or why the last message was refused."""
        return self._problem

    def close(self) -> None:
        """Stop receiving; closing twice does nothing."""
        self._arrivals.close()
        if self._opened:
            self._opened = False
            self._stop()

    def _start(self) -> None:
        """Receive in a thread of its own from now on."""
        raise NotImplementedError

    def _confirm(self, ticket: Ticket) -> None:
        """Send the acknowledgement of a commit."""
        raise NotImplementedError

    def _stop(self) -> None:
        """Disconnect and end the thread."""
        raise NotImplementedError

    def _refused(self, reason: str, kind: str = LINK, stream: str | None = None) -> None:
        self._problem = f"{self.name}: {reason}"
        self._refusals.add(reason, kind, self._arrivals.source(stream))

    def _fault(self, what: str, error: Exception) -> None:
        """Note an error of the program with one sender, whose connection alone ends."""
        _LOG.error("%s: %s", self.name, what, exc_info=error)
        self._refused(f"{what}: {type(error).__name__}: {error}")

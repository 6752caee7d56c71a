"""The workers of a cluster that take part in a run: asked when they come, refused by name where they cannot.

A worker that was refused, or that was not asked yet, gets no chunk, since it offers no memory for them.
"""

from __future__ import annotations

import operator
import pkgutil
import secrets
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any

from models.fleet.connect import ClusterError, RefusedWorkerError, check_addresses
from models.fleet.member import Membership, answer_name, differences, facts, join
from models.work.codec import name_of
from models.work.task import FileStore

JOIN_S = 600.0
"""Time for the first workers to come, s."""
ANSWER_S = 20.0
"""Time for the answers of workers that are there at the start, s."""
NOTICE_S = 3.0
"""Time after which missing workers are reported, s."""
SILENT_S = 30.0
"""Time without a heartbeat after which a worker does not take part until it answers, s. Dask sends one at least every
2 s with up to 200 workers, and gives up a worker without one after 300 s (``worker-ttl``)."""
PAUSED_S = 30.0
"""Time for which dask has paused a worker with no task at work, after which it does not take part until it goes on, s:
what fills its memory is not a chunk that will end."""
_POLL_S = 0.1


class Roster:
    """Workers by their address.

    Attributes:
        members: those that take part.
        resource: name of the memory that they offer: one for each program, so that runs of several do not mix.
    """

    def __init__(self, address: str, store: FileStore, tell: Callable[[str], None]) -> None:
        """Begin without workers.

        Args:
            address: of the scheduler, for people.
            store: that all workers reach.
            tell: called with lines for people.
        """
        self.members: dict[str, Membership] = {}
        self._tell = tell
        self._client: Any = None
        self._address = address
        self._store = store
        self._facts = facts()
        self.resource = f"spallwatch-{self._facts['program'][:12]}"
        self._asked: dict[str, tuple[Any, str]] = {}
        self._refused: dict[str, str] = {}
        self._paused: dict[str, float] = {}
        self._strict = False

    def use(self, client: Any) -> None:
        """Take a client, whose scheduler has workers that were not asked yet.

        Raises:
            RefusedWorkerError: the scheduler runs another program.
            OSError: it is lost.
        """
        self.close()
        self._client = client
        self._check_scheduler()

    def wait_for(self, count: int, seconds: float = JOIN_S, *, strict: bool = True) -> None:
        """Wait until so many workers take part.

        Args:
            count: of workers, at least.
            seconds: time for them to come, s.
            strict: whether one that cannot take part is an error; otherwise it is left out, as one that comes later.

        Raises:
            RefusedWorkerError: at least one that is there cannot.
            ClusterError: fewer have come.
            OSError: the scheduler is lost.
        """
        begun = time.monotonic()
        reported, self._strict = False, strict
        while True:
            self.refresh()
            if self._refused and strict:
                raise RefusedWorkerError(
                    f"{self._address}: workers that cannot be used:\n" + "\n".join(sorted(self._refused.values()))
                )
            passed = time.monotonic() - begun
            # One that is busy for others answers when it can.
            if len(self.members) >= count and (not self._asked or passed > ANSWER_S):
                self._strict = False
                return
            if passed > NOTICE_S and not reported:
                reported = True
                self._tell(f"{self._address}: {len(self.members)} workers take part, waiting for {count}")
            if passed > seconds:
                raise ClusterError(
                    f"{self._address}: {len(self.members)} workers take part after {seconds:.0f} s, expected {count}"
                )
            time.sleep(_POLL_S)

    def refresh(self) -> bool:
        """Ask new workers to join and forget those that are gone; return whether one has joined since.

        Raises:
            OSError: the scheduler is lost.
        """
        if self._client.status != "running":
            raise ConnectionError(f"{self._address}: {self._client.status}")
        known = self._client.scheduler_info(n_workers=-1)["workers"]
        present = self._answering(known)
        for address in set(self._asked).difference(present):
            self._delete_token(address, self._asked.pop(address)[1])
        for group in (self.members, self._refused):
            for address in set(group).difference(present):
                del group[address]
        self._ask(present.difference(self.members, self._asked, self._refused))
        joined = False
        for address, (future, token) in list(self._asked.items()):
            if future.done():
                del self._asked[address]
                joined = self._take(address, future, token) or joined
        return joined

    def addresses(self) -> list[str]:
        """Return where the members are reached, in order."""
        return sorted(self.members)

    def threads(self) -> int:
        """Return how many chunks may be at work, as far as their memory and their kind allow."""
        return sum(member.threads for member in self.members.values())

    def memory(self) -> int:
        """Return the bytes of the largest worker."""
        return max((member.memory for member in self.members.values()), default=0)

    def close(self) -> None:
        """Forget all workers, and delete the tokens of those that have not answered."""
        for address, (_, token) in self._asked.items():
            self._delete_token(address, token)
        for group in (self.members, self._asked, self._refused, self._paused):
            group.clear()

    def _answering(self, known: Mapping[str, Mapping[str, Any]]) -> set[str]:
        """Return the workers of a scheduler that send heartbeats and take tasks; forget members that began anew.

        The scheduler notes when it hears of each: the age is relative to the latest, so that no two clocks are compared
        and a scheduler that was busy finds no worker silent.
        """
        latest = max((float(worker["last_seen"]) for worker in known.values()), default=0.0)
        present = {address for address, worker in known.items() if latest - worker["last_seen"] <= SILENT_S}
        for address in present.intersection(self.members):
            if self.resource not in known[address]["resources"]:
                # Another process took its port before its loss was seen here.
                del self.members[address]
        stuck = self._stuck(known)
        for address in set(known).intersection(self.members).difference(present - stuck):
            paused = f"is paused for {PAUSED_S:.0f} s, its memory is full"
            how = paused if address in stuck else f"is silent for {SILENT_S:.0f} s"
            self._tell(f"worker {self.members[address].name} {how}: others get its chunks")
        return present - stuck

    def _stuck(self, known: Mapping[str, Mapping[str, Any]]) -> set[str]:
        """Return the workers that dask has paused for long while no task is at work there."""
        now = time.monotonic()
        idle = {
            address
            for address, worker in known.items()
            if worker["status"] == "paused" and not worker["metrics"].get("task_counts", {}).get("executing")
        }
        self._paused = {address: self._paused.get(address, now) for address in idle}
        return {address for address, since in self._paused.items() if now - since > PAUSED_S}

    def _delete_token(self, address: str, token: str) -> None:
        for name in (answer_name(token, address), token):
            with suppress(Exception):
                self._store.delete(name)

    def _check_scheduler(self) -> None:
        try:
            found = self._client.run_on_scheduler(facts)
        except ImportError as error:
            found = {}
            problem = f"spallwatch is not installed there ({error})"
        else:
            problem = differences(found, self._facts)
        if problem:
            raise RefusedWorkerError(f"scheduler {self._address} cannot be used: {problem}")

    def _ask(self, addresses: Iterable[str]) -> None:
        for address in addresses:
            try:
                check_addresses([address])
            except RefusedWorkerError as error:
                self._refuse(address, str(error))
                continue
            token = f"preflight/{secrets.token_hex(8)}"
            self._store.write(token, token.encode())
            # A worker without spallwatch ends when it is sent a function of it, so it is asked for it by name.
            where: dict[str, Any] = {"workers": [address], "pure": False}
            found = self._client.submit(pkgutil.resolve_name, name_of(join), key=f"find-{token[10:]}", **where)
            arguments = (self._store.url, token, self._facts, self.resource)
            future = self._client.submit(operator.call, found, *arguments, key=f"join-{token[10:]}", **where)
            self._asked[address] = future, token

    def _take(self, address: str, future: Any, token: str) -> bool:
        """Take the answer of a worker; return whether it takes part."""
        try:
            found: Membership = future.result(timeout=60)
            if not found.problem and self._store.read(answer_name(token, address)) != token.encode():
                found = Membership(found.name, problem=f"writes to another {self._store.url}")
        except ImportError as error:
            found = Membership(address, problem=f"spallwatch is not installed there ({error})")
        except Exception as error:
            if future.status != "error":
                # It went while it was asked.
                return False
            found = Membership(address, problem=f"{type(error).__name__}: {error}")
        finally:
            self._delete_token(address, token)
        if found.problem:
            self._refuse(address, f"worker {found.name}: {found.problem}")
            return False
        self.members[address] = found
        return True

    def _refuse(self, address: str, text: str) -> None:
        self._refused[address] = text
        if not self._strict:
            self._tell(f"gets no chunks: {text}")

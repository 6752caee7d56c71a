"""What a daemon is given while calls fail: blocks over TCP, files in a folder, and a user of its page.

Each gives one thing after the other, from a thread, and notes of each when it began and when it was done.
"""

from __future__ import annotations

import http.client
import json
import sqlite3
import threading
import time
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from streams.files.container import content_hash
from streams.link.sender import LinkError, SendError, TcpLink
from streams.link.wire import Frame, encode_frame
from streams.reblock import samples_hash
from streams.types.samples import Samples
from streams.types.spec import Address

RATE, SAMPLES = 25_600.0, 6_400
FIRST_NS, APART_NS = 1_767_225_600 * 10**9, 1_800 * 10**9
"""Blocks are dated half an hour apart, so that days end and retention has work within a minute."""
STREAM, FOLDER = "t", "f"
_BLOCKS_A_CONNECTION = 8
_PATIENCE_S = 1.5
_FILE_PATIENCE_S = 10.0
_NOISE = (0.3 * np.random.default_rng(0).standard_normal(SAMPLES)).astype(np.float32)


def _samples(number: int) -> NDArray[np.float32]:
    return (_NOISE * np.float32(1.0 + 1e-4 * number))[np.newaxis]


class Traffic:
    """One kind of traffic, from a thread of its own; the next begins ``pause_s`` after the one before."""

    pause_s = 0.1

    def __init__(self) -> None:
        """Begin at once."""
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._done: list[tuple[float, float, bool]] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def clear(self) -> None:
        """Forget what was done so far."""
        with self._lock:
            self._done.clear()

    def done_after(self, moment: float) -> float | None:
        """Return when the first that began after a moment (monotonic, s) was done; None where none is done yet."""
        with self._lock:
            return next((end for begin, end, succeeded in self._done if succeeded and begin >= moment), None)

    def failures(self) -> int:
        """Return how many failed since :meth:`clear`."""
        with self._lock:
            return sum(not succeeded for _, _, succeeded in self._done)

    def longest(self) -> float:
        """Return the longest duration since :meth:`clear`, s."""
        with self._lock:
            return max((end - begin for begin, end, _ in self._done), default=0.0)

    def end(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join(2 * _FILE_PATIENCE_S)

    def _run(self) -> None:
        while not self._stop.is_set():
            began = time.monotonic()
            try:
                self._once()
                succeeded = True
            except (OSError, LinkError, SendError, http.client.HTTPException, ValueError, sqlite3.Error):
                succeeded = False
            with self._lock:
                self._done.append((began, time.monotonic(), succeeded))
            self._stop.wait(self.pause_s)

    def _once(self) -> None:
        raise NotImplementedError


class Blocks(Traffic):
    """Blocks over TCP, each sent when the one before is acknowledged."""

    def __init__(self, port: int) -> None:
        """Send to a port of this machine."""
        self._link = TcpLink(Address("tcp", "127.0.0.1", port), STREAM, _PATIENCE_S)
        self._number: int | None = None
        self.acknowledged: dict[int, str] = {}
        """Content hashes of the acknowledged blocks, by number."""
        self.went_back: list[str] = []
        """Answers below a number that was acknowledged before."""
        self._sent: dict[int, str] = {}
        super().__init__()

    def _once(self) -> None:
        try:
            if self._number is None or self._number % _BLOCKS_A_CONNECTION == 0:
                self._note(self._link.connect())
            assert self._number is not None
            number = self._number + 1
            values = _samples(number)
            frame = Frame(
                number, Samples(values, rate=RATE, channels=("c",), units=("g",)), FIRST_NS + number * APART_NS
            )
            self._sent[number] = samples_hash(values, RATE, ("c",))
            self._link.send(encode_frame(frame))
            until = time.monotonic() + _PATIENCE_S
            while self._number < number and time.monotonic() < until:
                answer = self._link.committed(until - time.monotonic())
                if answer is not None:
                    self._note(answer)
            if self._number < number:
                raise LinkError("no acknowledgement")
        except (OSError, LinkError):
            self._number = None
            self._link.close()
            raise

    def end(self) -> None:
        """End the thread and close the connection."""
        super().end()
        self._link.close()

    def _note(self, answer: int) -> None:
        most = max(self.acknowledged, default=0)
        if answer < most:
            self.went_back.append(f"{answer} after {most}")
        for number in range(most + 1, answer + 1):
            self.acknowledged[number] = self._sent.get(number, "never sent")
        self._number = answer


class Files(Traffic):
    """MAT files in a watched folder, each given when the one before is in the store."""

    pause_s = 0.3

    def __init__(self, folder: Path, store: Path) -> None:
        """Write to a folder; look into the store."""
        self._folder, self._store = folder, store
        self._count = 0
        self.given: dict[str, str] = {}
        """Content hashes of all files, by name."""
        super().__init__()

    def _once(self) -> None:
        self._count += 1
        values = _samples(100_000 + self._count)[0]
        path = self._folder / f"f{self._count:05d}.mat"
        unseen = self._folder.parent / path.name
        savemat(unseen, {"c": values})
        self.given[path.name] = content_hash(unseen.read_bytes())
        unseen.replace(path)
        until = time.monotonic() + _FILE_PATIENCE_S
        while not self._stop.is_set() and time.monotonic() < until:
            if self._is_stored(path.name):
                return
            time.sleep(0.05)
        raise OSError(f"{path}: is not in the store")

    def _is_stored(self, name: str) -> bool:
        with suppress(sqlite3.Error), closing(sqlite3.connect(f"file:{self._store}?mode=ro", uri=True)) as connection:
            query = "SELECT 1 FROM blocks WHERE source = ? AND name LIKE ?"
            return connection.execute(query, (FOLDER, f"{name}%")).fetchone() is not None
        return False


class Reader(Traffic):
    """A user who signs in with the token and reads the machines, each time over a connection of its own."""

    pause_s = 0.3

    def __init__(self, port: int, token_file: Path) -> None:
        """Ask a port of this machine."""
        self._port, self._token_file = port, token_file
        super().__init__()

    def _once(self) -> None:
        token = self._token_file.read_text().strip()
        connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=2 * _PATIENCE_S)
        with closing(connection):
            body = json.dumps({"token": token})
            connection.request("POST", "/login", body, {"content-type": "application/json"})
            answer = connection.getresponse()
            answer.read()
            if answer.status != 204:
                raise ValueError(f"the sign-in was answered with {answer.status}")
            cookie = (answer.getheader("set-cookie") or "").partition(";")[0]
            connection.request("GET", "/api/machines", headers={"cookie": cookie})
            answer = connection.getresponse()
            if answer.status != 200 or not json.loads(answer.read())["machines"]:
                raise ValueError(f"the machines were answered with {answer.status}")

    def metrics(self) -> str:
        """Return what the page says to a collector of metrics, "" where it does not answer."""
        token = self._token_file.read_text().strip()
        with closing(http.client.HTTPConnection("127.0.0.1", self._port, timeout=2 * _PATIENCE_S)) as connection:
            try:
                connection.request("GET", "/metrics", headers={"authorization": f"Bearer {token}"})
                return connection.getresponse().read().decode()
            except (OSError, http.client.HTTPException):
                return ""

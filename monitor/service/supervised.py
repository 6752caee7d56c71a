"""One daemon under a supervisor: started, listened to, killed when it hangs, started again when it ends."""

from __future__ import annotations

import json
import logging
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import IO

from monitor.service.companions import LAST_PUBLICATION
from monitor.service.fleet import Machine
from monitor.service.logs import TO_JOURNAL, named, to_journal, unmarked

_LOG = logging.getLogger(__name__)
_HANGS_AFTER = 30.0
_LONGEST_START = 600.0
_USUAL_START = 5.0
_FIRST_PAUSE = 1.0
_LONGEST_PAUSE = 300.0
_GOOD_RUN = 60.0
_LONGEST_LINE = 16384
_MOST_LINES = 200
_WORDS = 300
_FINAL = "spallwatch: "
_KILLED_WITHIN = 0.2
_CREDENTIALS = struct.Struct("3i")
_START = "import json, sys; sys.path[:] = json.loads(sys.argv.pop()); from monitor.cli import main; main()"


class Ear:
    """Hears what one process says in the protocol of sd_notify(3), and nobody else."""

    def __init__(self) -> None:
        """Open an address in the abstract name space, which the kernel chooses and takes back by itself."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind("")
        self.address = "@" + self._socket.getsockname()[1:].decode("ascii")
        """As ``NOTIFY_SOCKET`` takes it."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._socket.fileno()

    def hear(self, pid: int) -> list[str]:
        """Return the lines that a process has said by now; the kernel vouches for who it was."""
        lines: list[str] = []
        while True:
            try:
                message, ancillary, _, _ = self._socket.recvmsg(4096, socket.CMSG_SPACE(_CREDENTIALS.size))
            except BlockingIOError:
                return lines
            for level, kind, data in ancillary:
                known = (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS)
                if known and _CREDENTIALS.unpack(data[: _CREDENTIALS.size])[0] == pid:
                    lines += message.decode("utf-8", "replace").splitlines()

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()


class Lines:
    """What a process writes, line by line, a name before each; it is never waited for."""

    def __init__(self, name: str, pipe: IO[bytes]) -> None:
        """Take the reading end of a pipe."""
        self._name, self._pipe, self._rest = name, pipe, b""
        os.set_blocking(pipe.fileno(), False)
        self.last = ""
        """The last line that says why it ended, as far as one does; else the last one that was not empty."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._pipe.fileno()

    def pass_on(self) -> bool:
        """Write what has come to standard error; return whether there may be more to come."""
        for _ in range(_MOST_LINES):
            try:
                part = os.read(self._pipe.fileno(), _LONGEST_LINE)
            except BlockingIOError:
                return True
            *lines, self._rest = (self._rest + part).split(b"\n")
            if not part or len(self._rest) > _LONGEST_LINE:
                lines, self._rest = [*lines, self._rest], b""
            for line in lines:
                self._write(line)
            if not part:
                return False
        return True

    def close(self) -> None:
        """Stop reading."""
        self._pipe.close()

    def _write(self, line: bytes) -> None:
        text = line.decode("utf-8", "replace").rstrip()
        if text:
            if text.startswith(_FINAL) or not self.last.startswith(_FINAL):
                self.last = unmarked(text)
            # Whoever reads the log may have gone; that ends nothing.
            with suppress(OSError):
                sys.stderr.write(f"{named(text, self._name)}\n")
                sys.stderr.flush()


class Supervised:
    """The daemon of one machine as a child process. All methods are called from one thread, and none waits."""

    def __init__(
        self,
        machine: Machine,
        options: Sequence[str] = (),
        monotonic: Callable[[], float] = time.monotonic,
        publish_within: float = LAST_PUBLICATION,
    ) -> None:
        """Take the machine; nothing is started yet.

        Args:
            machine: whose daemon it is.
            options: further ones of ``spallwatch run``, such as ``--quiet``.
            monotonic: seconds that never go back.
            publish_within: seconds for its last publication.
        """
        self.machine = machine
        self.publish_within = publish_within
        self._options, self._monotonic = tuple(options), monotonic
        self._child: subprocess.Popen[bytes] | None = None
        self._ear: Ear | None = None
        self._lines: Lines | None = None
        self._due = float("-inf")
        self._began = self._heard = 0.0
        self._ready_since: float | None = None
        self._failures = 0
        self._hung: str | None = None
        self._last_words = ""
        self.ready = False
        """Whether the daemon runs, and has said that it could commit a block."""
        self.starts = 0
        """How often it was started."""
        self.problem: str | None = None
        """Why it does not run, in one sentence, or None."""

    @property
    def pid(self) -> int | None:
        """Number of the child process, or None where none is running."""
        return None if self._child is None else self._child.pid

    @property
    def settled(self) -> bool:
        """Whether it is known by now how the start went."""
        return self.ready or self.problem is not None

    @property
    def waitable(self) -> list[Ear | Lines]:
        """What to wait on: something came when one of these can be read."""
        return [item for item in (self._ear, self._lines) if item is not None]

    def starting(self) -> bool:
        """Tell whether it was started a moment ago, and is not ready yet."""
        return self._child is not None and not self.ready and self._monotonic() - self._began < _USUAL_START

    def tick(self, *, may_start: bool = True) -> None:
        """Hear what the daemon says; start it where it is time to and allowed, and end it where it hangs."""
        now = self._monotonic()
        if self._child is None:
            if may_start and now >= self._due:
                self._start(now)
            return
        self._listen(now)
        code = self._child.poll()
        if code is not None:
            # It may have said something since.
            self._listen(now)
            # Whoever was killed had no last words: what was logged before has nothing to do with it.
            said = f" ({self._last_words})" if code > 0 and self._last_words else ""
            self._ended(self._hung or f"ended with {_code_words(code)}", now, said)
            return
        allowed = _HANGS_AFTER if self.ready else _LONGEST_START
        if now - self._heard > allowed:
            self._child.kill()
            # By the next time it is gone; one that is stuck in a dead device is killed once more so much later.
            self._heard = now
            self._hung = f"gave no sign of life for {allowed:.0f} s and was killed"
            self._say_problem(self._hung)

    def ask_to_stop(self) -> None:
        """Ask the daemon to end in order; it is not started again."""
        self._due = float("inf")
        if self._child is not None:
            self._child.terminate()

    def gone(self) -> bool:
        """Pass on what it says while it ends; return whether it has."""
        if self._child is None:
            return True
        self._listen(self._monotonic())
        if self._child.poll() is None:
            return False
        if self._child.returncode != 0:
            _LOG.warning("machine %s: ended with %s", self.machine.name, _code_words(self._child.returncode))
        self._forget()
        return True

    def kill(self) -> None:
        """End it at once; what was committed is safe."""
        if self._child is not None:
            self._child.kill()

    def forget(self) -> None:
        """Take leave of a daemon that was killed."""
        if self._child is not None:
            # One that hangs in a dead network share cannot even be killed; it is left behind.
            with suppress(subprocess.TimeoutExpired):
                self._child.wait(_KILLED_WITHIN)
        self._forget()

    def _start(self, now: float) -> None:
        self.starts += 1
        self._began = self._heard = now
        self._hung, self._last_words, self._ready_since = None, "", None
        path = str(self.machine.path.absolute())
        supervised = ["--supervised", f"{self.publish_within:.3f}"]
        command = [sys.executable, "-c", _START, "run", *supervised, "--config", path, *self._options]
        environment = {
            **os.environ,
            "WATCHDOG_USEC": str(round(_HANGS_AFTER * 1e6)),
            TO_JOURNAL: "1" if to_journal() else "0",
        }
        # The manager of services watches the supervisor, not its children.
        environment.pop("WATCHDOG_PID", None)
        command.append(json.dumps(sys.path))
        try:
            self._ear = Ear()
            environment["NOTIFY_SOCKET"] = self._ear.address
            self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, env=environment)
        except OSError as error:
            self._ended(f"cannot be started: {error.strerror or error}", now)
            return
        assert self._child.stderr is not None
        self._lines = Lines(self.machine.name, self._child.stderr)

    def _listen(self, now: float) -> None:
        assert self._child is not None
        if self._lines is not None:
            more = self._lines.pass_on()
            self._last_words = self._lines.last[:_WORDS]
            if not more:
                self._lines.close()
                self._lines = None
        assert self._ear is not None
        for line in self._ear.hear(self._child.pid):
            self._heard = now
            if line == "READY=1" and not self.ready:
                self.ready, self._ready_since = True, now
                if self.problem is not None:
                    _LOG.warning("machine %s: runs again", self.machine.name)
                self.problem = None

    def _ended(self, how: str, now: float, said: str = "") -> None:
        went_well = self._ready_since is not None and now - self._ready_since >= _GOOD_RUN
        self._failures = 1 if went_well else self._failures + 1
        pause = min(_FIRST_PAUSE * 2.0 ** min(self._failures - 1, 20), _LONGEST_PAUSE)
        self._due = now + pause
        often = f", {self._failures} times in a row" if self._failures > 1 else ""
        self._forget()
        self._say_problem(f"{how}{often}; it is started again after {pause:.0f} s{said}")

    def _say_problem(self, problem: str) -> None:
        self.ready, self.problem = False, problem
        _LOG.error("machine %s: the daemon %s", self.machine.name, problem)

    def _forget(self) -> None:
        """Close what was open to the child."""
        child, self._child = self._child, None
        if child is not None and child.stdin is not None:
            with suppress(OSError):
                child.stdin.close()
        for item in self.waitable:
            item.close()
        self._ear = self._lines = None
        self.ready = False


def _code_words(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"

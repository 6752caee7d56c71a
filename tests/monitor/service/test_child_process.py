"""Child processes of the daemon: what is done with one that cannot be ended in time."""

from __future__ import annotations

import gc
import os
import signal
from pathlib import Path

import pytest

from monitor.service.children import Child
from tests.support.waiting import wait_until


def hang() -> None:
    """Stay, as a child in an unreachable network share does."""
    wait_until(lambda: False)


@pytest.mark.process
def test_a_child_that_is_left_behind_is_waited_for_beside(monkeypatch: pytest.MonkeyPatch) -> None:
    child = Child("tests.monitor.service.test_child_process:hang")
    with monkeypatch.context() as unkillable:
        unkillable.setattr(child._process, "kill", lambda: None)
        child.end()
    pid = child.pid
    # No reference is left. Without a thread that waits for it, the process would stay a zombie, and Popen warn of it.
    del child
    gc.collect()
    os.kill(pid, signal.SIGKILL)
    wait_until(lambda: not Path(f"/proc/{pid}").exists())

import os
import signal
import sys
import threading
import time
import weakref
from collections.abc import Generator
from types import SimpleNamespace

import pytest

from models.platform.process_signals import ended_as_interrupted, ended_by_parent, interrupt_held, interrupts_kept
from tests.support.waiting import wait_until


@pytest.fixture
def signals() -> Generator[None]:
    """Put the handlers back that a test changes."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("signals")
def test_a_request_to_end_is_an_interruption_unless_it_is_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with ended_as_interrupted():
        os.kill(os.getpid(), signal.SIGHUP)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGHUP)) == (signal.SIG_DFL, signal.SIG_IGN)
    thread = threading.Thread(target=ended_as_interrupted().__enter__)
    thread.start()
    thread.join()
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.usefixtures("signals")
def test_a_process_cleans_up_when_its_parent_ends_it_or_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    cleaned: list[str] = []
    for ended in (True, False):
        lost = threading.Event()
        monkeypatch.setattr("multiprocessing.parent_process", lambda lost=lost: SimpleNamespace(join=lost.wait))
        with ended_by_parent(60.0):
            try:
                # Ctrl-C is for the parent.
                os.kill(os.getpid(), signal.SIGINT)
                if ended:
                    os.kill(os.getpid(), signal.SIGTERM)
                lost.set()
                time.sleep(60.0)
            finally:
                os.kill(os.getpid(), signal.SIGTERM)
                cleaned.append("cleaned")
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_IGN
        lost.set()
        wait_until(lambda: all(thread.name != "parent" for thread in threading.enumerate()))
    assert len(cleaned) == 2


def test_ctrl_c_is_held_back_from_what_is_started() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    with interrupt_held():
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before


@pytest.mark.usefixtures("signals")
def test_an_interruption_of_a_callback_is_raised_behind_it() -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    def drop_it() -> None:
        held = {1}
        kept = weakref.ref(held, interrupted)
        del held
        assert kept() is None
        time.sleep(60.0)

    signal.signal(signal.SIGINT, signal.default_int_handler)
    before = sys.unraisablehook
    with interrupts_kept(), pytest.raises(KeyboardInterrupt):
        drop_it()
    assert sys.unraisablehook is before

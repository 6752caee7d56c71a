"""The child process: what it returns, what kills it, and that nothing of it stays behind."""

from __future__ import annotations

import gc
import os
import re
import subprocess
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from signal import SIGHUP, SIGINT, SIGKILL, SIGTERM, Signals

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from models.platform.portable import DiskFile
from streams.files.formats.mat import mat_variables, read_mat
from streams.files.parse.child import ReaderProcess, isolated, shared_process
from streams.types.limits import ChildLimits
from streams.types.samples import ReaderError, Samples
from tests.streams import misbehave
from tests.streams.format_makers import mat_bytes, signal
from tests.support.waiting import at_most, join, wait_until

pytestmark = pytest.mark.process

REPOSITORY = Path(__file__).resolve().parents[3]


LIMITS = ChildLimits(memory=2 << 30, cpu_s=1, wall_s=8.0, files=5)


@pytest.fixture
def child() -> Iterator[ReaderProcess]:
    with ReaderProcess(LIMITS) as process:
        yield process


def crash(child: ReaderProcess, how: object) -> str:
    assert callable(how)
    with pytest.raises(ReaderError) as caught:
        child.call(how, b"data", "x.bin")
    return f"{caught.value.status}: {caught.value}"


def open_files() -> set[str]:
    return {path.name for path in Path("/proc/self/fd").iterdir() if path.exists()}


def alive(pid: int | None) -> bool:
    return pid is not None and Path(f"/proc/{pid}").exists()


def test_readings_values_and_errors_come_back_as_they_are(child: ReaderProcess) -> None:
    samples = signal()
    data = mat_bytes(samples)
    here, there = read_mat(data, "x.mat"), child.call(read_mat, data, "x.mat")
    assert isinstance(there, Samples)
    assert_array_equal(there.values, here.values)
    assert there.values.dtype == here.values.dtype
    for field in ("names", "columns", "channels", "rate", "speed", "load", "start", "units", "scaled"):
        assert getattr(there, field) == getattr(here, field)
    assert child.call(mat_variables, data, "x.mat") == {"acc_1": [[1, 1000], "double"], "acc_2": [[1, 1000], "double"]}
    with pytest.raises(ReaderError, match=r"ü\n<b>: not a MAT file") as caught:
        child.call(read_mat, b"MATLAB?", "ü\n<b>")
    assert caught.value.status == "unreadable"
    assert child.call(misbehave.answer_name, b"", "\udcff") == "\udcff"


def test_float32_and_empty_arrays(child: ReaderProcess) -> None:
    reading = child.call(misbehave.single, b"", "x")
    assert reading.values.dtype == np.float32
    assert_array_equal(reading.values, [[1.0, np.inf, -np.inf]])


def test_the_child_is_kept_and_then_replaced(child: ReaderProcess) -> None:
    pids = [child.call(misbehave.pid, b"", "x") for _ in range(12)]
    assert [pids.count(pid) for pid in dict.fromkeys(pids)] == [5, 5, 2]
    assert os.getpid() not in pids
    assert not alive(pids[0])


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (misbehave.segfault, "reader_crashed: .*died of SIGSEGV"),
        (misbehave.leave, "reader_crashed: .*ended with code 3"),
        (misbehave.burn, r"reader_crashed: .*(used more than 1 s of processor time|no answer within 8 s)"),
        (misbehave.eat, "refused: .*4 bytes needs more than 2432 MiB of memory"),
        (misbehave.write_much, "reader_crashed|unreadable"),
        (misbehave.nonsense, "unreadable: .*TypeError"),
        (misbehave.fail, "unreadable: .*ZeroDivisionError"),
        (misbehave.recurse, "unreadable: .*nested too deeply"),
        (misbehave.endless, "reader_crashed: .*without end"),
        (misbehave.not_json, "reader_crashed: .*ended with code 1"),
    ],
)
def test_whatever_a_reader_does_the_parent_goes_on(child: ReaderProcess, how: object, words: str) -> None:
    assert_goes_on(child, how, words)


def test_after_a_reader_that_hangs_the_parent_goes_on() -> None:
    # Its time counts from when the libraries are loaded.
    with ReaderProcess(replace(LIMITS, wall_s=2.0)) as child:
        assert_goes_on(child, misbehave.sleep, "reader_crashed: .*no answer within 2 s")


def assert_goes_on(child: ReaderProcess, how: object, words: str) -> None:
    answer = crash(child, how)
    assert re.match(words, answer), answer
    assert "x.bin" in answer
    assert_array_equal(child.call(read_mat, mat_bytes(signal()), "x").values, signal())


def test_a_child_that_is_killed_between_files_is_replaced(child: ReaderProcess) -> None:
    first = child.call(misbehave.pid, b"", "x")
    os.kill(first, SIGKILL)
    wait_until(lambda: Path(f"/proc/{first}/stat").read_text().split()[2] == "Z")
    assert child.call(misbehave.pid, b"", "x") != first


def test_many_threads_take_turns() -> None:
    data = {seed: mat_bytes(signal(seed=seed)) for seed in range(4)}
    wrong: list[int] = []

    def work(seed: int) -> None:
        for _ in range(5):
            reading = isolated(read_mat)(data[seed], f"{seed}")
            if not np.array_equal(reading.values, signal(seed=seed)):
                wrong.append(seed)

    threads = [threading.Thread(target=work, args=(seed,), daemon=True) for seed in data]
    for thread in threads:
        thread.start()
    join(*threads)
    assert not wrong


def test_closing_ends_a_call_that_is_under_way() -> None:
    child = ReaderProcess(ChildLimits(wall_s=60.0))
    answers: list[object] = []
    child.call(misbehave.pid, b"", "x")

    def work() -> None:
        # Whoever takes the end of the program for a verdict on a file would write it into the ledger.
        try:
            answers.append(child.call(misbehave.sleep, b"", "x"))
        except Exception as error:
            answers.append(error)
        except SystemExit:
            answers.append("end")

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    time.sleep(0.3)
    pid = child.pid
    with at_most(10.0):
        child.close()
        join(thread)
    assert answers == ["end"]
    assert not alive(pid)
    with pytest.raises(SystemExit):
        child.call(misbehave.pid, b"", "x")


@pytest.mark.parametrize("number", [SIGINT, SIGTERM, SIGHUP])
def test_signals_for_everybody_do_not_cost_a_file(child: ReaderProcess, number: Signals) -> None:
    pid = child.call(misbehave.pid, b"", "x")
    timer = threading.Timer(0.2, os.kill, (pid, number))
    timer.start()
    assert child.call(misbehave.nap, b"", "x") == pid
    timer.join()
    assert os.getpgid(pid) != os.getpgid(0)


def test_nothing_stays_open() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        before = open_files()
        for _ in range(3):
            with ReaderProcess() as child:
                child.call(misbehave.pid, b"", "x")
        gc.collect()
        assert open_files() <= before


PROGRAM = """
import os, sys, threading, time
from streams.files.parse.child import isolated, shared_process
from tests.streams import misbehave
mode = sys.argv[1]
if mode == "daemon":
    print(isolated(misbehave.pid)(b"", "x"), flush=True)
    threading.Thread(target=lambda: isolated(misbehave.sleep)(b"", "x"), daemon=True).start()
    time.sleep(0.5)
elif mode == "fork":
    first = isolated(misbehave.pid)(b"", "x")
    read, write = os.pipe()
    if os.fork() == 0:
        os.write(write, str(isolated(misbehave.pid)(b"", "x")).encode())
        shared_process().close()
        os._exit(0)
    os.wait()
    second = int(os.read(read, 100))
    assert first != second and isolated(misbehave.pid)(b"", "x") == first
    print(second, flush=True)
elif mode == "killed":
    print(isolated(misbehave.pid)(b"", "x"), flush=True)
    os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize(("mode", "code"), [("daemon", 0), ("fork", 0), ("killed", -9)])
def test_no_process_outlives_the_program(mode: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM, mode],
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr if code == 0 else "") == (code, "")
    pid = int(done.stdout.split()[-1])
    wait_until(lambda: not alive(pid))


def test_files_share_one_place_on_disk_that_none_of_them_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[DiskFile] = []
    monkeypatch.setattr("streams.files.parse.child.DiskFile", lambda: made.append(DiskFile()) or made[-1])
    with ReaderProcess(LIMITS) as process:
        for number in range(3):
            rows = np.full((1, 40_000), float(number))
            assert_array_equal(process.call(read_mat, mat_bytes(rows), "a.mat", ["*"], "UTC").values, rows)
        with pytest.raises(ReaderError):
            process.call(read_mat, b"no file" * 50_000, "b.mat", ["*"], "UTC")
        assert len(made) == 1
        handle = made[0].handle
    # What a file that failed may have left there is closed with it.
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(handle)


def test_the_shared_process_is_one() -> None:
    assert shared_process() is shared_process()


def test_a_process_that_remembers_reads_the_same_bytes_once(monkeypatch: pytest.MonkeyPatch) -> None:
    data, other = mat_bytes(signal()[:1]), mat_bytes(2.0 * signal()[:1])
    asked: list[str] = []
    ask = ReaderProcess._ask
    monkeypatch.setattr(ReaderProcess, "_ask", lambda *given: asked.append(given[1]["name"]) or ask(*given))

    with ReaderProcess(LIMITS, remembers=True) as process, ReaderProcess(LIMITS) as forgets:

        def read(content: bytes, name: str = "a.mat", pattern: str = "*", process: ReaderProcess = process) -> Samples:
            return process.call(read_mat, content, name, [pattern], "UTC")

        first = read(data)
        assert read(bytes(bytearray(data))) is first
        assert asked == ["a.mat"]
        assert not first.values.flags.writeable
        # Whatever is another is read.
        assert_array_equal(read(other).values, 2.0 * first.values)
        assert_array_equal(read(data).values, first.values)
        assert read(data, "b.mat") is not first
        assert read(data, "b.mat", "acc*") is not first
        assert len(asked) == 5
        with pytest.raises(ReaderError):
            read(data[:200])
        with pytest.raises(ReaderError):
            read(data[:200])
        assert len(asked) == 7
        assert read(data, process=forgets) is not read(data, process=forgets)
        # A pass over many files holds no file behind the one that it gives; a name that comes twice is remembered.
        asked.clear()
        for name in ("a.mat", "b.mat", "c.mat"):
            read(data, name)
        assert read(data, "c.mat") is read(data, "c.mat")
        assert asked == ["a.mat", "b.mat", "c.mat", "c.mat"]
        read(data, "d.mat")
        alone = weakref.ref(read(data, "e.mat"))
        assert alone() is None

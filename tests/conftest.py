"""What all tests share: where the recordings are, and what happens where they are not."""

from __future__ import annotations

import functools
import gc
import hashlib
import importlib.util
import math
import multiprocessing.process
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings
from numpy.typing import NDArray
from platformdirs import user_cache_path

from reference import recordings_folder
from reference.once import folder_of_the_run as folder_of_the_run
from tests.support.broker import broker_program
from tests.support.durations import Durations
from tests.support.effort import effort_count

if TYPE_CHECKING:
    from tests.support.object_storage import ObjectStorage

_REPOSITORY = Path(__file__).resolve().parents[1]

# Containers often set PYTHONDONTWRITEBYTECODE. Then each worker rewrites the assertions of all test files again, and
# each child process compiles the product again: half a minute of every three of processor time.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# The kernels of the user, also in children that are given another home or cache.
os.environ.setdefault("NUMBA_CACHE_DIR", str(user_cache_path("spallwatch") / "kernels"))

# There are more workers than cores: the threads of BLAS would wait for each other in loops, which triples its time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No failure depends on the time that an example takes. Quick effort draws the same examples every time.
settings.register_profile(
    "any machine",
    deadline=None,
    max_examples=effort_count(quick=10, full=100),
    derandomize=effort_count(quick=1, full=0) == 1,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("any machine")


def chromium_program() -> str | None:
    """Return the path of the browser Chromium, or None."""
    return shutil.which("chromium")


@functools.cache
def missing_for_pdf() -> str:
    """Return what is missing for a PDF, "" where nothing is."""
    from monitor.report.page import require_pdf
    from monitor.report.runs import ReportError

    try:
        require_pdf()
    except ReportError as error:
        return str(error)
    return ""


@functools.cache
def missing_for_cluster() -> str:
    """Return which packages of clusters and object storage are missing, "" where none is."""
    needed = ("distributed", "fsspec", "zarr", "s3fs", "moto", "flask", "flask_cors")
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    return f"missing for clusters and object storage: {', '.join(missing)}" if missing else ""


def pytest_configure(config: pytest.Config) -> None:
    """Keep what each test takes."""
    steers = "PYTEST_XDIST_WORKER" not in os.environ
    config.pluginmanager.register(Durations(_REPOSITORY / ".cache" / "durations.json", steers=steers))


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Return twice as many workers as there are cores: almost half of the time of a test of processes is waiting.

    Without those tests half as many more than cores; each further worker costs seconds of collection and of imports.
    Workers keep runs of neighbouring tests, unless asked otherwise: what a module shares is made by one of them.
    """
    if config.option.dist == "no":
        config.option.dist = "worksteal"
    cores = len(os.sched_getaffinity(0))
    return cores + (cores + 1) // 2 if config.option.markexpr == "not process" else 2 * cores


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Seek no garbage meanwhile: there is little of it, and it takes a tenth of the time before the first test."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests of the page together, in whatever order: they share a browser and a daemon."""
    items.sort(key=lambda item: item.get_closest_marker("browser") is None)


def pytest_collection_finish() -> None:
    """Exempt the thousands of tests and modules from garbage collection, and collect what tests leave less often."""
    gc.freeze()
    gc.set_threshold(100_000, 10, 10)


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark what starts a broker, a browser, a cluster, or ldconfig to find Pango as starting processes."""
    if any(item.get_closest_marker(name) for name in ("broker", "browser", "pdf", "cluster")):
        item.add_marker(pytest.mark.process)


class _ProcessGuard:
    """Fails a test that starts a process without the marker ``process``.

    The process in which file formats are read is no matter of a test: all tests of a worker share it.
    """

    def __init__(self) -> None:
        """Guard all ways in which a test of this project starts a process."""
        self.allowed = True
        self._watch(subprocess.Popen, "__init__")
        self._watch(multiprocessing.process.BaseProcess, "start")
        if hasattr(os, "fork"):
            self._watch(os, "fork")

    def _watch(self, owner: Any, name: str) -> None:
        original = getattr(owner, name)

        @functools.wraps(original)
        def start(*args: Any, **options: Any) -> Any:
            if not self.allowed and "streams.files.parse.worker" not in str(args[1:]):
                pytest.fail("a test that starts a process needs the marker process", pytrace=False)
            return original(*args, **options)

        setattr(owner, name, start)


_GUARD = _ProcessGuard()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Let only tests with the marker ``process``, and the fixtures that are made for them, start processes."""
    _GUARD.allowed = item.get_closest_marker("process") is not None
    try:
        return (yield)
    finally:
        _GUARD.allowed = True


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test where what it needs is missing; under CI that is a failure."""
    reason = None
    if item.get_closest_marker("real") is not None and not recordings_folder().is_dir():
        reason = "the recordings are missing: SPALLWATCH_DATA names no folder"
    if item.get_closest_marker("broker") is not None and broker_program() is None:
        reason = "the MQTT broker mosquitto is missing (Debian package mosquitto)"
    if item.get_closest_marker("browser") is not None and chromium_program() is None:
        reason = "the browser Chromium is missing (Debian package chromium)"
    if item.get_closest_marker("pdf") is not None and (missing := missing_for_pdf()):
        reason = missing
    if item.get_closest_marker("cluster") is not None and (missing := missing_for_cluster()):
        reason = missing
    if reason is None:
        return
    if os.environ.get("CI"):
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


@pytest.fixture(autouse=True, scope="session")
def fewer_points_and_draws() -> Iterator[None]:
    """Quick effort measures errors of maps at fewer points, and the spread of V_eq of fewer rigs.

    Identifications search fewer places, and draw posteriors from fewer candidates.
    """
    from models.identify import posterior, search, volume
    from models.maps import build

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "_POINTS", effort_count(quick=20, full=200))
        patch.setattr(build, "_POINTS_OF_FLOORS", effort_count(quick=4, full=40))
        patch.setattr(volume, "_RIGS", effort_count(quick=6, full=64))
        for module, name, quick in (
            (search, "_PLACES", 20),
            (search, "_STARTS", 4),
            (search, "_VALLEYS", 3),
            (posterior, "_ROUND", 24),
            (posterior, "_ROUND_PER_FREE", 16),
            (posterior, "ENOUGH", 50.0),
        ):
            if effort_count(quick=1, full=0):
                patch.setattr(module, name, quick)
        yield


@pytest.fixture(autouse=True, scope="session")
def kept_readers() -> Iterator[None]:
    """Quick effort hands the child process of a folder that is closed to the next one."""
    from tests.support.kept_reader import KeptReader

    with pytest.MonkeyPatch.context() as patch:
        if effort_count(quick=1, full=0):
            patch.setattr("streams.folder.reading.ReaderProcess", KeptReader)
        yield
    KeptReader.end()


@pytest.fixture(autouse=True, scope="session")
def quick_pace() -> Iterator[None]:
    """Quick effort shortens the intervals of daemons and pages in this process; those of forks: tests.support.forks."""
    from tests.support.pace import quicken

    with pytest.MonkeyPatch.context() as patch:
        quicken(patch.setattr)
        yield


@pytest.fixture(autouse=True, scope="session")
def forked_children() -> Iterator[None]:
    """Quick effort forks publisher and page of a daemon in this process; of forked daemons: tests.support.forks."""
    with pytest.MonkeyPatch.context() as patch:
        if effort_count(quick=1, full=0) and hasattr(os, "fork"):
            from tests.support.forked_children import SUBPROCESS

            patch.setattr("monitor.service.children.subprocess", SUBPROCESS)
        yield


@pytest.fixture
def refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuse a second writer at once: no process that was killed while it started a child can hold the lock."""
    monkeypatch.setattr("monitor.records.durable._LOCK_WAIT_S", 0.0)


@pytest.fixture(scope="module")
def kept_band_choices() -> Iterator[None]:
    """Find the band of a block once, for tests that analyse the same recording several times.

    The choice depends on its arguments alone; it takes half of the time of a block that votes for a band.
    """
    from monitor.health.signal import bands

    find_band, choices = bands.find_band, dict[object, Any]()

    def kept(
        blocks: Sequence[NDArray[Any]],
        rate: float,
        fundamentals: Mapping[str, float],
        interference: Sequence[Any] = (),
        rotations: Sequence[Any] = (),
        limit: float = math.inf,
    ) -> Any:
        if any(rotation is not None for rotation in rotations):
            return find_band(blocks, rate, fundamentals, interference, rotations, limit)
        digests = tuple((block.dtype.str, hashlib.sha256(block.tobytes()).hexdigest()) for block in blocks)
        key = (digests, rate, tuple(fundamentals.items()), tuple(interference), limit)
        if key not in choices:
            choices[key] = find_band(blocks, rate, fundamentals, interference, limit=limit)
        return choices[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bands, "find_band", kept)
        yield


@pytest.fixture(scope="session")
def storage() -> Iterator[ObjectStorage]:
    """An object storage that speaks S3, for tests marked ``cluster``; each uses a prefix of its own."""
    from tests.support.object_storage import object_storage

    with object_storage() as found:
        yield found


@pytest.fixture
def data_dir() -> Path:
    """The folder of recordings, for tests marked ``real``."""
    return recordings_folder()

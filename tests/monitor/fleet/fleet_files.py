"""A small fleet: dated recordings of noise that grows, and the archive that is made of them in this process."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from models.work.pool import SerialExecutor
from models.work.runner import Runner
from monitor.fleet.index import Index
from monitor.fleet.result import RESULT_NAME, Counts, RecordingResult
from monitor.fleet.run import ArchivePlan, extend_archive, replay_waiting
from tests.support.small_machine import BLOCK, small_machine

BEGIN = datetime.datetime(2024, 3, 1, 20, tzinfo=datetime.UTC)

DATED = 'time_from = "name"\ntime_name = "%Y%m%d-%H%M%S"'
DETECTION = "[detect]\nrun_in_blocks = 1\nlearn_blocks = 10\npersist_blocks = 2"
CONFIG = small_machine(block_s='"file"', source=DATED, more=DETECTION)

EACH = '[[machine]]\nname = "m"\nconfig = "m.toml"\nrecordings = {}\n'
CONTINUED = EACH + 'history = "continued"\n'


class Dying(SerialExecutor):
    """Loses all chunks from a number on, as if workers died."""

    def __init__(self, alive: int) -> None:
        super().__init__()
        self._alive = alive

    def submit(self, call):
        self._alive -= 1
        if self._alive < 0:
            raise KeyboardInterrupt
        super().submit(call)


def write_files(
    folder: Path, count: int = 22, *, seed: int = 1, grows_from: int = 16, begin: int = 0, hours: float = 2.0
) -> Path:
    """Write a file of one block each so many hours, from the number ``begin`` on; its level grows from a number on."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for number in range(begin, begin + count):
        samples = rng.standard_normal(BLOCK) * (1.0 + max(0, number - grows_from))
        moment = BEGIN + datetime.timedelta(hours=hours * number)
        np.save(folder / f"{moment:%Y%m%d-%H%M%S}.npy", samples.astype(np.float32))
    return folder


def make_archive(
    folder: Path,
    manifest: str,
    out: str = "out",
    *,
    runner: Runner | None = None,
    config: str = CONFIG,
    extend: bool = False,
    **plan: Any,
) -> Counts:
    """Write a manifest and ``m.toml`` into a folder, and replay it into ``out`` there, which ``extend`` adds to."""
    (folder / "m.toml").write_text(config)
    (folder / "manifest.toml").write_text(manifest)
    with Index(folder / out / "index.db") as index, runner or Runner(SerialExecutor()) as workers:
        asked = ArchivePlan(folder / "manifest.toml", str(folder / out), **{"resume": extend, **plan})
        if extend:
            extend_archive(asked, index)
        return replay_waiting(asked, index, workers)


def result_of(folder: Path) -> RecordingResult:
    """Return the result that stands beside the records in a folder."""
    return RecordingResult.from_json((folder / RESULT_NAME).read_bytes())


def records_of(folder: Path) -> dict[tuple[str, str, str], object]:
    """Return all variables of the files of records in a folder, with what says what they mean, by file and name."""
    found = {}
    for path in sorted(folder.glob("*.nc")):
        with netCDF4.Dataset(path) as dataset:
            dataset.set_auto_maskandscale(False)
            for group in (dataset, *dataset.groups.values()):
                for name, variable in group.variables.items():
                    attributes = {key: _bits(variable.getncattr(key)) for key in variable.ncattrs()}
                    found[path.name, group.path, name] = (variable.dimensions, attributes, _bits(variable[...]))
    return found


def _bits(values: Any) -> tuple[object, ...]:
    """Return type, shape and bits of an array, or the strings in it, for comparison."""
    array = np.asarray(values)
    return array.dtype.str, array.shape, array.tolist() if array.dtype == object else array.tobytes()


def assert_same_records(folder: Path, expected: Path) -> None:
    """Assert that the records in a folder equal others bit for bit, and that there are any."""
    found, wanted = records_of(folder), records_of(expected)
    assert wanted
    assert found.keys() == wanted.keys()
    different = [key for key, values in wanted.items() if values != found[key]]
    assert not different

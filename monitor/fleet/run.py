"""The replay of an archive: planned once, replayed by the workers of a runner, noted in the index as results come."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Literal

from models.work.folder_store import FolderStore, open_store
from models.work.runner import Runner
from models.work.task import FileStore
from monitor.fleet.arrays import refuse_unknown
from monitor.fleet.index import Index
from monitor.fleet.manifest import WORK_NAME, ManifestError
from monitor.fleet.part import PART_BLOCKS, SharedPlaces, read_result
from monitor.fleet.place import OWN, Overlap, refuse_lost_results, refuse_lost_work
from monitor.fleet.plan import Planner, check_unchanged, extend, signed_urls
from monitor.fleet.replaying import Replaying
from monitor.fleet.result import RESULT_NAME, Counts, Later, RecordingResult
from monitor.records.database import Closing

Records = Literal["days", "zarr"]
_READERS = 16
"""Results that are read at a time."""
_MAX_RESULTS_BYTES = 8 << 20
"""Of results in memory; more are kept on the disk."""

STORE, PAGE = "store", "page"
"""What the index calls finished of a Zarr archive: its store, or its page too; only then are their sources deleted."""


@dataclass(frozen=True)
class ArchivePlan:
    """What is asked for.

    Attributes:
        manifest: file of the manifest.
        out: folder or URL of the archive, which all workers reach.
        records: "days": a netCDF file a UTC day; "zarr": one store.
        part_blocks: blocks of a history after which its state is kept; None: as the archive was begun, or
            ``PART_BLOCKS``.
        resume: whether an archive that was begun is continued.
    """

    manifest: Path
    out: str
    records: Records = "days"
    part_blocks: int | None = None
    resume: bool = False

    def __post_init__(self) -> None:
        """Refuse an ``out`` that is no place of its own."""
        store = open_store(self.out)
        if not self.out.strip() or (isinstance(store, FolderStore) and len(Path(store.url).resolve().parts) == 1):
            raise ManifestError(f"--out: expected a folder or URL of the archive's own, got {self.out!r}")

    @property
    def work(self) -> str:
        """URL of what is needed until the archive is complete."""
        return f"{self.out.rstrip('/')}/{WORK_NAME}"

    @property
    def zarr_url(self) -> str:
        """URL of the one Zarr store."""
        return f"{self.out.rstrip('/')}/records.zarr"

    @property
    def records_url(self) -> str:
        """URL of the store of the daily files."""
        return self.out if self.records == "days" else f"{self.work}/records"


class Results(Closing):
    """The results of an archive in the order of its manifest, read from its store once.

    The first iteration keeps them in a temporary file; the recordings do not change meanwhile.
    """

    def __init__(self, index: Index, records: FileStore) -> None:
        """Take the index and the store of the records."""
        self._index, self._records = index, records
        self._kept = tempfile.SpooledTemporaryFile(max_size=_MAX_RESULTS_BYTES)  # noqa: SIM115 - see close()
        self._complete = False

    def close(self) -> None:
        """Delete the temporary file; closing twice does nothing."""
        self._kept.close()

    def __iter__(self) -> Iterator[RecordingResult]:
        """Yield the result of each recording that does not wait; ArchiveError where one is missing."""
        if not self._complete:
            yield from self._read()
            return
        place = 0
        while True:
            # Another iteration may move the file.
            self._kept.seek(place)
            line = self._kept.readline()
            if not line:
                return
            place = self._kept.tell()
            yield RecordingResult.from_json(line)

    def _read(self) -> Iterator[RecordingResult]:
        place = 0
        folders = (f"{machine}/{name}" for machine, name in self._index.folders())
        with ThreadPoolExecutor(_READERS) as pool:
            # Object storage answers late, and holds one file for each recording.
            while listed := [*islice(folders, _READERS)]:
                for result in pool.map(partial(read_result, self._records), listed):
                    self._kept.seek(place)
                    self._kept.write(result.to_json() + b"\n")
                    place = self._kept.tell()
                    yield result
        self._kept.seek(place)
        self._kept.truncate()
        self._complete = True


def prepare(plan: ArchivePlan, index: Index) -> SharedPlaces:
    """Plan an archive, or check that one goes on as it was planned; return what its tasks share.

    Raises:
        ManifestError: the manifest cannot be used or has changed; there is an archive already, and it is not resumed.
        WrongInputError: something else is in the place of the Zarr store.
        ConfigError: a configuration cannot be used.
    """
    work = open_store(plan.work)
    _check_place(plan, index)
    if index.planned and not plan.resume:
        raise ManifestError(
            f"--out {plan.out}: holds an archive; --resume continues it, --extend also adds recordings, "
            "or take another --out"
        )
    if not index.planned:
        refuse_lost_work(work)
        part_blocks = PART_BLOCKS if plan.part_blocks is None else plan.part_blocks
        begun = {"archive": secrets.token_hex(8), "records": plan.records, "part_blocks": str(part_blocks)}
        index.set_meta(**begun, finished="")
        try:
            Planner(index, work, _overlap(plan)).plan(plan.manifest, partial(_refuse_results, plan, index))
        except BaseException:
            delete_work(plan, index)
            raise
        # On the disk before any record: without its index an archive does not go on.
        index.settle()
    else:
        check_unchanged(index, plan.manifest, work)
        index.wait_again()
    meta = index.meta()
    return SharedPlaces(meta["archive"], open_store(plan.records_url).url, work.url, int(meta["part_blocks"]))


def _overlap(plan: ArchivePlan) -> Overlap:
    return Overlap(open_store(plan.out).url, machines=plan.records == "days")


def _refuse_results(plan: ArchivePlan, index: Index) -> None:
    if plan.records == "days":
        refuse_lost_results(index, open_store(plan.out))


def _check_place(plan: ArchivePlan, index: Index) -> None:
    meta = index.meta()
    if index.planned:
        stated = {"records": plan.records, "part_blocks": plan.part_blocks}
        for key, value in stated.items():
            if value is not None and meta[key] != str(value):
                option = f"--{key.replace('_', '-')}"
                raise ManifestError(f"--out {plan.out}: was begun with {option} {meta[key]}, got {value}")
    if plan.records == "zarr" and meta.get("store_begun") != "yes":
        refuse_unknown(open_store(plan.zarr_url))


def extend_archive(plan: ArchivePlan, index: Index) -> Later:
    """Add what the manifest names now to an archive that was planned; return what was added.

    Raises:
        ManifestError, ConfigError, RemoteError: as :func:`monitor.fleet.plan.extend`.
    """
    _check_place(plan, index)
    counts = index.counts()
    complete = counts.done == counts.recordings
    if complete and plan.records == "zarr":
        raise ManifestError(f"--out {plan.out}: --extend: a complete archive with --records zarr cannot be extended")
    try:
        return extend(index, plan.manifest, open_store(plan.work), _overlap(plan))
    except BaseException:
        if complete:
            delete_work(plan, index)
        raise


def replay_waiting(plan: ArchivePlan, index: Index, runner: Runner, noted: Callable[[], bool] = lambda: True) -> Counts:
    """Plan an archive unless that is done, replay what waits, and return the counts.

    Raises:
        ManifestError, ConfigError: as :func:`prepare`.
    """
    shared = prepare(plan, index)
    if index.left():
        # An older store or page in the place, whole or not, is of other results.
        index.set_meta(finished="", writing="")
    noted()
    signed = signed_urls(plan.manifest) if index.meta()["signed"] == "yes" else {}
    Replaying(index, shared, runner, signed, noted).run()
    return index.counts()


def delete_work(plan: ArchivePlan, index: Index) -> None:
    """Delete what an archive needs no more once it is complete, and no other file.

    The states at the ends of histories stay, since recordings that come later go on from them; of a Zarr archive, which
    cannot be extended, the results that its page can still be made of.
    """
    work = open_store(plan.work)
    kept: set[str | None] = set()
    if plan.records == "days":
        kept |= {checkpoint.state for _, checkpoint in index.checkpoints()}
    results = index.meta().get("finished") == STORE
    for name in [name for name in work.names() if OWN.fullmatch(name)]:
        if name not in kept and not (results and name.endswith(f"/{RESULT_NAME}")):
            work.delete(name)
    if isinstance(work, FolderStore):
        work.remove_if_empty()

"""What is made of the results of an archive once they are there: the one Zarr store, and the page of the fleet."""

from __future__ import annotations

import importlib
import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping
from datetime import UTC, tzinfo
from typing import Any

from models.words.errors import WrongInputError
from models.work.folder_store import open_store
from models.work.runner import Runner
from monitor.fleet.arrays import METADATA
from monitor.fleet.index import Index
from monitor.fleet.report import FleetEntry, channels_of, fleet_html, period_of, quality_of, shown_channels
from monitor.fleet.result import RecordingResult
from monitor.fleet.run import PAGE, STORE, ArchivePlan, Results


def fleet_page(
    results: Iterable[RecordingResult],
    *,
    title: str = "Bearing health: the fleet",
    zone: tzinfo = UTC,
    logs: Mapping[tuple[str, str], str] | None = None,
) -> str:
    """Return the page of an archive as HTML.

    Args:
        results: taken one by one, in the order of the manifest; of very many the worst are listed.
        title: of the page.
        zone: of dates.
        logs: of recordings that were set aside, by machine and recording.
    """
    return fleet_html(_entries(results, zone, logs or {}), title=title, zone=zone)


def _entries(
    results: Iterable[RecordingResult], zone: tzinfo, logs: Mapping[tuple[str, str], str]
) -> Iterator[FleetEntry]:
    for result in results:
        channels = channels_of(result.summary, zone)
        shown = shown_channels(channels)
        blocks = int(result.summary.get("blocks") or 0)
        yield FleetEntry(
            machine=result.machine,
            recording=result.recording,
            url=result.url,
            grade="failed" if result.status == "failed" else channels[0].grade if channels else "open",
            channels=shown,
            more=len(channels) - len(shown),
            accepted=int(result.summary.get("accepted") or 0),
            offered=blocks,
            quality=quality_of(result.summary),
            period=period_of(result.first, result.last, blocks, zone),
            last=result.last,
            reason=result.reason,
            log=logs.get((result.machine, result.recording), ""),
        )


REPORT_NAME = "fleet.html"


def zarr_writer() -> Any:
    """Return ``write_archive`` of the module that imports zarr.

    Raises:
        WrongInputError: the extra is not installed.
    """
    try:
        module = importlib.import_module("monitor.fleet.zarr_store")
    except ModuleNotFoundError as error:
        raise WrongInputError(f'--records zarr: pip install "spallwatch[cluster]" ({error.name} is missing)') from None
    return module.write_archive


def finish(
    plan: ArchivePlan,
    index: Index,
    runner: Runner,
    *,
    report: bool,
    confirm: Callable[[], None] = lambda: None,
    keep: Callable[[], None] = lambda: None,
) -> str | None:
    """Write the one Zarr store, if the archive is one, and the page, as far as an earlier run has not done so.

    Return the URL of the page, None where there is none. ``confirm`` is called before the metadata of the store and the
    page are written, ``keep`` before the first file of the store: a later process must find in the index that it was
    begun, and by which writing.

    Raises:
        LeaseLostError: as ``confirm`` and ``keep``.
        WrongInputError: the extra is not installed, or another Zarr store is in its place.
    """
    finished = _finished(plan, index)
    if finished == PAGE:
        return report_of(plan)
    records = open_store(plan.records_url)
    with Results(index, records) as results:
        if plan.records == "zarr" and finished != STORE:
            writing = index.meta().get("writing") or secrets.token_hex(8)
            index.set_meta(store_begun="yes", writing=writing)
            keep()
            zarr_writer()(results, records, plan.zarr_url, runner, confirm, writing)
            index.set_meta(writing="")
            _note_finished(plan, index, STORE)
        if not report:
            return None
        confirm()
        page = _write_report(plan, index, results)
    _note_finished(plan, index, PAGE)
    return page


def _finished(plan: ArchivePlan, index: Index) -> str:
    """Return what earlier runs have made of the results of all recordings: ``STORE``, ``PAGE`` or nothing, "".

    Of archives of daily files nothing: their results stay, and the page is made of them each time.
    """
    if not _is_complete(plan, index) or open_store(plan.zarr_url).read(METADATA) is None:
        return ""
    noted = index.meta().get("finished")
    if noted is None:
        # An index of an earlier version: what the store is made of was deleted once it was whole.
        return PAGE if next(iter(open_store(plan.records_url).names()), None) is None else ""
    return noted


def _note_finished(plan: ArchivePlan, index: Index, what: str) -> None:
    """Keep in the index what was made of the results; they are made again where a recording will be tried again."""
    if _is_complete(plan, index):
        index.set_meta(finished=what)


def _is_complete(plan: ArchivePlan, index: Index) -> bool:
    counts = index.counts()
    return plan.records == "zarr" and counts.recordings == counts.done > 0


def report_of(plan: ArchivePlan) -> str | None:
    """Return the URL of the page of an earlier run, None where there is none."""
    return None if open_store(plan.out).read(REPORT_NAME) is None else _report_url(plan)


def _report_url(plan: ArchivePlan) -> str:
    return f"{plan.out.rstrip('/')}/{REPORT_NAME}"


def _write_report(plan: ArchivePlan, index: Index, results: Results) -> str:
    """Write the page of the machines and recordings beside the index, and return its URL."""
    places = ((name.partition("/"), outcome.log) for name, outcome in index.wrong())
    logs = {(machine, name): log for (machine, _, name), log in places if log}
    page = fleet_page(results, title=f"Archive {plan.manifest.stem}", logs=logs)
    open_store(plan.out).write(REPORT_NAME, page.encode())
    return _report_url(plan)

"""The page of an archive: all machines and recordings, the worst first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, tzinfo

from monitor.fleet.report.entries import FleetEntry, channels_of, period_of, quality_of, shown_channels
from monitor.fleet.report.page import fleet_html
from monitor.fleet.result import RecordingResult


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

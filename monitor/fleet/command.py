"""``spallwatch archive``: many recordings of many machines, replayed into one place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.work.redact import redact
from monitor.commands import option
from monitor.commands.cluster_options import Sharing, sharing
from monitor.commands.common import emit, say

if TYPE_CHECKING:
    from monitor.fleet.index import Index
    from monitor.fleet.result import Counts
    from monitor.fleet.run import Records

_MAX_NAMED = 20


@click.group("archive")
def group() -> None:
    """Replay archives: many recordings of many machines, in folders or object storage, also on a cluster."""


@group.command("replay")
@click.argument("manifest", type=option.FILE)
@click.option("--out", required=True, type=option.PLACE, metavar="URL", help="Folder or object storage of the archive.")
@click.option(
    "--records",
    type=click.Choice(["days", "zarr"]),
    default="days",
    help="A netCDF file a UTC day and recording, or one Zarr store of all of them.",
)
@click.option(
    "--part-blocks",
    type=click.IntRange(min=200),
    help="Blocks of a recording after which its state is kept.  [default: 5000]",
)
@click.option("--extend", is_flag=True, help="Add the recordings that MANIFEST names since --out was begun.")
@click.option("--report/--no-report", default=True, help="Write fleet.html under --out.")
@sharing("Processes")
@option.output
def replay(
    manifest: Path,
    out: str,
    records: Records,
    part_blocks: int | None,
    extend: bool,
    report: bool,
    sharing: Sharing,
    as_json: bool,
    quiet: bool,
) -> None:
    """Replay the recordings of MANIFEST (TOML or CSV), each on its own or as the history of a machine.

    With --resume, what is done stays and what failed is tried again. With --extend, recordings are added as well: new
    ones, and those that continue a history at its end. Exit code 1 where a recording failed: the others are done.
    """
    from monitor.fleet.finish import finish, zarr_writer
    from monitor.fleet.place import INDEX_NAME, open_index
    from monitor.fleet.plan import grown_folders, later_recordings
    from monitor.fleet.result import Later
    from monitor.fleet.run import ArchivePlan, delete_work, extend_archive, replay_waiting

    if records == "zarr":
        # Not after all has been replayed.
        zarr_writer()
    plan = ArchivePlan(manifest, out, records, part_blocks=part_blocks, resume=sharing.resume or extend)

    def tell(text: str) -> None:
        say(f"spallwatch: {redact(text)}", quiet=quiet)

    with open_index(out, tell=tell) as opened, sharing.open(out, quiet=quiet, locked=False) as shared:
        index = opened.index
        begun = index.planned
        added = extend_archive(plan, index) if extend and begun else Later()
        before, grown = index.counts().done, grown_folders(index) if extend and begun else Later()
        later = later_recordings(index, manifest) if sharing.resume and begun and not extend else Later()
        counts = replay_waiting(plan, index, shared.runner, opened.noted)
        written = plan.zarr_url if records == "zarr" else out
        page = finish(plan, index, shared.runner, report=report, confirm=opened.confirm, keep=opened.keep)
        if counts.done == counts.recordings:
            opened.keep()
            delete_work(plan, index)
        values = _values(index, counts, f"{out.rstrip('/')}/{INDEX_NAME}")
    values |= {"kept": before, "out": redact(out), "records": redact(written)}
    for key, found in (("added", added), ("not_in_archive", later), ("grown", grown)):
        values[key] = {"recordings": found.recordings, "first": found.first or None}
    values |= {"report": None if page is None else redact(page), "cluster": shared.values()}
    emit(values, [*lines(values), *shared.lines()], as_json=as_json)
    if counts.failed or counts.set_aside:
        click.get_current_context().exit(1)


@group.command("status")
@click.argument("out", type=option.PLACE)
@option.output
def status(out: str, as_json: bool, quiet: bool) -> None:
    """Say how far the archive at OUT is, from its index."""
    from monitor.fleet.place import INDEX_NAME, open_index

    with open_index(out, read_only=True) as opened:
        values = _values(opened.index, opened.index.counts(), f"{out.rstrip('/')}/{INDEX_NAME}")
    values["out"] = redact(out)
    emit(values, lines(values), as_json=as_json)


def _values(index: Index, counts: Counts, place: str) -> dict[str, Any]:
    from monitor.fleet.result import STATUS_WORDS

    return {
        "recordings": counts.recordings,
        "waiting": counts.waiting,
        "done": counts.done,
        "failed": [
            {
                "recording": name,
                "status": STATUS_WORDS[outcome.status],
                "reason": outcome.reason,
                "log": outcome.log,
                "chunk": outcome.chunk,
            }
            for name, outcome in index.wrong()
        ],
        "blocks": counts.rows,
        "seconds": counts.seconds,
        "index": redact(place),
    }


def lines(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines for people."""
    waiting = f", {values['waiting']} wait" if values["waiting"] else ""
    kept = f" ({values['kept']} of them before)" if values.get("kept") else ""
    yield (
        f"{values['recordings']} recordings: {values['done']} done{kept}, {len(values['failed'])} failed{waiting}; "
        f"{values['blocks']} blocks in {values['seconds']:.1f} s of work"
    )
    if (added := values.get("added", {"recordings": 0}))["recordings"]:
        yield f"added: {added['recordings']} recordings that the manifest names since, {added['first']} the first"
    later = values.get("not_in_archive", {"recordings": 0})
    if later["recordings"]:
        yield (
            f"not in this archive: {later['recordings']} recordings that its patterns name since it was begun, "
            f"{later['first']} the first; --extend adds them"
        )
    if (grown := values.get("grown", {"recordings": 0}))["recordings"]:
        yield (
            f"not read: files that came since into {grown['recordings']} recordings, {grown['first']} the first; "
            "name them as recordings of their own"
        )
    for one in islice(values["failed"], _MAX_NAMED):
        yield f"{one['recording']} {one['status'].replace('_', ' ')}: {one['reason']}"
    if len(values["failed"]) > _MAX_NAMED:
        yield f"and {len(values['failed']) - _MAX_NAMED} more, in {values['index']}"
    if values.get("report"):
        yield f"report: {values['report']}"
    yield f"archive: {values['out']}"

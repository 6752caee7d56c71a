"""The place of the one Zarr store of an archive: whether it is free, ours, or holds something else. Without zarr."""

from __future__ import annotations

import json

from models.words.errors import WrongInputError
from models.work.task import FileStore
from monitor.fleet.arrays import ARCHIVE_VERSION

METADATA = "zarr.json"
"""Written last: with it a store is whole."""


def refuse_foreign(out: FileStore) -> None:
    """Refuse to write an archive over a Zarr store of something else.

    Raises:
        WrongInputError: it has metadata that are not those of an archive, or of a later version.
    """
    data = out.read(METADATA)
    if data is None:
        return
    try:
        version = json.loads(data)["attributes"]["spallwatch_archive"]
    except (ValueError, KeyError, TypeError):
        version = None
    if not isinstance(version, int) or version > ARCHIVE_VERSION:
        raise WrongInputError(
            f"{out.url}: is a Zarr store, but no archive of spallwatch up to version {ARCHIVE_VERSION}; it is left "
            "as it is"
        )


def refuse_unknown(out: FileStore) -> None:
    """Refuse a place in which no archive was begun, unless it is empty or holds a whole one.

    Raises:
        WrongInputError: as :func:`refuse_foreign`, or there are files without the metadata of an archive.
    """
    refuse_foreign(out)
    if out.read(METADATA) is None and (found := next(iter(out.names()), None)) is not None:
        raise WrongInputError(
            f"{out.url}: holds {found}, and no archive that was begun here; move it away, or take another --out"
        )

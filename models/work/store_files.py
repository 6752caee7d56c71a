"""The files of a runner in a store: what is found done, what was attempted, and which are its own to delete."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime

import numpy as np

from models.words.errors import WrongInputError
from models.work.folder_store import FolderStore
from models.work.program import processor, program, versions
from models.work.task import FileStore

_RUN = "run.json"
_FORMAT = 1
_OWN = re.compile(
    r"chunks/[0-9a-f]{2}/[0-9a-f]{40}|(shared|tasks)/[0-9a-f]{40}|(started|failed)/[0-9a-f]{40}/[0-9a-f-]+"
    r"|preflight/[0-9a-f]{16}(-\w+)?"
)


class KnownChunks:
    """The keys of all chunks in a store: 8 bytes of memory each, so that 10 million fit."""

    def __init__(self, store: FileStore) -> None:
        """List them."""
        # Two keys may begin alike; whether a chunk is there is known when it is read.
        keys = (int(name[-40:-24], 16) for name in store.names("chunks/") if _OWN.fullmatch(name))
        self._keys = np.sort(np.fromiter(keys, np.uint64))

    def __len__(self) -> int:
        """Return their number."""
        return len(self._keys)

    def __contains__(self, key: str) -> bool:
        """Return whether a chunk is likely in the store."""
        begin = np.uint64(int(key[:16], 16))
        place = int(np.searchsorted(self._keys, begin))
        return place < len(self._keys) and bool(self._keys[place] == begin)


def attempted_chunks(store: FileStore) -> set[str]:
    """Return the keys of chunks with markers or logs of earlier attempts."""
    names = (name for prefix in ("started/", "failed/") for name in store.names(prefix))
    return {name.split("/")[1] for name in names if _OWN.fullmatch(name)}


def write_shared(store: FileStore, name: str, data: bytes, *, again: bool = False) -> None:
    """Write what all tasks share, unless it is there; ``again``: a file that is there may be damaged."""
    if again or next(iter(store.names(f"shared/{name}")), None) is None:
        store.write(f"shared/{name}", data)


def write_run(store: FileStore) -> str | None:
    """Write of which program a store is; return a line for people where it was of another one.

    Raises:
        WrongInputError: the store has a file of that name which no runner wrote.
    """
    run = {
        "format": _FORMAT,
        "program": program(),
        "versions": versions(),
        "processor": processor(),
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    before = _program_of(store)
    store.write(_RUN, json.dumps(run, indent=1).encode())
    if before in (None, run["program"]):
        return None
    return f"{store.url} was begun by another version of the program: its chunks are not used"


def _program_of(store: FileStore) -> str | None:
    data = store.read(_RUN) or b"{}"
    if data == b"{}":
        return None
    try:
        return str(json.loads(data)["program"])
    except (ValueError, TypeError, KeyError):
        raise WrongInputError(f"{store.url}: holds a {_RUN} of something else; expected a place for chunks") from None


def check_writable(store: FileStore) -> None:
    """Read and write a file of a store that was begun; what the store raises tells that it is lost."""
    store.write(_RUN, store.read(_RUN) or b"{}")


def delete_own(store: FileStore) -> None:
    """Delete what runners put into a store, and no other file; the folder, too, where that leaves it empty."""
    prefixes = ("started/", "failed/", "chunks/", "tasks/", "shared/", "preflight/")
    for name in [name for prefix in prefixes for name in store.names(prefix) if _OWN.fullmatch(name)]:
        store.delete(name)
    store.delete(_RUN)
    if isinstance(store, FolderStore):
        store.remove_parts()
        store.remove_if_empty()

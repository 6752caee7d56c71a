"""An object that several processes write in turn: read with a tag, written only where it is still as it was read.

On S3 by conditional requests (``If-None-Match``, ``If-Match``). Where a server ignores or lacks them, and on other
kinds, it is compared before it is written and read again afterwards: two writers at the same moment can then both
believe that they were alone.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from hashlib import blake2b
from typing import Any, Protocol

from models.work.errors import ObjectStorageError

PAUSES_S = (0.1, 0.3, 1.0)
"""Before a conditional request is repeated that S3 refused because of another one (409), s."""


@dataclass(frozen=True)
class KeptObject:
    """An object as it was read.

    Attributes:
        data: its content.
        tag: of this content at this place.
        age_s: time since it was written by the clock of the server, s; None where the server does not say.
    """

    data: bytes
    tag: str
    age_s: float | None = None


class KeptStore(Protocol):
    """A store with objects that are written in turn; ObjectStorageError where a request fails."""

    @property
    def url(self) -> str:
        """URL of the store."""
        ...

    def read_kept(self, name: str) -> KeptObject | None:
        """Return an object, None where there is none."""
        ...

    def write_kept(self, name: str, data: bytes, tag: str | None) -> str | None:
        """Write an object where its tag is still this one (None: where there is none); return the new tag.

        None where another one is there, or where a server refused because of another request at the same moment; see
        :func:`write_unchanged`. ``data`` is unlike what any other process writes: what a lost answer leaves
        unknown is found by reading the object again.
        """
        ...

    def delete_kept(self, name: str, tag: str) -> None:
        """Delete an object where its tag is still this one; where a server lacks that condition, any that is there."""
        ...


def write_unchanged(store: KeptStore, name: str, data: bytes, tag: str | None) -> str | None:
    """Write an object as ``write_kept``, again where it was refused although it is as it was; return the new tag.

    None where another one is there.

    Raises:
        ObjectStorageError: a request fails, or each one is refused.
    """
    for pause in (*PAUSES_S, None):
        written = store.write_kept(name, data, tag)
        if written is not None:
            return written
        found = store.read_kept(name)
        if (None if found is None else found.tag) != tag:
            return None
        if pause is not None:
            time.sleep(pause)
    raise ObjectStorageError(f"{store.url}/{name} cannot be written: refused each time, though it is as it was")


def tag_of(data: bytes) -> str:
    """Return a tag by content, for servers without tags."""
    return blake2b(data, digest_size=16).hexdigest()


def age_of(answer: Mapping[str, Any]) -> float | None:
    """Return the age of an object by an answer of S3: its time of change against the server's ``Date``, s."""
    stated = answer.get("ResponseMetadata", {}).get("HTTPHeaders", {}).get("date")
    try:
        now = parsedate_to_datetime(stated)
        return (now - answer["LastModified"]).total_seconds()
    except (KeyError, TypeError, ValueError):
        return None

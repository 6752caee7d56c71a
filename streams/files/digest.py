"""The digest of the bytes of a file, and the rejection of one that changes while it is read."""

from __future__ import annotations

import hashlib

from streams.types.large import Data, pieces_of
from streams.types.samples import ReaderError


def content_hash(data: Data) -> str:
    """Return the BLAKE2b-128 digest of the bytes of a file, in hexadecimal."""
    digest = hashlib.blake2b(digest_size=16)
    for piece in pieces_of(data):
        digest.update(piece)
    return digest.hexdigest()


def hash_of_file(raw: Data, name: str) -> str:
    """Return :func:`content_hash` of a file that may be read from disk by that.

    Raises:
        ReaderError: ``changed`` where it has become shorter, ``unreadable`` where it cannot be read.
    """
    try:
        return content_hash(raw)
    except EOFError as error:
        raise changed_error(name) from error
    except OSError as error:
        raise ReaderError("unreadable", f"{name}: cannot be read ({error.strerror})") from error


def changed_error(name: str) -> ReaderError:
    """Return the rejection of a file that changed while it was read."""
    return ReaderError("changed", f"{name}: changed while it was read")

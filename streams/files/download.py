"""One file over HTTP, streamed to disk; what breaks off is continued, and its length is checked."""

from __future__ import annotations

import http.client
import re
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import BinaryIO

from models.words.errors import SpallwatchError
from models.work.redact import bare_url, redact
from streams.types.spec import SourceError

TIMEOUT_S = 30.0
ATTEMPTS = 5
_FIRST_PAUSE_S = 0.5
_PIECE = 1 << 20
_GONE = (404, 410)
_OF_THE_MOMENT = (408, 425, 429, 500, 502, 503, 504)
_CODE = re.compile(rb"<Code>([^<]{1,100})</Code>")
_MESSAGE = re.compile(rb"<Message>([^<]{1,200})</Message>")


class RemoteError(SpallwatchError):
    """A recording cannot be fetched now; the message names its URL, without credentials, and the cause."""


@dataclass(frozen=True)
class Downloaded:
    """A file that was fetched: bytes, entity tag and time of its last change (s since 1970 UTC) where stated."""

    size: int
    etag: str | None
    changed: float | None


def download(url: str, target: Path, max_bytes: int) -> Downloaded:
    """Fetch ``http://`` or ``https://`` into a file, at most ``max_bytes``.

    Raises:
        SourceError: there is nothing, or it is larger.
        RemoteError: the server refuses, cannot be reached, breaks off each time or states no length.
    """
    etag: str | None = None
    reason = ""
    for attempt in range(ATTEMPTS):
        if attempt:
            time.sleep(_FIRST_PAUSE_S * 2 ** (attempt - 1))
        try:
            with target.open("r+b" if target.exists() else "w+b") as file:
                return _continue(url, file, etag, max_bytes)
        except _BrokenOffError as error:
            etag, reason = error.etag, error.reason
    raise RemoteError(f"{bare_url(url)}: {reason} ({ATTEMPTS} tries)")


class _BrokenOffError(RemoteError):
    """A try that may be repeated, from where it ended if the entity tag is the same."""

    def __init__(self, reason: str, etag: str | None = None) -> None:
        super().__init__(reason)
        self.reason = redact(reason)
        self.etag = etag


def _continue(url: str, file: BinaryIO, etag: str | None, max_bytes: int) -> Downloaded:
    """Fetch what is missing of a file of which a part may be there."""
    there = file.seek(0, 2) if etag is not None else 0
    headers = {"User-Agent": "spallwatch"}
    if there and etag is not None:
        headers |= {"Range": f"bytes={there}-", "If-Range": etag}
    try:
        answer = urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=TIMEOUT_S)
    except urllib.error.HTTPError as error:
        with error:
            raise _refusal(url, error) from None
    except (urllib.error.URLError, OSError, http.client.HTTPException, ValueError) as error:
        raise _BrokenOffError(_words(error)) from None
    with answer:
        start = 0
        if answer.status == 206:
            if answer.headers.get("ETag") != etag or not _begins_at(answer.headers.get("Content-Range"), there):
                raise _BrokenOffError("the file changed while it was fetched")
            start = there
        return _written(url, answer, file, start, max_bytes)


def _begins_at(content_range: str | None, start: int) -> bool:
    return content_range is not None and content_range.startswith(f"bytes {start}-")


def _written(url: str, answer: http.client.HTTPResponse, file: BinaryIO, start: int, max_bytes: int) -> Downloaded:
    """Write the body of an answer to a file from ``start`` on."""
    stated, etag = answer.headers.get("Content-Length"), answer.headers.get("ETag")
    if stated is None and not answer.chunked:
        raise RemoteError(f"{bare_url(url)}: the server states no length, so that a part cannot be told from the whole")
    if stated is not None and not stated.isdecimal():
        raise RemoteError(f"{bare_url(url)}: the server states a length of {stated[:20]!r}, expected bytes")
    whole = None if stated is None else start + int(stated)
    refuse_size(bare_url(url), whole or 0, max_bytes)
    # A weak tag promises no equal bytes: such a file is begun anew.
    strong = etag if etag and not etag.startswith("W/") else None
    file.seek(start)
    file.truncate()
    size = start
    try:
        while piece := answer.read(_PIECE):
            size += len(piece)
            refuse_size(bare_url(url), size, max_bytes)
            file.write(piece)
    except (OSError, http.client.HTTPException) as error:
        raise _BrokenOffError(_words(error), strong) from None
    if whole is not None and size != whole:
        raise _BrokenOffError(f"broke off after {size} of {whole} bytes", strong)
    return Downloaded(size, etag, _stamp(answer.headers.get("Last-Modified")))


def refuse_size(name: str, size: int, max_bytes: int) -> None:
    """Raise SourceError where more bytes are to be fetched than there is room for."""
    if size > max_bytes:
        raise SourceError(f"{name}: {size} bytes, the scratch folder may hold {max_bytes}")


def _refusal(url: str, error: urllib.error.HTTPError) -> Exception:
    """Return what an answer with an error status means; object storages say more in a body of XML."""
    try:
        body = error.read(4096)
    except (OSError, http.client.HTTPException):
        body = b""
    said = ": ".join(
        found[1].decode("utf-8", "replace") for found in (_CODE.search(body), _MESSAGE.search(body)) if found
    )
    text = f"HTTP {error.code} {error.reason}" + (f" ({said})" if said else "")
    if error.code in _OF_THE_MOMENT:
        return _BrokenOffError(text)
    kind = SourceError if error.code in _GONE else RemoteError
    return kind(f"{bare_url(url)}: {redact(text)}")


def _words(error: Exception) -> str:
    reason = error.reason if isinstance(error, urllib.error.URLError) else error
    text = reason.strerror if isinstance(reason, OSError) and reason.strerror else str(reason)
    return f"{type(reason).__name__}: {text}" if isinstance(reason, Exception) else text


def _stamp(text: str | None) -> float | None:
    try:
        return None if text is None else parsedate_to_datetime(text).timestamp()
    except ValueError:
        return None

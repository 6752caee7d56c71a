"""File systems of object storage by their URLs; the one module that imports fsspec, and only when a URL asks for it.

Keys, endpoints and other options come from the environment (``AWS_*``, ``FSSPEC_S3_*``) and the configuration files of
AWS and fsspec, never from a URL: URLs are printed and stored.
"""

from __future__ import annotations

import importlib
import os
import re
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from functools import partial
from typing import Any, TypeVar, cast

from models.words.errors import SpallwatchError, WrongInputError
from models.work.redact import has_user_info, redact

_S3 = ("s3", "s3a")
_QUERY = re.compile(r"\?[\w.-]+=")
_S3_LIMITS: dict[str, object] = {"connect_timeout": 10, "read_timeout": 30}
_S3_ATTEMPTS = 5
"""Tries of a request that is refused, answered by 5xx or throttled; the waits between them double, below 8 s.

In the mode "legacy": "standard" makes only some 100 repetitions in the life of a process that storage failed.
"""
_S3_ROUNDS = 2
"""How often s3fs begins such a series anew where an answer broke off."""
_PAUSES_S = (0.2, 1.0, 5.0)
"""Before an action is begun anew, s."""
_INCOMPLETE = ("ClientPayloadError", "IncompleteReadError", "ResponseStreamingError", "FlexibleChecksumError")
"""Exceptions of botocore and aiohttp for answers that broke off, or that do not have their checksum."""
_PREFIX = re.compile(r"^\[Errno \d+\] |^An error occurred \([^)]*\) when calling the \w+ operation(?: \([^)]*\))?: ")

MAX_HELD_NAMES = 1_000_000
"""Names of one listing that is held in memory, about 1 kB each."""

T = TypeVar("T")


def filesystem(url: str, *, asynchronous: bool = False) -> tuple[Any, str]:
    """Return the fsspec file system of a URL such as ``s3://BUCKET/FOLDER``, and the path in it.

    Listings are never taken from a cache: other processes write. An ``asynchronous`` one, for zarr, makes its requests
    in threads: one that is asynchronous itself never closes its connections.

    Raises:
        WrongInputError: credentials in the URL, a chain of URLs, a scheme that fsspec does not know, a missing package.
    """
    scheme, _, rest = url.partition("://")
    shown = redact(url)
    if has_user_info(url):
        raise WrongInputError(
            f"{shown}: credentials in a URL; expected them in the environment (such as AWS_SECRET_ACCESS_KEY) or in a "
            "configuration file of AWS or fsspec"
        )
    if "::" in url or _QUERY.search(rest):
        raise WrongInputError(f"{shown}: expected SCHEME://BUCKET/FOLDER without '::' and without a query")
    if not rest.strip("/"):
        raise WrongInputError(f"{shown}: expected a bucket, {scheme}://BUCKET/FOLDER")
    try:
        registry: Any = importlib.import_module("fsspec")
        kind: Any = registry.get_filesystem_class(scheme)
    except ValueError:
        raise WrongInputError(f"{shown}: {scheme}:// is not a kind of object storage that fsspec knows") from None
    except ImportError as error:
        extra = "s3" if scheme in _S3 else "cluster"
        missing = error.name or str(error)
        raise WrongInputError(f'{shown}: needs pip install "spallwatch[{extra}]" ({missing})') from None
    options: dict[str, Any] = {"use_listings_cache": False}
    if scheme in _S3:
        options |= _s3_options(kind)
    try:
        # The host, for kinds that are no buckets.
        found = kind(**kind._get_kwargs_from_urls(url), **options)
    except Exception as error:
        raise WrongInputError(f"{shown}: {scheme}:// cannot be used ({cause(error)})") from None
    if scheme in _S3:
        found.retries = _S3_ROUNDS
        # By it s3fs lists whatever it lists; it asks for further pages for as long as a server has any.
        pages: Any = kind._list_pages
        found._list_pages = partial(_guarded_pages, pages, found)
    path = str(kind._strip_protocol(url)).rstrip("/")
    if asynchronous:
        wrapper: Any = importlib.import_module("fsspec.implementations.asyn_wrapper")
        found = wrapper.AsyncFileSystemWrapper(found, asynchronous=True)
    return found, path


def _s3_options(kind: Any) -> dict[str, Any]:
    """Return timeouts and retries, except those that the configuration or the environment states."""
    config: Any = importlib.import_module("fsspec.config")
    stated: dict[str, Any] = config.apply_config(kind, {}).get("config_kwargs", {})
    limits = dict(_S3_LIMITS)
    if not {"AWS_MAX_ATTEMPTS", "AWS_RETRY_MODE"} & os.environ.keys():
        limits["retries"] = {"total_max_attempts": _S3_ATTEMPTS, "mode": "legacy"}
    return {"config_kwargs": {**limits, **stated}}


def is_below(name: str) -> bool:
    """Return whether a name of parts joined by "/" stays below the folder that it is of, on any system."""
    return not any(part in ("", ".", "..") or "\\" in part for part in name.split("/"))


class ListingError(SpallwatchError):
    """A server lists what no bucket holds: the message says what."""


class Listing:
    """Checks the pages of one listing of S3: it goes on, stays below its prefix, and ends."""

    def __init__(self, prefix: str, max_names: int) -> None:
        """Begin with the prefix that was asked for, and with the number of names that are believed."""
        self._prefix, self._max_names = prefix, max_names
        self._names = 0
        self._begins: set[str] = set()

    def check(self, page: Mapping[str, Any]) -> str | None:
        """Return the token of the next page, None after the last one; ListingError where a page cannot be right."""
        names = [str(entry["Key"]) for entry in page.get("Contents", ())]
        names += [str(entry["Prefix"]) for entry in page.get("CommonPrefixes", ())]
        if foreign := [name for name in names if not name.startswith(self._prefix)]:
            raise ListingError(f"lists {foreign[0][:80]!r}, expected names that begin with {self._prefix!r}")
        self._names += len(names)
        if self._names > self._max_names:
            raise ListingError(f"lists more than {self._max_names} names, expected fewer")
        if not page.get("IsTruncated"):
            return None
        token = page.get("NextContinuationToken")
        marks = {f"token {token}", f"name {names[0]}"} if names else {f"token {token}"}
        if not token or self._begins & marks:
            raise ListingError(
                "lists the same again and again" if token else "says that names are missing, but no token"
            )
        self._begins |= marks
        return str(token)


async def _guarded_pages(pages: Callable[..., Any], files: Any, method: str, **options: Any) -> AsyncIterator[Any]:
    """Yield the pages of a listing of s3fs, each after it was checked."""
    listing = Listing(str(options.get("Prefix", "")), MAX_HELD_NAMES)
    async for page in pages(files, method, **options):
        listing.check(page)
        yield page


def repeated(action: Callable[[], T]) -> T:
    """Return what an action returns, begun anew where an answer was incomplete in spite of repeated requests."""
    for pause in _PAUSES_S:
        try:
            return action()
        except Exception as error:
            if not any(type(part).__name__ in _INCOMPLETE for part in chain(error)):
                raise
        time.sleep(pause)
    return action()


def in_loop(files: Any, request: Callable[[], Awaitable[T]]) -> T:
    """Return what a request of an asynchronous file system answers, made in its own event loop."""
    asynchronous: Any = importlib.import_module("fsspec.asyn")
    return asynchronous.sync(files.loop, request)


def chain(error: BaseException) -> Iterator[BaseException]:
    """Yield an exception and those that caused it."""
    found: BaseException | None = error
    while found is not None:
        yield found
        found = found.__cause__ or (None if found.__suppress_context__ else found.__context__)


def error_code(error: BaseException) -> str | None:
    """Return the code of S3 for what went wrong, such as ``NoSuchBucket``, None where there is none."""
    for part in chain(error):
        response = getattr(part, "response", None)
        if isinstance(response, dict):
            stated = cast("dict[str, object]", response).get("Error")
            if isinstance(stated, dict):
                return str(cast("dict[str, object]", stated).get("Code"))
    return None


def cause(error: BaseException) -> str:
    """Return in one line, without credentials, why a request failed."""
    if isinstance(error, RecursionError):
        # botocore follows a redirection that names no region to the same place.
        return "the endpoint redirects requests; expected its own address and region"
    code = error_code(error)
    lines = str(error).strip().splitlines()
    text = lines[0] if lines else ""
    if isinstance(error, OSError) and error.strerror and not code:
        text = error.strerror
    while found := _PREFIX.match(text):
        text = text[found.end() :]
    name = code if code and not code.isdigit() else type(error).__name__
    said = {"403": "denied", "404": "not found"}.get(code or "", text)
    return redact(f"{name}: {said}" if said else name)

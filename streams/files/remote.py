"""Recordings in object storage and behind HTTP: found by their URLs, fetched for as long as they are needed.

A URL is that of fsspec (``s3://BUCKET/FOLDER``), ``https://`` with or without a signed query, or ``file://``, where
nothing is copied. The kind of a source may stand before it: ``dataset:ims:s3://BUCKET/FOLDER``.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

from models.platform.scratch import free_bytes, scratch_folder
from models.words.errors import SpallwatchError
from models.work.filesystem import ListingError, cause, error_code, filesystem, is_below, repeated
from models.work.redact import bare_url, has_user_info, redact
from streams.files.container import is_archive
from streams.files.download import RemoteError, download, refuse_size
from streams.files.groups import FilesBeside
from streams.types.listing import is_skipped, natural_key, shown
from streams.types.spec import SourceError

_URL = re.compile(r"(?P<kind>(?:dataset:[^:]*:|folder:)?)(?P<url>(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*)://.*)", re.DOTALL)
_LIVE = ("tcp", "mqtt")
_HTTP = ("http", "https")
_GLOB = re.compile(r"[*?\[]")
_FILES_AT_A_TIME = 16
FETCHED = "fetched-"
NOTHING_BESIDE = FilesBeside()
_MD5 = re.compile(r"[0-9a-f]{32}")


@dataclass(frozen=True)
class RemoteFile:
    """One object: its path in the file system, its name below the recording, bytes, entity tag, time of change."""

    path: str
    name: str
    size: int
    etag: str | None = None
    changed: float | None = None


@dataclass(frozen=True)
class Fetched:
    """A recording that is on this machine now.

    Attributes:
        url: of the local copy, as sources are named: its path, behind the kind of the source where one was given.
        path: file or folder.
        size: bytes that were fetched.
        etags: entity tags of the files by name, as far as the server states them.
    """

    url: str
    path: Path
    size: int
    etags: dict[str, str]


def is_remote(url: str) -> bool:
    """Return whether the URL of a source names what has to be fetched, or a ``file://``."""
    found = _URL.fullmatch(url)
    return found is not None and found["scheme"].lower() not in _LIVE


def bare(url: str, hide: Callable[[str], str] = redact) -> str:
    """Return a URL without user info, query and fragment: the name of a recording whose signature changes each day.

    ``hide`` is from :func:`models.work.redact.redactor` where there are many.
    """
    found = _URL.fullmatch(url)
    return url if found is None else found["kind"] + bare_url(found["url"], hide)


def expand(url: str) -> list[str]:
    """Return the URLs that a pattern (``*``, ``?``, ``[...]``, ``**``) names, in natural order; else the URL itself.

    Raises:
        SourceError: nothing fits the pattern.
        RemoteError: the storage cannot be listed.
    """
    kind, place, scheme = split_url(url)
    if scheme in _HTTP or not _GLOB.search(place):
        return [url]
    if scheme == "file":
        root = Path(_local(place))
        relative = root.relative_to(root.anchor)
        found = [path.as_uri() for path in Path(root.anchor).glob(str(relative))]
    else:
        files, path = filesystem(place)
        with foreseen(place, "listed"):
            paths: list[str] = repeated(lambda: files.glob(path)) or _nothing(files, path)
        found = [f"{scheme}://{name.strip('/')}" for name in paths]
    found = [name for name in found if not is_skipped(PurePosixPath(name).name)]
    if not found:
        raise SourceError(f"{redact(url)}: nothing fits this pattern")
    return [kind + name for name in sorted(found, key=natural_key)]


@contextmanager
def fetched(
    url: str, scratch: Path, max_bytes: int | None = None, *, beside: FilesBeside = NOTHING_BESIDE
) -> Generator[Fetched]:
    """Fetch a recording (an object, or all below a prefix) below ``scratch``; it is removed at the end.

    With an object come the files that are read with it, where they are there; with a file behind HTTP none. Names of
    files and of the folder are kept, as they may date or name blocks.

    Args:
        max_bytes: limit of what is fetched, by default nine tenths of what is free there; the sum of a recording is
            compared with it before the first byte.
        beside: which files are read with another one, by the patterns of the source.

    Raises:
        SourceError: nothing is there, it is too large, a name leads out of the folder, credentials stand in the URL.
        RemoteError: the storage refuses or cannot be reached, or a file changed while it was fetched.
    """
    kind, place, scheme = split_url(url)
    if scheme == "file":
        path = Path(_local(place))
        if not path.exists():
            raise SourceError(f"{url}: there is no such file or folder")
        yield Fetched(f"{kind}{path}", path, 0, {})
        return
    allowed = free_bytes(scratch) if max_bytes is None else max_bytes
    with scratch_folder(FETCHED, scratch) as folder:
        http = scheme in _HTTP
        found = _fetch_http(place, folder, allowed) if http else _fetch_objects(place, folder, allowed, beside)
        yield Fetched(f"{kind}{found.path}", found.path, found.size, found.etags)


@contextmanager
def local_source(url: str | None, folder: Path, beside: FilesBeside = NOTHING_BESIDE) -> Generator[str | None]:
    """Give the URL of a source that can be opened here: of its copy in ``folder`` where it is remote, else itself.

    The folder is made for a copy and removed with it, unless something else is in it. ``beside`` as of :func:`fetched`.

    Raises:
        SourceError, RemoteError: as :func:`fetched`.
    """
    if url is None or not is_remote(url):
        yield url
        return
    try:
        with fetched(url, folder, beside=beside) as recording:
            yield recording.url
    finally:
        with suppress(OSError):
            folder.rmdir()


def remote_files(url: str) -> list[RemoteFile]:
    """Return the objects of a recording, in natural order of their names: one, or all below a prefix.

    Raises:
        SourceError: nothing is there.
        RemoteError: the storage refuses or cannot be reached.
    """
    files, path = filesystem(url)
    with foreseen(url, "listed"):
        entries: dict[str, dict[str, Any]] = repeated(lambda: files.find(path, detail=True))
    if list(entries) == [path]:
        return [_entry(PurePosixPath(path).name, path, entries[path])]
    inside = (
        (name.lstrip("/")[len(path.strip("/")) + 1 :], name, entry)
        for name, entry in entries.items()
        if not name.endswith("/") and entry.get("type") == "file"
    )
    found = [_entry(name, place, entry) for name, place, entry in inside if not any(map(is_skipped, name.split("/")))]
    if not found:
        raise SourceError(f"{redact(url)}: there is no such object, and none below it")
    return sorted(found, key=lambda file: natural_key(file.name))


def split_url(url: str) -> tuple[str, str, str]:
    """Return the kind of a source, its URL and the scheme; SourceError for credentials in it."""
    found = _URL.fullmatch(url)
    if found is None:
        raise SourceError(f"{url!r}: expected a URL such as s3://BUCKET/FOLDER")
    if has_user_info(url):
        raise SourceError(
            f"{redact(url)}: credentials in a URL; expected them in the environment or a configuration file"
        )
    return found["kind"], found["url"], found["scheme"].lower()


def _nothing(files: Any, pattern: str) -> list[str]:
    """Return no paths; raise where a pattern has no bucket, which fsspec's ``glob`` does not tell."""
    bucket, _, path = pattern.partition("/")
    if hasattr(files, "call_s3"):
        files.call_s3("list_objects_v2", Bucket=bucket, Prefix=_GLOB.split(path)[0], MaxKeys=1)
    return []


def _local(url: str) -> str:
    parts = urlsplit(url)
    if parts.netloc not in ("", "localhost") or not parts.path:
        raise SourceError(f"{url}: expected file:///PATH")
    return unquote(parts.path)


def _entry(name: str, path: str, entry: dict[str, Any]) -> RemoteFile:
    """Return what a file system says of an object, each with words of its own."""
    etag = next((str(entry[key]).strip('"') for key in ("ETag", "etag") if entry.get(key)), None)
    times = (entry.get(key) for key in ("LastModified", "last_modified", "updated", "mtime", "created"))
    changed = next((time for time in times if isinstance(time, datetime)), None)
    return RemoteFile(path, name, int(entry["size"]), etag, None if changed is None else changed.timestamp())


def _fetch_http(url: str, folder: Path, allowed: int) -> Fetched:
    name = PurePosixPath(unquote(urlsplit(url).path)).name or "recording"
    target = target_of(folder, name, url)
    found = download(url, target, allowed)
    _set_time(target, found.changed)
    return Fetched("", target, found.size, {} if found.etag is None else {name: found.etag.strip('"')})


def _fetch_objects(url: str, folder: Path, allowed: int, beside: FilesBeside) -> Fetched:
    found = remote_files(url)
    path = filesystem(url)[1]
    one = len(found) == 1 and found[0].path.strip("/") == path.strip("/")
    if one:
        found += _files_beside(url, found[0], beside)
    size = sum(file.size for file in found)
    count = f"{url} ({len(found)} files)" if len(found) > 1 else url
    refuse_size(count, size, allowed)
    root = folder if one else folder / PurePosixPath(path).name
    fetch_files(url, found, {file.path: target_of(root, file.name, url) for file in found})
    return Fetched(
        "", root / found[0].name if one else root, size, {file.name: file.etag for file in found if file.etag}
    )


def _files_beside(url: str, file: RemoteFile, beside: FilesBeside) -> list[RemoteFile]:
    """Return the objects that are read with one, as far as they are there; an archive has none."""
    if is_archive(file.name):
        return []
    files, folder = filesystem(url)[0], file.path.removesuffix(file.name)
    found: list[RemoteFile] = []
    with foreseen(url, "listed"):
        for name in beside.all(file.name):
            with suppress(FileNotFoundError):
                entry = repeated(partial(files.info, folder + name))
                found += [_entry(name, folder + name, entry)] if entry.get("type") == "file" else []
    return found


def fetch_files(url: str, found: Sequence[RemoteFile], targets: Mapping[str, Path]) -> None:
    """Fetch objects of one URL to the paths of ``targets``, several at a time, and compare them with their entries.

    Raises:
        SourceError, RemoteError: as :func:`fetched`.
    """
    files = filesystem(url)[0]
    with foreseen(url, "fetched"):
        for folder in {target.parent for target in targets.values()}:
            folder.mkdir(parents=True, exist_ok=True)
        _get_all(files, found, targets)
    for file in found:
        _check(files, file, targets[file.path], url)


def _get_all(files: Any, found: Sequence[RemoteFile], targets: Mapping[str, Path]) -> None:
    """Fetch objects, several at a time: a request waits for the network most of its time.

    In threads: where a file fails, fsspec's own ``get`` leaves the others under way.
    """
    pool = ThreadPoolExecutor(_FILES_AT_A_TIME if files.async_impl else 1)
    try:
        for done in [pool.submit(_get, files, file, targets[file.path]) for file in found]:
            done.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _get(files: Any, file: RemoteFile, target: Path) -> None:
    repeated(lambda: files.get_file(file.path, str(target), callback=_Arrived(file)))


class _Arrived:
    """Ends a transfer that brings more than was listed, before it fills the disk: a callback as fsspec takes it."""

    def __init__(self, file: RemoteFile) -> None:
        self._file, self._size = file, 0

    def set_size(self, size: int | None) -> None:
        # Here s3fs would leave the connection open.
        pass

    def relative_update(self, count: int = 1) -> None:
        self._size += count
        if self._size > self._file.size:
            counts = f"{self._file.size} bytes before, at least {self._size} came"
            raise RemoteError(f"{redact(self._file.path)}: changed while it was fetched ({counts})")


def _check(files: Any, file: RemoteFile, target: Path, url: str) -> None:
    """Compare a file with what the storage said of it beforehand, and give it its date."""
    where = f"{urlsplit(url).scheme}://{file.path.strip('/')}"
    with foreseen(where, "fetched"):
        size = target.stat().st_size
        same = size == file.size and (_has_digest(target, file.etag) or _is_same(files, file))
    if not same:
        raise RemoteError(f"{redact(where)}: changed while it was fetched ({file.size} bytes before, {size} came)")
    _set_time(target, file.changed)


def _has_digest(target: Path, etag: str | None) -> bool:
    """Return whether an entity tag is the MD5 of a file, as S3 makes it of objects that were sent in one part."""
    if etag is None or not _MD5.fullmatch(etag):
        return False
    with target.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.md5(usedforsecurity=False)).hexdigest() == etag


def _is_same(files: Any, file: RemoteFile) -> bool:
    """Return whether the storage still says of an object what it said before, as far as it says it both times."""
    now = _entry(file.name, file.path, files.info(file.path))
    pairs = ((now.size, file.size), (now.etag, file.etag), (now.changed, file.changed))
    return all(None in pair or pair[0] == pair[1] for pair in pairs)


def target_of(folder: Path, name: str, url: str) -> Path:
    """Return where a file goes; SourceError for a name that no folder can hold."""
    if not is_below(name) or "\0" in name:
        raise SourceError(f"{redact(url)}: the name {shown(name)!r} cannot be that of a file")
    return folder.joinpath(*name.split("/"))


def _set_time(target: Path, changed: float | None) -> None:
    if changed is not None:
        os.utime(target, (changed, changed))


@contextmanager
def foreseen(url: str, done: str) -> Iterator[None]:
    """Raise SourceError or RemoteError for whatever a file system raises, of the storage or of this machine."""
    try:
        yield
    except ListingError as error:
        raise RemoteError(f"{redact(url)} {error}") from None
    except SpallwatchError:
        raise
    except Exception as error:
        text = f"{redact(url)} cannot be {done}: {cause(error)}"
        gone = isinstance(error, FileNotFoundError) or error_code(error) == "NoSuchBucket"
        raise (SourceError if gone else RemoteError)(text) from None

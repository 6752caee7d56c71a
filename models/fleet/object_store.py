"""A store in a bucket of an object storage: S3 and what speaks as it does, and others that fsspec knows.

An object is written by one request, so that readers see all of it or nothing. Requests that fail on the way or are
throttled are repeated (``models.work.filesystem``); what is left is a ObjectStorageError with the URL and the cause.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from functools import partial
from hashlib import blake2b
from typing import Any

from models.words.errors import SpallwatchError, WrongInputError
from models.work.errors import ObjectStorageError
from models.work.filesystem import Listing, ListingError, cause, error_code, filesystem, in_loop, is_below, repeated
from models.work.redact import redact

SCHEMES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "memory")
"""Where a file appears whole or not at all. Of these s3 is tested against a server; memory is for tests."""
_MAX_NAMES = 100_000_000
"""Names below a prefix that are believed; they are not held."""
_CHANGED = ("PreconditionFailed", "412", "ConditionalRequestConflict", "409", "NoSuchKey", "404")
"""Codes of S3 for a conditional request that found another object, or one that is being written or gone."""

_WITHOUT_CONDITION = ("NotImplemented", "InvalidArgument", "InvalidRequest")
"""Codes of servers that delete, but know no condition of it."""


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


class ObjectStore:
    """Objects below a prefix of a bucket.

    Attributes:
        url: of the prefix, without a slash at its end; it holds no credentials.
    """

    def __init__(self, url: str) -> None:
        """Name the prefix; nothing is asked of the server yet.

        Raises:
            WrongInputError: not such a URL, credentials in it, or a package that is missing.
        """
        scheme = url.partition("://")[0]
        if scheme not in SCHEMES:
            raise WrongInputError(
                f"{redact(url)}: {scheme}:// does not write a file in one step; expected a folder or one of "
                + ", ".join(f"{known}://" for known in SCHEMES if known != "memory")
            )
        self._files, self._root = filesystem(url)
        self.url = url.rstrip("/")
        self._is_s3 = scheme in ("s3", "s3a")
        # One GET; several ranges at a time would ask for the size first.
        self._read_options: dict[str, Any] = {"max_concurrency": 1} if self._is_s3 else {}

    def read(self, name: str) -> bytes | None:
        """Return an object, None where there is none; ObjectStorageError where that is not known."""
        path = self._path(name)
        with self._foreseen(name, "read"):
            try:
                return bytes(repeated(lambda: self._files.cat_file(path, **self._read_options)))
            except FileNotFoundError as error:
                if error_code(error) == "NoSuchBucket":
                    raise
                return None

    def write(self, name: str, data: bytes, *, durable: bool = True) -> None:
        """Write an object whole; ObjectStorageError where that fails."""
        path = self._path(name)
        with self._foreseen(name, "written"):
            repeated(lambda: self._files.pipe_file(path, data))

    def delete(self, name: str) -> None:
        """Delete an object if it is there; ObjectStorageError where that fails."""
        path = self._path(name)
        with self._foreseen(name, "deleted"):
            try:
                repeated(lambda: self._files.rm_file(path))
            except FileNotFoundError as error:
                if error_code(error) == "NoSuchBucket":
                    raise

    def names(self, prefix: str = "") -> Iterator[str]:
        """Yield the names of all objects that begin so; what a server keeps as a folder is none.

        Answer by answer, or folder by folder: of ten million names, few are held at a time.
        """
        if self._is_s3:
            yield from self._s3_names(prefix)
            return
        folders = [prefix.rpartition("/")[0]]
        while folders:
            folder = folders.pop()
            for name, is_folder in self._entries(folder):
                if is_folder:
                    if name.startswith(prefix) or prefix.startswith(f"{name}/"):
                        folders.append(name)
                elif name.startswith(prefix):
                    yield name

    def _s3_names(self, prefix: str) -> Iterator[str]:
        """Yield names as S3 lists them, by prefix; one request for each thousand, and one where there is none."""
        bucket, _, root = self._root.partition("/")
        root = f"{root}/" if root else ""
        options: dict[str, str] = {}
        listing = Listing(f"{root}{prefix}", _MAX_NAMES)
        while True:
            with self._foreseen(prefix, "listed"):
                ask: Any = partial(self._files.call_s3, "list_objects_v2", Bucket=bucket, Prefix=f"{root}{prefix}")
                answer: dict[str, Any] = repeated(partial(ask, **options))
                token = listing.check(answer)
            for entry in answer.get("Contents", ()):
                # The mark of a folder, as some programs make an object of it.
                if not entry["Key"].endswith("/"):
                    yield entry["Key"][len(root) :]
            if token is None:
                return
            options = {"ContinuationToken": token}

    def _entries(self, folder: str) -> list[tuple[str, bool]]:
        """Return names and kinds of what stands in a folder, nothing where there is no such folder."""
        place = f"{self._root}/{folder}".rstrip("/")
        with self._foreseen(folder, "listed"):
            try:
                found: list[dict[str, Any]] = self._files.ls(place, detail=True)
            except FileNotFoundError as error:
                if error_code(error) == "NoSuchBucket":
                    raise
                return []
        entries: list[tuple[str, bool]] = []
        for entry in found:
            path = str(entry["name"]).lstrip("/") if not self._root.startswith("/") else str(entry["name"])
            # The folder itself, as some programs make an object of it.
            if path.rstrip("/") != place and not (entry["type"] != "directory" and path.endswith("/")):
                entries.append((path[len(self._root) + 1 :].rstrip("/"), entry["type"] == "directory"))
        return entries

    def read_kept(self, name: str) -> KeptObject | None:
        """Return an object that is written in turn, None where there is none; ObjectStorageError otherwise."""
        if not self._is_s3:
            data = self.read(name)
            return None if data is None else KeptObject(data, tag_of(data))
        bucket, _, key = self._path(name).partition("/")

        async def get() -> tuple[dict[str, Any], bytes]:
            answer = await self._files._call_s3("get_object", Bucket=bucket, Key=key)
            async with answer["Body"] as body:
                return answer, await body.read()

        with self._foreseen(name, "read"):
            try:
                answer, data = repeated(lambda: in_loop(self._files, get))
            except FileNotFoundError as error:
                if error_code(error) == "NoSuchBucket":
                    raise
                return None
        return KeptObject(data, str(answer["ETag"]), age_of(answer))

    def write_kept(self, name: str, data: bytes, tag: str | None) -> str | None:
        """Write an object where its tag is still this one (None: where there is none); return the new tag.

        None where another one is there, or where a server refused because of another request at the same moment; see
        :func:`models.fleet.lease.write_unchanged`. ``data`` is unlike what any other process writes: what a lost answer
        leaves unknown is found by reading the object again. ObjectStorageError where a request fails.
        """
        if self._is_s3:
            written = self._put_if(name, data, tag)
            # A server may ignore the condition.
            if written is not None:
                return written if self._etag(name) == written else None
        else:
            if self._has_tag(name, tag):
                self.write(name, data)
        # An earlier attempt may have written it whose answer was lost.
        now = self.read_kept(name)
        return now.tag if now is not None and now.data == data else None

    def delete_kept(self, name: str, tag: str) -> None:
        """Delete an object where its tag is still this one; where a server lacks that condition, any that is there.

        ObjectStorageError where a request fails.
        """
        if not self._is_s3:
            if self._has_tag(name, tag):
                self.delete(name)
            return
        bucket, _, key = self._path(name).partition("/")
        with self._foreseen(name, "deleted"):
            try:
                repeated(partial(self._files.call_s3, "delete_object", Bucket=bucket, Key=key, IfMatch=tag))
                return
            except Exception as error:
                code = error_code(error)
                if code in _CHANGED:
                    return
                if code not in _WITHOUT_CONDITION:
                    raise
        if self._has_tag(name, tag):
            self.delete(name)

    def _put_if(self, name: str, data: bytes, tag: str | None) -> str | None:
        """Ask S3 to write an object where it has not changed; return its tag, None where another one was found."""
        bucket, _, key = self._path(name).partition("/")
        put = partial(self._files.call_s3, "put_object", Bucket=bucket, Key=key, Body=data)
        condition = {"IfNoneMatch": "*"} if tag is None else {"IfMatch": tag}
        with self._foreseen(name, "written"):
            try:
                return str(repeated(partial(put, **condition))["ETag"])
            except Exception as error:
                code = error_code(error)
                if code == "NotImplemented":
                    return str(repeated(put)["ETag"]) if self._has_tag(name, tag) else None
                if code not in _CHANGED:
                    raise
                return None

    def _has_tag(self, name: str, tag: str | None) -> bool:
        found = self.read_kept(name)
        return (None if found is None else found.tag) == tag

    def _etag(self, name: str) -> str | None:
        bucket, _, key = self._path(name).partition("/")
        with self._foreseen(name, "read"):
            try:
                return str(repeated(partial(self._files.call_s3, "head_object", Bucket=bucket, Key=key))["ETag"])
            except FileNotFoundError:
                return None

    def _path(self, name: str) -> str:
        if not is_below(name):
            raise ValueError(f"a name is parts joined by '/', got {name!r}")
        return f"{self._root}/{name}"

    @contextmanager
    def _foreseen(self, name: str, done: str) -> Generator[None]:
        """Raise ObjectStorageError for whatever the file system raises: each brings exceptions of its own."""
        try:
            yield
        except ListingError as error:
            raise ObjectStorageError(f"{self.url}/{name} {error}".replace("/ ", " ")) from None
        except SpallwatchError:
            raise
        except Exception as error:
            # No chain: its exceptions hold requests with their headers.
            raise ObjectStorageError(f"{self.url}/{name} cannot be {done}: {cause(error)}".replace("/ ", " ")) from None


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

"""Other servers that speak S3: stores, recordings, refusals and an archive on each, as on moto's.

Start a server with an empty bucket named ``archive``, name it in the environment (``AWS_ENDPOINT_URL``,
``AWS_ACCESS_KEY_ID``, ``AWS_SECRET_ACCESS_KEY``, ``AWS_DEFAULT_REGION``), and run ``python -m benchmarks.object_servers
--name NAME``; ``benchmarks/results/object_servers.json`` keeps what came of each, by name. Such as::

    rclone serve s3 --addr 127.0.0.1:9102 --auth-key KEY,SECRET FOLDER
    nanio serve --host 127.0.0.1 --port 9101 --data-dir FOLDER
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from benchmarks.cluster_cases import CASES
from benchmarks.common import print_table, write_json
from benchmarks.object_cluster import Place, Said, leaks
from models.fleet.object_store import ObjectStore
from models.words.errors import SpallwatchError
from models.work.storage_error import ObjectStorageError
from streams.remote import RemoteError, expand, fetched
from tests.models.work.store_files import check_files
from tests.support.object_storage import ObjectStorage

_NAMES = 1203
"""More than one answer holds."""
_RECORDINGS = 6


def stores(storage: ObjectStorage, prefix: str) -> None:
    """Check all that a store does, and that each of many names is listed once."""
    check_files(ObjectStore(storage.url(f"{prefix}/files")))
    store = ObjectStore(storage.url(f"{prefix}/many"))
    wanted = [f"chunks/{number % 7:02}/{number:05}" for number in range(_NAMES)]
    for name in wanted:
        store.write(name, b"x")
    assert sorted(store.names("chunks/")) == sorted(wanted)
    assert sorted(store.names("chunks/03")) == sorted(name for name in wanted if name.startswith("chunks/03"))


def recordings(storage: ObjectStorage, prefix: str, folder: Path) -> None:
    """Check what is fetched: a folder by a pattern with files of two levels, and one file by a signed URL."""
    files = {f"run/{part}/{number}.npy": os.urandom(70_000) for part in "ab" for number in range(20)}
    store = ObjectStore(storage.url(f"{prefix}/fetched"))
    for name, data in files.items():
        store.write(name, data)
    (url,) = expand(f"{store.url}/r*")
    with fetched(url, folder) as recording:
        found = {path for path in recording.path.rglob("*") if path.is_file()}
        assert {f"run/{path.relative_to(recording.path)}": path.read_bytes() for path in found} == files
    signed = storage.presigned(f"{prefix}/fetched/run/a/7.npy")
    with fetched(signed, folder) as recording:
        assert recording.path.read_bytes() == files["run/a/7.npy"]


def refusals(storage: ObjectStorage, prefix: str, folder: Path) -> list[str]:
    """Return what is said of a wrong secret, a bucket that is not there, and a signed URL that has expired."""
    import s3fs

    def refused(action: Callable[[], object]) -> str:
        try:
            action()
        except (ObjectStorageError, RemoteError) as error:
            return str(error)
        except SpallwatchError as error:
            raise AssertionError(f"{type(error).__name__}: {error}") from None
        raise AssertionError("nothing was refused")

    said = [
        refused(lambda: ObjectStore("s3://nosuchbucket/x").read("a")),
        refused(lambda: ObjectStore("s3://nosuchbucket/x").write("a", b"1")),
        refused(lambda: list(ObjectStore("s3://nosuchbucket/x").names())),
        refused(lambda: fetched(storage.presigned(f"{prefix}/fetched/run/a/7.npy", -10), folder).__enter__()),
    ]
    secret = os.environ["AWS_SECRET_ACCESS_KEY"]
    os.environ["AWS_SECRET_ACCESS_KEY"] = "planted/secret+of+forty+characters"
    s3fs.S3FileSystem.clear_instance_cache()
    try:
        said += [
            refused(lambda: ObjectStore(storage.url(prefix)).read("a")),
            refused(lambda: ObjectStore(storage.url(prefix)).write("a", b"1")),
            refused(lambda: list(ObjectStore(storage.url(prefix)).names())),
        ]
    finally:
        os.environ["AWS_SECRET_ACCESS_KEY"] = secret
        s3fs.S3FileSystem.clear_instance_cache()
    assert all(len(text.splitlines()) == 1 for text in said)
    return said


def archive(storage: ObjectStorage, prefix: str, folder: Path, said: Said) -> dict[str, Any]:
    """Replay an archive from the bucket into it, chunks there too; compare it with one of local folders."""
    case = replace(next(case for case in CASES if case.name == "archive"), size=_RECORDINGS)
    place = Place(case, storage, folder / "archive")
    place.prepare(said)
    said.run(case.arguments(place.folder, place.folder / "alone", "--workers", "1"))
    begun = time.monotonic()
    said.run(place.arguments(prefix, "--workers", "2"))
    seconds = time.monotonic() - begun
    assert place.content(prefix) == place.content("alone")
    return {"recordings": _RECORDINGS, "seconds": seconds, "equal": True}


def checked(environment: Mapping[str, str], folder: Path) -> dict[str, Any]:
    """Run all checks against the server of an environment; AssertionError where one fails."""
    endpoint = environment["AWS_ENDPOINT_URL"]
    storage = ObjectStorage(endpoint, urlsplit(endpoint).port or 80, environment, environment)
    prefix = f"check-{uuid.uuid4().hex[:8]}"
    said = Said()
    begun = time.monotonic()
    stores(storage, prefix)
    recordings(storage, prefix, folder)
    found = {
        "names": _NAMES,
        "refused": refusals(storage, prefix, folder),
        "archive": archive(storage, prefix, folder, said),
    }
    found["credentials_found"] = leaks(said, [folder], storage)
    assert not found["credentials_found"]
    return {**found, "seconds": time.monotonic() - begun}


def main() -> None:
    """Check one server, and write what came of it beside the others."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--name", required=True, help="of the server, with its version")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    options = parser.parse_args()
    names = ("AWS_ENDPOINT_URL", "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_DEFAULT_REGION")
    with tempfile.TemporaryDirectory(prefix="spallwatch-servers-") as scratch:
        found = checked({name: os.environ[name] for name in names}, Path(scratch))
    print_table(options.name, [{"names": found["names"], **found["archive"]}])
    print(*found["refused"], sep="\n")
    known: dict[str, Any] = {}
    if options.json is not None and options.json.exists():
        known = json.loads(options.json.read_text())["servers"]
    tables: dict[str, Any] = {"servers": {**known, options.name: found}}
    write_json(options.json, tables)


if __name__ == "__main__":
    main()

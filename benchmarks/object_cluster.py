"""A map, a library and an archive with chunks, recordings and records in an object storage: equal to one process.

Each command runs in one process without the storage, in two processes of this machine, and on a scheduler with three
workers of which one is killed for good and one joins; at last the command itself is killed and continued with
``--resume``. Then all that was said and written is searched for the credentials, also after runs that were refused.
The server is moto's on loopback, which checks signatures. Run with ``python -m benchmarks.object_cluster``;
``benchmarks/results/object_cluster.json`` keeps what came of it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.cluster_cases import Case, chosen_cases, command
from benchmarks.common import print_table, write_json
from models.fleet.object_store import ObjectStore
from tests.support.cluster_processes import ClusterProcesses, cluster_processes
from tests.support.object_storage import ObjectStorage, object_storage
from tests.support.waiting import wait_until

_SIGNED_EVERY = 5
_KILLED_AT, _ADDED_AT, _ENDED_AT = 0.2, 0.35, 0.6


@dataclass
class Said:
    """All that commands printed.

    Attributes:
        texts: of each command.
        signatures: of the URLs that were given, which none of them may hold.
    """

    texts: list[str] = field(default_factory=list[str])
    signatures: list[str] = field(default_factory=list[str])

    def run(self, arguments: list[str]) -> dict[str, Any]:
        """Run a command to its end; return its JSON."""
        return self.answer(start(arguments))

    def answer(self, process: subprocess.Popen[str]) -> dict[str, Any]:
        """Wait for a command; return its JSON."""
        output, errors = process.communicate()
        self.texts += [output, errors]
        if process.returncode != 0:
            raise SystemExit(f"{process.args}: exit code {process.returncode}\n{errors}")
        return json.loads(output)

    def refused(self, arguments: list[str], words: str, **variables: str) -> str:
        """Run a command that must be refused with some words; return the line that says so."""
        run = subprocess.run(
            command(arguments), capture_output=True, text=True, check=False, env={**os.environ, **variables}
        )
        self.texts += [run.stdout, run.stderr]
        lines = [line for line in run.stderr.splitlines() if words in line]
        if run.returncode == 0 or not lines:
            raise SystemExit(f"{arguments}: exit code {run.returncode}, expected {words!r}\n{run.stderr}")
        return lines[0]


def start(arguments: list[str]) -> subprocess.Popen[str]:
    """Start a command."""
    return subprocess.Popen(command(arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@dataclass(frozen=True)
class Place:
    """Where a case reads and writes: its inputs and outputs in the bucket where it is an archive."""

    case: Case
    storage: ObjectStorage
    folder: Path

    def prepare(self, said: Said) -> None:
        """Write the inputs; those of an archive go to the bucket too, with a manifest of their URLs."""
        self.case.prepare(self.folder)
        if self.case.name != "archive":
            return
        store = ObjectStore(self.storage.url("recordings"))
        lines = (self.folder / "manifest.csv").read_text().splitlines()
        for number, line in enumerate(lines[1:], 1):
            machine, config, name = line.split(",")
            store.write(name, (self.folder / name).read_bytes())
            url = f"{store.url}/{name}"
            if number % _SIGNED_EVERY == 0:
                url = self.storage.presigned(f"recordings/{name}")
                said.signatures.append(url.rpartition("=")[2])
            lines[number] = f"{machine},{self.folder / config},{url}"
        (self.folder / "remote").mkdir(exist_ok=True)
        (self.folder / "remote" / "manifest.csv").write_text("\n".join(lines) + "\n")

    def arguments(self, name: str, *options: str) -> list[str]:
        """Return the arguments of a run whose result has a name."""
        archive = self.case.name == "archive"
        inputs = self.folder / "remote" if archive else self.folder
        out = self.storage.url(f"out/{name}") if archive else str(self.folder / f"{name}{self.case.suffix}")
        chunks = self.storage.url(f"chunks/{self.case.name}-{name}")
        arguments = self.case.arguments(inputs, Path("OUT"), *options, "--chunks", chunks)
        return [out if argument == "OUT" else argument for argument in arguments]

    def content(self, name: str) -> str:
        """Return the digest of a result."""
        out = self.folder / f"{name}{self.case.suffix}"
        if self.case.name == "archive" and not out.exists():
            store = ObjectStore(self.storage.url(f"out/{name}"))
            for path in store.names("records.zarr/"):
                target = out / path
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(store.read(path) or b"")
        # Where a recording was is another place, of course.
        shutil.rmtree(out / "records.zarr" / "url", ignore_errors=True)
        return self.case.content(out)

    def done(self, name: str) -> Callable[[], int]:
        """Return what counts the chunks that are done."""
        store = ObjectStore(self.storage.url(f"chunks/{self.case.name}-{name}"))
        return lambda: sum(1 for _ in store.names("chunks/"))


def disturbed(place: Place, cluster: ClusterProcesses, total: int, said: Said) -> dict[str, Any]:
    """Run a case on a cluster; kill a worker, add one, kill the command and continue it."""
    options = ("--cluster", cluster.address, "--workers", "2")
    begun = time.monotonic()
    process = start(place.arguments("cluster", *options))
    done = place.done("cluster")
    events: list[dict[str, Any]] = []
    steps = (
        (_KILLED_AT, "w1 killed for good", cluster.workers["w1"].stop),
        (_ADDED_AT, "w4 added", lambda: cluster.add_worker("w4")),
        (_ENDED_AT, "the command killed", process.kill),
    )
    for share, name, cause in steps:
        wait_until(lambda share=share: done() >= share * total or process.poll() is not None)
        if process.poll() is None:
            events.append({"event": name, "chunks_done": done()})
            cause()
    if len(events) == len(steps):
        said.texts += list(process.communicate())
        process = start(place.arguments("cluster", *options, "--resume"))
    answer = said.answer(process)["cluster"]
    if len(events) < len(steps):
        raise SystemExit(f"{place.case.name}: ended after {len(events)} of {len(steps)} events: its chunks are too few")
    return {
        "hash": place.content("cluster"),
        "seconds": time.monotonic() - begun,
        "chunks": answer["chunks"],
        "found_done_after_resume": answer["kept"],
        "failed": len(answer["failed"]),
        "events": events,
    }


def refusals(place: Place, said: Said) -> list[str]:
    """Return what is said where the storage refuses: each in one line, with URL and cause."""
    arguments = place.arguments("refused", "--workers", "2")
    bucket = [argument.replace("s3://archive/chunks", "s3://nobucket/chunks") for argument in arguments]
    user = [argument.replace("s3://archive/chunks", "s3://planted:planted@archive/chunks") for argument in arguments]
    return [
        said.refused(arguments, "SignatureDoesNotMatch", AWS_SECRET_ACCESS_KEY="planted/secret+of+forty+characters"),
        said.refused(arguments, "InvalidAccessKeyId", AWS_ACCESS_KEY_ID="AKIAPLANTED0PLANTED0"),
        said.refused(arguments, "AccessDenied", **place.storage.reader),
        said.refused(arguments, "EndpointConnectionError", AWS_ENDPOINT_URL="http://127.0.0.1:1"),
        said.refused(bucket, "NoSuchBucket"),
        said.refused(user, "credentials in a URL"),
    ]


def leaks(said: Said, folders: Iterable[Path], storage: ObjectStorage) -> list[str]:
    """Return where credentials stand that should not: in what was printed, in files and in the bucket."""
    secrets = [*storage.secrets(), *said.signatures, "planted", "PLANTED0"]
    words = [secret.encode() for secret in secrets]
    found = [f"printed {number}" for number, text in enumerate(said.texts) if any(w in text.encode() for w in words)]
    # The manifest itself holds the signed URLs that it was given.
    files = [path for folder in folders for path in folder.rglob("*") if path.is_file() and path.name != "manifest.csv"]
    found += [str(path) for path in files if any(word in path.read_bytes() for word in words)]
    store = ObjectStore("s3://archive")
    found += [name for name in store.names() if any(word in (store.read(name) or b"") for word in words)]
    return found


def run_case(case: Case, storage: ObjectStorage, folder: Path, said: Said) -> dict[str, Any]:
    """Run a case in all ways; return what came of it."""
    place = Place(case, storage, folder)
    place.prepare(said)
    out = folder / f"alone{case.suffix}"
    begun = time.monotonic()
    said.run(case.arguments(folder, out, "--workers", "1"))
    alone = {"hash": place.content("alone"), "seconds": time.monotonic() - begun}
    begun = time.monotonic()
    answer = said.run(place.arguments("two", "--workers", "2"))["cluster"]
    two = {"hash": place.content("two"), "seconds": time.monotonic() - begun, "chunks": answer["chunks"]}
    with cluster_processes(folder / "logs", ("w1", "w2", "w3"), case.memory, storage.environment) as cluster:
        found = disturbed(place, cluster, answer["chunks"], said)
    refused = refusals(place, said)
    wrong = {**storage.environment, "AWS_SECRET_ACCESS_KEY": "planted/secret+of+forty+characters"}
    with cluster_processes(folder / "logs-refused", ("w1",), case.memory, wrong) as cluster:
        arguments = place.arguments("refused", "--cluster", cluster.address)
        refused.append(said.refused(arguments, "worker w1 at tcp://127.0.0.1:"))
    return {
        "equal": alone["hash"] == two["hash"] == found["hash"],
        "one_process": alone,
        "two_processes": two,
        "cluster": found,
        "refused": refused,
    }


def main() -> None:
    """Run all cases; exit code 1 where a result differs or credentials are found."""
    json_file, cases = chosen_cases(__doc__ or "")
    tables: dict[str, Any] = {}
    said = Said()
    with tempfile.TemporaryDirectory(prefix="spallwatch-objects-") as scratch, object_storage(1000) as storage:
        os.environ.update(storage.environment)
        for case in cases:
            table = tables[case.name] = run_case(case, storage, Path(scratch) / case.name, said)
            runs = [{"run": name, **table[name]} for name in ("one_process", "two_processes", "cluster")]
            columns = ("run", "seconds", "chunks", "hash")
            print_table(
                f"{case.name}: {'equal' if table['equal'] else 'DIFFERENT'}",
                [{column: str(run.get(column, ""))[:16] for column in columns} for run in runs],
            )
            print_table("events", table["cluster"]["events"])
            print(*table["refused"], sep="\n", flush=True)
        tables["credentials found"] = leaks(said, [Path(scratch)], storage)
    print(f"credentials found: {tables['credentials found'] or 'nowhere'}")
    write_json(json_file, tables)
    if tables["credentials found"] or not all(tables[name]["equal"] for name in tables if name != "credentials found"):
        raise SystemExit(1)


if __name__ == "__main__":
    main()

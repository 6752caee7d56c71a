"""Archives over an object storage that fails: each round must end with the records of local folders, bit for bit.

Recordings, chunks and records are in a bucket behind a proxy that spoils a share of the answers (refusals, resets,
lost, cut and damaged answers), and from a request drawn at random on all of them, or all of one kind: expired
credentials, an outage, a lost bucket, no right to write or to read, an expired signature. Then the command must end
with exit code 1; the storage recovers, and ``--resume`` must finish. At last all that was printed and written is
searched for the credentials. The server is moto's on loopback. Run with ``python -m benchmarks.storage_faults``;
``benchmarks/results/storage_faults.json`` keeps what came of it.
"""

from __future__ import annotations

import hashlib
import json
import random
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.common import arguments, print_table, write_json
from models.fleet.object_store import ObjectStore
from monitor.fleet import part
from monitor.fleet.part import described
from tests.monitor.fleet.fleet_files import CONFIG, write_files
from tests.support.commands import run_command
from tests.support.faulty_storage import (
    Fault,
    FaultyStorage,
    Request,
    Rule,
    at_random,
    faulty_storage,
    no_fault,
    without_pauses,
)
from tests.support.object_storage import ObjectStorage, object_storage, use_account

_ROUNDS, _QUICK_ROUNDS = 20, 5
_SEED = 20261124
_SHARES = (0.0, 0.05, 0.2)
"""Share of the answers that are spoiled all the time."""
_PART_BLOCKS = 5
_MAX_RESUMES = 4
_FOLDERS = ("fan-1", "fan-2")
_Content = dict[str, list[Any]]


def _any(_request: Request) -> bool:
    return True


def _is_signed(request: Request) -> bool:
    return "X-Amz-Signature" in request.query


LASTING: dict[str, tuple[Fault, Callable[[Request], bool]]] = {
    "expired credentials": (Fault("refuse", 403, "ExpiredToken"), _any),
    "outage": (Fault("refuse", 503, "ServiceUnavailable"), _any),
    "throttled for good": (Fault("refuse", 503, "SlowDown"), _any),
    "no connection": (Fault("reset"), _any),
    "bucket deleted": (Fault("refuse", 404, "NoSuchBucket"), _any),
    "no right to write": (Fault("refuse", 403, "AccessDenied"), lambda request: request.method == "PUT"),
    "no right to read": (Fault("refuse", 403, "AccessDenied"), lambda request: request.method == "GET"),
    "signature expired": (Fault("refuse", 403, "AccessDenied"), _is_signed),
    "shortened answers": (Fault("shorten"), lambda request: request.method == "GET" and request.path.endswith(".npy")),
}
"""What fails from a moment on, and which requests it meets."""


@dataclass
class Campaign:
    """The bucket, its recordings, and all that was said.

    Attributes:
        storage: behind the proxy.
        folder: of manifests and recordings on this machine.
        expected: records of the archive of local folders.
        texts: what commands printed.
        signatures: of the URLs that were given.
    """

    storage: ObjectStorage
    proxy: FaultyStorage
    folder: Path
    expected: _Content = field(default_factory=dict[str, list[Any]])
    texts: list[str] = field(default_factory=list[str])
    signatures: list[str] = field(default_factory=list[str])

    def prepare(self) -> None:
        """Write recordings here and into the bucket, and replay those of this machine."""
        (self.folder / "m.toml").write_text(CONFIG)
        for number, name in enumerate((*_FOLDERS, "press", "signed")):
            write_files(self.folder / name, 1 if name == "signed" else 12, seed=number, grows_from=6)
        store = ObjectStore(self.storage.url("recorded"))
        for path in self.folder.glob("*/*.npy"):
            store.write(f"{path.parent.name}/{path.name}", path.read_bytes())
        code, said = self.replay(self._manifest(str(self.folder), local=True), str(self.folder / "local"))
        if code != 0:
            raise SystemExit(said)
        self.expected = content(self.folder / "local")

    def replay(self, manifest: Path, out: str, *options: str) -> tuple[int, str]:
        """Replay an archive with one worker; return the exit code and what was said."""
        run = run_command("archive", "replay", manifest, "--out", out, "--workers", "1", *options, cwd=self.folder)
        self.texts += [run.stdout, run.stderr]
        return run.returncode, run.stderr

    def manifest(self) -> Path:
        """Return a manifest of the bucket, whose signed URL is new."""
        return self._manifest(self.storage.url("recorded"), local=False)

    def _manifest(self, root: str, *, local: bool) -> Path:
        (name,) = (path.name for path in (self.folder / "signed").iterdir())
        signed = f"{root}/signed/{name}"
        if not local:
            signed = self.storage.presigned(f"recorded/signed/{name}")
            self.signatures.append(signed.rpartition("=")[2])
        rows = [f"fan,m.toml,{root}/{folder},each" for folder in _FOLDERS]
        rows += [f"fan,m.toml,{signed},each", f"press,m.toml,{root}/press/*.npy,continued"]
        path = self.folder / ("local.csv" if local else "manifest.csv")
        path.write_text("\n".join(["machine,config,recording,history", *rows]) + "\n")
        return path

    def round(self, number: int, requests: int) -> dict[str, Any]:
        """Replay once into the bucket while it fails; return what happened."""
        began = time.monotonic()
        rng = random.Random(_SEED + number)
        name = [*LASTING, "none"][number % (len(LASTING) + 1)]
        share = rng.choice(_SHARES)
        begins = rng.randrange(int(0.9 * requests))
        out = self.storage.url(f"out-{number}")
        self.proxy.begin()
        transient = at_random(rng.randrange(1 << 30), share)
        self.proxy.rule = transient if name == "none" else _from(self.proxy, begins, *LASTING[name], transient)
        code, said = self.replay(self.manifest(), out, "--chunks", f"{out}-chunks")
        faults = Counter(self.proxy.faults)
        first_code, lines = code, [line for line in said.splitlines() if line.startswith("spallwatch")]
        resumes = 0
        while code != 0 and resumes < _MAX_RESUMES:
            resumes += 1
            self.proxy.rule = at_random(rng.randrange(1 << 30), share)
            code, said = self.replay(self.manifest(), out, "--chunks", f"{out}-chunks", *self._resume(out))
        self.proxy.rule = no_fault
        found = self._fetched(out)
        return {
            "round": number,
            "seconds": time.monotonic() - began,
            "lasting": name,
            "share": share,
            "from_request": begins,
            "faults": sum(faults.values()),
            "first_exit_code": first_code,
            "said": lines[:1] if first_code else [],
            "tracebacks": sum("Traceback" in text for text in self.texts[-2 * resumes - 2 :]),
            "resumes": resumes,
            "exit_code": code,
            "equal": found == self.expected,
            "last_words": "" if code == 0 else said[-300:],
        }

    def _resume(self, out: str) -> list[str]:
        """Return the option, unless nothing was planned yet."""
        return ["--resume"] if ObjectStore(out).read("index.db") is not None else []

    def _fetched(self, out: str) -> _Content:
        folder = self.folder / "fetched"
        store = ObjectStore(out)
        for name in store.names():
            if name.endswith((".nc", ".json")):
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(store.read(name) or b"")
        try:
            return content(folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def leaks(self) -> list[str]:
        """Return where credentials stand that should not."""
        words = [secret.encode() for secret in (*self.storage.secrets(), *self.signatures)]
        texts = ((f"printed {number}", text.encode()) for number, text in enumerate(self.texts))
        files = ((str(path), path.read_bytes()) for path in self.folder.rglob("*") if path.is_file())
        store = ObjectStore(self.storage.url("").rstrip("/"))
        objects = ((name, store.read(name) or b"") for name in store.names())
        return [
            where
            for source in (texts, files, objects)
            for where, data in source
            if not where.endswith("manifest.csv") and any(word in data for word in words)
        ]


def content(folder: Path) -> _Content:
    """Return what stands for the records of an archive of days, by recording: digests of files and of their results."""
    found: _Content = {}
    for path in sorted(folder.glob("*/*/result.json")):
        result = json.loads(path.read_bytes())
        name = path.parent.relative_to(folder).as_posix()
        files = [(one.name, *described(one)[:5]) for one in sorted(path.parent.glob("*.nc"))]
        listed = sorted(Path(file["name"]).name for file in result["files"])
        summary = {key: value for key, value in result["summary"].items() if key not in _OF_THE_RUN}
        told = hashlib.sha256(json.dumps(summary, sort_keys=True).encode()).hexdigest()
        found[name] = [result["status"], files, listed, told]
    return found


_OF_THE_RUN = ("seconds", "blocks_per_second", "records")
"""Keys of a summary that depend on when and where it was made."""


def _from(proxy: FaultyStorage, begins: int, fault: Fault, meets: Callable[[Request], bool], before: Rule) -> Rule:
    def rule(request: Request) -> Fault | None:
        return fault if proxy.requests >= begins and meets(request) else before(request)

    return rule


def summary(rounds: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return counts by what lasted."""
    table: dict[str, dict[str, Any]] = {}
    for one in rounds:
        row = table.setdefault(
            one["lasting"],
            {"lasting": one["lasting"], "rounds": 0, "failed_first": 0, "resumes": 0, "faults": 0, "equal": 0},
        )
        row["rounds"] += 1
        row["failed_first"] += one["first_exit_code"] != 0
        row["equal"] += one["equal"] and one["exit_code"] == 0
        for key in ("resumes", "faults"):
            row[key] += one[key]
    return list(table.values())


def main() -> None:
    """Run all rounds; exit code 1 where records differ, a run does not end or credentials are found."""
    options = arguments(__doc__ or "")
    begun = time.monotonic()
    rounds: list[dict[str, Any]] = []
    with (
        pytest.MonkeyPatch.context() as patch,
        tempfile.TemporaryDirectory(prefix="spallwatch-faults-") as scratch,
        object_storage() as server,
        faulty_storage(server.port) as proxy,
    ):
        without_pauses(patch)
        patch.setattr(part, "PART_BLOCKS", _PART_BLOCKS)
        use_account({**server.environment, "AWS_ENDPOINT_URL": proxy.endpoint}, patch)
        campaign = Campaign(replace(server, endpoint=proxy.endpoint), proxy, Path(scratch))
        campaign.prepare()
        proxy.begin()
        campaign.replay(campaign.manifest(), campaign.storage.url("out-clean"))
        requests = proxy.requests
        for number in range(_QUICK_ROUNDS if options.quick else _ROUNDS):
            rounds.append(campaign.round(number, requests))
            print(json.dumps(rounds[-1]), flush=True)
        leaks = campaign.leaks()
    table = summary(rounds)
    print_table("Rounds by what lasted", table)
    print(f"credentials found: {leaks or 'nowhere'}; {time.monotonic() - begun:.0f} s")
    tables: dict[str, Any] = {"requests_of_a_run": requests, "by_fault": table, "credentials_found": leaks}
    write_json(options.json, {**tables, "rounds": rounds})
    if leaks or not all(one["equal"] and one["exit_code"] == 0 for one in rounds):
        raise SystemExit(1)


if __name__ == "__main__":
    main()

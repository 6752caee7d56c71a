"""``replay`` of a recording in an object storage: the records of the same files in a folder, and no credentials."""

from __future__ import annotations

import uuid
from pathlib import Path

import numpy as np
import pytest

from models.fleet.object_store import ObjectStore
from monitor.health.record import Record
from monitor.records.store import Store
from tests.support.commands import run_command
from tests.support.object_storage import BUCKET, use_account
from tests.support.small_machine import small_machine

pytest.importorskip("fsspec", reason="needs the extra cluster")

CONFIG = small_machine()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "m.toml").write_text(CONFIG)
    (tmp_path / "in").mkdir()
    for number in range(4):
        samples = np.random.default_rng(number).standard_normal(256)
        np.save(tmp_path / "in" / f"b{number}.npy", samples.astype(np.float32))
    (tmp_path / "in" / "notes.txt").write_text("words\n")
    return tmp_path


def upload(folder: Path, url: str) -> str:
    store = ObjectStore(url)
    for path in (folder / "in").iterdir():
        store.write(path.name, path.read_bytes())
    return url


def replay(folder: Path, url: str, *options: str, out: str = "out") -> tuple[int, str]:
    result = run_command("replay", url, "--config", "m.toml", "--out", out, "--no-report", *options, cwd=folder)
    return result.returncode, result.stdout + result.stderr


def records(folder: Path, out: str) -> list[Record]:
    with Store.open(folder / out / "state.db", read_only=True) as store:
        return list(store.records())


def written(folder: Path) -> bytes:
    """Return the bytes of all files below a folder."""
    return b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())


def test_the_records_are_those_of_the_same_files_in_a_folder(folder: Path) -> None:
    url = upload(folder, f"memory://{uuid.uuid4()}/run")
    assert replay(folder, "in", out="local")[0] == 0
    code, said = replay(folder, url)
    assert code == 0, said
    assert "1 file ignored, of another format" in said
    assert records(folder, "out") == records(folder, "local")
    assert len(records(folder, "out")) == 4
    assert not (folder / "out" / "fetched").exists()
    # Continued from the same place: what was taken is not taken again.
    assert replay(folder, url, "--resume")[0] == 0
    assert records(folder, "out") == records(folder, "local")
    # The configured URL may be such a one as well.
    (folder / "m.toml").write_text(CONFIG.replace('name = "s"\n', f'name = "s"\nurl = "{url}/b1.npy"\n', 1))
    result = run_command("replay", "--config", "m.toml", "--out", "one", "--no-report", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert [record.content_hash for record in records(folder, "one")] == [records(folder, "local")[1].content_hash]


@pytest.mark.cluster
def test_no_credentials_are_said_or_written(folder: Path, storage, monkeypatch) -> None:
    use_account(storage.environment, monkeypatch)
    url = upload(folder, storage.url("replayed"))
    signed = storage.presigned("replayed/b0.npy")
    secrets = [*storage.secrets(), signed.partition("?")[2], signed.rpartition("=")[2], "planted"]
    assert replay(folder, url)[0] == 0
    result = run_command("replay", signed, "--config", "m.toml", "--out", "signed", cwd=folder)
    said = result.stdout + result.stderr
    assert result.returncode == 0, said
    assert b"b0.npy" in (folder / "signed" / "report.html").read_bytes()
    wrong = {"AWS_SECRET_ACCESS_KEY": "planted/secret+of+forty+characters/and/so", "AWS_MAX_ATTEMPTS": "1"}
    for change, place, code, cause in (
        ({}, f"s3://planted:planted@{BUCKET}/replayed", 2, f"s3://***@{BUCKET}/replayed: credentials in a URL"),
        ({}, "s3://nobucket/run", 2, "s3://nobucket/run cannot be listed: NoSuchBucket"),
        ({}, storage.url("nothing"), 2, f"s3://{BUCKET}/nothing: there is no such object"),
        ({}, f"{signed}0", 1, "b0.npy: HTTP 403 FORBIDDEN (SignatureDoesNotMatch"),
        (wrong, url, 1, f"{url} cannot be listed: SignatureDoesNotMatch"),
        ({"AWS_ENDPOINT_URL": "http://127.0.0.1:1", "AWS_MAX_ATTEMPTS": "1"}, url, 1, "EndpointConnectionError"),
    ):
        use_account({**storage.environment, **change}, monkeypatch)
        found, words = replay(folder, place, out="failed")
        assert (found, cause in words) == (code, True), words
        assert len(words.strip().splitlines()) <= 2
        monkeypatch.setenv("SPALLWATCH_TRACEBACK", "1")
        traceback = replay(folder, place, out="failed")[1]
        monkeypatch.delenv("SPALLWATCH_TRACEBACK")
        assert "Traceback" in traceback
        said += words + traceback
    everything = said.encode() + written(folder)
    assert not [secret for secret in secrets if secret.encode() in everything]
